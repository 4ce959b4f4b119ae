"""Random appearance: objects, light and camera, more varied than any real place, so that a detector learns none.

A set of kinds is a handful of vehicles and a handful of other objects, each with a shape and a size of its own; its
index plus ``FIRST_KIND`` is its kind in ``Bodies``. Without such a set there is one model for each
of the kinds in ``SIZES``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sim.render.exposure import Exposure
from sim.render.ground_canvas import near
from sim.render.open_scene import random_ground
from sim.render.props import (
    animal,
    bench,
    bicycle,
    board,
    building,
    container,
    cooler,
    flag,
    flats,
    house,
    motorcycle,
    panels,
    pedestrian,
    shelter,
    stall,
    tank,
    tent,
)
from sim.render.render import Style
from sim.world.bodies import AMBER, DARK, PAINT, STEEL, WHITE, Model, crate, pole, rover, tracked
from sim.world.road_vehicles import (
    articulated_bus,
    bus,
    lorry,
    passenger,
    pickup_truck,
    shade,
    trailer,
    trailer_truck,
    tram,
    van_body,
)
from sim.world.view import OCCLUDER, OTHER_VEHICLE, PERSON, UGV

FIRST_KIND = 10
"""Kinds below are those of ``Bodies``; kinds from ``FIXED_KIND`` on are those of ``SIZES``."""
FIXED_KIND = 40
"""First kind of those with a fixed entry; above every kind of a random catalogue, which begin at ``FIRST_KIND``."""
Range = tuple[float, float]
Draw = Callable[[np.random.Generator], Model]
Entry = tuple[str, float, Range, Range, Range, Draw]
HEAVY: tuple[Entry, ...] = (
    ("bus", 0.3, (7.0, 13.5), (2.3, 2.6), (2.7, 3.4), bus),
    ("articulated bus", 0.15, (16.0, 24.0), (2.4, 2.65), (2.9, 3.5), articulated_bus),
    ("lorry", 0.2, (6.0, 10.5), (2.1, 2.55), (2.6, 3.8), lorry),
    ("trailer truck", 0.15, (14.0, 17.5), (2.45, 2.6), (3.3, 4.0), trailer_truck),
    ("trailer", 0.2, (6.0, 13.7), (2.3, 2.6), (2.8, 4.0), trailer),
    ("tram", 0.2, (14.0, 33.0), (2.3, 2.65), (3.1, 3.7), tram),
)
"""Road vehicles of depots and docks, in the same columns; sizes are those of common models, shares a choice."""
URBAN: tuple[Entry, ...] = (
    ("person", 0.35, (0.4, 1.0), (0.4, 0.75), (1.5, 1.9), pedestrian),
    ("bicycle", 0.12, (1.6, 2.1), (0.5, 0.75), (1.1, 1.75), bicycle),
    ("motorcycle", 0.18, (1.8, 2.3), (0.6, 0.9), (1.1, 1.75), motorcycle),
    ("shelter", 0.25, (2.5, 7.0), (1.2, 2.2), (2.2, 2.8), shelter),
    ("stall", 0.15, (1.5, 5.0), (1.2, 3.0), (2.0, 3.0), stall),
    ("flag", 0.1, (0.8, 2.5), (0.1, 0.6), (3.0, 8.0), flag),
    ("board", 0.15, (1.0, 5.0), (0.1, 0.5), (1.8, 5.0), board),
    ("house", 0.25, (9.0, 32.0), (7.0, 12.0), (5.0, 12.0), house),
    ("flats", 0.25, (9.0, 45.0), (8.0, 20.0), (4.0, 24.0), flats),
)
"""Distractors in towns, which must not be detected, in the same columns; sizes and shares are a choice."""
PLAIN_SHARE = 0.2
"""Share of kinds of road vehicles in a random catalogue of whose panes and fittings little is seen; a choice."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ObjectKind:
    """One kind of object with a random shape and size."""

    name: str
    model: Model
    size: tuple[float, float, float]
    """Length, width and height, metres."""
    group: str
    """``road``, ``rover`` or ``clutter``; the first two are vehicles."""


def _rover(axles: int) -> Draw:
    def draw(rng: np.random.Generator) -> Model:
        cargo = shade((STEEL, DARK, WHITE, AMBER)[int(rng.integers(4))], rng) if rng.random() < 0.8 else PAINT
        return rover(
            axles=axles, nose=rng.uniform(0.08, 0.2), cargo=rng.uniform(0.3, 0.55), mast=rng.random() < 0.7,
            cargo_color=cargo, tyre=rng.uniform(0.07, 0.13), wheel_top=rng.uniform(0.35, 0.6),
        )  # fmt: skip

    return draw


def _tracked(rng: np.random.Generator) -> Model:
    return tracked(
        deck=shade((STEEL, DARK, WHITE)[int(rng.integers(3))], rng),
        turret=rng.random() < 0.5,
        belt=rng.uniform(0.1, 0.2),
    )


def _box(inset: Range) -> Draw:
    def draw(rng: np.random.Generator) -> Model:
        lid = PAINT if rng.random() < 0.5 else shade((DARK, WHITE, STEEL)[int(rng.integers(3))], rng)
        return crate(inset=rng.uniform(*inset), lid=lid)

    return draw


