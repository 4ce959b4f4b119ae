"""A short flight at one height, filmed with tags on the roofs, as a session folder.

Order of rendering: the scene with its tags, motion blur and lens, vignetting and sensor noise, H.264.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import numpy as np
from numpy.typing import NDArray

from bench.apriltag.tags import Tag, draw_tags
from infra.session_format import DETECTIONS, TRUTH
from sim.render.exposure import Exposure, expose
from sim.render.render import Renderer
from sim.session import frame_times, write_session, write_visible_truth
from sim.world.presets import nominal
from sim.world.scenario import Gnss, Scenario, ScenarioAttitude, ScenarioCamera, ScenarioFlight, Targets
from sim.world.view import project
from sim.world.world import World

__all__ = ["CAMERAS", "SIDES_M", "camera_of", "render_frame", "scenario_of", "tags_of", "write_flight"]

Image = NDArray[np.uint8]

CAMERAS = {"1080p": (1920, 1080), "4K": (3840, 2160)}
DIAGONAL_DEG = 84.0
"""Diagonal field of view of a typical consumer drone."""
SIDES_M = (0.3, 0.5)
"""Sides of the tags' black squares, given to the vehicles in turn."""
SPACING_M = 5.0
"""Distance between neighbouring vehicles."""
SHUTTER_S = 1.0 / 100.0
"""Exposure time on an overcast day."""
SOFTNESS_PX, NOISE, CRF = 0.6, 3.0, 23
"""Blur of the lens, 1σ of the sensor's noise in grey values, and quality of the encoder (libx264's default)."""
NO_CAMERA = Exposure(vignette=0.0, noise=0.0)
"""Renders the scene without lens and sensor effects, which follow once the tags are drawn."""
CLOCK = 90_000
"""Ticks a second of the video's time stamps."""


def camera_of(name: str) -> ScenarioCamera:
    """A camera that looks straight down."""
    width, height = CAMERAS[name]
    # f = ½ diagonal / tan(½ field of view)
    f = 0.5 * float(np.hypot(width, height)) / float(np.tan(np.radians(0.5 * DIAGONAL_DEG)))
    return ScenarioCamera(width=width, height=height, fx=f, fy=f, cx=0.5 * width, cy=0.5 * height, crf=CRF)


def scenario_of(camera: str, height_m: float, duration_s: float, fps: float, seed: int = 1) -> Scenario:
    """Seven vehicles close together on a winding road, a look-alike among them, and a consumer drone's errors."""
    usual = nominal(seed)
    return replace(
        usual,
        gnss=Gnss(white_m=0.3, bias_m=1.0, uav_bias_m=1.0),
        attitude=ScenarioAttitude(compass_bias_deg=3.0, tilt_pitch_deg=0.7, tilt_roll_deg=0.5),
        name=f"apriltag-{camera}-{height_m:g}",
        duration_s=duration_s,
        fps=fps,
        camera=camera_of(camera),
        flight=ScenarioFlight(height_m=height_m),
        ground=replace(usual.ground, spacing_m=SPACING_M),
        targets=Targets(lookalikes=1),
    )


def tags_of(scenario: Scenario) -> tuple[Tag, ...]:
    """One tag on each of our vehicles; its number is the vehicle's system id."""
    return tuple(
        Tag(body=i, number=system_id, side_m=SIDES_M[i % len(SIDES_M)]) for i, system_id in enumerate(scenario.ugv_ids)
    )


def render_frame(world: World, renderer: Renderer, t: float, index: int) -> Image:
    """The frame exposed at time t as the camera gives it to its encoder: (height, width, 3) BGR."""
    view, bodies = world.view(t), world.bodies(t)
    bare = renderer.draw(view, bodies, index, NO_CAMERA)
    shown = draw_tags(bare, view, bodies, tags_of(world.scenario))
    length, direction = _blur(world, t)
    lens = Exposure(blur_px=length, blur_direction=direction, softness_px=SOFTNESS_PX, noise=NOISE)
    return expose(shown, lens, np.random.default_rng([world.scenario.seed, index]))


def _blur(world: World, t: float) -> tuple[float, float]:
    """Median motion of our vehicles in the image while the shutter is open: length, px, and direction, radians."""
    places = []
    for moment in (t - 0.5 * SHUTTER_S, t + 0.5 * SHUTTER_S):
        at = world.at(moment).xy[: world.scenario.fleet_size]
        places.append(project(world.view(moment), np.column_stack([at, np.zeros(len(at))]))[0])
    move = np.nanmedian(places[1] - places[0], axis=0)
    return float(np.hypot(*move)), float(np.arctan2(move[1], move[0]))


def write_flight(scenario: Scenario, folder: Path) -> World:
    """Write a session whose video shows the tags; ``truth.csv`` holds what can be seen."""
    world = write_session(scenario, folder)
    (folder / DETECTIONS.name).unlink()
    t, _ = frame_times(scenario)
    write_visible_truth(folder / TRUTH.name, world, t)
    _encode(world, t, folder / "video.mp4")
    return world


def _encode(world: World, t: NDArray[np.float64], path: Path) -> None:
    """Encode the video, in one thread and without look-ahead: equal flights give equal bytes."""
    camera = world.scenario.camera
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=Fraction(world.scenario.fps).limit_denominator(1000))
        stream.width, stream.height, stream.pix_fmt = camera.width, camera.height, "yuv420p"
        stream.time_base = stream.codec_context.time_base = Fraction(1, CLOCK)
        stream.options = {"preset": "veryfast", "crf": str(camera.crf), "tune": "zerolatency", "threads": "1"}
        for frame in _frames(world, t):
            container.mux(stream.encode(frame))
        container.mux(stream.encode())


def _frames(world: World, t: NDArray[np.float64]) -> Iterator[Any]:
    renderer = Renderer(world.scene, seed=world.scenario.seed)
    for index, now in enumerate(t.tolist()):
        frame = av.VideoFrame.from_ndarray(render_frame(world, renderer, now, index), format="bgr24")
        frame.pts, frame.time_base = round((now - float(t[0])) * CLOCK), Fraction(1, CLOCK)
        yield frame
