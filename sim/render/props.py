"""Objects beside roads that are no vehicles: buildings with roof fittings, containers, street furniture, who walks.

Houses have rows of windows on their walls, and roofs with dormers, skylights, chimneys and plant. Much of it has the
size of a vehicle, stands in rows like parked ones, and must not be detected.
"""

from __future__ import annotations

import itertools
from itertools import pairwise

import numpy as np

from sim.world.bodies import AMBER, DARK, PAINT, SKIN, STEEL, TYRE, WHITE, Block, Color, Model
from sim.world.road_vehicles import paint, shade

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


def building(rng: np.random.Generator) -> Model:
    """A flat roof with a parapet and units on it, or a gable."""
    walls = shade((STEEL, WHITE, (110.0, 130.0, 160.0), (80.0, 90.0, 130.0))[int(rng.integers(4))], rng)
    if rng.random() < 0.3:
        ridge = Block(x=(-0.5, 0.5), y=(-0.5, 0.5), z=(0.7, 1.0), taper=(0.0, 0.0, 0.48), sides=PAINT, front=walls,
                      rear=walls, layer=1)  # fmt: skip
        return Model.of(Block(x=(-0.49, 0.49), y=(-0.48, 0.48), z=(0.0, 0.7), top=walls, sides=walls), ridge)
    rim = rng.uniform(0.01, 0.04)
    blocks = [
        Block(x=(-0.5, 0.5), y=(-0.5, 0.5), z=(0.0, 0.9), top=walls, sides=walls),
        Block(x=(-0.5 + rim, 0.5 - rim), y=(-0.5 + rim, 0.5 - rim), z=(0.9, 0.901), layer=1),
    ]
    blocks += _partitions(rng)
    for _ in range(int(rng.integers(0, 20))):
        x, y = rng.uniform(-0.42, 0.42, 2)
        a, b = rng.uniform(0.01, 0.09), rng.uniform(0.01, 0.09)
        color = shade((WHITE, STEEL, DARK, (120.0, 100.0, 80.0), (90.0, 150.0, 90.0))[int(rng.integers(5))], rng)
        unit = Block(
            x=(x - a, x + a), y=(y - b, y + b), z=(0.9, 0.9 + rng.uniform(0.005, 0.2)), top=color, sides=color, layer=2
        )
        blocks.append(unit)
        if rng.random() < 0.5:  # a fan, a hatch or a pane in it
            top = unit.z[1]
            inner = shade((DARK, STEEL, WHITE)[int(rng.integers(3))], rng)
            blocks.append(
                Block(
                    x=(x - 0.6 * a, x + 0.6 * a),
                    y=(y - 0.6 * b, y + 0.6 * b),
                    z=(top, top + 0.002),
                    top=inner,
                    sides=inner,
                    layer=3,
                    corner=(0.5 * a, 0.5 * b),
                )
            )
    if rng.random() < 0.3:
        blocks += _grid(rng, (-0.4, rng.uniform(-0.1, 0.4)), (-0.35, rng.uniform(-0.1, 0.35)), 0.93, 2)
    return Model.of(*blocks)


def _partitions(rng: np.random.Generator) -> list[Block]:
    """Low walls, pipes and sheets of another colour on a roof."""
    blocks = []
    for _ in range(int(rng.integers(0, 8))):
        x, y = rng.uniform(-0.45, 0.45, 2)
        color = shade((WHITE, STEEL, DARK, (90.0, 150.0, 90.0), (120.0, 100.0, 80.0))[int(rng.integers(5))], rng)
        a, b = (
            rng.permutation([rng.uniform(0.1, 0.5), rng.uniform(0.004, 0.02)])
            if rng.random() < 0.6
            else (rng.uniform(0.05, 0.25), rng.uniform(0.05, 0.25))
        )
        foot = ((max(x - a, -0.48), min(x + a, 0.48)), (max(y - b, -0.48), min(y + b, 0.48)))
        blocks.append(
            Block(x=foot[0], y=foot[1], z=(0.9, 0.9 + rng.uniform(0.002, 0.04)), top=color, sides=color, layer=1)
        )
    return blocks


def _grid(
    rng: np.random.Generator, x: tuple[float, float], y: tuple[float, float], z: float, layer: int
) -> list[Block]:
    """Dark panes in rows, as solar panels and skylights are."""
    color = shade((70.0, 50.0, 40.0) if rng.random() < 0.7 else (150.0, 140.0, 130.0), rng)
    columns, rows = int(rng.integers(2, 7)), int(rng.integers(2, 5))
    a, b = np.linspace(*x, columns + 1), np.linspace(*y, rows + 1)
    share = rng.uniform(0.8, 0.95)
    return [
        Block(
            x=(u, u + share * (a[1] - a[0])),
            y=(v, v + share * (b[1] - b[0])),
            z=(z, z + 0.01),
            top=color,
            sides=color,
            layer=layer,
        )
        for u in a[:-1]
        for v in b[:-1]
    ]