def _passenger(shape: str) -> Draw:
    return lambda rng: passenger(rng, shape)


ROAD: tuple[Entry, ...] = (
    ("saloon", 0.25, (4.3, 5.1), (1.72, 1.95), (1.4, 1.52), _passenger("saloon")),
    ("hatchback", 0.18, (3.4, 4.4), (1.6, 1.85), (1.42, 1.6), _passenger("hatchback")),
    ("suv", 0.2, (4.1, 5.0), (1.78, 2.0), (1.6, 1.85), _passenger("suv")),
    ("estate", 0.07, (4.4, 5.0), (1.75, 1.9), (1.42, 1.6), _passenger("estate")),
    ("van", 0.1, (4.3, 6.3), (1.75, 2.1), (1.8, 2.7), van_body),
    ("pick-up", 0.06, (4.4, 5.7), (1.7, 2.05), (1.6, 1.95), pickup_truck),
    ("lorry", 0.08, (5.0, 10.5), (1.9, 2.55), (2.4, 3.8), lorry),
    ("bus", 0.03, (7.0, 12.5), (2.3, 2.6), (2.7, 3.4), bus),
    ("trailer truck", 0.03, (12.0, 16.5), (2.45, 2.6), (3.3, 4.0), trailer_truck),
)
"""Road vehicles: name, share of its group, ranges of length, width and height in metres, and what draws its shape.
Sizes are those of common models, shares a choice."""
ROVERS: tuple[Entry, ...] = (
    ("rover", 0.5, (1.4, 2.8), (0.9, 1.7), (0.6, 1.2), _rover(2)),
    ("rover with six wheels", 0.3, (1.8, 3.2), (1.1, 1.8), (0.6, 1.3), _rover(3)),
    ("tracked rover", 0.2, (1.2, 2.8), (0.8, 1.7), (0.5, 1.2), _tracked),
)
"""Ground robots, in the same columns; sizes and shares are a choice."""
CLUTTER: tuple[Entry, ...] = (
    ("person", 0.25, (0.4, 1.0), (0.4, 0.75), (1.5, 1.9), pedestrian),
    ("bicycle", 0.07, (1.6, 2.1), (0.5, 0.75), (1.1, 1.75), bicycle),
    ("animal", 0.04, (0.8, 2.4), (0.3, 0.8), (0.6, 1.6), animal),
    ("crate", 0.1, (0.5, 3.0), (0.5, 2.0), (0.3, 2.0), _box((0.02, 0.2))),
    ("barrier", 0.08, (1.5, 20.0), (0.1, 0.5), (0.5, 2.0), _box((0.01, 0.02))),
    ("pole", 0.1, (0.6, 3.0), (0.12, 0.3), (3.0, 9.0), lambda _: pole()),
    ("slab", 0.1, (0.8, 3.2), (0.8, 3.0), (0.02, 0.25), _box((0.02, 0.3))),
    ("container", 0.07, (3.0, 12.2), (2.0, 2.5), (1.2, 2.9), container),
    ("cooler", 0.06, (0.8, 4.0), (0.6, 2.2), (0.6, 2.0), cooler),
    ("panels", 0.03, (2.0, 12.0), (1.5, 5.0), (0.5, 3.0), panels),
    ("tank", 0.06, (0.5, 3.0), (0.5, 3.0), (0.3, 2.0), tank),
    ("tent", 0.04, (2.0, 6.0), (2.0, 5.0), (2.2, 3.5), tent),
    ("building", 0.1, (6.0, 30.0), (4.0, 16.0), (2.5, 14.0), building),
    ("bench", 0.05, (1.2, 2.4), (0.4, 0.8), (0.5, 0.9), bench),
    ("stall", 0.07, (1.5, 4.0), (1.2, 3.0), (2.0, 3.0), stall),
)
"""Distractors, which must not be detected, in the same columns; sizes and shares are a choice."""


_ENTRIES = (*ROAD, *ROVERS, *CLUTTER)
"""Catalogue entries, numbered from ``FIXED_KIND`` on."""
VEHICLES: tuple[int, ...] = (UGV, OTHER_VEHICLE, *range(FIXED_KIND, FIXED_KIND + len(ROAD) + len(ROVERS)))
"""Kinds of ``SIZES`` that are vehicles."""
_OF_KIND: Mapping[int, Entry] = {
    UGV: ROVERS[0],
    OTHER_VEHICLE: ROAD[0],
    PERSON: CLUTTER[0],
    **{FIXED_KIND + k: e for k, e in enumerate(_ENTRIES)},
}
"""Entry of each kind."""
SIZES: Mapping[int, tuple[Range, Range, Range]] = {
    **{kind: entry[2:5] for kind, entry in _OF_KIND.items()},
    OCCLUDER: ((1.5, 8.0), (1.5, 8.0), (2.0, 10.0)),
}
"""Ranges of length, width and height in metres."""


