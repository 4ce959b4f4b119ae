"""Road vehicles of random make, as seen from above: rounded bodies, glass, roof fittings, loads.

Every function draws one model; a body's length, width and height scale it. Proportions are those of common European
and Asian cars, in vehicle lengths and widths.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from sim.world.bodies import AMBER, DARK, GLASS, PAINT, RED, STEEL, TYRE, WHITE, Block, Color, Model, pair

Blocks = list[Block]


def paint(factor: float) -> Color:
    """The body's colour, made lighter or darker."""
    return (-factor, -factor, -factor)


def shade(color: Color, rng: np.random.Generator, spread: float = 0.3) -> Color:
    """A colour near another."""
    b, g, r = (
        float(np.clip(c * f, 0.0, 255.0)) for c, f in zip(color, rng.uniform(1 - spread, 1 + spread, 3), strict=True)
    )
    return b, g, r


def _glass(rng: np.random.Generator) -> Color:
    """Dark, or bright where the sky is mirrored in it."""
    grey = float(rng.uniform(18.0, 80.0) if rng.random() < 0.75 else rng.uniform(80.0, 170.0))
    return grey * rng.uniform(1.0, 1.2), grey, grey * rng.uniform(0.85, 1.0)


def _slab(
    x: tuple[float, float], y: tuple[float, float], z: float, color: Color, layer: int, corner: float = 0.0
) -> Block:
    return Block(x=x, y=y, z=(z, z + 0.01), top=color, sides=color, layer=layer, corner=(0.4 * corner, corner))


def _lights(rng: np.random.Generator, z: float, layer: int = 1) -> Blocks:
    """Head and tail lamps."""
    front = shade((WHITE, STEEL, GLASS)[int(rng.integers(3))], rng)
    rear = shade(RED if rng.random() < 0.6 else (40.0, 30.0, 110.0), rng)
    at, half = rng.uniform(0.3, 0.38), rng.uniform(0.05, 0.1)
    return [
        *pair((0.45, 0.485), at, half, (z - 0.12, z + 0.004), front, layer),
        *pair((-0.49, -0.47), at, half, (z - 0.12, z + 0.004), rear, layer),
    ]


def _wheels(rng: np.random.Generator, out: float = 0.48) -> Blocks:
    return [
        wheel
        for x in (-0.31, 0.32)
        for wheel in pair((x - 0.075, x + 0.075), out - 0.06, 0.06, (0.0, 0.4), shade(TYRE, rng), 0)
    ]


def passenger(rng: np.random.Generator, shape: str) -> Model:
    """A ``hatchback``, ``saloon``, ``estate`` or ``suv``."""
    low, high = {"hatchback": (0.17, 0.25), "saloon": (0.22, 0.29), "estate": (0.2, 0.27), "suv": (0.19, 0.27)}[shape]
    bonnet = rng.uniform(low, high)
    boot = rng.uniform(0.09, 0.17) if shape == "saloon" else rng.uniform(0.005, 0.035)
    rear = rng.uniform(0.08, 0.15) if shape in ("saloon", "hatchback") else rng.uniform(0.03, 0.08)
    screen, waist = rng.uniform(0.11, 0.18), rng.uniform(0.55, 0.62)
    belt, tumble = rng.uniform(0.4, 0.45), rng.uniform(0.06, 0.12)
    glass, other = _glass(rng), _glass(rng)
    roof = paint(rng.uniform(0.9, 1.12)) if rng.random() < 0.85 else shade(DARK if rng.random() < 0.7 else WHITE, rng)
    front, tail = 0.5 - bonnet, -0.5 + boot
    body = paint(rng.uniform(0.85, 1.0))
    blocks = [
        *_wheels(rng),
        Block(x=(-0.5, 0.5), y=(-0.49, 0.49), z=(0.15, 0.4), taper=(0.005, 0.01, 0.005), corner=(0.09, 0.26),
              top=body, sides=body),
        Block(x=(-0.49, 0.49), y=(-0.485, 0.485), z=(0.4, waist), taper=(0.01, 0.03, 0.025), corner=(0.08, 0.24)),
        _slab((front + 0.01, 0.45), (-0.3, 0.3), waist, paint(rng.uniform(0.9, 1.12)), 1, 0.1),
        _slab((front - 0.02, front + 0.012), (-0.36, 0.36), waist, shade(DARK, rng), 1),
        Block(x=(tail, front), y=(-belt, belt), z=(waist, 1.0), taper=(rear, screen, tumble), corner=(0.03, 0.08),
              top=roof, sides=other, front=glass, rear=glass, layer=1),
        *_lights(rng, waist),
    ]  # fmt: skip
    mirror = front - 0.4 * screen
    blocks += pair((mirror, mirror + 0.035), 0.47, 0.028, (waist, waist + 0.1), PAINT, 1)
    return Model.of(*blocks, *_roof_fittings(rng, (tail + rear, front - screen), belt - tumble))


