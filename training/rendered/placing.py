"""Places of objects on a training image: vehicles in bays and lanes or anywhere, clutter and trees between them."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from sim.render.randomise import FIRST_KIND, ObjectKind, car_color, random_leaf
from sim.render.training_ground import TrainingGround
from sim.world.view import OCCLUDER, Bodies, CameraView, FloatArray, project, ray_ground

MAX_IN_SLOTS = 70
"""Bodies after which no more bays are filled: stays below the 80 boxes that a crop keeps."""
LARGE_M = 9.0
"""Clutter of this length or more keeps off bays and lanes."""
HEAVY_M = 6.0
"""Road vehicles of this length or more fill the long bays of depots."""
TWO_WHEELERS = ("bicycle", "motorcycle")
"""Names of what rides and stands in lanes and bays and must not be detected."""
TWO_WHEELER_SHARE = 0.06
"""Share of lanes and bays with a two-wheeler where the catalogue has any; a choice."""
SHADY_SHARE = 0.35
"""Share of vehicles in some streets and car parks with a tree beside or over them; a choice."""
SIDE_VIEW = 0.7
"""Cosine of a camera's tilt below which houses are seen from the side, and it may fly below their roofs."""


@dataclass(slots=True)
class _Placed:
    """Bodies so far, and the circles along their middle lines that keep them apart."""

    rows: list[tuple[float, ...]] = field(default_factory=list)
    colors: list[NDArray[np.int64]] = field(default_factory=list)
    circles: FloatArray = field(default_factory=lambda: np.zeros((0, 3)))

    def add(
        self,
        kind: int,
        at: tuple[float, float, float],
        size: tuple[float, float, float],
        color: NDArray[np.int64],
        solid: bool = True,
    ) -> bool:
        """Place a body at (x, y, heading) unless it would overlap another."""
        (x, y, heading), (length, width, height) = at, size
        if solid:
            narrow, wide = sorted((length, width))
            along = heading if length >= width else heading + 0.5 * np.pi
            count = max(int(np.ceil(wide / narrow)), 1)
            t = (np.arange(count) + 0.5) / count * wide - 0.5 * wide
            own = np.stack([x + t * np.sin(along), y + t * np.cos(along), np.full(count, 0.56 * narrow)], axis=-1)
            gap = np.hypot(*(own[:, None, :2] - self.circles[None, :, :2]).transpose(2, 0, 1))
            if (gap < own[:, None, 2] + self.circles[None, :, 2]).any():
                return False
            self.circles = np.concatenate([self.circles, own])
        self.rows.append((kind, x, y, heading, length, width, height))
        self.colors.append(color)
        return True

    def bodies(self) -> Bodies:
        """All of them."""
        return Bodies.from_rows(self.rows, self.colors)


def random_bodies(
    view: CameraView, ground: TrainingGround, catalogue: tuple[ObjectKind, ...], rng: np.random.Generator
) -> Bodies:
    """Vehicles and much else on what the camera sees."""
    placed = _Placed()
    mode = rng.choice(3, p=[0.6, 0.25, 0.15])  # traffic; a team of rovers; all kinds anywhere
    paint = rng.random()
    # now and then most vehicles have one colour, or one that is nearly black or white
    fleet = None
    if paint < 0.55:
        low, high = (8, 50) if paint < 0.15 else (225, 240)
        fleet = rng.integers(low, high) + rng.integers(0, 12, 3) if paint < 0.3 else car_color(rng)
    _buildings(placed, view, ground, catalogue, rng)
    if mode != 1 or rng.random() < 0.3:
        _in_slots(placed, view, ground, catalogue, fleet, rng)
    groups = ("road",) if mode == 0 else ("rover",) if mode == 1 else ("road", "rover")
    _anywhere(
        placed,
        view,
        ground,
        [k for k, s in enumerate(catalogue) if s.group in groups],
        catalogue,
        rng,
        int(rng.poisson(2.0 if mode == 0 else 9.0)),
        team=mode == 1,
    )
    small = [k for k, s in enumerate(catalogue) if s.group == "clutter" and s.size[0] < LARGE_M]
    _anywhere(placed, view, ground, small, catalogue, rng, int(rng.poisson(rng.choice([2.0, 8.0, 16.0]))))
    for _ in range(int(rng.poisson(rng.choice([0.5, 2.0, 6.0])))):
        _tree(placed, _ground_point(view, rng), float(rng.uniform(1.2, 8.0)), np.array(random_leaf(rng)), rng)
    if rng.random() < 0.4:
        _thicket(placed, view, ground, rng)
    crowd = [
        k for k, s in enumerate(catalogue) if s.name in (*TWO_WHEELERS, "person", "animal", "crate", "cooler", "tank")
    ]
    if crowd and rng.random() < 0.2:
        _crowd(placed, view, int(rng.choice(crowd)), catalogue, rng)
    return placed.bodies()


