"""The published methods against themselves as one would first write them down.

Loops over hypotheses, vehicles, tracks and frames, one small least-squares problem per hypothesis. Symbols as in
:mod:`bench.paper.projection`, :mod:`assoc.methods.topology`, :mod:`assoc.methods.belief` and
:mod:`bench.paper.tts`.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from itertools import permutations
from math import acos, atan2, cos, degrees, hypot, log, pi, sin, sqrt

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment
from scipy.spatial import Delaunay

from assoc.methods.belief import fuse, masses
from assoc.methods.topology import associate_by_topology, topology_angles, topology_cost
from bench.paper.projection import associate_by_projection, reprojection_errors
from bench.paper.tts import associate_by_tts_once, tts_similarity

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
Pairs = list[tuple[int, int]]


def hypotheses(n_rl: int, n_im: int) -> list[Pairs]:
    """All injective assignments as lists of (vehicle, track)."""
    if n_rl >= n_im:
        return [[(i, j) for j, i in enumerate(chosen)] for chosen in permutations(range(n_rl), n_im)]
    return [list(enumerate(chosen)) for chosen in permutations(range(n_im), n_rl)]


def literal_projection(x: FloatArray, y: FloatArray, history: int = 10) -> IntArray:
    """Everything in Python: lists, one ``lstsq`` per hypothesis, one pixel error at a time; returns (n_im,)."""
    best: list[tuple[float, Pairs]] = [(float("inf"), [])] * (len(x) - history)
    for pairs in hypotheses(x.shape[1], y.shape[1]):
        rows = [x[t][i].tolist() for t in range(history) for i, _ in pairs]
        targets = [y[t][j].tolist() for t in range(history) for _, j in pairs]
        theta = np.linalg.lstsq(rows, targets, rcond=None)[0].tolist()
        for f in range(history, len(x)):
            error = 0.0
            for i, j in pairs:
                a, b, c = x[f][i].tolist()
                u = a * theta[0][0] + b * theta[1][0] + c * theta[2][0]
                v = a * theta[0][1] + b * theta[1][1] + c * theta[2][1]
                error += hypot(u - y[f][j][0], v - y[f][j][1])
            if error < best[f - history][0]:
                best[f - history] = (error, pairs)
    return _most(best, y.shape[1])


def projection_array_loop(x: FloatArray, y: FloatArray, history: int = 10) -> IntArray:
    """One hypothesis at a time, but arrays inside; returns (n_im,)."""
    best: list[tuple[float, Pairs]] = [(float("inf"), [])] * (len(x) - history)
    for pairs in hypotheses(x.shape[1], y.shape[1]):
        i, j = (np.array(side) for side in zip(*pairs, strict=True))
        X, Y = x[:history, i].reshape(-1, 3), y[:history, j].reshape(-1, 2)
        # θ = (XᵀX)⁻¹ XᵀY
        theta = np.linalg.inv(X.T @ X) @ X.T @ Y
        error = np.sum(np.linalg.norm(x[history:, i] @ theta - y[history:, j], axis=2), axis=1)
        for f, value in enumerate(error.tolist()):
            if value < best[f][0]:
                best[f] = (value, pairs)
    return _most(best, y.shape[1])


def _most(best: list[tuple[float, Pairs]], n_im: int) -> IntArray:
    """The hypothesis that won most frames; the first of equals."""
    votes = Counter(tuple(pairs) for _, pairs in best)
    winner = max(best, key=lambda one: votes[tuple(one[1])])[1]
    answer = np.full(n_im, -1, np.int64)
    for i, j in winner:
        answer[j] = i
    return answer


def angle_between(p: tuple[float, float], q: tuple[float, float]) -> float:
    """∠(p, q) by the law of cosines."""
    a, b, c = hypot(*p), hypot(*q), hypot(p[0] - q[0], p[1] - q[1])
    return acos(max(-1.0, min(1.0, (a * a + b * b - c * c) / (2.0 * a * b)))) if a * b > 0.0 else pi / 2.0


def literal_topology(
    image: FloatArray, front: FloatArray, world: FloatArray, heading: FloatArray, yaw: float
) -> tuple[FloatArray, IntArray]:
    """Costs (m, n) and vehicles (m,) from offsets (right, forward) and headings."""
    north, up = (sin(yaw), cos(yaw)), (0.0, 1.0)
    cost = np.zeros((len(image), len(world)))
    for j in range(len(image)):
        there = (float(image[j][0]), float(image[j][1]))
        alpha_j = angle_between(there, up)
        beta_j = angle_between(there, (sin(front[j]), cos(front[j])))
        for i in range(len(world)):
            here = (float(world[i][0]), float(world[i][1]))
            alpha_i = angle_between(here, north)
            beta_i = angle_between(here, (sin(heading[i]), cos(heading[i])))
            cost[j, i] = sqrt((alpha_i - alpha_j) ** 2 + (beta_i - beta_j) ** 2)
    return cost, _assigned(cost)


def literal_fusion(errors: FloatArray, cost: FloatArray) -> FloatArray:
    """Masses of both matrices and Dempster's rule, (m, n); for matrices without ties and full conflict."""
    first, second = _masses(errors), _masses(cost)
    fused = []
    for a, b in zip(first, second, strict=True):
        conflict = sum(a[k] * b[j] for k in range(len(a)) for j in range(len(b)) if k != j)
        row = [p * q / (1.0 - conflict) for p, q in zip(a, b, strict=True)]
        fused.append([value / sum(row) for value in row])
    return np.array(fused)