def _roof_fittings(rng: np.random.Generator, x: tuple[float, float], half: float) -> Blocks:
    """A gleam, and often a sunroof, dark panoramic glass, rails or a rack."""
    (rear, front), length = x, x[1] - x[0]
    blocks = []
    if rng.random() < 0.6:
        at = rng.uniform(-0.5, 0.5) * half
        gleam = paint(rng.uniform(0.88, 1.2))
        ends = (rear + 0.1 * length, front - 0.1 * length)
        blocks.append(_slab(ends, (at - 0.3 * half, at + 0.3 * half), 1.0, gleam, 2))
    kind = rng.random()
    if kind < 0.15:
        middle = front - rng.uniform(0.25, 0.45) * length
        hatch = (middle - 0.15 * length, middle + 0.15 * length)
        blocks.append(_slab(hatch, (-0.75 * half, 0.75 * half), 1.0, _glass(rng), 3))
    elif kind < 0.32:
        glass = (rear + rng.uniform(0.05, 0.3) * length, front - 0.05 * length)
        blocks.append(_slab(glass, (-0.85 * half, 0.85 * half), 1.0, _glass(rng), 3))
    elif kind < 0.52:
        rail = shade((STEEL, DARK, WHITE)[int(rng.integers(3))], rng)
        blocks += pair((rear, front), 0.88 * half, 0.025, (1.0, 1.03), rail, 3)
    elif kind < 0.57:
        box = shade((DARK, STEEL, WHITE)[int(rng.integers(3))], rng)
        load = Block(x=(rear, front - 0.3 * length), y=(-0.6 * half, 0.6 * half), z=(1.0, 1.15),
                     taper=(0.02, 0.04, 0.04), top=box, sides=box, layer=3)  # fmt: skip
        blocks.append(load)
    elif kind < 0.6:
        blocks.append(_slab((-0.04, 0.02), (-0.2, 0.2), 1.0, shade(AMBER if rng.random() < 0.5 else WHITE, rng), 3))
    return blocks


def pickup_truck(rng: np.random.Generator) -> Model:
    """Bonnet, single or double cabin, an open bed with or without a load or cover."""
    bed, bonnet, waist = rng.uniform(0.28, 0.48), rng.uniform(0.16, 0.25), rng.uniform(0.52, 0.6)
    glass = _glass(rng)
    cab, front = -0.5 + bed, 0.5 - bonnet
    floor = shade((DARK, STEEL, TYRE)[int(rng.integers(3))], rng) if rng.random() < 0.8 else paint(0.75)
    blocks = [
        *_wheels(rng),
        Block(x=(-0.5, 0.5), y=(-0.485, 0.485), z=(0.15, waist), taper=(0.005, 0.025, 0.02), corner=(0.05, 0.16)),
        _slab((-0.475, cab - 0.02), (-0.4, 0.4), waist, floor, 1),
        _slab((front + 0.01, 0.45), (-0.3, 0.3), waist, paint(rng.uniform(0.88, 1.12)), 1, 0.1),
        Block(x=(cab, front), y=(-0.43, 0.43), z=(waist, 1.0), taper=(0.03, rng.uniform(0.09, 0.14), 0.08),
              corner=(0.03, 0.08), top=paint(rng.uniform(0.9, 1.1)), sides=glass, layer=1),
        *_lights(rng, waist),
    ]  # fmt: skip
    if rng.random() < 0.4:
        blocks += _load(rng, (-0.46, cab - 0.03), 0.38, (waist, 0.9), 2)
    return Model.of(*blocks)


