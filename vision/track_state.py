"""What is known of every track, as a struct of arrays, and how it moves on in time and with the camera."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from vision import kalman
from vision.detections import Detections

__all__ = ["TrackState"]

Floats = NDArray[np.float64]
Indices = NDArray[np.intp]

SIZE_TIME_S = 0.5
"""Time constant of the smoothed sides."""
AXIS_TIME_S = 0.12
"""Time constant of the smoothed axis."""
VOTES = 5.0
"""Most votes for a front that are remembered: a turned front is believed after about as many sightings."""
NEARLY_SQUARE = 1.4
"""Ratio of sides below which width and length may have been taken for each other."""


@dataclass(slots=True, kw_only=True)
class TrackState:
    """k tracks in order of their ids."""

    track_id: NDArray[np.int64]
    x: Floats
    """(k, 4) centre px and velocity px/s."""
    P: Floats
    """(k, 4, 4)"""
    sides: Floats
    """(k, 2) w, h px."""
    axis: Floats
    """(k,) rad, box angle without jumps."""
    front: Floats
    """(k,) votes for the front along the axis (positive) or against; 0: never known."""
    score: Floats
    hits: NDArray[np.int64]
    age_s: Floats
    gap_s: Floats
    detection: Indices
    """(k,) index into this picture's detections, -1 unseen."""

    @classmethod
    def start(cls, boxes: Detections, index: Indices, first_id: int, noise: Floats, speed: Floats) -> TrackState:
        """New tracks on the detections at ``index`` (k,), numbered from ``first_id``."""
        seen, k = boxes.take(index), len(index)
        x, P = kalman.initial(seen.centre, noise, speed)
        return cls(
            track_id=np.arange(first_id, first_id + k, dtype=np.int64),
            x=x,
            P=P,
            sides=np.stack([seen.w, seen.h], axis=-1),
            axis=seen.angle.copy(),
            front=_vote(seen.heading, seen.angle),
            score=seen.score.copy(),
            hits=np.ones(k, dtype=np.int64),
            age_s=np.zeros(k),
            gap_s=np.zeros(k),
            detection=np.asarray(index, dtype=np.intp),
        )

    @classmethod
    def none(cls) -> TrackState:
        """No tracks."""
        return cls.start(Detections.empty(), np.empty(0, dtype=np.intp), 1, np.empty(0), np.empty(0))

    def __len__(self) -> int:
        return len(self.track_id)

    @property
    def length(self) -> Floats:
        """Size of a box in one number, (k,) px: √(w h), at least a pixel."""
        return np.maximum(np.sqrt(self.sides[:, 0] * self.sides[:, 1]), 1.0)

    @property
    def boxes(self) -> Floats:
        """Rows cx cy w h angle, (k, 5)."""
        return np.concatenate([self.x[:, :2], self.sides, self.axis[:, None]], axis=1)

    @property
    def heading(self) -> Floats:
        """Voted front, (k,) rad clockwise from image up, NaN when none was ever seen."""
        turned = self.axis + np.where(self.front < 0, 1.5 * np.pi, 0.5 * np.pi)
        return np.where(self.front == 0, np.nan, turned % (2 * np.pi))

    def keep(self, mask: NDArray[np.bool_]) -> TrackState:
        """The tracks of a mask (k,)."""
        return TrackState(**{f.name: getattr(self, f.name)[mask] for f in fields(self)})

    def join(self, other: TrackState) -> TrackState:
        """These and then those."""
        return TrackState(
            **{f.name: np.concatenate([getattr(self, f.name), getattr(other, f.name)]) for f in fields(self)}
        )

    def predict(self, dt: float, wander: Floats) -> None:
        """Move on by ``dt`` seconds, unseen until corrected; ``wander`` (k,) px/s as in the filter."""
        self.x, self.P = kalman.predict(self.x, self.P, dt, wander)
        self.age_s = self.age_s + dt
        self.gap_s = self.gap_s + dt
        self.detection = np.full(len(self), -1, dtype=np.intp)

    def warp(self, H: Floats) -> None:
        """Follow the camera: H (3, 3) leads from the picture before to this one."""
        J = kalman.jacobian(H, self.x[:, :2])
        along = np.stack([np.cos(self.axis), np.sin(self.axis)], axis=-1)
        across = np.stack([-along[:, 1], along[:, 0]], axis=-1)
        moved, aside = (J @ along[:, :, None])[:, :, 0], (J @ across[:, :, None])[:, :, 0]
        self.axis = self.axis + _half_turns(np.arctan2(moved[:, 1], moved[:, 0]) - self.axis, 2 * np.pi)
        self.sides = self.sides * np.stack([np.linalg.norm(moved, axis=1), np.linalg.norm(aside, axis=1)], axis=-1)
        self.x, self.P = kalman.warp(self.x, self.P, H)

    def correct(self, rows: Indices, boxes: Detections, index: Indices, noise: Floats) -> None:
        """Tracks ``rows`` (q,) are seen as the detections ``index`` (q,); ``noise`` (q,) px of their centres."""
        seen = boxes.take(index)
        self.x[rows], self.P[rows] = kalman.correct(self.x[rows], self.P[rows], seen.centre, noise)
        self._shape(rows, seen)
        self._seen(rows, index, seen.score)

    def restart(self, rows: Indices, boxes: Detections, index: Indices, noise: Floats, speed: Floats) -> None:
        """Tracks ``rows`` (q,) are found again elsewhere: as new in motion, the same in id and age."""
        seen = boxes.take(index)
        self.x[rows], self.P[rows] = kalman.initial(seen.centre, noise, speed)
        self.sides[rows] = np.stack([seen.w, seen.h], axis=-1)
        self.axis[rows], self.front[rows] = seen.angle, _vote(seen.heading, seen.angle)
        self._seen(rows, index, seen.score)

    def _seen(self, rows: Indices, index: Indices, score: Floats) -> None:
        self.score[rows] = score
        self.hits[rows] += 1
        self.gap_s[rows] = 0.0
        self.detection[rows] = index

    def _shape(self, rows: Indices, seen: Detections) -> None:
        """Sides and axis move towards what is seen, the front by majority."""
        sides, angle = np.array([seen.w, seen.h]).T, seen.angle
        turn = _half_turns(angle - self.axis[rows], np.pi)
        swapped = (np.abs(turn) > np.pi / 4) & np.isnan(seen.heading)
        if swapped.any():
            swapped &= sides.max(axis=1) < NEARLY_SQUARE * np.maximum(sides.min(axis=1), 1e-9)
            sides = np.where(swapped[:, None], sides[:, ::-1], sides)
            turn = np.where(swapped, _half_turns(turn + np.pi / 2, np.pi), turn)
        gap = self.gap_s[rows]
        # a gain of 1/hits at first, 1 − e^(−dt/τ) in the long run
        early = 1.0 / (self.hits[rows] + 1)
        self.axis[rows] += np.maximum(early, 1 - np.exp(-gap / AXIS_TIME_S)) * turn
        gain = np.maximum(early, 1 - np.exp(-gap / SIZE_TIME_S))
        self.sides[rows] += gain[:, None] * (sides - self.sides[rows])
        votes = self.front[rows] + _vote(seen.heading, self.axis[rows])
        # a draw goes to what was believed before
        votes = np.where(votes == 0, 0.5 * np.sign(self.front[rows]), votes)
        self.front[rows] = np.clip(votes, -VOTES, VOTES)


def _vote(heading: Floats, axis: Floats) -> Floats:
    """+1 for a front along the axis, -1 against it, 0 unknown."""
    ahead = np.where(np.cos(heading - np.pi / 2 - axis) >= 0, 1.0, -1.0)
    return np.where(np.isnan(heading), 0.0, ahead)


def _half_turns(angle: Floats, period: float) -> Floats:
    """The same angle modulo ``period``, nearest to 0."""
    return np.asarray((angle + period / 2) % period - period / 2)
