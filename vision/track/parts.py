"""Boxes round the front and the rear of one vehicle, put together again.

A detector that has learnt shorter vehicles sees two in a long one, now and then. Two boxes in one line that touch are
one vehicle where together they are as long as many vehicles here.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vision.detect.boxes import wrap
from vision.detect.detections import FIELDS, Detections

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

REMEMBERED_S = 30.0
"""Time constant with which lengths that were seen are forgotten, s."""
BIN, SHORTEST_M, LONGEST_M = 0.05, 0.2, 40.0
"""Width of a class of lengths, of their ln, and the range of the classes, m."""
ALIKE = 0.15
"""Lengths whose ln differ by no more are alike: a detector's boxes vary by a tenth."""
MIN_SHARE, MIN_AGAINST_PARTS = 0.2, 0.35
"""Least share of all boxes that must be as long as the whole, and least ratio to those as long as a part: vehicles
that are two boxes for a third of the time give as many of one as of the other."""
GAP, ASIDE = 0.22, 0.3
"""Space between parts, or overlap, along the line, in their mean length; and off it, in the length of one."""
TURNED = float(np.deg2rad(20.0))
"""Angle that a part may be turned from the line."""
WIDTHS = 0.25
"""Difference of the ln of their widths up to which two boxes are parts of one vehicle."""


@dataclass(frozen=True, slots=True)
class JoinedBoxes:
    """The boxes of a frame, one for each two that are parts of one vehicle."""

    boxes: Detections
    """(k,) in the order of their first parts."""
    first: Ints
    """(k,) row of each among the boxes of the frame; of one that was put together, of its first part."""
    second: Ints
    """(k,) row of the other part of each that was put together; −1 none."""


class PartJoiner:
    """Learns how long vehicles are here, and puts the parts of one together."""

    def __init__(self) -> None:
        self._weight = np.zeros(int(np.ceil(np.log(LONGEST_M / SHORTEST_M) / BIN)) + 1)
        """Time for which each class of lengths was seen, s."""
        self._t_us: int | None = None

    def join(self, t_us: int, boxes: Detections, pixel_m: Floats, least_score: float) -> JoinedBoxes:
        """Put the parts of vehicles together.

        Args:
            t_us: when the frame was taken.
            boxes: (m,) of the frame.
            pixel_m: (m, 2, 2) what a pixel right and down is at each on the ground, m.
            least_score: Weaker boxes are left as they are, and nothing is learnt from them.
        """
        dt = 0.1 if self._t_us is None else min(max(t_us - self._t_us, 0) / 1e6, 1.0)
        self._t_us = t_us
        self._weight *= np.exp(-dt / REMEMBERED_S)
        length, width = np.maximum(boxes.w, boxes.h), np.minimum(boxes.w, boxes.h)
        scale = _along(pixel_m, _axis(boxes))
        strong = np.flatnonzero((boxes.score >= least_score) & np.isfinite(scale) & (length > 0.0))
        touching = _touching(boxes, length, width, strong)
        now = self._weight + self._counted((length * scale)[strong], dt) if touching else self._weight
        pairs = []
        for i, j, whole in touching:
            line = float(np.arctan2(*(boxes.centre[j] - boxes.centre[i])[::-1]))
            if self._makes_one(now, np.array([whole, length[i], length[j]]) * _along(pixel_m[i], line)):
                pairs.append((i, j, whole))
        second = np.full(len(boxes), -1)
        for i, j, whole in pairs:
            second[i], length[i] = j, whole
        begins = np.ones(len(boxes), np.bool_)
        begins[second[second >= 0]] = False
        first, counted = np.flatnonzero(begins), strong[begins[strong]]
        self._weight += self._counted((length * scale)[counted], dt)
        whole_boxes = _replaced(boxes, width, pairs) if pairs else boxes
        return JoinedBoxes(whole_boxes.select(first) if pairs else boxes, first, second[first])

    def _counted(self, length_m: Floats, dt: float) -> Floats:
        """(K,) what boxes of these lengths add to each class in a time."""
        return np.asarray(np.bincount(_class_of(length_m), minlength=len(self._weight)) * dt, np.float64)

    def _makes_one(self, weight: Floats, length_m: Floats) -> bool:
        """Tell whether a vehicle is rather as long as the first of three lengths than as the two parts of it."""
        reach = round(ALIKE / BIN)
        whole, *parts = (float(np.sum(weight[max(k - reach, 0) : k + reach + 1])) for k in _class_of(length_m).tolist())
        return whole >= MIN_SHARE * float(np.sum(weight)) and whole >= MIN_AGAINST_PARTS * max(parts)


