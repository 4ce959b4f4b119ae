"""A model of an oriented detector: the detections it would return for a frame, and the true body of each."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim.world.boxes import Boxes, in_image, true_boxes, visible_share
from sim.world.motion import wrapped
from sim.world.scenario import Scenario
from sim.world.view import OCCLUDER, UGV, Bodies, CameraView
from sim.world.world import World, random_stream

FloatArray = NDArray[np.float64]
SCORE = 5
"""Column of the score."""
HIDDEN_SHARE = 0.5
"""Visible share below which a body is not detected, and is not in the truth of a rendered frame."""
WEAK_SCORES = (0.1, 0.29)
"""Range of scores that are too low to count."""
SPREAD = 0.1
"""Share by which the distance of merging varies from frame to frame."""
PARTS_APART = 0.4
"""Distance between the centres of a vehicle's front and rear, in its lengths; each is half as long as the whole."""
_Span = tuple[int, float, float]
"""A body, and the seconds from and until which a state of it lasts."""


def merged_boxes(
    values: FloatArray, seen: NDArray[np.bool_], lengths: float, rng: np.random.Generator
) -> tuple[FloatArray, NDArray[np.bool_]]:
    """One box for two neighbours that are too near to be separated.

    Args:
        values: (n, 7) cx, cy, w, h, angle, score, heading.
        seen: (n,) the rows that are detected at all.
        lengths: boxes merge below about this distance, in lengths (mean w) of the pair.

    Returns:
        values and seen. The row that stays is the longer one of the pair, with its axis and heading, and now holds
        both; the other is unseen.
    """
    values, seen = values.copy(), seen.copy()
    limit = lengths * (1.0 + SPREAD * rng.normal())
    rows = np.flatnonzero(seen)
    away = np.linalg.norm(values[rows, None, :2] - values[None, rows, :2], axis=-1)
    reach = limit * 0.5 * (values[rows, None, 2] + values[None, rows, 2])
    pairs = np.argwhere(np.triu(away < reach, 1))
    for a, b in pairs[np.argsort(away[tuple(pairs.T)], kind="stable")]:
        i, j = sorted((int(rows[a]), int(rows[b])), key=lambda row: -float(values[row, 2]))
        if seen[i] and seen[j]:
            values[i, :4] = _round_both(values[i], values[j])
            seen[j] = False
    return values, seen


def _round_both(first: FloatArray, second: FloatArray) -> FloatArray:
    """Centre and sides of the box along the first one's axis that holds both."""
    along = np.array([np.cos(first[4]), np.sin(first[4])])
    axes = np.stack([along, [-along[1], along[0]]])
    places = np.concatenate([_corners(first), _corners(second)]) @ axes.T
    middle = 0.5 * (places.min(axis=0) + places.max(axis=0))
    return np.concatenate([middle @ axes, np.ptp(places, axis=0)])


def _corners(box: FloatArray) -> FloatArray:
    """(4, 2) pixels."""
    c, s = np.cos(box[4]), np.sin(box[4])
    half = 0.5 * np.array([(1, 1), (1, -1), (-1, -1), (-1, 1)]) * box[2:4]
    return np.asarray(box[:2] + half @ np.array([[c, s], [-s, c]]))


def in_parts(values: FloatArray, two: NDArray[np.bool_]) -> FloatArray:
    """Boxes of front and rear in place of those that are found in two parts.

    Args:
        values: (m, 7) cx, cy, w, h, angle, score, heading.
        two: (m,) the rows that are two boxes.

    Returns:
        (m + k, 7) the k fronts in place of the whole, the rears last.
    """
    whole, rear = values.copy(), values[two]
    ahead = 0.5 * PARTS_APART * rear[:, 2:3] * np.stack([np.cos(rear[:, 4]), np.sin(rear[:, 4])], axis=-1)
    rear[:, 2] *= 0.5
    whole[two] = rear
    whole[two, :2] += ahead
    rear[:, :2] -= ahead
    return np.concatenate([whole, rear])


@dataclass(frozen=True, slots=True, kw_only=True)
class DetectedRows:
    """m detections of one frame, in random order."""

    values: FloatArray
    """(m, 7) cx, cy, w, h, angle, score, heading; heading NaN unknown."""
    system_id: NDArray[np.int64]
    """(m,) 0 for clutter and bodies without a system id."""
    body: NDArray[np.int64]
    """(m,) body, in the order of ``World.roles``; −1 clutter."""


