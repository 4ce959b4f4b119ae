"""The published methods and the program's identifier on one window; every method labels the window's last frame.

An answer is (m,) the index of the vehicle of each box, −1 for none.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from assoc.errors import DegenerateError
from assoc.identification.identifier import Identifier
from assoc.methods.belief import fuse, masses
from assoc.methods.topology import (
    associate_by_topology,
    signed_angles,
    signed_topology_cost,
    topology_angles,
    topology_cost,
)
from assoc.records import CameraState, Observation, VehicleReports
from bench.paper.films import CAMERA, Window, film, paper_road, windows
from bench.paper.projection import Projection, associate_by_projection, reprojection_errors
from bench.paper.tts import associate_by_tts, associate_by_tts_once, tts_similarity
from vision.camera.camera import CameraPose, Mount, camera_pose, ground
from vision.camera.intrinsics import Intrinsics

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

HISTORY = 10
START_US = 1_795_170_000_000_000
LENS = Intrinsics(width=CAMERA.width, height=CAMERA.height, fx=CAMERA.fx, fy=CAMERA.fy, cx=CAMERA.cx, cy=CAMERA.cy)
_CENTRE = np.array([CAMERA.cx, CAMERA.cy])


@dataclass(frozen=True, slots=True, kw_only=True)
class ConditionNoise:
    """White noise of one condition."""

    position_m: float
    """σ on the relative coordinates that projection, TTS and the identifier are given."""
    topology: float
    """σ on what topology is given: metres on positions, degrees on headings."""
    heading_deg: float = 2.0
    """σ on the headings that the identifier is given."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MethodAnswer:
    """A method's answer for the last frame."""

    vehicle: IntArray
    """(m,) −1 none."""
    confidence: FloatArray
    """(m,) NaN where the method has none."""


Method = Callable[[Window, ConditionNoise], MethodAnswer]


def _plain(vehicle: IntArray) -> MethodAnswer:
    return MethodAnswer(vehicle=vehicle, confidence=np.full(len(vehicle), np.nan))


def _relative(window: Window, noise: ConditionNoise) -> FloatArray:
    """(T, n, 3) reported vehicles minus the UAV's position."""
    return np.asarray(window.positions(noise.position_m) - window.uav_enu[:, None])


def _project(window: Window, noise: ConditionNoise) -> Projection | None:
    try:
        return associate_by_projection(_relative(window, noise), window.uv, history=HISTORY)
    except DegenerateError:
        return None


def projection(window: Window, noise: ConditionNoise) -> MethodAnswer:
    """Section 3.2: ten frames of history, the next two vote."""
    found = _project(window, noise)
    return _plain(found.vehicle if found else np.full(window.uv.shape[1], -1, np.int64))


def _topology_views(window: Window, noise: ConditionNoise) -> tuple[tuple[FloatArray, FloatArray], ...]:
    """Offsets and headings of the last frame, in the image and in the world; v₀ of the world."""
    away = window.uv[-1] - _CENTRE
    offset = (window.positions(noise.topology, second=True)[-1] - window.uav_enu[-1])[:, :2]
    return (away * (1.0, -1.0), window.front[-1]), (offset, window.headings(noise.topology)[-1])


def _topology_cost(window: Window, noise: ConditionNoise) -> FloatArray:
    image, world = _topology_views(window, noise)
    return topology_cost(topology_angles(*image), topology_angles(*world, float(window.uav_yaw[-1])))


def topology(window: Window, noise: ConditionNoise) -> MethodAnswer:
    """Section 3.3, unsigned angles as printed."""
    return _plain(associate_by_topology(_topology_cost(window, noise)))


def topology_signed(window: Window, noise: ConditionNoise) -> MethodAnswer:
    """The same with signed angles."""
    image, world = _topology_views(window, noise)
    cost = signed_topology_cost(signed_angles(*image), signed_angles(*world, float(window.uav_yaw[-1])))
    return _plain(associate_by_topology(cost))


def fusion(window: Window, noise: ConditionNoise) -> MethodAnswer:
    """Section 3.4 and Algorithm 1: the vehicle of the largest fused mass."""
    found = _project(window, noise)
    if found is None:
        return topology(window, noise)
    errors = reprojection_errors(_relative(window, noise)[-1], window.uv[-1], found.theta)
    fused = fuse(masses(errors), masses(_topology_cost(window, noise)))
    return MethodAnswer(vehicle=np.argmax(fused, axis=1), confidence=np.max(fused, axis=1))


def _tts_views(window: Window, noise: ConditionNoise) -> tuple[FloatArray, FloatArray]:
    return window.uv[-1] * (1.0, -1.0), _relative(window, noise)[-1, :, :2]


def tts(window: Window, noise: ConditionNoise) -> MethodAnswer:
    """Triangular topological sequence, both steps."""
    return _plain(associate_by_tts(*_tts_views(window, noise)))


def tts_one_step(window: Window, noise: ConditionNoise) -> MethodAnswer:
    """The first step of the method alone."""
    return _plain(associate_by_tts_once(tts_similarity(*_tts_views(window, noise))))