def random_catalogue(
    rng: np.random.Generator, *, road: int = 8, rovers: int = 3, clutter: int = 10, heavy: int = 0, urban: int = 0
) -> tuple[ObjectKind, ...]:
    """Draw kinds of each table, frequent ones more often; heavy vehicles are road vehicles, urban things clutter."""
    groups = (
        ("road", ROAD, road),
        ("rover", ROVERS, rovers),
        ("clutter", CLUTTER, clutter),
        ("road", HEAVY, heavy),
        ("clutter", URBAN, urban),
    )
    return tuple(_sort(group, table, rng) for group, table, count in groups for _ in range(count))


def _sort(group: str, table: tuple[Entry, ...], rng: np.random.Generator) -> ObjectKind:
    share = np.array([entry[1] for entry in table])
    name, _, length, width, height, draw = table[int(rng.choice(len(table), p=share / share.sum()))]
    size = (float(rng.uniform(*length)), float(rng.uniform(*width)), float(rng.uniform(*height)))
    model = draw(rng)
    if group == "road" and rng.random() < PLAIN_SHARE:
        model = _plain(model, rng)
    return ObjectKind(name=name, model=model, size=size, group=group)


def _plain(model: Model, rng: np.random.Generator) -> Model:
    """The model with most of its panes and fittings about as light as its paint: glare, dirt, a bad camera."""
    own = model.colors[..., :1] < 0.0
    washed = ~own & (rng.random(own.shape) < rng.uniform(0.4, 1.0))
    return replace(model, colors=np.where(washed, -rng.uniform(0.8, 1.1, own.shape), model.colors))


def car_color(rng: np.random.Generator) -> NDArray[np.int64]:
    """Paint as it is on the road: three quarters white, black, grey or silver."""
    kind = rng.random()
    if kind < 0.76:
        low, high = ((205, 250), (20, 55), (65, 135), (150, 200))[int(rng.choice(4, p=[0.36, 0.25, 0.23, 0.16]))]
        grey = rng.uniform(low, high) + rng.normal(0.0, 4.0, 3)
    elif kind < 0.92:
        base = ((120, 60, 30), (50, 40, 150), (90, 60, 40), (45, 35, 95))[int(rng.integers(4))]
        grey = np.array(base) * rng.uniform(0.6, 1.5) + rng.normal(0.0, 10.0, 3)
    else:
        grey = rng.uniform(10.0, 250.0, 3)
    return np.asarray(np.clip(grey, 8, 252), dtype=np.int64)


def random_style(rng: np.random.Generator, catalogue: tuple[ObjectKind, ...] | None = None) -> Style:
    """Light and camera at random, for a set of kinds; without one, also a ground, and a model for each kind."""
    if catalogue is None:
        models = {kind: entry[5](rng) for kind, entry in _OF_KIND.items()}
        return replace(_random_light(rng), models=models, ground=random_ground(rng))
    return replace(_random_light(rng), models={FIRST_KIND + k: kind.model for k, kind in enumerate(catalogue)})


def _random_light(rng: np.random.Generator) -> Style:
    dull = rng.random() < 0.45  # an overcast day: faint shadows, even light
    return Style(
        sun_azimuth=float(rng.uniform(0.0, 2.0 * np.pi)),
        sun_elevation=float(rng.uniform(0.3, 1.4)),
        shadow=float(rng.uniform(0.0, 0.2) if dull else rng.uniform(0.3, 0.75)),
        ambient=float(rng.uniform(0.7, 0.95) if dull else rng.uniform(0.4, 0.75)),
        penumbra_m=float(rng.uniform(0.5, 2.0) if dull else rng.uniform(0.0, 0.4)),
        contact=float(rng.uniform(0.1, 0.6)),
        in_shadow=float(rng.uniform(0.45, 0.8)),
        leaf=None,
        exposure=_random_exposure(rng),
    )


def _random_exposure(rng: np.random.Generator) -> Exposure:
    return Exposure(
        gain=_random_gain(rng),
        balance=tuple(rng.uniform(0.93, 1.07, 3).tolist()),
        vignette=0.0,
        noise=float(rng.choice([0.0, 1.0, 2.0, 3.0, 6.0])),
        blur_px=float(rng.choice([0.0, 0.0, 0.0, 0.0, 2.0, 3.0, 5.0])),
        blur_direction=float(rng.uniform(0.0, np.pi)),
        softness_px=float(rng.choice([0.0, 0.4, 0.6, 0.9, 1.2])),
    )


def _random_gain(rng: np.random.Generator) -> float:
    """Dark, or as it should be, or so bright that white paint shows nothing but its outline."""
    low, high = ((0.5, 0.8), (0.8, 1.3), (1.3, 1.9))[int(rng.choice(3, p=[0.12, 0.78, 0.1]))]
    return float(rng.uniform(low, high))


def random_leaf(rng: np.random.Generator) -> tuple[int, int, int]:
    """Colour of a crown: greens, autumn, bare wood, blossom."""
    bases = ((48, 92, 66), (45, 80, 60), (60, 110, 90), (50, 60, 150), (40, 120, 190), (80, 100, 115), (110, 130, 120))
    return near(bases[int(rng.integers(len(bases)))], 20, rng)
