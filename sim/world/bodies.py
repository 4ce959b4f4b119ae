"""Shapes of all bodies: vehicles and persons as stacks of tapered blocks.

A model fills the unit box: x from −½ (rear) to ½ (front), y from −½ (left) to ½ (right), z from 0 to 1; a body's
length, width and height scale it. Front and rear differ as on real vehicles: windscreen and bonnet, white and red
lights, cargo.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
Color = tuple[float, float, float]

PAINT: Color = (-1.0, -1.0, -1.0)
"""Code for the body's own colour; −k is k times that colour."""
# BGR of what has no paint of the body's own; each a choice
GLASS: Color = (52.0, 44.0, 38.0)
TYRE: Color = (34.0, 34.0, 36.0)
DARK: Color = (58.0, 56.0, 55.0)
STEEL: Color = (150.0, 150.0, 148.0)
WHITE: Color = (245.0, 248.0, 250.0)
RED: Color = (36.0, 30.0, 200.0)
AMBER: Color = (40.0, 140.0, 235.0)
SKIN: Color = (120.0, 150.0, 195.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Block:
    """A box whose top may be smaller than its foot."""

    x: tuple[float, float]
    """Rear and front of the foot."""
    y: tuple[float, float]
    """Left and right of the foot."""
    z: tuple[float, float]
    """Bottom and top."""
    taper: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Distance that the top draws in at the rear, at the front, and at either side."""
    top: Color = PAINT
    sides: Color = PAINT
    """Colour of the walls (left, right, and front and rear unless given)."""
    front: Color | None = None
    rear: Color | None = None
    layer: int = 0
    """Blocks of a higher layer are on top of those below and drawn after them."""
    corner: tuple[float, float] = (0.0, 0.0)
    """Share of the length and of the width that the rounded corners take; zero = sharp."""

    def corners(self, rounded: bool = False) -> FloatArray:
        """Foot ring, then top ring: each rear-left, rear-right, front-right, front-left.

        Args:
            rounded: three points a corner, (24, 3), in place of one, (8, 3).
        """
        (x0, x1), (y0, y1), (z0, z1), (tr, tf, ts) = self.x, self.y, self.z, self.taper
        foot, top = (x0, x1, y0, y1), (x0 + tr, x1 - tf, y0 + ts, y1 - ts)
        ring = _round_ring if rounded else _sharp_ring
        return np.array([(*p, z) for sides, z in ((foot, z0), (top, z1)) for p in ring(*sides, *self.corner)])


@dataclass(frozen=True, slots=True, kw_only=True)
class Model:
    """Blocks as arrays."""

    corners: FloatArray
    """(b, 2 k, 3) in the unit box: foot ring, top ring; k is 4, or 12 where a block has round corners."""
    colors: FloatArray
    """(b, 5, 3) of top, front, rear, left, right; −1 = the body's own colour."""
    layers: NDArray[np.int64]
    """(b,)"""
    blocks: tuple[Block, ...] = field(default=(), repr=False)

    @classmethod
    def of(cls, *blocks: Block) -> Model:
        """Stack blocks into a model."""
        colors = [[b.top, b.front or b.sides, b.rear or b.sides, b.sides, b.sides] for b in blocks]
        rounded = any(b.corner != (0.0, 0.0) for b in blocks)
        return cls(
            corners=np.stack([b.corners(rounded) for b in blocks]),
            colors=np.array(colors),
            layers=np.array([b.layer for b in blocks]),
            blocks=blocks,
        )


def _sharp_ring(x0: float, x1: float, y0: float, y1: float, _dx: float, _dy: float) -> list[tuple[float, float]]:
    return [(x0, y0), (x0, y1), (x1, y1), (x1, y0)]


def _round_ring(x0: float, x1: float, y0: float, y1: float, dx: float, dy: float) -> list[tuple[float, float]]:
    dx, dy = min(dx, 0.5 * (x1 - x0)), min(dy, 0.5 * (y1 - y0))
    # the middle point of a quarter of an ellipse lies 1 − 1/√2 of its axes inside the corner
    mx, my = 0.29 * dx, 0.29 * dy
    return [
        (x0 + dx, y0),
        (x0 + mx, y0 + my),
        (x0, y0 + dy),
        (x0, y1 - dy),
        (x0 + mx, y1 - my),
        (x0 + dx, y1),
        (x1 - dx, y1),
        (x1 - mx, y1 - my),
        (x1, y1 - dy),
        (x1, y0 + dy),
        (x1 - mx, y0 + my),
        (x1 - dx, y0),
    ]


def pair(
    x: tuple[float, float], at: float, half: float, z: tuple[float, float], color: Color, layer: int
) -> list[Block]:
    """Return the same small block at the left and at the right."""
    return [Block(x=x, y=(s * at - half, s * at + half), z=z, top=color, sides=color, layer=layer) for s in (-1.0, 1.0)]


def _wheels(axles: tuple[float, ...], half_length: float, half_width: float, top: float) -> list[Block]:
    at = 0.5 - half_width
    return [w for x in axles for w in pair((x - half_length, x + half_length), at, half_width, (0.0, top), TYRE, 0)]


def rover(
    *,
    axles: int = 2,
    nose: float = 0.12,
    cargo: float = 0.42,
    mast: bool = True,
    cargo_color: Color = STEEL,
    tyre: float = 0.1,
    wheel_top: float = 0.5,
) -> Model:
    """A small unmanned ground vehicle: open wheels, narrow sensor nose, mast near the front, cargo box at the rear.

    Args:
        axles: 2 or 3.
        nose: length of the narrow front part, in vehicle lengths.
        mast: whether it carries a sensor mast.
        cargo_color: of the cargo box's lid.
        tyre: half width of a tyre, in vehicle widths.
        wheel_top: height of the wheels, in vehicle heights.
    """
    places = tuple(np.linspace(-0.34, 0.32, axles))
    hull = 0.46 - nose
    blocks = _wheels(places, 0.17 if axles == 2 else 0.13, tyre, wheel_top)
    blocks += [
        Block(x=(-0.46, hull), y=(-0.36, 0.36), z=(0.2, 0.62), taper=(0.03, 0.03, 0.03)),
        Block(x=(hull, 0.46), y=(-0.24, 0.24), z=(0.2, 0.52), taper=(0.0, 0.04, 0.03), top=DARK, front=GLASS),
        *pair((0.44, 0.5), 0.2, 0.07, (0.35, 0.55), WHITE, 1),
        *pair((-0.5, -0.46), 0.24, 0.08, (0.4, 0.62), RED, 1),
        Block(x=(-0.43, -0.43 + cargo), y=(-0.29, 0.29), z=(0.62, 0.82), top=cargo_color, sides=DARK, layer=1),
        Block(
            x=(hull - 0.16, hull - 0.04),
            y=(-0.28, 0.28),
            z=(0.62, 0.68),
            taper=(0.0, 0.05, 0.02),
            top=GLASS,
            sides=GLASS,
            layer=1,
        ),
    ]
    if mast:
        blocks += [
            Block(x=(hull - 0.22, hull - 0.14), y=(-0.05, 0.05), z=(0.62, 0.9), top=DARK, sides=DARK, layer=2),
            Block(x=(hull - 0.25, hull - 0.09), y=(-0.12, 0.12), z=(0.88, 1.0), top=WHITE, sides=GLASS, layer=3),
        ]
    return Model.of(*blocks)


def tracked(*, deck: Color = STEEL, turret: bool = True, belt: float = 0.15) -> Model:
    """A small vehicle on two belts: flat deck, sloping bow with lamps, often an arm or a turret that points ahead.

    Args:
        turret: whether it carries one.
        belt: width of a belt, in vehicle widths.
    """
    at, inner = 0.5 - 0.5 * belt, 0.49 - belt
    blocks = [
        *pair((-0.5, 0.5), at, 0.5 * belt, (0.0, 0.55), TYRE, 0),
        Block(x=(-0.47, 0.46), y=(-inner, inner), z=(0.15, 0.6), taper=(0.02, 0.16, 0.0), front=DARK),
        Block(x=(-0.42, 0.2), y=(-0.8 * inner, 0.8 * inner), z=(0.6, 0.64), top=deck, sides=DARK, layer=1),
        *pair((0.3, 0.36), 0.6 * inner, 0.05, (0.55, 0.66), WHITE, 2),
        *pair((-0.46, -0.43), 0.6 * inner, 0.06, (0.6, 0.66), RED, 2),
    ]
    if turret:
        blocks += [
            Block(x=(-0.15, 0.15), y=(-0.22, 0.22), z=(0.64, 0.95), taper=(0.03, 0.06, 0.04), layer=2),
            Block(x=(0.12, 0.4), y=(-0.05, 0.05), z=(0.75, 0.85), top=DARK, sides=DARK, layer=3),
        ]
    return Model.of(*blocks)


def car(
    *,
    bonnet: float = 0.26,
    boot: float = 0.12,
    roof: Color = PAINT,
    screen: float = 0.13,
    rear_screen: float = 0.08,
    glass: Color = GLASS,
) -> Model:
    """A passenger car seen from above: bonnet, large sloping windscreen, cabin, small rear window, boot."""
    return Model.of(
        *_wheels((-0.3, 0.32), 0.075, 0.07, 0.4),
        Block(x=(-0.5, 0.5), y=(-0.47, 0.47), z=(0.15, 0.58), taper=(0.015, 0.03, 0.03)),
        Block(x=(-0.5 + boot, 0.5 - bonnet), y=(-0.44, 0.44), z=(0.58, 1.0), taper=(rear_screen, screen, 0.09),
              top=roof, sides=glass, layer=1),
        *pair((0.46, 0.495), 0.33, 0.09, (0.42, 0.585), WHITE, 1),
        *pair((-0.497, -0.475), 0.34, 0.09, (0.45, 0.585), RED, 1),
        *pair((0.5 - bonnet - 0.1, 0.5 - bonnet - 0.06), 0.48, 0.045, (0.55, 0.68), PAINT, 1),
    )  # fmt: skip


def person() -> Model:
    """Shoulders, head and a stride."""
    return Model.of(
        Block(x=(-0.3, 0.35), y=(-0.28, 0.28), z=(0.0, 0.5), top=DARK, sides=DARK),
        Block(x=(-0.25, 0.25), y=(-0.5, 0.5), z=(0.45, 0.82), taper=(0.05, 0.05, 0.1), layer=1),
        Block(x=(-0.22, 0.22), y=(-0.2, 0.2), z=(0.82, 1.0), taper=(0.05, 0.05, 0.05), top=DARK, sides=SKIN, layer=2),
    )


def crate(*, inset: float = 0.06, lid: Color = PAINT) -> Model:
    """A box with a lid, alike at both ends."""
    return Model.of(
        Block(x=(-0.5, 0.5), y=(-0.5, 0.5), z=(0.0, 0.9)),
        Block(x=(-0.5 + inset, 0.5 - inset), y=(-0.5 + inset, 0.5 - inset), z=(0.9, 1.0), top=lid, layer=1),
    )


def pole() -> Model:
    """A lamp post: a thin column with an arm."""
    return Model.of(
        Block(x=(-0.06, 0.06), y=(-0.5, 0.5), z=(0.0, 1.0), top=STEEL, sides=DARK),
        Block(x=(0.0, 0.5), y=(-0.4, 0.4), z=(0.97, 1.0), top=STEEL, sides=DARK, layer=1),
    )