def _load(rng: np.random.Generator, x: tuple[float, float], half: float, z: tuple[float, float], layer: int) -> Blocks:
    """Goods on an open bed."""
    blocks = []
    for _ in range(int(rng.integers(1, 6))):
        a, b = np.sort(rng.uniform(*x, 2))
        c, d = np.sort(rng.uniform(-half, half, 2))
        color = shade((STEEL, DARK, WHITE, AMBER, (80.0, 110.0, 140.0))[int(rng.integers(5))], rng)
        blocks.append(
            Block(x=(a, b), y=(c, d), z=(z[0], rng.uniform(z[0] + 0.02, z[1])), top=color, sides=color, layer=layer)
        )
    return blocks


def van_body(rng: np.random.Generator) -> Model:
    """A delivery van, minibus or people carrier."""
    nose, screen = rng.uniform(0.05, 0.16), rng.uniform(0.08, 0.15)
    glass, front = _glass(rng), 0.5 - nose
    side = glass if rng.random() < 0.5 else PAINT
    blocks = [
        *_wheels(rng),
        Block(x=(-0.5, 0.5), y=(-0.49, 0.49), z=(0.12, 0.45), taper=(0.0, 0.02, 0.01), corner=(0.05, 0.18)),
        Block(x=(-0.495, front), y=(-0.48, 0.48), z=(0.45, 1.0), taper=(0.02, screen, 0.05), corner=(0.02, 0.08),
              top=paint(rng.uniform(0.92, 1.08)), sides=side, front=glass, rear=glass if rng.random() < 0.6 else PAINT,
              layer=1),
        _slab((front - 0.01, 0.46), (-0.34, 0.34), 0.45, paint(rng.uniform(0.88, 1.1)), 1, 0.1),
        *_lights(rng, 0.45),
    ]  # fmt: skip
    if rng.random() < 0.4:  # ribs across the roof
        ribs = np.linspace(-0.4, front - screen - 0.08, int(rng.integers(3, 8)))
        blocks += [_slab((x, x + 0.015), (-0.38, 0.38), 1.0, paint(rng.uniform(0.8, 0.95)), 2) for x in ribs]
    return Model.of(*blocks, *_roof_fittings(rng, (-0.46, front - screen), 0.4)[:2])


def lorry(rng: np.random.Generator) -> Model:
    """A cabin with a box, a flat bed, or a tipper behind it."""
    cab, gap, nose = rng.uniform(0.18, 0.3), rng.uniform(0.01, 0.05), rng.uniform(0.0, 0.06)
    rear = 0.5 - cab
    return Model.of(
        *_wheels(rng, 0.46),
        Block(x=(-0.5, 0.5), y=(-0.42, 0.42), z=(0.1, 0.35), top=shade(DARK, rng), sides=shade(DARK, rng)),
        *_cabin(rng, rear, nose, rng.uniform(0.6, 0.98)),
        *_cargo(rng, -0.5, rear - gap),
    )


def trailer_truck(rng: np.random.Generator) -> Model:
    """A tractor with a long trailer."""
    cab = rng.uniform(0.13, 0.18)
    rear = 0.5 - cab
    return Model.of(
        *_wheels(rng, 0.46),
        Block(x=(-0.45, 0.48), y=(-0.35, 0.35), z=(0.1, 0.3), top=shade(DARK, rng), sides=shade(DARK, rng)),
        *_cabin(rng, rear, 0.0, rng.uniform(0.8, 0.98)),
        *_cargo(rng, -0.5, rear - rng.uniform(0.01, 0.05)),
    )


