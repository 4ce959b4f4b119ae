"""Scenery of a flight: light, camera, appearance and objects beside the road, drawn from the scenario's seed.

Nothing of it moves, hides a vehicle or is one, so that truth and telemetry are those of the bare scenario.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sim.render.exposure import Exposure
from sim.render.ground import GroundStyle
from sim.render.ground_canvas import near
from sim.render.randomise import FIRST_KIND, ObjectKind, car_color, random_catalogue, random_leaf
from sim.render.render import DEFAULT_MODELS, Style
from sim.world.view import OCCLUDER, Bodies, FloatArray, Scene
from sim.world.world import World, random_stream

THINGS, TREES = 260, 160
"""Objects and trees beside the road of one scene; a choice, so that views are neither empty nor full."""
REACH_M = 45.0
"""How far from where vehicles drive things are put."""
CLEAR_M = 1.5
"""Room between a thing and a lane or a vehicle's way."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Scenery:
    """Appearance of a flight."""

    style: Style
    bodies: Bodies
    """Objects beside the road."""


def random_scenery(world: World) -> Scenery:
    """Scenery of a world; the same for equal scenarios."""
    rng = random_stream(world.scenario, "dressing")
    catalogue = tuple(kind for kind in random_catalogue(rng, road=0, rovers=0, clutter=14) if kind.name != "pole")
    return Scenery(style=_style(catalogue, rng), bodies=_beside(world, catalogue, rng))


def joined(first: Bodies, second: Bodies) -> Bodies:
    """Two sets of bodies as one, the first before the second."""
    fields = ("kind", "x", "y", "heading", "length", "width", "height", "color")
    return Bodies(**{name: np.concatenate([getattr(first, name), getattr(second, name)]) for name in fields})


def _style(catalogue: tuple[ObjectKind, ...], rng: np.random.Generator) -> Style:
    """A clear or a dull day, never so dark that nothing could be seen."""
    dull = rng.random() < 0.4
    ground = GroundStyle()
    return Style(
        sun_azimuth=float(rng.uniform(0.0, 2.0 * np.pi)),
        sun_elevation=float(rng.uniform(0.5, 1.2)),
        shadow=float(rng.uniform(0.05, 0.2) if dull else rng.uniform(0.35, 0.6)),
        ambient=float(rng.uniform(0.7, 0.9) if dull else rng.uniform(0.45, 0.7)),
        penumbra_m=float(rng.uniform(0.5, 1.5) if dull else rng.uniform(0.05, 0.3)),
        contact=float(rng.uniform(0.2, 0.5)),
        in_shadow=float(rng.uniform(0.55, 0.8)),
        leaf=None,
        ground=replace(
            ground,
            colors=tuple(near(color, 10, rng) for color in ground.colors),
            blotches=float(rng.uniform(0.1, 0.25)),
            wear=float(rng.uniform(0.3, 0.9)),
        ),
        exposure=Exposure(
            gain=float(rng.uniform(0.85, 1.15)),
            balance=tuple(rng.uniform(0.96, 1.04, 3).tolist()),
            vignette=0.15,
            noise=2.0,
            softness_px=0.6,
        ),
        models={**DEFAULT_MODELS, **{FIRST_KIND + k: kind.model for k, kind in enumerate(catalogue)}},
    )


def _beside(world: World, catalogue: tuple[ObjectKind, ...], rng: np.random.Generator) -> Bodies:
    """Objects and trees at random places off the roads and off all paths."""
    times = np.arange(0.0, world.scenario.duration_s, 0.5)
    ways = np.concatenate([world.at(float(t)).xy for t in times])
    low, high = ways.min(axis=0) - REACH_M, ways.max(axis=0) + REACH_M
    rows: list[tuple[float, ...]] = []
    colors: list[NDArray[np.int64]] = []
    kept = np.zeros((0, 3))
    for k in range(THINGS + TREES):
        x, y = rng.uniform(low, high)
        heading = float(rng.uniform(0.0, 2.0 * np.pi))
        if k < THINGS:
            i = int(rng.integers(len(catalogue)))
            kind, size, color = FIRST_KIND + i, catalogue[i].size, car_color(rng)
        else:
            wide = float(rng.uniform(1.5, 7.0))
            kind, color = OCCLUDER, np.array(random_leaf(rng))
            size = (wide, wide * float(rng.uniform(0.8, 1.2)), float(rng.uniform(1.2, 1.0 + wide)))
        # seen from the side, what is tall hides what is behind it
        reach = 0.5 * float(np.hypot(size[0], size[1])) + 0.5 * size[2]
        if _gap(np.array([x, y]), world.scene, ways) < reach + CLEAR_M:
            continue
        if len(kept) and (np.hypot(kept[:, 0] - x, kept[:, 1] - y) < kept[:, 2] + reach).any():
            continue
        kept = np.concatenate([kept, [[x, y, reach]]])
        rows.append((kind, x, y, heading, *size))
        colors.append(color)
    table = np.array(rows).reshape(-1, 7).T
    return Bodies(
        kind=table[0].astype(np.int8),
        x=table[1],
        y=table[2],
        heading=table[3],
        length=table[4],
        width=table[5],
        height=table[6],
        color=np.array(colors, np.uint8).reshape(-1, 3),
    )


def _gap(at: FloatArray, scene: Scene, ways: FloatArray) -> float:
    """Metres from a place to the nearest lane or way."""
    gaps = [float(np.hypot(*(road.centre - at).T).min()) - 0.5 * road.width for road in scene.roads]
    return min([*gaps, float(np.hypot(*(ways - at).T).min()) - 1.0])