class DetectorModel:
    """Detections with noise, misses, flipped headings and clutter; reproducible if frames are requested in order."""

    def __init__(self, world: World) -> None:
        self._world = world
        self._rng = random_stream(world.scenario, "detector")
        self._merging = random_stream(world.scenario, "merging")
        self._missing = random_stream(world.scenario, "missing")
        self._weak = random_stream(world.scenario, "weak")
        self._missed = np.zeros(len(world.roles.role) + len(world.scenario.occlusions), dtype=bool)
        self._looked_at = -np.inf
        n = len(world.roles.role)
        self._lost = _bursts(world.scenario, n) + _never_found(world.scenario)
        self._parts = _part_runs(world.scenario, np.flatnonzero(world.roles.kind == UGV).tolist())

    def detect(self, t: float) -> DetectedRows:
        """Detections of the frame exposed t seconds after the first."""
        settings, rng = self._world.scenario.detector, self._rng
        view, bodies = self._world.view(t), self._world.bodies(t)
        boxes = true_boxes(view, bodies)
        n = len(bodies.kind)
        noise = rng.normal(0.0, 1.0, (5, n))
        luck = rng.random((3, n))
        missed = self._misses(t, luck[0])
        weak = missed & (self._weak.random(n) < settings.weak)
        seen = _visible(view, bodies, boxes) & (~missed | weak) & ~_during(self._lost, t, n)
        clutter = np.concatenate([self._clutter(int(rng.poisson(settings.clutter)), rng), self._weak_clutter()])
        if any(b.start_s <= t < b.stop_s for b in self._world.scenario.blackouts):
            none = np.empty(0, dtype=np.int64)
            return DetectedRows(values=np.empty((0, 7)), system_id=none, body=none)
        rows = self._rows(boxes, noise, luck)
        rows[weak, SCORE] = self._weak.uniform(*WEAK_SCORES, int(np.count_nonzero(weak)))
        if settings.merge_lengths > 0.0:
            rows, seen = merged_boxes(rows, seen, settings.merge_lengths, self._merging)
        found, two = np.flatnonzero(seen), _during(self._parts, t, n)
        rows, found = in_parts(rows[found], two[found]), np.concatenate([found, found[two[found]]])
        system_id = np.zeros(n, dtype=np.int64)
        system_id[: len(self._world.roles.system_id)] = self._world.roles.system_id
        values = np.concatenate([rows, clutter])
        ids = np.concatenate([system_id[found], np.zeros(len(clutter), dtype=np.int64)])
        body = np.concatenate([found, np.full(len(clutter), -1)])
        order = rng.permutation(len(values))
        return DetectedRows(values=values[order], system_id=ids[order], body=body[order])

    def _rows(self, boxes: Boxes, noise: FloatArray, luck: FloatArray) -> FloatArray:
        settings = self._world.scenario.detector
        spread = np.hypot(settings.pixel_noise, settings.size_noise * np.sqrt(boxes.w * boxes.h))
        cx = boxes.cx + spread * noise[0]
        cy = boxes.cy + spread * noise[1]
        w = np.maximum(boxes.w + spread * noise[2], 2.0)
        h = np.maximum(boxes.h + spread * noise[3], 2.0)
        flipped = luck[1] < settings.flip
        angle = wrapped(boxes.angle + np.radians(settings.angle_noise_deg) * noise[4] + np.pi * flipped)
        score = _score(luck[2], settings.score)
        return _oriented(cx, cy, w, h, angle, score, settings.heading_missing)

    def _weak_clutter(self) -> FloatArray:
        rows = self._clutter(int(self._weak.poisson(self._world.scenario.detector.weak_clutter)), self._weak)
        rows[:, SCORE] = self._weak.uniform(*WEAK_SCORES, len(rows))
        return rows

    def _clutter(self, m: int, rng: np.random.Generator) -> FloatArray:
        camera, settings = self._world.scenario.camera, self._world.scenario.detector
        draws = rng.random((6, m))
        scale = camera.fx / self._world.scenario.flight.height_m
        return _oriented(
            draws[0] * camera.width,
            draws[1] * camera.height,
            scale * (0.8 + 2.5 * draws[2]),
            scale * (0.6 + 1.2 * draws[3]),
            wrapped(2.0 * np.pi * draws[4]),
            _score(draws[5], max(0.35, settings.score - 0.3)),
            settings.heading_missing,
        )

    def _misses(self, t: float, luck: FloatArray) -> NDArray[np.bool_]:
        """(n,) whether each body is missed, from uniform draws or as a two-state Markov process in time."""
        settings = self._world.scenario.detector
        if settings.miss_run_s == 0.0 or settings.miss in (0.0, 1.0):
            return luck < settings.miss
        # p(t + Δt) = m + (missed(t) − m) e^(−Δt (a + b)),  a = 1/run,  b = a m / (1 − m)
        kept = np.exp(-(t - self._looked_at) / settings.miss_run_s / (1.0 - settings.miss))
        chance = settings.miss + (self._missed - settings.miss) * kept
        self._missed, self._looked_at = self._missing.random(len(luck)) < chance, t
        return self._missed