def trailer(rng: np.random.Generator) -> Model:
    """A trailer that stands without a tractor: its box or bed on wheels at the rear, legs at the front."""
    dark = shade(DARK, rng)
    tyre = shade(TYRE, rng)
    return Model.of(
        *pair((-0.42, -0.2), 0.42, 0.06, (0.0, 0.3), tyre, 0),
        *pair((0.22, 0.24), 0.35, 0.04, (0.0, 0.3), dark, 0),
        Block(x=(-0.5, 0.48), y=(-0.3, 0.3), z=(0.2, 0.3), top=dark, sides=dark),
        *_cargo(rng, -0.5, 0.5),
    )


def tram(rng: np.random.Generator) -> Model:
    """Two to seven cars with narrow joints, both ends alike, and on the roof long boxes and a bow that takes power."""
    model = _jointed(rng, int(rng.integers(2, 8)), float(rng.uniform(0.012, 0.03)))
    at, wide, boxes = float(rng.uniform(-0.4, 0.4)), float(rng.uniform(0.2, 0.4)), []
    color = shade((STEEL, WHITE, DARK)[int(rng.integers(3))], rng)
    for middle in np.linspace(-0.42, 0.42, int(rng.integers(3, 10))):
        half = float(rng.uniform(0.015, 0.05))
        boxes.append(_slab((middle - half, middle + half), (-wide, wide), 0.98, color, 3))
    bow = [_slab((at + d, at + d + 0.003), (-0.35, 0.35), 1.0, DARK, 4) for d in (0.0, 0.012)]
    ends = [Block(x=x, y=(-0.42, 0.42), z=(0.45, 0.9), top=GLASS, sides=GLASS, layer=2)
            for x in ((-0.5, -0.485), (0.485, 0.5))]  # fmt: skip
    return Model.of(*model.blocks, *boxes, *bow, *ends)


def articulated_bus(rng: np.random.Generator) -> Model:
    """Two or three stiff cars with dark joints between them, stretched out straight."""
    return _jointed(rng, int(rng.choice([2, 2, 3])), float(rng.uniform(0.03, 0.07)))


def _jointed(rng: np.random.Generator, cars: int, joint: float) -> Model:
    """A row of cars, joints of a share of the length between them."""
    glass, joint_color = _glass(rng), shade(TYRE, rng)
    top = paint(rng.uniform(0.9, 1.1)) if rng.random() < 0.5 else shade(WHITE, rng, 0.15)
    ends = np.linspace(-0.5, 0.5, cars + 1)
    blocks = [
        Block(x=(-0.48, 0.48), y=(-0.45, 0.45), z=(0.1, 0.93), top=joint_color, sides=joint_color),
        *pair((0.483, 0.493), 0.52, 0.03, (0.7, 0.9), shade(DARK, rng), 2),
    ]
    for rear, front in pairwise(ends):
        x = (rear + (0.5 * joint if rear > -0.5 else 0.0), front - (0.5 * joint if front < 0.5 else 0.0))
        blocks += [
            Block(x=x, y=(-0.49, 0.49), z=(0.1, 0.5), corner=(0.006, 0.05), layer=1),
            Block(x=x, y=(-0.49, 0.49), z=(0.5, 0.97), taper=(0.004, 0.01, 0.03), corner=(0.01, 0.08), top=top,
                  sides=glass, layer=1),
        ]  # fmt: skip
        for _ in range(int(rng.integers(0, 3))):
            inset = min(0.06, 0.3 * (x[1] - x[0]))
            middle, half, wide = (
                rng.uniform(x[0] + inset, x[1] - inset),
                rng.uniform(0.01, 0.05),
                rng.uniform(0.12, 0.38),
            )
            blocks.append(_slab((middle - half, middle + half), (-wide, wide), 0.97, shade(STEEL, rng), 2))
    return Model.of(*blocks)