def panels(rng: np.random.Generator) -> Model:
    """Solar panels on a low frame."""
    frame = shade(STEEL, rng)
    return Model.of(
        Block(x=(-0.5, 0.5), y=(-0.5, 0.5), z=(0.0, 0.8), top=frame, sides=frame),
        *_grid(rng, (-0.48, 0.5), (-0.48, 0.5), 0.8, 1),
    )


def container(rng: np.random.Generator) -> Model:
    """A freight container or skip: ribs, no cabin, alike at both ends."""
    ribs = np.linspace(-0.46, 0.44, int(rng.integers(6, 16)))
    dark = paint(rng.uniform(0.75, 0.9))
    blocks = [Block(x=(-0.5, 0.5), y=(-0.5, 0.5), z=(0.0, 1.0))]
    blocks += [Block(x=(x, x + 0.02), y=(-0.47, 0.47), z=(1.0, 1.002), top=dark, sides=dark, layer=1) for x in ribs]
    if rng.random() < 0.3:
        inside = shade((60.0, 80.0, 90.0), rng)
        blocks = [blocks[0], Block(x=(-0.47, 0.47), y=(-0.44, 0.44), z=(1.0, 1.002), top=inside, sides=inside, layer=1)]
    return Model.of(*blocks)


def tank(rng: np.random.Generator) -> Model:
    """A round tank, bin, umbrella or planter."""
    lid = paint(rng.uniform(0.6, 1.2)) if rng.random() < 0.6 else shade(DARK, rng)
    return Model.of(
        Block(x=(-0.5, 0.5), y=(-0.5, 0.5), z=(0.0, 1.0), corner=(0.5, 0.5)),
        Block(x=(-0.35, 0.35), y=(-0.35, 0.35), z=(1.0, 1.01), corner=(0.35, 0.35), top=lid, sides=lid, layer=1),
    )


def tent(rng: np.random.Generator) -> Model:
    """A pavilion, awning or parasol: four sloping sides."""
    height = rng.uniform(0.5, 0.9)
    return Model.of(Block(x=(-0.5, 0.5), y=(-0.5, 0.5), z=(height, 1.0), taper=(0.45, 0.45, 0.45)))


def cooler(rng: np.random.Generator) -> Model:
    """A cooling unit, generator or skylight: a pale box with dark openings."""
    blocks = [Block(x=(-0.5, 0.5), y=(-0.5, 0.5), z=(0.0, 1.0), corner=(0.02, 0.02))]
    count = int(rng.integers(1, 4))
    hole: Color = shade(DARK, rng)
    for k in range(count):
        middle = (k + 0.5) / count - 0.5
        a = 0.36 / count
        blocks.append(Block(x=(middle - a, middle + a), y=(-0.36, 0.36), z=(1.0, 1.01), top=hole, sides=hole, layer=1,
                            corner=(a, 0.36) if rng.random() < 0.6 else (0.0, 0.0)))  # fmt: skip
    return Model.of(*blocks)


def pedestrian(rng: np.random.Generator) -> Model:
    """Somebody who walks or stands: two legs, arms that swing, hair or a hat, now and then a bag or an umbrella."""
    cloth = shade((DARK, (110.0, 80.0, 60.0), STEEL, WHITE, SKIN)[int(rng.integers(5))], rng)
    hair = shade((DARK, (60.0, 80.0, 110.0), (110.0, 160.0, 190.0), STEEL, WHITE)[int(rng.integers(5))], rng)
    step, arms, chest = rng.uniform(0.0, 0.35), rng.uniform(0.0, 0.35), rng.uniform(0.14, 0.28)
    blocks = [
        Block(x=(-0.14 - step, 0.14 - step), y=(-0.26, -0.02), z=(0.0, 0.5), top=cloth, sides=cloth),
        Block(x=(-0.14 + step, 0.14 + step), y=(0.02, 0.26), z=(0.0, 0.5), top=cloth, sides=cloth),
        Block(x=(-chest, chest), y=(-0.4, 0.4), z=(0.45, 0.82), taper=(0.04, 0.04, 0.08), layer=1, corner=(0.1, 0.1)),
        Block(x=(-0.1, 0.1 + arms), y=(-0.5, -0.34), z=(0.5, 0.78), layer=1),
        Block(x=(-0.1 - arms, 0.1), y=(0.34, 0.5), z=(0.5, 0.78), layer=1),
        Block(x=(-0.16, 0.16), y=(-0.2, 0.2), z=(0.82, 1.0), top=hair, sides=SKIN, layer=2, corner=(0.12, 0.12)),
    ]
    extra = rng.random()
    if extra < 0.3:
        bag = shade((DARK, AMBER, WHITE, (60.0, 60.0, 140.0))[int(rng.integers(4))], rng)
        x = float(rng.uniform(-0.45, 0.1))
        blocks.append(Block(x=(x, x + 0.3), y=(-0.3, 0.3), z=(0.4, 0.75), top=bag, sides=bag, layer=2))
    elif extra < 0.36:
        blocks.append(
            Block(x=(-0.5, 0.5), y=(-0.5, 0.5), z=(0.97, 1.0), taper=(0.1, 0.1, 0.1), layer=3, corner=(0.3, 0.3))
        )
    return Model.of(*blocks)


