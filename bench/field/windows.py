"""The published methods on perfect tracks: each window of ten history and two future frames gets one answer.

The answer of a window names all boxes of its tracks in it. Tracks that are seen in at least two thirds of the window
take part, missing centres are interpolated; so do the vehicles that report throughout. Projection gives no answer
where it would have to try more than 50 000 assignments; nor then does the fusion. The fused masses are assigned one to
one, which leaves surplus boxes unnamed as projection and topology do.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from assoc.errors import AssocError
from assoc.methods.belief import fuse, masses
from assoc.methods.topology import associate_by_topology, topology_angles, topology_cost
from bench.field.scene import SessionFrame, SessionFrames
from bench.paper.projection import Projection, associate_by_projection, reprojection_errors
from bench.paper.tts import associate_by_tts

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
Method = Literal["projection", "topology", "fused", "TTS"]

METHODS: tuple[Method, ...] = ("projection", "topology", "fused", "TTS")
HISTORY, FUTURE = 10, 2
LEAST_SEEN = 8
MOST_ASSIGNMENTS = 50_000
UNANSWERED = -1
"""Name of boxes in windows in which the method gives no answer."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _SessionWindow:
    """T frames, n vehicles, m tracks."""

    vehicle: IntArray
    """(n,) index of the vehicles that take part."""
    body: IntArray
    """(m,) tracks."""
    x: FloatArray
    """(T, n, 3) vehicles relative to the UAV."""
    y: FloatArray
    """(T, m, 2) pixels."""
    vehicle_heading: FloatArray
    """(n,) at the last frame."""
    heading: FloatArray
    """(m,) when last seen."""
    yaw: float


def by_windows(scene: SessionFrames) -> dict[Method, list[IntArray]]:
    """Names of every frame's boxes by each method: (m,) system ids, 0 none, −1 unanswered."""
    answers: dict[Method, list[IntArray]] = {method: [] for method in METHODS}
    length = HISTORY + FUTURE
    for start in range(0, len(scene.looks), length):
        looks = scene.looks[start : start + length]
        window = _window(looks) if len(looks) == length else None
        names = _ask(window, scene.center_px) if window is not None else {}
        for method in METHODS:
            answers[method] += [_named(look, window, names.get(method), scene.ids) for look in looks]
    return answers


def _named(look: SessionFrame, window: _SessionWindow | None, vehicle: IntArray | None, ids: IntArray) -> IntArray:
    if window is None or vehicle is None:
        return np.full(len(look.body), UNANSWERED, np.int64)
    named = np.zeros(len(look.body), np.int64)
    for body, chosen in zip(window.body.tolist(), vehicle.tolist(), strict=True):
        if chosen >= 0:
            named[look.body == body] = ids[window.vehicle[chosen]]
    return named


def _window(looks: tuple[SessionFrame, ...]) -> _SessionWindow | None:
    bodies, counts = np.unique(np.concatenate([np.unique(look.body) for look in looks]), return_counts=True)
    bodies = bodies[(counts >= LEAST_SEEN) & (bodies >= 0)]
    p = np.stack([look.p for look in looks])
    vehicle = np.flatnonzero(np.isfinite(p).all(axis=(0, 2)))
    if not len(bodies) or not len(vehicle):
        return None
    y = np.full((len(looks), len(bodies), 2), np.nan)
    heading = np.full(len(bodies), np.nan)
    for k, look in enumerate(looks):
        _, mine, theirs = np.intersect1d(bodies, look.body, return_indices=True)
        y[k, mine], heading[mine] = look.uv[theirs], look.heading[theirs]
    return _SessionWindow(
        vehicle=vehicle,
        body=bodies,
        x=(p - np.stack([look.uav for look in looks])[:, None])[:, vehicle],
        y=_filled(y),
        vehicle_heading=looks[-1].vehicle_heading[vehicle],
        heading=heading,
        yaw=looks[-1].yaw,
    )


def _filled(y: FloatArray) -> FloatArray:
    """Missing rows interpolated in time."""
    t = np.arange(len(y))
    for column in y.reshape(len(y), -1).T:
        known = np.isfinite(column)
        column[~known] = np.interp(t[~known], t[known], column[known])
    return y


def _ask(window: _SessionWindow, center_px: FloatArray) -> dict[Method, IntArray]:
    """(m,) place in ``window.vehicle`` of each track, −1 none, by the methods that answer."""
    offset = (window.y[-1] - center_px) * (1.0, -1.0)
    image = topology_angles(offset, window.heading)
    cost = topology_cost(image, topology_angles(window.x[-1, :, :2], window.vehicle_heading, window.yaw))
    names: dict[Method, IntArray] = {
        "topology": associate_by_topology(cost),
        "TTS": associate_by_tts(offset, window.x[-1, :, :2]),
    }
    won = _project(window)
    if won is not None:
        names["projection"] = won.vehicle
        E = reprojection_errors(window.x[-1], window.y[-1], won.theta)
        names["fused"] = _one_to_one(fuse(masses(E), masses(cost)))
    return names


def _project(window: _SessionWindow) -> Projection | None:
    try:
        return associate_by_projection(window.x, window.y, history=HISTORY, most=MOST_ASSIGNMENTS)
    except AssocError:
        return None


def _one_to_one(mass: FloatArray) -> IntArray:
    answer = np.full(len(mass), -1, np.int64)
    rows, columns = linear_sum_assignment(mass, maximize=True)
    answer[rows] = columns
    return answer
