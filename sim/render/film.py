"""Rendered video of a world: H.264 files whose frames carry their true capture times.

Its scenery (light, camera, appearance and objects beside the road) is drawn from the scenario's seed. Nothing of it
moves, hides a vehicle or is one, so that truth and telemetry are those of the bare scenario.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
from numpy.typing import NDArray

from sim.render.exposure import Exposure
from sim.render.ground import GroundStyle
from sim.render.ground_canvas import near
from sim.render.randomise import FIRST_KIND, ObjectKind, car_color, random_catalogue, random_leaf
from sim.render.render import DEFAULT_MODELS, Renderer, Style
from sim.world.view import OCCLUDER, Bodies, FloatArray, Scene
from sim.world.world import World, random_stream

THINGS, TREES = 260, 160
"""Objects and trees beside the road of one scene; a choice, so that views are neither empty nor full."""
REACH_M = 45.0
"""Largest distance of things from where vehicles drive, m."""
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
    return Bodies.from_rows(rows, colors)


def _gap(at: FloatArray, scene: Scene, ways: FloatArray) -> float:
    """Metres from a place to the nearest lane or way."""
    gaps = [float(np.hypot(*(road.centre - at).T).min()) - 0.5 * road.width for road in scene.roads]
    return min([*gaps, float(np.hypot(*(ways - at).T).min()) - 1.0])


class Film:
    """Images of a world, in the scenery that its scenario asks for."""

    def __init__(self, world: World) -> None:
        self._world = world
        self._scenery = random_scenery(world) if world.scenario.scenery == "dressed" else None
        style = self._scenery.style if self._scenery else None
        self._renderer = Renderer(world.scene, style, seed=world.scenario.seed)

    def image(self, t: float, index: int) -> NDArray[np.uint8]:
        """The frame exposed at time t: (height, width, 3) BGR."""
        bodies = self._world.bodies(t)
        if self._scenery:
            bodies = joined(bodies, self._scenery.bodies)
        return self._renderer.draw(self._world.view(t), bodies, index)


def write_video(world: World, t: FloatArray, path: Path, report: Callable[[int, int], None] | None = None) -> None:
    """Render and encode the frames exposed at t (k,) seconds; the first frame's time stamp is 0.

    Args:
        t: (k,) seconds.
        report: called with the frames that are encoded so far, and all there are.
    """
    film, scenario = Film(world), world.scenario
    images = (film.image(now, index) for index, now in enumerate(t.tolist()))
    size = (scenario.camera.width, scenario.camera.height)
    encode(images, t, path, size=size, fps=scenario.fps, crf=scenario.camera.crf, report=report)


def encode(
    images: Iterable[NDArray[np.uint8]],
    t: FloatArray,
    path: Path,
    *,
    size: tuple[int, int],
    fps: float,
    crf: int,
    report: Callable[[int, int], None] | None = None,
) -> None:
    """Encode images as H.264; the first one's time stamp is 0.

    One encoder thread and no look-ahead: with B-frames x264's output differs from run to run, and equal images are to
    give equal bytes.

    Args:
        images: (height, width, 3) BGR each.
        t: (k,) seconds at which they were exposed.
        size: width and height, px, both even.
        crf: quality: lower is finer and larger.
        report: called with the images that are encoded so far, and all there are.
    """
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=Fraction(fps).limit_denominator(1000))
        stream.width, stream.height, stream.pix_fmt = *size, "yuv420p"
        stream.time_base = stream.codec_context.time_base = Fraction(1, 90_000)
        keyframes = str(max(1, round(2 * fps)))
        options: dict[str, object] = {"preset": "medium", "crf": str(crf), "g": keyframes}
        stream.options = options | {"tune": "zerolatency", "threads": "1"}
        for done, (image, now) in enumerate(zip(images, t.tolist(), strict=True), start=1):
            frame = av.VideoFrame.from_ndarray(image, format="bgr24")
            frame.pts, frame.time_base = round((now - float(t[0])) * 90_000), Fraction(1, 90_000)
            for packet in stream.encode(frame):
                container.mux(packet)
            if report is not None:
                report(done, len(t))
        for packet in stream.encode():
            container.mux(packet)