def bench(rng: np.random.Generator) -> Model:
    """A bench with slats, with or without a back."""
    slat = shade((STEEL, (70.0, 110.0, 150.0), (40.0, 70.0, 100.0), WHITE)[int(rng.integers(4))], rng)
    edges = np.linspace(-0.5, 0.3 if rng.random() < 0.6 else 0.5, int(rng.integers(3, 6)))
    blocks = [
        Block(x=(-0.5, 0.5), y=(a + 0.02, b - 0.02), z=(0.4, 0.5), top=slat, sides=DARK, layer=1)
        for a, b in itertools.pairwise(edges)
    ]
    if edges[-1] < 0.5:
        blocks.append(Block(x=(-0.5, 0.5), y=(0.35, 0.5), z=(0.4, 1.0), top=slat, sides=slat, layer=2))
    return Model.of(Block(x=(-0.42, 0.42), y=(-0.4, 0.4), z=(0.0, 0.4), top=DARK, sides=DARK), *blocks)


def shelter(rng: np.random.Generator) -> Model:
    """A bus shelter: a thin roof on posts, a wall behind, a bench, often posters at one end."""
    roof = shade((DARK, STEEL, WHITE, (120.0, 115.0, 105.0))[int(rng.integers(4))], rng)
    wall = shade((STEEL, (150.0, 145.0, 130.0), DARK)[int(rng.integers(3))], rng)
    blocks = [
        Block(x=(-0.48, 0.48), y=(0.38, 0.44), z=(0.0, 0.92), top=wall, sides=wall),
        Block(x=(-0.35, 0.3), y=(0.1, 0.32), z=(0.15, 0.2), top=STEEL, sides=DARK),
        *(Block(x=(x, x + 0.02), y=(-0.4, -0.34), z=(0.0, 0.92), top=DARK, sides=DARK) for x in (-0.47, 0.45)),
        Block(x=(-0.5, 0.5), y=(-0.5, 0.5), z=(0.93, 1.0), top=roof, sides=roof, layer=1),
    ]
    if rng.random() < 0.5:
        blocks.append(Block(x=(0.45, 0.5), y=(-0.4, 0.4), z=(0.05, 0.9), top=wall, sides=WHITE))
    return Model.of(*blocks)


def flag(rng: np.random.Generator) -> Model:
    """A pole with a cloth of one to three colours that hangs, or flies from it."""
    cloth = [shade(c, rng) for c in (WHITE, (60.0, 60.0, 190.0), (150.0, 90.0, 40.0), AMBER)]
    foot, ends = float(rng.uniform(0.2, 0.75)), np.linspace(-0.46, 0.5, int(rng.integers(2, 5)))
    aside = float(rng.uniform(-0.3, 0.5))
    order = rng.permutation(4)
    return Model.of(
        Block(x=(-0.5, -0.46), y=(-0.06, 0.06), z=(0.0, 1.0), top=STEEL, sides=STEEL),
        *(Block(x=(a, b), y=(-0.5, aside), z=(foot, 0.98), top=cloth[k], sides=cloth[k], layer=1)
          for k, (a, b) in zip(order, itertools.pairwise(ends), strict=False)),
    )  # fmt: skip


def board(rng: np.random.Generator) -> Model:
    """A hoarding, shop window or road sign: an upright panel in two colours on posts."""
    back, front = (shade((WHITE, STEEL, DARK, (150.0, 90.0, 40.0), AMBER)[int(rng.integers(5))], rng) for _ in range(2))
    foot, inset = float(rng.uniform(0.1, 0.6)), float(rng.uniform(0.05, 0.4))
    return Model.of(
        *(Block(x=(x, x + 0.04), y=(-0.2, 0.2), z=(0.0, foot), top=STEEL, sides=DARK) for x in (-0.4, 0.36)),
        Block(x=(-0.5, 0.5), y=(-0.3, 0.3), z=(foot, 1.0), top=back, sides=back, layer=1),
        Block(x=(-0.5 + inset, 0.5 - inset), y=(-0.5, 0.5), z=(foot + 0.1, 0.92), top=front, sides=front, layer=2),
    )