def _tree(
    placed: _Placed, at: tuple[float, float], wide: float, leaf: NDArray[np.int64], rng: np.random.Generator
) -> None:
    size = (wide, float(wide * rng.uniform(0.8, 1.2)), float(rng.uniform(1.0, 1.0 + 1.2 * wide)))
    placed.add(OCCLUDER, (*at, float(rng.uniform(0.0, 6.3))), size, leaf, solid=False)


def _thicket(placed: _Placed, view: CameraView, ground: TrainingGround, rng: np.random.Generator) -> None:
    """A hedge of bushes in a row, or a wood; it keeps off bays and lanes."""
    x, y = _ground_point(view, rng)
    slots = slots_in_view(view, ground)[:, :2]
    leaf, count, hedge = np.array(random_leaf(rng)), int(rng.integers(8, 30)), bool(rng.random() < 0.6)
    wide = float(rng.uniform(0.7, 2.5) if hedge else rng.uniform(2.0, 6.0))
    along = ground.street + 0.5 * np.pi * int(rng.integers(2)) + rng.normal(0.0, 0.1)
    for k in range(count):
        stray = rng.normal(0.0, 0.08 if hedge else 2.0, 2) * wide
        reach = rng.uniform(0.7, 1.0) * wide * (k - 0.5 * count) if hedge else 0.0
        at = (float(x + reach * np.sin(along) + stray[0]), float(y + reach * np.cos(along) + stray[1]))
        if len(slots) and np.hypot(*(slots - at).T).min() < 3.0 + 0.3 * wide:
            continue
        _tree(placed, at, wide * float(rng.uniform(0.7, 1.3)), np.clip(leaf + rng.normal(0.0, 8.0, 3), 5, 250), rng)


def _crowd(
    placed: _Placed, view: CameraView, kind: int, catalogue: tuple[ObjectKind, ...], rng: np.random.Generator
) -> None:
    """Many small things of one sort close together: people, bicycles at a rack, goods."""
    x, y = _ground_point(view, rng)
    reach = catalogue[kind].size[0] * rng.uniform(2.0, 8.0)
    for _ in range(int(rng.integers(6, 30))):
        at = (x + float(rng.normal(0.0, reach)), y + float(rng.normal(0.0, reach)), float(rng.uniform(0.0, 6.3)))
        placed.add(FIRST_KIND + kind, at, _jittered(catalogue[kind].size, rng), car_color(rng))


def _ground_point(view: CameraView, rng: np.random.Generator) -> tuple[float, float]:
    for _ in range(5):
        x, y, _ = ray_ground(view, rng.uniform(-0.08, 1.08, 2) * (view.width, view.height))
        if np.hypot(x - view.p_enu[0], y - view.p_enu[1]) < 6.0 * view.p_enu[2]:
            return float(x), float(y)
    return float(view.p_enu[0]), float(view.p_enu[1])


def _buildings(
    placed: _Placed,
    view: CameraView,
    ground: TrainingGround,
    catalogue: tuple[ObjectKind, ...],
    rng: np.random.Generator,
) -> None:
    large = [k for k, s in enumerate(catalogue) if s.group == "clutter" and s.size[0] >= LARGE_M]
    if not large or rng.random() < 0.4:
        return
    near = slots_in_view(view, ground)
    for _ in range(int(rng.integers(1, 5))):
        k, (x, y) = int(rng.choice(large)), _ground_point(view, rng)
        size = catalogue[k].size
        if len(near) and np.hypot(near[:, 0] - x, near[:, 1] - y).min() < 0.5 * np.hypot(*size[:2]) + 1.5:
            continue
        if view.p_enu[2] < size[2] + 8.0 and not _stands_behind(view, x, y, size):
            continue
        placed.add(FIRST_KIND + k, (x, y, ground.street + 0.5 * np.pi * int(rng.integers(4))), size, car_color(rng))


def _stands_behind(view: CameraView, x: float, y: float, size: tuple[float, float, float]) -> bool:
    """Tell whether a house fills the background of a view from the side: beyond the camera's aim, and clear of it."""
    if -view.R_enu_cam[2, 2] > SIDE_VIEW:
        return False
    aim = ray_ground(view, [0.5 * view.width, 0.6 * view.height])[:2]
    reach, distance = np.hypot(*(aim - view.p_enu[:2])), np.hypot(x - view.p_enu[0], y - view.p_enu[1])
    return bool(np.isfinite(reach) and distance > reach + 0.5 * np.hypot(*size[:2]))