def mean_residual(window: Window, noise: ConditionNoise) -> MethodAnswer:
    """The plain way with a known pose: boxes on the ground, mean distance to the reports, all assigned."""
    seen = np.stack([_on_ground(window, k) for k in range(len(window.uv))])
    away = seen[:, :, None] - window.positions(noise.position_m)[:, None, :, :2]
    return _plain(associate_by_topology(np.linalg.norm(np.mean(away, axis=0), axis=2)))


def _on_ground(window: Window, k: int) -> FloatArray:
    """(m, 2) where the boxes of frame k are on the ground, by the UAV's report."""
    camera = camera_state(window.uav_enu[k], float(window.uav_yaw[k]))
    pose = CameraPose(R_enu_cam=camera.R_enu_cam, p_enu=camera.p_enu)
    return np.asarray(ground(LENS, pose, window.uv[k], camera.ground_z)[:, :2])


def identifier(window: Window, noise: ConditionNoise) -> MethodAnswer:
    """A new identifier at the window's first frame, with the UAV's telemetry."""
    return identify(window, noise)[-1]


METHODS: dict[str, Method] = {
    "projection": projection,
    "topology": topology,
    "topology signed": topology_signed,
    "fusion": fusion,
    "TTS": tts,
    "TTS one step": tts_one_step,
    "mean residual": mean_residual,
    "identifier": identifier,
}


def identify(window: Window, noise: ConditionNoise) -> list[MethodAnswer]:
    """Feed a window to a new identifier, frame by frame; the answer of every frame."""
    who = Identifier(range(1, window.p_enu.shape[1] + 1))
    answers = []
    p, heading = window.positions(noise.position_m), window.headings(noise.heading_deg)
    for k in range(len(window.uv)):
        t_us = START_US + round((window.start + k) / window.fps * 1e6)
        camera = camera_state(window.uav_enu[k], float(window.uav_yaw[k]))
        answer = who.update(_observation(t_us, window, k), camera, vehicle_reports(t_us, p[k], heading[k]))
        answers.append(MethodAnswer(vehicle=answer.system_id - 1, confidence=answer.confidence))
    return answers


def _observation(t_us: int, window: Window, k: int) -> Observation:
    m, front = window.uv.shape[1], window.front[k]
    reach = 0.5 * window.length_px[k]
    ahead = window.uv[k] + reach[:, None] * np.stack([np.sin(front), -np.cos(front)], axis=-1)
    return Observation(
        t_us=t_us,
        track_id=np.arange(1, m + 1),
        ray_cam=LENS.rays(window.uv[k]),
        front_cam=LENS.rays(ahead),
        gap_s=np.zeros(m),
        score=np.full(m, 0.8),
    )


def camera_state(p_enu: FloatArray, yaw: float) -> CameraState:
    """The camera as the UAV's telemetry has it: straight down below a level body.

    Args:
        p_enu: (3,) reported position.
        yaw: Reported yaw.
    """
    # level body, nose at the yaw: FRD vectors in ENU
    nose, right = np.array([np.sin(yaw), np.cos(yaw), 0.0]), np.array([np.cos(yaw), -np.sin(yaw), 0.0])
    pose = camera_pose(Mount(), p_enu, np.stack([nose, right, np.array([0.0, 0.0, -1.0])], axis=1))
    return CameraState(
        R_enu_cam=pose.R_enu_cam,
        p_enu=pose.p_enu,
        ground_z=0.0,
        px_rad=1.0 / CAMERA.fx,
        attitude_known=True,
        position_known=True,
        stabilized=True,
        half_view=(0.5 * CAMERA.width / CAMERA.fx, 0.5 * CAMERA.height / CAMERA.fy),
    )


def vehicle_reports(t_us: int, p: FloatArray, heading: FloatArray) -> VehicleReports:
    """One report of each vehicle, positions (n, 3) and headings (n,), of this moment."""
    n = len(p)
    return VehicleReports(
        t_us=np.full(n, t_us),
        vehicle=np.arange(n),
        p_enu=p,
        v_enu=np.full((n, 3), np.nan),
        heading=heading,
        std_m=np.full(n, np.nan),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class MethodTime:
    """Processor time that a published method takes for a window (Table 1)."""

    method: str
    cpu_ms: float
    """Median over the windows, of one thread."""


def times(most: int) -> list[MethodTime]:
    """Times for seven vehicles and six boxes; of fusion, that of the two costs alone.

    Args:
        most: Windows used.
    """
    noise, rng = ConditionNoise(position_m=1.0, topology=1.0), np.random.default_rng(1)
    cut = windows(film(paper_road("straight", 0.0, 1)), 12, 1, boxes=6, visible=6)[:most]
    costs = rng.random((2, 6, 7))

    def fused(window: Window, noise: ConditionNoise) -> object:
        return fuse(masses(costs[0]), masses(costs[1]))

    taken = {name: METHODS[name] for name in ("projection", "topology", "TTS")} | {"fusion": fused}
    return [MethodTime(method=name, cpu_ms=_median_ms(method, cut, noise)) for name, method in taken.items()]


def _median_ms(method: Callable[[Window, ConditionNoise], object], cut: list[Window], noise: ConditionNoise) -> float:
    spent = []
    for window in cut:
        began = time.thread_time()
        method(window, noise)
        spent.append(1e3 * (time.thread_time() - began))
    return float(np.median(spent))