def stall(rng: np.random.Generator) -> Model:
    """A market stall or kiosk under an awning, plain or in stripes, goods or a counter before it."""
    counter = shade((WHITE, STEEL, AMBER, (60.0, 120.0, 60.0))[int(rng.integers(4))], rng)
    stripe = shade((WHITE, AMBER, (60.0, 60.0, 190.0), (150.0, 90.0, 40.0))[int(rng.integers(4))], rng)
    blocks = [
        Block(x=(-0.5, 0.5), y=(-0.5, -0.25), z=(0.0, 0.4), top=counter, sides=counter),
        Block(x=(-0.5, 0.5), y=(-0.3, 0.5), z=(0.0, 0.85), top=DARK, sides=counter),
        Block(x=(-0.5, 0.5), y=(-0.4, 0.5), z=(0.85, 1.0), taper=(0.04, 0.04, float(rng.uniform(0.0, 0.4))), layer=1),
    ]
    if rng.random() < 0.4:
        edges = np.linspace(-0.5, 0.5, 2 * int(rng.integers(2, 6)) + 2)
        blocks += [
            Block(x=(a, b), y=(-0.4, 0.5), z=(1.0, 1.001), top=stripe, sides=stripe, layer=2)
            for a, b in zip(edges[:-1:2], edges[1::2], strict=True)
        ]
    return Model.of(*blocks)


def bicycle(rng: np.random.Generator) -> Model:
    """A bicycle or motor scooter, ridden or not."""
    blocks = [
        Block(x=(-0.5, 0.5), y=(-0.12, 0.12), z=(0.0, 0.45), top=shade(TYRE, rng), sides=shade(TYRE, rng)),
        Block(x=(0.22, 0.28), y=(-0.5, 0.5), z=(0.5, 0.6), top=shade(STEEL, rng), sides=DARK, layer=1),
    ]
    if rng.random() < 0.7:
        blocks.append(Block(x=(-0.2, 0.12), y=(-0.38, 0.38), z=(0.6, 0.9), layer=2, corner=(0.08, 0.2)))
        blocks.append(Block(x=(-0.08, 0.1), y=(-0.2, 0.2), z=(0.9, 1.0), top=shade(DARK, rng), sides=DARK, layer=3))
    return Model.of(*blocks)


def motorcycle(rng: np.random.Generator) -> Model:
    """A motorcycle or moped, ridden or parked: two wheels in line, a tank or step, a seat, often a box behind it."""
    tyre = shade(TYRE, rng)
    blocks = [
        Block(x=(-0.5, -0.2), y=(-0.14, 0.14), z=(0.0, 0.4), top=tyre, sides=tyre),
        Block(x=(0.2, 0.5), y=(-0.14, 0.14), z=(0.0, 0.4), top=tyre, sides=tyre),
        Block(x=(-0.42, 0.36), y=(-0.26, 0.26), z=(0.2, 0.55), taper=(0.04, 0.06, 0.06), layer=1),
        Block(x=(0.2, 0.26), y=(-0.5, 0.5), z=(0.55, 0.62), top=shade(STEEL, rng), sides=DARK, layer=2),
    ]
    if rng.random() < 0.5:
        box = shade((DARK, WHITE, AMBER)[int(rng.integers(3))], rng)
        blocks.append(Block(x=(-0.5, -0.28), y=(-0.35, 0.35), z=(0.5, 0.75), top=box, sides=box, layer=2))
    if rng.random() < 0.7:
        coat, helmet = (
            shade(DARK, rng) if rng.random() < 0.5 else PAINT,
            shade(WHITE if rng.random() < 0.5 else DARK, rng),
        )
        blocks.append(Block(x=(-0.26, 0.1), y=(-0.42, 0.42), z=(0.5, 0.85), top=coat, sides=coat, layer=3))
        blocks.append(Block(x=(-0.1, 0.06), y=(-0.18, 0.18), z=(0.85, 1.0), top=helmet, sides=helmet, layer=4))
    return Model.of(*blocks)


def animal(rng: np.random.Generator) -> Model:
    """A cow, horse or dog: a long trunk and a narrow head."""
    dark = paint(rng.uniform(0.6, 1.0))
    return Model.of(
        Block(x=(-0.5, 0.28), y=(-0.5, 0.5), z=(0.3, 1.0), corner=(0.12, 0.25), taper=(0.08, 0.05, 0.12)),
        Block(x=(0.25, 0.5), y=(-0.2, 0.2), z=(0.5, 0.95), corner=(0.08, 0.1), top=dark, sides=AMBER, layer=1),
    )


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