def _visible(view: CameraView, bodies: Bodies, boxes: Boxes) -> NDArray[np.bool_]:
    """(n,) whether a body is in the image and not hidden by others."""
    unhidden = visible_share(view, bodies) > HIDDEN_SHARE
    return np.asarray(in_image(view, boxes) & unhidden & (bodies.kind != OCCLUDER))


def truth_rows(world: World, t: float, *, ours: bool = True) -> list[str]:
    """``cx,cy,w,h,angle,system_id`` of everything visible at time t; ids 0 if its vehicles are not ours."""
    view, bodies = world.view(t), world.bodies(t)
    boxes = true_boxes(view, bodies)
    rows = np.flatnonzero(_visible(view, bodies, boxes))
    columns = np.stack([boxes.cx, boxes.cy, boxes.w, boxes.h, boxes.angle], axis=-1)[rows].tolist()
    ids = world.roles.system_id[rows] if ours else np.zeros(len(rows), np.int64)
    return [
        f"{cx:.2f},{cy:.2f},{w:.2f},{h:.2f},{angle:.4f},{name}"
        for (cx, cy, w, h, angle), name in zip(columns, ids.tolist(), strict=True)
    ]


def _oriented(
    cx: FloatArray, cy: FloatArray, w: FloatArray, h: FloatArray, angle: FloatArray, score: FloatArray, no_front: bool
) -> FloatArray:
    # heading = angle + π/2 (mod 2π); a detector without fronts knows the axis only, angle in [−π/2, π/2)
    heading = np.full_like(angle, np.nan) if no_front else wrapped(angle + np.pi / 2.0)
    axis = (angle + np.pi / 2.0) % np.pi - np.pi / 2.0 if no_front else angle
    return np.stack([cx, cy, w, h, axis, score, heading], axis=-1)


def _score(u: FloatArray, mean: float) -> FloatArray:
    """Scores about the mean, from uniform draws: a triangle of half-width 0.2 inside 0.05..0.99."""
    triangle = np.where(u < 0.5, np.sqrt(2.0 * u) - 1.0, 1.0 - np.sqrt(2.0 * (1.0 - u)))
    return np.clip(mean + 0.2 * triangle, 0.05, 0.99)


def _during(spans: list[_Span], t: float, n: int) -> NDArray[np.bool_]:
    """(n,) the bodies that are within one of their spans at time t."""
    now = np.zeros(n, dtype=bool)
    for body, start, stop in spans:
        now[body] |= start <= t < stop
    return now


def _never_found(scenario: Scenario) -> list[_Span]:
    """Vehicles of ours that no frame shows."""
    order = random_stream(scenario, "never found").permutation(scenario.fleet_size).tolist()
    return [(body, -np.inf, np.inf) for body in order[: scenario.detector.never_found]]


def _part_runs(scenario: Scenario, bodies: list[int]) -> list[_Span]:
    """Runs in which vehicles are found in two parts, with pauses between them, all of random length."""
    share, run_s = scenario.detector.parts, scenario.detector.parts_run_s
    if share == 0.0:
        return []
    rng, spans, pause_s = random_stream(scenario, "parts"), list[_Span](), run_s * (1.0 - share) / share
    for body in bodies:
        stop = -float(rng.exponential(run_s + pause_s))
        while stop < scenario.duration_s:
            start = stop + float(rng.exponential(pause_s))
            stop = start + float(rng.exponential(run_s))
            spans.append((body, start, stop))
    return spans


def _bursts(scenario: Scenario, n: int) -> list[_Span]:
    settings = scenario.detector
    rng = random_stream(scenario, "bursts")
    counts = rng.poisson(settings.bursts_per_min * scenario.duration_s / 60.0, n)
    starts = [(body, rng.uniform(0.0, scenario.duration_s)) for body, count in enumerate(counts) for _ in range(count)]
    return [(body, start, start + rng.uniform(settings.burst_min_s, settings.burst_max_s)) for body, start in starts]
