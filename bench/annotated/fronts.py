"""Fronts of vehicles that drive: whether their boxes point to where the labels say they drive."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from gcs.report.score import match
from gcs.session.tables import Table
from sim.annotated.ground_tracks import GroundTrack, ground_motion
from sim.annotated.tracks import AnnotatedTracks
from sim.world.camera import view_from
from sim.world.view import project
from sim.world.world import World

__all__ = ["turned_fronts"]

FloatArray = NDArray[np.float64]

DRIVEN_LENGTHS = 2.0
"""A box counts once its vehicle is so many of its lengths from where its track began."""
GRID_S = 0.05
"""Step of the paths that tell the direction of travel."""


def turned_fronts(
    labels: AnnotatedTracks, vehicles: Sequence[GroundTrack], world: World, logged: Table
) -> NDArray[np.bool_]:
    """Whether each box that shows a front points more than 90° away from its vehicle's direction of travel.

    Args:
        labels: of the film.
        vehicles: where they are on the ground.
        world: its camera.
        logged: the identity log.

    Returns:
        (k,) of the boxes of tracks over vehicles that came two of their lengths away since the track was first over
        them.
    """
    m = match(_truth(labels), logged)
    heading = {
        (int(frame), int(track)): front
        for frame, track, front in zip(logged["frame"], logged["track_id"], logged["heading"], strict=True)
        if np.isfinite(track) and np.isfinite(front)
    }
    turned = []
    for vehicle in vehicles:
        if len(vehicle.frames) < 2:
            continue
        travel = _travel(vehicle, world)
        length_m = _length_m(labels, vehicle, world)
        place = dict(zip(vehicle.frames.tolist(), vehicle.xy, strict=True))
        over = (m.truth == vehicle.track) & (m.track > 0) & np.isin(m.frame, vehicle.frames)
        began: dict[int, FloatArray] = {}
        for frame, track in zip(m.frame[over].tolist(), m.track[over].tolist(), strict=True):
            since = began.setdefault(track, place[frame])
            front = heading.get((frame, track))
            driven = np.linalg.norm(place[frame] - since) >= DRIVEN_LENGTHS * length_m
            if driven and front is not None and np.isfinite(travel[frame]):
                turned.append(np.cos(front - travel[frame]) < 0.0)
    return np.array(turned, dtype=np.bool_)


def _truth(labels: AnnotatedTracks) -> Table:
    """The labels as a table of true boxes, in which each vehicle is known by its number in the labels."""
    seen = ~labels.hidden
    cx, cy, w, h, angle = labels.boxes()[seen].T
    columns = {"cx": cx, "cy": cy, "w": w, "h": h, "angle": angle}
    numbers = {"frame": labels.frame[seen], "system_id": labels.track[seen]}
    return Table(columns=columns | {name: n.astype(np.float64) for name, n in numbers.items()}, skipped=0)


def _travel(vehicle: GroundTrack, world: World) -> dict[int, float]:
    """Direction of travel in the image by frame, clockwise from its top, rad; NaN for one that never drives."""
    first, last = float(vehicle.t[0]), float(vehicle.t[-1])
    motion = ground_motion([vehicle], np.linspace(first, last, max(int(np.ceil((last - first) / GRID_S)), 2) + 1))
    course = np.interp(vehicle.t, motion.t, motion.heading[:, 0])
    travel = {}
    for frame, t, at, along in zip(vehicle.frames.tolist(), vehicle.t.tolist(), vehicle.xy, course, strict=True):
        ahead = at + np.array([np.sin(along), np.cos(along)])
        points = np.column_stack([np.stack([at, ahead]), np.zeros(2)])
        uv, _ = project(view_from(world.scenario, world.at(t).uav), points)
        du, dv = uv[1] - uv[0]
        travel[frame] = float(np.arctan2(du, -dv))
    return travel


def _length_m(labels: AnnotatedTracks, vehicle: GroundTrack, world: World) -> float:
    """Length of a vehicle as its labels have it, m: the median of their longer sides."""
    own = (labels.track == vehicle.track) & np.isin(labels.frame, vehicle.frames)
    side_px = dict(zip(labels.frame[own].tolist(), labels.boxes()[own, 2:4].max(axis=1).tolist(), strict=True))
    lengths = []
    for frame, t, at in zip(vehicle.frames.tolist(), vehicle.t.tolist(), vehicle.xy, strict=True):
        view = view_from(world.scenario, world.at(t).uav)
        # one pixel is d / f metres across
        lengths.append(side_px[frame] * float(np.linalg.norm(np.append(at, 0.0) - view.p_enu)) / view.fx)
    return float(np.median(lengths))