def slots_in_view(view: CameraView, ground: TrainingGround) -> FloatArray:
    """(n, 4) x, y, heading, length of slots that the image shows, the ground repeating."""
    step = ground.period_m
    at = np.array([_corner(view, u, v) for u in (0.0, 0.5, 1.0) for v in (0.0, 0.5, 1.0)])
    low, high = np.floor(at.min(axis=0) / step), np.floor(at.max(axis=0) / step)
    s = ground.slots
    base = np.stack([s.x, s.y, s.heading, s.length], axis=-1)
    tiles = [
        base + np.array([i * step, (j + 1) * step, 0.0, 0.0])
        for i in np.arange(low[0], min(high[0], low[0] + 3) + 1)
        for j in np.arange(low[1], min(high[1], low[1] + 3) + 1)
    ]
    slots = np.concatenate(tiles) if tiles else np.zeros((0, 4))
    uv, ok = project(view, np.column_stack([slots[:, :2], np.zeros(len(slots))]))
    near = np.hypot(slots[:, 0] - view.p_enu[0], slots[:, 1] - view.p_enu[1]) < 6.0 * view.p_enu[2]
    margin = 0.06 * view.width
    with np.errstate(invalid="ignore"):
        inside = ((uv > -margin) & (uv < (view.width + margin, view.height + margin))).all(axis=1)
    return np.asarray(slots[ok & near & inside])


def _corner(view: CameraView, u: float, v: float) -> FloatArray:
    at = ray_ground(view, [u * view.width, v * view.height])[:2]
    offset = at - view.p_enu[:2]
    reach = np.hypot(*offset)
    if not np.isfinite(reach):
        return view.p_enu[:2]
    return np.asarray(view.p_enu[:2] + offset * min(1.0, 6.0 * view.p_enu[2] / max(reach, 1e-9)))


def _in_slots(
    placed: _Placed,
    view: CameraView,
    ground: TrainingGround,
    catalogue: tuple[ObjectKind, ...],
    fleet: NDArray[np.int64] | None,
    rng: np.random.Generator,
) -> None:
    slots = slots_in_view(view, ground)
    road = [k for k, s in enumerate(catalogue) if s.group == "road"]
    heavy = [k for k in road if catalogue[k].size[0] >= HEAVY_M]
    light = [k for k, s in enumerate(catalogue) if s.name in TWO_WHEELERS]
    own = int(rng.choice(heavy)) if heavy else None
    share = float(rng.choice([0.2, 0.5, 0.9]))
    shady = float(rng.choice([0.0, SHADY_SHARE], p=[0.6, 0.4]))
    for x, y, heading, room in slots[rng.permutation(len(slots))]:
        if len(placed.rows) > MAX_IN_SLOTS:
            return
        k = int(rng.choice(road))
        if light and rng.random() < TWO_WHEELER_SHARE:
            k = int(rng.choice(light))
        elif heavy and room > HEAVY_M and rng.random() < 0.6:
            k = own if own is not None and rng.random() < 0.7 else int(rng.choice(heavy))
        if rng.random() > share or catalogue[k].size[0] > room:
            continue
        at = (x + rng.normal(0.0, 0.1), y + rng.normal(0.0, 0.1), heading)
        color = fleet if fleet is not None and rng.random() < 0.6 else car_color(rng)
        placed.add(FIRST_KIND + k, at, _jittered(catalogue[k].size, rng), color)
        if rng.random() < shady:
            beside = rng.uniform(0.0, 2.0 * np.pi)
            off = rng.uniform(1.0, 4.0) * np.array([np.sin(beside), np.cos(beside)])
            wide = float(rng.uniform(1.5, 5.0))
            _tree(placed, (float(x + off[0]), float(y + off[1])), wide, np.array(random_leaf(rng)), rng)


def _anywhere(
    placed: _Placed,
    view: CameraView,
    ground: TrainingGround,
    kinds: list[int],
    catalogue: tuple[ObjectKind, ...],
    rng: np.random.Generator,
    count: int,
    team: bool = False,
) -> None:
    """Things at random places; a team shares its sort and its colour more often than not."""
    if not kinds:
        return
    own, color = int(rng.choice(kinds)), rng.integers(10, 250, 3)
    for _ in range(count):
        k = own if team and rng.random() < 0.7 else int(rng.choice(kinds))
        vehicle = catalogue[k].group != "clutter"
        paint = color if team and k == own else car_color(rng) if rng.random() < 0.6 else rng.integers(10, 250, 3)
        for _ in range(4):
            along = ground.street + 0.5 * np.pi * int(rng.integers(4)) + rng.normal(0.0, 0.08)
            heading = float(along if rng.random() < (0.3 if vehicle else 0.6) else rng.uniform(0.0, 2.0 * np.pi))
            if placed.add(
                FIRST_KIND + k, (*_ground_point(view, rng), heading), _jittered(catalogue[k].size, rng), paint
            ):
                break


def _jittered(size: tuple[float, float, float], rng: np.random.Generator) -> tuple[float, float, float]:
    length, width, height = size
    return length * rng.uniform(0.95, 1.05), width * rng.uniform(0.96, 1.04), height * rng.uniform(0.95, 1.05)
