"""Houses beside roads: rows of windows on their walls, and roofs with dormers, skylights, chimneys and plant.

Much of it has the size of a vehicle, stands in rows like parked ones, and must not be detected.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from sim.world.bodies import DARK, STEEL, WHITE, Block, Color, Model
from sim.world.road_vehicles import shade

PLASTER: tuple[Color, ...] = (
    (200.0, 215.0, 225.0),
    (160.0, 180.0, 200.0),
    (90.0, 110.0, 165.0),
    (120.0, 150.0, 190.0),
    (150.0, 150.0, 150.0),
)
"""BGR of walls: white, cream, brick, ochre, concrete."""
TILES: tuple[Color, ...] = ((60.0, 75.0, 150.0), (55.0, 60.0, 75.0), (80.0, 90.0, 120.0), (110.0, 110.0, 115.0))
"""BGR of roofs: red and brown tiles, slate, weathered."""
FLAT_ROOFS: tuple[Color, ...] = ((70.0, 72.0, 75.0), (150.0, 152.0, 155.0), (205.0, 208.0, 210.0), (85.0, 120.0, 105.0))
"""BGR of flat roofs: felt, gravel, foil, plants."""
PANE = 0.002
"""Thickness of what lies flat on a roof, as a share of the height."""


def house(rng: np.random.Generator) -> Model:
    """A gabled house or a row of them: windows, dormers in a row on either slope, skylights, chimneys."""
    wall, tiles = _one_of(PLASTER, rng), _one_of(TILES, rng)
    eaves = float(rng.uniform(0.5, 0.72))
    blocks = _storeys(rng, wall, eaves, int(rng.integers(1, 4)))
    layer = 1 + max(block.layer for block in blocks)
    overhang = float(rng.uniform(0.0, 0.03))
    blocks.append(
        Block(
            x=(-0.5, 0.5),
            y=(-0.5 - overhang, 0.5 + overhang),
            z=(eaves, 1.0),
            taper=(0.0, 0.0, 0.49 + overhang),
            top=tiles,
            sides=tiles,
            front=wall,
            rear=wall,
            layer=layer,
        )
    )
    for side in (-1.0, 1.0):
        if rng.random() < 0.7:
            blocks += _dormers(rng, side, eaves, wall, tiles, layer + 1)
    for _ in range(int(rng.integers(0, 4))):
        x, y, half = rng.uniform(-0.45, 0.45), rng.uniform(-0.15, 0.15), rng.uniform(0.012, 0.03)
        chimney = _one_of(PLASTER, rng)
        blocks.append(
            Block(
                x=(x - half, x + half),
                y=(y - 2.0 * half, y + 2.0 * half),
                z=(0.85, 1.06),
                top=DARK,
                sides=chimney,
                layer=layer + 2,
            )
        )
    return Model.of(*blocks)


def flats(rng: np.random.Generator) -> Model:
    """A block of flats, an office or a hall: windows in storeys, a flat roof with plant in rows."""
    wall, roof = _one_of(PLASTER, rng), _one_of(FLAT_ROOFS, rng)
    top = float(rng.uniform(0.88, 0.95))
    blocks = _storeys(rng, wall, top, int(rng.integers(1, 7)))
    layer = 1 + max(block.layer for block in blocks)
    rim = float(rng.uniform(0.005, 0.03))
    blocks.append(
        Block(
            x=(-0.5 + rim, 0.5 - rim), y=(-0.5 + rim, 0.5 - rim), z=(top, top + PANE), top=roof, sides=roof, layer=layer
        )
    )
    for _ in range(int(rng.integers(0, 4))):
        blocks += _plant_row(rng, top, layer + 1)
    return Model.of(*blocks)


def _storeys(rng: np.random.Generator, wall: Color, top: float, count: int) -> list[Block]:
    """Walls from the ground to ``top`` with a row of windows in each storey: blocks that are stacked."""
    glass = shade((60.0, 52.0, 46.0), rng)
    frames = shade(WHITE, rng) if rng.random() < 0.5 else wall
    panes = int(rng.integers(2, 9))
    share = float(rng.uniform(0.35, 0.9))
    height = top / count
    foot, blocks = 0.0, []
    for storey in range(count):
        sill, lintel = foot + 0.3 * height, foot + 0.8 * height
        blocks.append(Block(x=(-0.5, 0.5), y=(-0.5, 0.5), z=(foot, sill), top=wall, sides=wall, layer=3 * storey))
        edges = np.linspace(-0.5, 0.5, panes + 1)
        for left, right in pairwise(edges):
            cut = left + share * (right - left)
            for ends, color in (((left, cut), glass), ((cut, right), frames)):
                blocks.append(
                    Block(x=ends, y=(-0.5, 0.5), z=(sill, lintel), top=wall, sides=color, layer=3 * storey + 1)
                )
        foot += height
        blocks.append(Block(x=(-0.5, 0.5), y=(-0.5, 0.5), z=(lintel, foot), top=wall, sides=wall, layer=3 * storey + 2))
    return blocks


def _dormers(rng: np.random.Generator, side: float, eaves: float, wall: Color, tiles: Color, layer: int) -> list[Block]:
    """Dormers or skylights in a row on one slope, alike and evenly spaced."""
    count, half = int(rng.integers(1, 8)), float(rng.uniform(0.02, 0.06))
    low, high = sorted(rng.uniform(0.12, 0.44, 2))
    rise = 1.0 - eaves
    # the slope: z = 1 − 2 |y| (1 − eaves)
    foot, head = 1.0 - 2.0 * high * rise, 1.0 - 2.0 * low * rise
    skylight = rng.random() < 0.35
    cover = shade((70.0, 60.0, 52.0), rng) if skylight else shade(STEEL, rng) if rng.random() < 0.4 else tiles
    y = (low, high) if side > 0.0 else (-high, -low)
    blocks = []
    for x in np.linspace(-0.42, 0.42, count) if count > 1 else (float(rng.uniform(-0.3, 0.3)),):
        ends = (float(x) - half, float(x) + half)
        if skylight:
            blocks.append(Block(x=ends, y=y, z=(head, head + PANE), top=cover, sides=cover, layer=layer))
        else:
            blocks.append(Block(x=ends, y=y, z=(foot, head), top=cover, sides=wall, front=wall, layer=layer))
    return blocks


def _plant_row(rng: np.random.Generator, top: float, layer: int) -> list[Block]:
    """Air conditioners, fans, skylights or stair heads in a row, alike and evenly spaced."""
    count = int(rng.integers(2, 10))
    a, b = float(rng.uniform(0.01, 0.07)), float(rng.uniform(0.02, 0.12))
    rise = float(rng.uniform(0.01, 0.12))
    color = shade((WHITE, STEEL, DARK, (70.0, 60.0, 52.0))[int(rng.integers(4))], rng)
    lid = shade((DARK, STEEL, WHITE)[int(rng.integers(3))], rng)
    y, inner = float(rng.uniform(-0.35, 0.35)), float(rng.uniform(0.4, 0.8))
    first, last = sorted(rng.uniform(-0.42, 0.42, 2))
    blocks = []
    for x in np.linspace(first, last, count):
        unit = Block(x=(x - a, x + a), y=(y - b, y + b), z=(top, top + rise), top=color, sides=color, layer=layer)
        opening = Block(
            x=(x - inner * a, x + inner * a),
            y=(y - inner * b, y + inner * b),
            z=(unit.z[1], unit.z[1] + PANE),
            top=lid,
            sides=lid,
            layer=layer + 1,
        )
        blocks += [unit, opening]
    return blocks


def _one_of(colors: tuple[Color, ...], rng: np.random.Generator) -> Color:
    return shade(colors[int(rng.integers(len(colors)))], rng)
