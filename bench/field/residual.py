"""The simple competitor: the camera's pose at face value, and who has been nearest for the last two seconds.

For each track i and vehicle j the mean of the residual vector over the frames of the last two seconds in which both
are known; Hungarian on its length; none beyond six metres.
"""

from __future__ import annotations

from collections import deque

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from bench.field.scene import SessionFrame, SessionFrames

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

MEMORY_S = 2.0
LIMIT_M = 6.0


def mean_residual(scene: SessionFrames) -> list[IntArray]:
    """Names of every frame's boxes: (m,) system ids, 0 none."""
    memory: deque[SessionFrame] = deque(maxlen=max(1, round(MEMORY_S * scene.fps)))
    answers = []
    for look in scene.looks:
        memory.append(look)
        named = np.zeros(len(look.body), np.int64)
        tracked = np.flatnonzero(look.body >= 0)
        distance = _distances(memory, look.body[tracked], len(scene.ids))
        rows, columns = linear_sum_assignment(np.minimum(distance, 1e3))
        near = distance[rows, columns] <= LIMIT_M
        named[tracked[rows[near]]] = scene.ids[columns[near]]
        answers.append(named)
    return answers


def _distances(memory: deque[SessionFrame], bodies: IntArray, n: int) -> FloatArray:
    """(k, n) metres; inf where the two were never known together."""
    total, count = np.zeros((len(bodies), n, 2)), np.zeros((len(bodies), n, 1))
    for look in memory:
        _, mine, theirs = np.intersect1d(bodies, look.body, return_indices=True)
        residual = look.on_ground[theirs, None] - look.p[None, :, :2]
        known = np.isfinite(residual).all(axis=-1, keepdims=True)
        total[mine] += np.where(known, residual, 0.0)
        count[mine] += known
    with np.errstate(invalid="ignore"):
        mean = np.linalg.norm(total / count, axis=-1)
    return np.asarray(np.where(np.isfinite(mean), mean, np.inf))
