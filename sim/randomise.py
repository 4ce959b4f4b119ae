"""Random looks: ground, light, camera and vehicle shapes, wider than any real place, so that a detector learns none."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from sim.bodies import (
    AMBER,
    DARK,
    GLASS,
    PAINT,
    STEEL,
    WHITE,
    Color,
    Model,
    car,
    crate,
    person,
    pickup,
    pole,
    rover,
    van,
)
from sim.exposure import Exposure
from sim.ground import GroundStyle
from sim.render import Style
from sim.view import OCCLUDER, PERSON, STRANGER, UGV, Road, Scene

__all__ = ["SIZES", "VEHICLES", "random_models", "random_scene", "random_style"]

PICKUP, VAN, LORRY, ROVER_6, CRATE, BARRIER, POLE, SLAB = 4, 5, 6, 7, 8, 9, 10, 11
"""Kinds beyond those of ``Bodies``, known to the training pictures alone."""
VEHICLES = (UGV, STRANGER, PICKUP, VAN, LORRY, ROVER_6)
Range = tuple[float, float]
SIZES: Mapping[int, tuple[Range, Range, Range]] = {
    UGV: ((1.6, 2.8), (1.0, 1.7), (0.6, 1.2)),
    STRANGER: ((3.4, 5.0), (1.6, 1.95), (1.35, 1.7)),
    PERSON: ((0.35, 0.6), (0.4, 0.7), (1.5, 1.9)),
    OCCLUDER: ((1.5, 8.0), (1.5, 8.0), (2.0, 10.0)),
    PICKUP: ((3.0, 5.4), (1.6, 2.0), (1.5, 1.9)),
    VAN: ((3.6, 6.0), (1.7, 2.1), (1.8, 2.6)),
    LORRY: ((5.0, 8.0), (2.1, 2.5), (2.4, 3.5)),
    ROVER_6: ((1.8, 3.2), (1.1, 1.8), (0.6, 1.3)),
    CRATE: ((0.5, 2.6), (0.5, 1.6), (0.3, 1.5)),
    BARRIER: ((1.5, 5.0), (0.15, 0.4), (0.5, 1.1)),
    POLE: ((0.6, 2.0), (0.12, 0.25), (3.0, 8.0)),
    SLAB: ((0.8, 5.0), (0.8, 3.0), (0.02, 0.1)),
}
"""Ranges of length, width and height in metres."""


def random_models(rng: np.random.Generator) -> dict[int, Model]:
    """One shape for each kind; ``OCCLUDER`` has none and is drawn as a tree."""

    def some(*colors: Color) -> Color:
        chosen = colors[int(rng.integers(len(colors)))]
        return (
            chosen if chosen is PAINT else tuple(np.clip(np.array(chosen) * rng.uniform(0.7, 1.3, 3), 0, 255).tolist())
        )

    def a_rover(axles: int) -> Model:
        return rover(
            axles=axles, nose=rng.uniform(0.08, 0.2), cargo=rng.uniform(0.3, 0.55), mast=rng.random() < 0.7,
            cargo_color=some(STEEL, DARK, PAINT, WHITE, AMBER), tyre=rng.uniform(0.07, 0.13),
            wheel_top=rng.uniform(0.35, 0.6),
        )  # fmt: skip

    glass = some(GLASS, GLASS, DARK, STEEL)
    nose = rng.uniform(0.05, 0.2)
    return {
        UGV: a_rover(2),
        ROVER_6: a_rover(3),
        STRANGER: car(
            bonnet=rng.uniform(0.18, 0.32), boot=rng.uniform(0.02, 0.16), roof=some(PAINT, PAINT, DARK, WHITE),
            screen=rng.uniform(0.1, 0.17), rear_screen=rng.uniform(0.03, 0.1), glass=glass,
        ),
        PICKUP: pickup(
            bed=rng.uniform(0.32, 0.46), bonnet=rng.uniform(0.18, 0.27), bed_color=some(DARK, STEEL, PAINT), glass=glass
        ),
        VAN: van(nose=nose, glass=glass),
        LORRY: van(nose=rng.uniform(0.02, 0.06), box_gap=rng.uniform(0.02, 0.08), box_color=some(WHITE, STEEL, PAINT)),
        PERSON: person(),
        CRATE: crate(inset=rng.uniform(0.02, 0.2), lid=some(PAINT, DARK, WHITE)),
        BARRIER: crate(inset=0.02, lid=some(PAINT, WHITE)),
        POLE: pole(),
        SLAB: crate(inset=rng.uniform(0.02, 0.3), lid=some(PAINT, DARK, STEEL)),
    }  # fmt: skip


def random_style(rng: np.random.Generator) -> Style:
    """A look drawn from all."""
    dull = rng.random() < 0.3  # an overcast day: faint shadows, even light
    return Style(
        sun_azimuth=float(rng.uniform(0.0, 2.0 * np.pi)),
        sun_elevation=float(rng.uniform(0.35, 1.4)),
        shadow=float(rng.uniform(0.0, 0.25) if dull else rng.uniform(0.3, 0.7)),
        ambient=float(rng.uniform(0.75, 0.95) if dull else rng.uniform(0.4, 0.75)),
        leaf=_jitter((48, 92, 66), 35, rng),
        ground=_random_ground(rng),
        exposure=Exposure(
            gain=float(rng.uniform(0.6, 1.35)),
            balance=tuple(rng.uniform(0.88, 1.12, 3).tolist()),
            vignette=0.0,
            noise=float(rng.choice([0.0, 2.0, 4.0, 7.0, 11.0])),
            blur_px=float(rng.choice([0.0, 0.0, 2.0, 4.0, 6.0])),
            blur_direction=float(rng.uniform(0.0, np.pi)),
            softness_px=float(rng.choice([0.0, 0.4, 0.8, 1.3])),
        ),
        models=random_models(rng),
    )


def random_scene(rng: np.random.Generator) -> Scene:
    """Up to four roads crossing open ground of a hundred metres, or none."""
    roads = []
    for _ in range(int(rng.choice([0, 1, 2, 3, 4]))):
        bearing, offset, bend = rng.uniform(0.0, np.pi), rng.uniform(-30.0, 30.0), rng.normal(0.0, 0.004)
        along = np.arange(-50.0, 50.0, 1.0)
        line = np.stack([along, offset + bend * along**2], axis=-1)
        c, s = np.cos(bearing), np.sin(bearing)
        lanes = int(rng.integers(1, 5))
        roads.append(
            Road(centre=line @ np.array([[c, s], [-s, c]]), width=float(lanes * rng.uniform(2.6, 3.8)), lanes=lanes)
        )
    return Scene(roads=tuple(roads))


def _random_ground(rng: np.random.Generator) -> GroundStyle:
    bases = [
        (62, 105, 92),
        (92, 122, 146),
        (136, 142, 146),
        (92, 90, 88),
        (150, 152, 154),
        (212, 216, 218),
        (56, 54, 54),
    ]
    colors = [_jitter(base, 26, rng) for base in bases]
    if rng.random() < 0.25:  # snow, sand, or a paved yard in place of grass
        colors[0] = _jitter(((225, 225, 225), (140, 180, 205), (120, 118, 116))[int(rng.integers(3))], 15, rng)
    return GroundStyle(
        colors=tuple(colors),
        contrast=float(rng.uniform(0.05, 0.7)),
        blotches=float(rng.uniform(0.02, 0.3)),
        soil_share=float(rng.uniform(0.0, 0.6)),
        marks=bool(rng.random() < 0.8),
        wear=float(rng.uniform(0.0, 1.0)),
        side_px=3584,
    )


def _jitter(color: tuple[int, int, int], spread: float, rng: np.random.Generator) -> tuple[int, int, int]:
    shared = rng.normal(0.0, spread)
    b, g, r = (int(np.clip(c + shared + rng.normal(0.0, 0.4 * spread), 5, 250)) for c in color)
    return b, g, r
