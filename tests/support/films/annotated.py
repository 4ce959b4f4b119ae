"""A simulated flight's true boxes as labels, in the layouts of public data sets."""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np

from sim.session import frame_times
from sim.world.boxes import in_image, true_boxes
from sim.world.scenario import Scenario, ScenarioCamera, ScenarioFlight, ScenarioGround, ScenarioTiming, Targets
from sim.world.world import World

FILMED = Scenario(
    name="filmed",
    duration_s=10.0,
    fps=5.0,
    ground=ScenarioGround(
        kind="curved", vehicles=4, lanes=2, speed_mps=5.0, spacing_m=12.0, length_m=4.4, width_m=1.8, height_m=1.5
    ),
    flight=ScenarioFlight(height_m=45.0),
    camera=ScenarioCamera(width=640, height=360, fx=460.0, fy=460.0, cx=320.0, cy=180.0),
    timing=ScenarioTiming(frame_jitter_s=0.0),
    targets=Targets(parked_lookalikes=2),
)
"""Four cars on a winding road and two parked ones, from 45 m."""
FOV_DEG = float(2.0 * np.degrees(np.arctan(320.0 / 460.0)))
"""Of its camera."""
SUFFIXES = {"csv": "tracks.csv", "mot": "gt.txt", "visdrone": "uav0001.txt", "uavdt": "M0101_gt_whole.txt"}
"""A usual file name of each layout."""


def tilted(pitch_deg):
    return dataclasses.replace(FILMED, camera=dataclasses.replace(FILMED.camera, pitch_deg=pitch_deg))


def labels_of(world, layout):
    """The text of a label file."""
    lines = ["frame,id,x1,y1,x2,y2,x3,y3,x4,y4,class"] if layout == "csv" else []
    for frame, now in enumerate(frame_times(world.scenario)[0].tolist()):
        view = world.view(now)
        boxes = true_boxes(view, world.bodies(now))
        for body in np.flatnonzero(in_image(view, boxes)).tolist():
            corners = _corners(boxes, body)
            numbers = ",".join(f"{value:.2f}" for value in corners.ravel())
            left, top = corners.min(axis=0)
            width, height = np.ptp(corners, axis=0)
            upright = f"{frame + 1},{body},{left:.2f},{top:.2f},{width:.2f},{height:.2f}"
            lines.append(
                {
                    "csv": f"{frame},{body},{numbers},car",
                    "mot": f"{upright},1,1,1.0",
                    "visdrone": f"{upright},1,4,0,0",
                    "uavdt": f"{upright},1,1,1",
                }[layout]
            )
    return "\n".join(lines) + "\n"


def _corners(boxes, body):
    c, s = np.cos(boxes.angle[body]), np.sin(boxes.angle[body])
    sides = 0.5 * np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]) * (boxes.w[body], boxes.h[body])
    return sides @ np.array([[c, s], [-s, c]]) + (boxes.cx[body], boxes.cy[body])


def true_motions(world, times):
    """Homographies (3, 3) from the image before, by the true camera over level ground."""
    maps = []
    for now in times.tolist():
        view = world.view(now)
        # u ~ K R' (p - c) with p = (x, y, 0): columns of K R' [e1 e2 -c]
        K = np.array([[view.fx, 0.0, view.cx], [0.0, view.fy, view.cy], [0.0, 0.0, 1.0]])
        maps.append(K @ view.R_enu_cam.T @ np.column_stack([np.eye(3)[:, :2], -view.p_enu]))
    return [None, *(b @ np.linalg.inv(a) for a, b in itertools.pairwise(maps))]


def ground_errors(world, made, times):
    """(k,) metres between the true ground positions of the team and those that were worked out, one frame laid on
    the other by the best turn and shift."""
    pairs = [
        (world.at(now).xy[track.track], made.world.at(now).xy[k])
        for frame, now in enumerate(times.tolist())
        for k, track in enumerate(made.team)
        if frame in track.frames
    ]
    a, b = (np.array(side) - np.mean(side, axis=0) for side in zip(*pairs, strict=True))
    U, _, Vt = np.linalg.svd(b.T @ a)
    return np.linalg.norm(b @ U @ Vt - a, axis=1)


def film_of(scenario):
    """The world and the times of its frames."""
    return World(scenario), frame_times(scenario)[0]