def _cabin(rng: np.random.Generator, rear: float, nose: float, height: float) -> Blocks:
    glass = _glass(rng)
    blocks = [
        Block(x=(rear, 0.5 - nose), y=(-0.46, 0.46), z=(0.3, height), taper=(0.0, rng.uniform(0.015, 0.06), 0.04),
              corner=(0.015, 0.1), top=paint(rng.uniform(0.9, 1.1)), front=glass, layer=1),
        *pair((0.46 - nose, 0.48 - nose), 0.48, 0.03, (0.4, 0.6), shade(DARK, rng), 1),
    ]  # fmt: skip
    if nose > 0.02:
        blocks.append(Block(x=(0.5 - nose, 0.5), y=(-0.44, 0.44), z=(0.3, 0.5), corner=(0.02, 0.15), layer=1))
    if rng.random() < 0.5:  # a wind deflector
        top = paint(rng.uniform(0.8, 1.1))
        deflector = Block(x=(rear, rear + 0.08), y=(-0.4, 0.4), z=(height, 1.0), taper=(0.0, 0.06, 0.05), top=top,
                          sides=top, layer=2)  # fmt: skip
        blocks.append(deflector)
    return blocks


def _cargo(rng: np.random.Generator, rear: float, front: float) -> Blocks:
    color = PAINT if rng.random() < 0.25 else shade((WHITE, STEEL, DARK, AMBER, (150.0, 90.0, 50.0))[
        int(rng.choice(5, p=[0.5, 0.2, 0.1, 0.1, 0.1]))], rng)  # fmt: skip
    if rng.random() < 0.65:
        blocks = [Block(x=(rear, front), y=(-0.49, 0.49), z=(0.3, 1.0), taper=(0.0, 0.0, 0.005), corner=(0.004, 0.01),
                        top=color, sides=color, layer=2)]  # fmt: skip
        edge = shade(STEEL, rng)
        blocks += pair((rear, front), 0.475, 0.012, (1.0, 1.005), edge, 3)
        if rng.random() < 0.5:
            ribs = np.linspace(rear + 0.03, front - 0.03, int(rng.integers(4, 12)))
            rib = tuple(rng.uniform(0.8, 0.95) * c for c in color)
            blocks += [_slab((x, x + 0.008), (-0.46, 0.46), 1.0, (rib[0], rib[1], rib[2]), 3) for x in ribs]
        return blocks
    floor = shade(((70.0, 100.0, 130.0), STEEL, DARK, (90.0, 110.0, 120.0))[int(rng.integers(4))], rng)
    wall = color if rng.random() < 0.6 else PAINT
    high = rng.uniform(0.4, 0.65)
    return [
        Block(x=(rear, front), y=(-0.48, 0.48), z=(0.3, high), top=wall, sides=wall, layer=1),
        _slab((rear + 0.02, front - 0.02), (-0.43, 0.43), high, floor, 2),
        *(_load(rng, (rear + 0.03, front - 0.03), 0.42, (high, 0.95), 3) if rng.random() < 0.6 else []),
    ]


def bus(rng: np.random.Generator) -> Model:
    """One long roof with hatches and cooling units, glass all round, the windscreen upright at the front."""
    glass = _glass(rng)
    top = paint(rng.uniform(0.9, 1.1)) if rng.random() < 0.5 else shade(WHITE, rng, 0.15)
    blocks = [
        *_wheels(rng, 0.46),
        Block(x=(-0.5, 0.5), y=(-0.49, 0.49), z=(0.1, 0.5), corner=(0.012, 0.06)),
        Block(x=(-0.5, 0.5), y=(-0.49, 0.49), z=(0.5, 0.97), taper=(0.004, rng.uniform(0.005, 0.03), 0.03),
              corner=(0.015, 0.08), top=top, sides=glass, layer=1),
        *pair((0.475, 0.49), 0.52, 0.03, (0.7, 0.9), shade(DARK, rng), 2),
    ]  # fmt: skip
    for _ in range(int(rng.integers(1, 5))):
        middle, half, wide = rng.uniform(-0.4, 0.35), rng.uniform(0.015, 0.09), rng.uniform(0.12, 0.38)
        unit = shade((WHITE, STEEL, DARK)[int(rng.integers(3))], rng)
        blocks.append(
            Block(
                x=(middle - half, middle + half),
                y=(-wide, wide),
                z=(0.97, 1.03),
                taper=(0.003, 0.003, 0.02),
                top=unit,
                sides=unit,
                layer=2,
            )
        )
    return Model.of(*blocks)