def _class_of(length_m: Floats) -> NDArray[np.int64]:
    bounded = np.clip(length_m, SHORTEST_M, LONGEST_M)
    return np.round(np.log(bounded / SHORTEST_M) / BIN).astype(np.int64)


def _along(pixel_m: Floats, angle: Floats | float) -> Floats:
    """(…) metres of a pixel in the direction of an angle (…), rad, of what pixels are on the ground (…, 2, 2), m."""
    step = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    return np.asarray(np.hypot(*np.moveaxis(np.sum(pixel_m * step[..., None, :], axis=-1), -1, 0)))


def _axis(boxes: Detections) -> Floats:
    """(m,) direction of the longer sides, rad, modulo π."""
    return np.asarray(boxes.angle + 0.5 * np.pi * (boxes.h > boxes.w))


def _touching(
    all_boxes: Detections, all_lengths: Floats, all_widths: Floats, rows: Ints
) -> list[tuple[int, int, float]]:
    """Pairs of some boxes in one line that touch, the nearest first, no box twice; how long they are together, px."""
    if len(rows) < 2:
        return []
    centre, length, width = all_boxes.centre[rows], all_lengths[rows], all_widths[rows]
    offset = centre[None] - centre[:, None]
    away = np.hypot(offset[..., 0], offset[..., 1])
    mean = 0.5 * (length[:, None] + length[None])
    i, j = np.nonzero(np.triu(np.abs(away - mean) < GAP * mean, 1))
    width = np.maximum(width, 1.0)
    alike = np.abs(np.log(width[i] / width[j])) < WIDTHS
    i, j = i[alike], j[alike]
    if not len(i):
        return []
    line, axis = np.arctan2(offset[i, j, 1], offset[i, j, 0]), _axis(all_boxes)[rows]
    # a half may be wider than long: its box's axis is either side
    turned = np.maximum(*(_between(line, axis[k], length[k] / width[k]) for k in (i, j)))
    aside = away[i, j] * np.sin(turned)
    good = (turned < TURNED) & (aside < ASIDE * length[i])
    found, taken = [], set[int]()
    for k in np.argsort(away[i, j] + np.where(good, 0.0, np.inf), kind="stable").tolist():
        a, b = int(i[k]), int(j[k])
        if not good[k]:
            break
        if a not in taken and b not in taken:
            taken |= {a, b}
            found.append((int(rows[a]), int(rows[b]), float(away[a, b] + mean[a, b])))
    return found


def _between(line: Floats, axis: Floats, elongation: Floats) -> Floats:
    """Angle between lines and boxes' axes, rad, 0 to π/2; of boxes that are nearly square to the nearer side."""
    off = np.abs(wrap(2.0 * (line - axis))) / 2.0
    return np.where(elongation < 1.15, np.minimum(off, 0.5 * np.pi - off), off)


def _replaced(boxes: Detections, width: Floats, pairs: list[tuple[int, int, float]]) -> Detections:
    """The boxes with that round each pair in the place of its first."""
    table, length = boxes.table.copy(), np.maximum(boxes.w, boxes.h)
    for i, j, _ in pairs:
        offset = boxes.centre[j] - boxes.centre[i]
        away = float(np.hypot(*offset))
        direction = offset / away
        # the ends of both along the line
        start, stop = -0.5 * length[i], away + 0.5 * length[j]
        front = boxes.heading[i] if boxes.score[i] >= boxes.score[j] else boxes.heading[j]
        front = front if np.isfinite(front) else np.nanmax([boxes.heading[i], boxes.heading[j], -np.inf])
        angle = float(np.arctan2(direction[1], direction[0]))
        if np.isfinite(front) and np.cos(front - 0.5 * np.pi - angle) < 0.0:
            angle += np.pi
        table[:2, i] = boxes.centre[i] + direction * 0.5 * (start + stop)
        table[2:5, i] = stop - start, max(width[i], width[j]), wrap(angle)
        table[5, i] = max(boxes.score[i], boxes.score[j])
        table[6, i] = (angle + 0.5 * np.pi) % (2 * np.pi) if np.isfinite(front) else np.nan
    return Detections(**dict(zip(FIELDS, table, strict=True)), looked=boxes.looked)