def _masses(cost: FloatArray) -> list[list[float]]:
    rows = cost.tolist()
    low, high = min(min(row) for row in rows), max(max(row) for row in rows)
    result = []
    for row in rows:
        good = [1.0 - (value - low) / (high - low) for value in row]
        total = sum(good)
        result.append([value / total if total > 0.0 else 1.0 / len(good) for value in good])
    return result


def literal_tts(image: FloatArray, world: FloatArray) -> tuple[FloatArray, IntArray]:
    """Similarity (m, n), best cyclic alignment, and the vehicles (m,) of the first step."""
    a, b = _sequences(image), _sequences(world)
    similarity = np.zeros((len(a), len(b)))
    for j, x in enumerate(a):
        for i, y in enumerate(b):
            short, long = (x, y) if len(x) <= len(y) else (y, x)
            norm = sum(triangle[0] for triangle in x) + sum(triangle[0] for triangle in y)
            similarity[j, i] = max(
                sum(_pair(p, long[(k + shift) % len(long)]) for k, p in enumerate(short)) / norm
                for shift in range(len(long))
            )
    return similarity, _assigned(-similarity)


def _pair(p: tuple[float, float, float], q: tuple[float, float, float]) -> float:
    d = sum(abs(u - v) for u, v in zip(p, q, strict=True))
    return (p[0] + q[0]) * (1.0 - log(1.0 + 1.72 * d / 180.0))


def _sequences(points: FloatArray) -> list[list[tuple[float, float, float]]]:
    """Around each point its triangles, anticlockwise; degrees at itself, the next and the previous corner."""
    around: list[list[tuple[float, tuple[float, float, float]]]] = [[] for _ in points]
    for simplex in Delaunay(points).simplices.tolist():
        for k, target in enumerate(simplex):
            p, q, r = (points[simplex[(k + step) % 3]].tolist() for step in range(3))
            if (q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0]) < 0.0:
                q, r = r, q
            corners = (_corner(p, q, r), _corner(q, r, p), _corner(r, p, q))
            middle = ((p[0] + q[0] + r[0]) / 3.0 - p[0], (p[1] + q[1] + r[1]) / 3.0 - p[1])
            around[target].append((atan2(middle[1], middle[0]), corners))
    return [_opened(sorted(triangles)) for triangles in around]


def _opened(
    triangles: list[tuple[float, tuple[float, float, float]]],
) -> list[tuple[float, float, float]]:
    """The sequence from behind the widest gap on."""
    directions = [direction for direction, _ in triangles]
    gaps = [(direction - directions[k - 1]) % (2.0 * pi) for k, direction in enumerate(directions)]
    start = gaps.index(max(gaps))
    return [corners for _, corners in triangles[start:] + triangles[:start]]


def _corner(p: list[float], q: list[float], r: list[float]) -> float:
    return degrees(angle_between((q[0] - p[0], q[1] - p[1]), (r[0] - p[0], r[1] - p[1])))


def _assigned(cost: FloatArray) -> IntArray:
    answer = np.full(len(cost), -1, np.int64)
    rows, columns = linear_sum_assignment(cost)
    answer[rows] = columns
    return answer


