"""Flights as a tracker meets them: detections frame by frame with misses, and telemetry; and who follows them.

A keeper sees the tracks of each frame and may decide which lost track a box continues.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from assoc.identification.identifier import Identifier
from assoc.records import CameraState
from bench.paper.films import FPS, film
from bench.paper.methods import LENS, START_US, camera_state, vehicle_reports
from gcs.fold.evidence import observation_of
from sim.telemetry.detections import DetectorModel
from sim.world.scenario import Scenario
from sim.world.world import World
from vision.camera.camera import CameraPose, image_warp
from vision.detect.detections import Detections
from vision.track.tracks import Stitch, Tracks

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

SIGMA_M, SIGMA_DEG = 0.5, 2.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Walk:
    """What trackers are given: frames of detections, the truth, the vehicles' and the UAV's telemetry."""

    seed: int
    detections: tuple[Detections, ...]
    truth: tuple[IntArray, ...]
    """Per frame (m,) index of the vehicle, −1 none."""
    p_enu: FloatArray
    """(F, n, 3) reported."""
    heading: FloatArray
    """(F, n) reported."""
    cameras: tuple[CameraState, ...]


def walk(scenario: Scenario, hidden: BoolArray | None = None) -> Walk:
    """Fly it once.

    Args:
        scenario: The flight.
        hidden: (F, n) True while a vehicle is not to be detected.
    """
    seen, model = film(scenario), DetectorModel(World(scenario))
    index = {system_id: i for i, system_id in enumerate(scenario.ugv_ids)}
    detections, truth = [], []
    for k in range(scenario.frame_count):
        rows = model.detect(k / scenario.fps)
        who = np.array([index.get(int(i), -1) for i in rows.system_id], np.int64)
        left = np.ones(len(who), np.bool_) if hidden is None else (who < 0) | ~hidden[k, who]
        detections.append(_detections(rows.values[left]))
        truth.append(who[left])
    noise = np.random.default_rng([scenario.seed, 14]).normal(0.0, 1.0, (*seen.heading.shape, 4))
    return Walk(
        seed=scenario.seed,
        detections=tuple(detections),
        truth=tuple(truth),
        p_enu=seen.p_enu + SIGMA_M * noise[..., :3],
        heading=seen.heading + np.radians(SIGMA_DEG) * noise[..., 3],
        cameras=tuple(camera_state(p, float(yaw)) for p, yaw in zip(seen.uav_enu, seen.uav_yaw, strict=True)),
    )


def frame_us(frame: int) -> int:
    """Unix µs of a frame."""
    return START_US + round(frame * 1e6 / FPS)


def camera_motion(walk: Walk, frame: int) -> FloatArray | None:
    """(3, 3) homography from the frame before to this one, as telemetry has it; None for the first."""
    if frame == 0:
        return None
    before, now = (CameraPose(R_enu_cam=c.R_enu_cam, p_enu=c.p_enu) for c in walk.cameras[frame - 1 : frame + 1])
    return image_warp(LENS, before, now, 0.0)


def _detections(rows: FloatArray) -> Detections:
    names = ("cx", "cy", "w", "h", "angle", "score", "heading")
    return Detections(**dict(zip(names, np.ascontiguousarray(rows.T), strict=True)))


class Plain:
    """Nothing continues a lost track but the tracker's own prediction."""

    def __init__(self, walk: Walk) -> None:
        self._walk = walk

    def stitch(self, frame: int) -> Stitch | None:
        """What the tracker may ask in a frame."""
        return None

    def known(self) -> Collection[int]:
        """Tracks with a name: once out of sight they are continued by ``stitch`` only."""
        return ()

    def observe(self, frame: int, tracks: Tracks) -> None:
        """Use the tracks of a frame as evidence."""


class Ours(Plain):
    """The identifier names tracks and decides which lost track a box continues."""

    def __init__(self, walk: Walk) -> None:
        super().__init__(walk)
        self._who = Identifier(range(1, walk.p_enu.shape[1] + 1))
        self._named: list[int] = []

    def stitch(self, frame: int) -> Stitch | None:
        camera = self._walk.cameras[frame]

        def continued(track_id: NDArray[np.int64], centres: FloatArray) -> NDArray[np.intp]:
            return self._who.stitch(frame_us(frame), track_id, LENS.rays(centres), camera).astype(np.intp)

        return continued

    def known(self) -> Collection[int]:
        return self._named

    def observe(self, frame: int, tracks: Tracks) -> None:
        walk = self._walk
        observation = observation_of(frame_us(frame), walk.detections[frame], tracks, LENS)
        reports = vehicle_reports(frame_us(frame), walk.p_enu[frame], walk.heading[frame])
        answer = self._who.update(observation, walk.cameras[frame], reports)
        self._named = answer.track_id[answer.system_id > 0].tolist()
