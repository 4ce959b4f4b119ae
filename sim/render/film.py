"""Rendered video of a world: H.264 files whose frames carry their true capture times."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
from numpy.typing import NDArray

from sim.render.render import Renderer
from sim.render.scenery import joined, random_scenery
from sim.world.world import World

FloatArray = NDArray[np.float64]


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