FRAMES, HEIGHT_M, FOCAL_PX = 12, 40.0, 1200.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Snap:
    """Input of the single-frame and the window methods."""

    x: FloatArray
    """(T, n, 3) vehicles minus UAV, metres."""
    y: FloatArray
    """(T, m, 2) pixels from the image centre, v downwards."""
    heading: FloatArray
    """(n,) reported."""
    front: FloatArray
    """(m,) clockwise from image up."""
    errors: FloatArray
    """(m, n) E of the last frame, pixels."""
    cost: FloatArray
    """(m, n) C of the last frame."""
    vehicle: IntArray
    """(m,) the truth."""


def snap(n: int, m: int, seed: int) -> Snap:
    """Vehicles that turn on their way, seen from straight above with 1 px and 0.5 m noise."""
    rng = np.random.default_rng([seed, n, m])
    side = 9.0 * np.sqrt(n)
    t = 0.1 * np.arange(FRAMES)[:, None]
    course = rng.uniform(-np.pi, np.pi, n) + rng.uniform(-0.4, 0.4, n) * t
    speed = rng.uniform(2.0, 6.0, n)
    step = 0.1 * speed[:, None] * np.stack([np.sin(course), np.cos(course)], axis=-1)
    xy = rng.uniform(-0.5 * side, 0.5 * side, (n, 2)) + np.cumsum(step, axis=0)
    vehicle = rng.permutation(n)[:m]
    y = FOCAL_PX / HEIGHT_M * xy[:, vehicle] * (1.0, -1.0) + rng.normal(0.0, 1.0, (FRAMES, m, 2))
    x = np.concatenate([xy, np.full((FRAMES, n, 1), -HEIGHT_M)], axis=2) + rng.normal(0.0, 0.5, (FRAMES, n, 3))
    noise = np.radians(3.0)
    heading, front = course[-1] + rng.normal(0.0, noise, n), course[-1, vehicle] + rng.normal(0.0, noise, m)
    theta = FOCAL_PX / HEIGHT_M * np.array([[1.0, 0.0], [0.0, -1.0], [0.0, 0.0]])
    world = topology_angles(x[-1, :, :2], heading)
    return Snap(
        x=x,
        y=y,
        heading=heading,
        front=front,
        errors=reprojection_errors(x[-1], y[-1], theta),
        cost=topology_cost(topology_angles(y[-1] * (1.0, -1.0), front), world),
        vehicle=vehicle,
    )


@pytest.mark.parametrize("size", [(4, 3), (5, 4), (5, 5)])
def test_projection_is_that_of_the_loops_written_out(size):
    for seed in range(2):
        s = snap(*size, seed)
        ours = associate_by_projection(s.x, s.y).vehicle.tolist()
        assert literal_projection(s.x, s.y).tolist() == ours
        assert projection_array_loop(s.x, s.y).tolist() == ours


def test_surplus_boxes_are_left_out_as_in_the_loops():
    s = snap(4, 4, 1)
    x = s.x[:, :3]
    ours = associate_by_projection(x, s.y).vehicle.tolist()
    assert ours.count(-1) == 1
    assert literal_projection(x, s.y).tolist() == projection_array_loop(x, s.y).tolist() == ours


def test_topology_and_fusion_are_those_of_the_loops_written_out():
    s = snap(7, 6, 3)
    image, world = s.y[-1] * (1.0, -1.0), s.x[-1, :, :2]
    cost, answer = literal_topology(image, s.front, world, s.heading, 0.4)
    ours = topology_cost(topology_angles(image, s.front), topology_angles(world, s.heading, 0.4))
    np.testing.assert_allclose(ours, cost, atol=1e-9)
    assert associate_by_topology(ours).tolist() == answer.tolist()
    np.testing.assert_allclose(fuse(masses(s.errors), masses(s.cost)), literal_fusion(s.errors, s.cost), atol=1e-12)


@pytest.mark.parametrize("size", [(4, 4), (9, 6), (5, 9)])
def test_triangular_sequences_are_compared_as_in_the_loops(size):
    for seed in range(6):
        rng = np.random.default_rng(seed)
        image, world = (
            10.0 * rng.permutation(np.argwhere(np.ones((6, 6))))[:n] + rng.uniform(-3, 3, (n, 2)) for n in size
        )
        similarity, answer = literal_tts(image, world)
        np.testing.assert_allclose(tts_similarity(image, world), similarity, atol=1e-9)
        assert associate_by_tts_once(similarity).tolist() == answer.tolist()
