"""State of all tracks, as one table, and how it moves on in time and with the camera."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vision.detect.detections import Detections
from vision.track import kalman
from vision.track.fronts import front_of, vote_of, votes_after, way_after

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Indices = NDArray[np.intp]
Flags = NDArray[np.bool_]

SIZE_TIME_S = 0.5
"""Time constant of the smoothed sides."""
ENOUGH = 2.5
"""Evidence from which on a track is reported, nats. Raise → fewer tracks on nothing; lower → sooner ones."""
MAX_SKIPPED_S = 1.0
"""Longest time without a look that does not count as out of sight: by then a track may be anywhere."""
CONFIRM_HITS = 2
"""Fewest frames that confirm: what looks most like a vehicle may still be none."""
AXIS_TIME_S = 0.12
"""Time constant of the smoothed axis."""
NEARLY_SQUARE = 1.4
"""Ratio of sides below which width and length may have been confused."""

RATES = -1.0 / np.array([[SIZE_TIME_S], [SIZE_TIME_S], [AXIS_TIME_S]])
"""Smoothing of the rows SHAPE, 1/s, with its sign turned."""

# rows of the table: with everything in one array each step is a few calls, whatever the number of tracks
X, SIDES, SHAPE, AGES, REPORTED, WHOLE, COVARIANCE, EXPECTED = (
    slice(*ends) for ends in ((0, 4), (4, 6), (4, 7), (10, 12), (0, 12), (12, 15), (15, 31), (31, 33))
)
SHARED, WAY, EVIDENCE, SKIPPED, SKIPPED_S = range(33, 38)
W, H, AXIS, LENGTH, FRONT, SCORE, AGE, GAP, TRACK_ID, DETECTION, HITS = range(4, 15)
ROWS = 38
"""Rows of the table."""
SPEED_VARIANCES = COVARIANCE.start + 10, COVARIANCE.start + 15
BOX = np.array([0, 1, W, H, AXIS])
"""Rows that make up a box."""
# rows of a detections' table
SEEN_SHAPE, SEEN_SCORE, SEEN_HEADING = slice(2, 5), 5, 6


class TrackState:
    """k tracks in order of their ids.

    The rows of its table (38, k): centre px and velocity px/s; sides px and axis, an angle without jumps; length
    √(w h) px, at least one; votes for the front along the axis (positive) or against (0: none); score; seconds
    since first and since last seen; in whole numbers the id, the index into this frame's detections (-1 unseen) and
    the frames in which it was seen; the covariance of the first four; the centre expected in this frame, px, NaN where
    there was none; seconds for which it shared boxes since it last had one of its own; the way that it went along its
    axis, lengths; evidence that it is of a vehicle, nats; whether nobody looked for it in this frame (1), and for how
    long of the time since it was last seen nobody did, seconds.
    """

    __slots__ = ("table",)

    def __init__(self, table: Floats) -> None:
        self.table = table

    @classmethod
    def start(cls, boxes: Detections, index: Indices, first_id: int, noise: Floats, speed: Floats) -> TrackState:
        """New tracks on the detections at ``index`` (k,), numbered from ``first_id``."""
        table, seen = np.zeros((ROWS, len(index))), boxes.table.take(index, axis=1)
        table[TRACK_ID] = np.arange(first_id, first_id + len(index))
        _place(table, seen, noise, speed)
        _mark_seen(table, seen, index)
        return cls(table)

    @classmethod
    def none(cls) -> TrackState:
        """No tracks."""
        return cls(np.empty((ROWS, 0)))

    def __len__(self) -> int:
        return int(self.table.shape[1])

    @property
    def x(self) -> Floats:
        """(k, 4) centre px and velocity px/s; may be written to."""
        return self.table[X].T

    @property
    def P(self) -> Floats:  # noqa: N802 - the covariance has this name everywhere
        """(k, 4, 4) covariance of x."""
        return _square(self.table)

    @property
    def boxes(self) -> Floats:
        """Rows cx cy w h angle, (k, 5)."""
        return self.table.take(BOX, axis=0).T

    @property
    def length(self) -> Floats:
        """Size of a box in one number, (k,) px: √(w h), at least a pixel."""
        return self.table[LENGTH, :]

    @property
    def expected(self) -> Floats:
        """(k, 2) px where it was expected in this frame, NaN where it starts again; read-only copy."""
        expected = self.table[EXPECTED].T.copy()
        expected.setflags(write=False)
        return expected

    @property
    def age_s(self) -> Floats:
        """(k,) since first seen."""
        return self.table[AGE, :]

    @property
    def gap_s(self) -> Floats:
        """(k,) since last seen."""
        return self.table[GAP, :]

    @property
    def missed_s(self) -> Floats:
        """(k,) how much of the time since it was last seen it was looked for."""
        return np.asarray(self.table[GAP] - self.table[SKIPPED_S])

    @property
    def skipped(self) -> Flags:
        """(k,) those that nobody looked for in this frame."""
        return np.asarray(self.table[SKIPPED] > 0.0)

    @property
    def shared_s(self) -> Floats:
        """(k,) for how long it shared boxes with other tracks since it last had one of its own."""
        return self.table[SHARED, :]

    @property
    def evidence(self) -> Floats:
        """(k,) that it is of a vehicle, nats; may be written to."""
        return self.table[EVIDENCE, :]

    @property
    def confirmed(self) -> Flags:
        """(k,) enough speaks for it, and more than one box."""
        return (self.table[EVIDENCE, :] >= ENOUGH) & (self.table[HITS, :] >= CONFIRM_HITS)

    @property
    def score(self) -> Floats:
        """(k,) of the last box."""
        return self.table[SCORE, :]

    @property
    def unseen(self) -> Flags:
        """(k,) no detection of this frame is its."""
        return self.table[DETECTION, :] < 0.0

    @property
    def track_id(self) -> Ints:
        """(k,) from 1."""
        return self.table[TRACK_ID, :].astype(np.int64)

    @property
    def detection(self) -> Indices:
        """(k,) index into this frame's detections, -1 unseen."""
        return self.table[DETECTION, :].astype(np.intp)

    @property
    def front(self) -> Floats:
        """(k,) positive where the front is along the axis, negative where it is against it, 0 unknown."""
        return front_of(self.table[FRONT, :], self.table[WAY, :])

    @property
    def axis(self) -> Floats:
        """(k,) rad clockwise from image right, without jumps."""
        return self.table[AXIS, :]

    def move(self, rows: Indices, place: Floats, gap_s: Floats) -> None:
        """Put tracks (h,) to places (h, 2) px, unseen for (h,) seconds."""
        self.table[:2, rows], self.table[GAP, rows] = place.T, gap_s

    def share(self, rows: Indices, dt: float) -> None:
        """Tracks (h,) share boxes in this frame, ``dt`` seconds after the one before."""
        self.table[SHARED, rows] += dt

    def drive(self, dt: float) -> None:
        """Note which way the tracks that are seen went in ``dt`` seconds, the camera's motion being taken out."""
        at = self.table
        variance = 0.5 * (at[SPEED_VARIANCES[0]] + at[SPEED_VARIANCES[1]])
        way = way_after(at[WAY], at[2], at[3], variance, at[AXIS], at[W], dt)
        at[WAY] = np.where(self.unseen, at[WAY], way)

    def apart(self, boxes: Detections) -> Floats:
        """Squared distances of tracks and boxes, (k, m) px²."""
        dx, dy = boxes.cx - self.table[0, :, None], boxes.cy - self.table[1, :, None]
        return dx * dx + dy * dy

    def columns(self) -> tuple[Floats, Ints]:
        """Read-only copies of the rows up to the gap, (12, k), and of the whole numbers, (3, k)."""
        reported, whole = self.table[REPORTED].copy(), self.table[WHOLE].astype(np.int64)
        reported.setflags(write=False)
        whole.setflags(write=False)
        return reported, whole

    def select(self, rows: Indices) -> TrackState:
        """Copies of the tracks ``rows``."""
        return TrackState(self.table.take(rows, axis=1))

    def join(self, other: TrackState) -> TrackState:
        """Return these tracks and then the others."""
        return TrackState(np.concatenate([self.table, other.table], axis=1))

    def predict(self, dt: float, wander: float) -> None:
        """Move on by ``dt`` seconds, unseen until corrected; ``wander`` as in the filter, but in sizes/s."""
        _move(self.table, *kalman.predict(self.x, self.P, dt, wander * self.length))
        self.table[AGES] += dt
        self.table[DETECTION] = -1.0
        self.table[SKIPPED] = 0.0

    def skip(self, rows: Flags, dt: float) -> None:
        """Note that nobody looks for some tracks (k,) in this frame, ``dt`` seconds after the one before."""
        self.table[SKIPPED, rows] = 1.0
        self.table[SKIPPED_S, rows] = np.minimum(self.table[SKIPPED_S, rows] + dt, MAX_SKIPPED_S)

    def note_expected(self) -> None:
        """Keep where the tracks are now as where they are expected in this frame."""
        self.table[EXPECTED] = self.table[:2]

    def copy(self) -> TrackState:
        """Copy the tracks, to be moved otherwise."""
        return TrackState(self.table.copy())

    def take_motion(self, other: TrackState) -> None:
        """Copy the motion and the shape of the same tracks in ``other``; where they are expected stays."""
        self.table[: EXPECTED.start] = other.table[: EXPECTED.start]

    def warp(self, H: Floats) -> None:
        """Follow the camera: H (3, 3) leads from the frame before to this one."""
        table = self.table
        x, P, J = kalman.warp(self.x, self.P, H)
        _move(table, x, P)
        c, s = np.cos(table[AXIS]), np.sin(table[AXIS])
        # columns of J R(axis): where a step along the box and one across it lead
        moved = J @ np.array([[c, -s], [s, c]]).transpose(2, 0, 1)
        table[AXIS] += _near_zero(np.arctan2(moved[:, 1, 0], moved[:, 0, 0]) - table[AXIS], 2 * np.pi)
        table[SIDES] *= np.sqrt((moved * moved).sum(axis=1)).T
        _measure(table)

    def correct(self, rows: Indices, boxes: Detections, index: Indices, noise: Floats) -> None:
        """Correct the tracks ``rows`` (q,) by the detections ``index`` (q,); ``noise`` (q,) px of their centres."""
        known, seen = self.table.take(rows, axis=1), boxes.table.take(index, axis=1)
        _move(known, *kalman.correct(known[X].T, _square(known), seen[:2].T, noise))
        _reshape(known, seen)
        _mark_seen(known, seen, index)
        self.table[:, rows] = known

    def restart(self, rows: Indices, boxes: Detections, index: Indices, noise: Floats, speed: Floats) -> None:
        """Restart the motion of the tracks ``rows`` (q,), which are found again elsewhere; id and age stay."""
        known, seen = self.table.take(rows, axis=1), boxes.table.take(index, axis=1)
        _place(known, seen, noise, speed)
        _mark_seen(known, seen, index)
        self.table[:, rows] = known


def _square(table: Floats) -> Floats:
    """The covariances (k, 4, 4) in a table."""
    return table[COVARIANCE].reshape(4, 4, -1).transpose(2, 0, 1)


def _move(table: Floats, x: Floats, P: Floats) -> None:
    """Put states (k, 4) and covariances (k, 4, 4) into a table."""
    table[X], table[COVARIANCE] = x.T, P.transpose(1, 2, 0).reshape(16, -1)


def _place(table: Floats, seen: Floats, noise: Floats, speed: Floats) -> None:
    """Put the tracks of a table where boxes (7, k) are seen, with their shape."""
    _move(table, *kalman.initial(seen[:2].T, noise, speed))
    table[SHAPE], table[EXPECTED] = seen[SEEN_SHAPE], np.nan
    table[FRONT] = np.where(np.isnan(seen[SEEN_HEADING]), 0.0, vote_of(seen[SEEN_HEADING], table[AXIS]))
    table[WAY] = 0.0
    _measure(table)


def _measure(table: Floats) -> None:
    """Write the lengths of boxes whose sides changed into a table."""
    table[LENGTH] = np.maximum(np.sqrt(table[W] * table[H]), 1.0)


def _mark_seen(table: Floats, seen: Floats, index: Indices) -> None:
    """Note in a table that its tracks were seen as the detections ``index``."""
    table[SCORE], table[DETECTION], table[GAP] = seen[SEEN_SCORE], index, 0.0
    table[SHARED] = table[SKIPPED_S] = 0.0
    table[HITS] += 1.0


def _reshape(table: Floats, seen: Floats) -> None:
    """Move sides and axis in a table towards what is seen (7, k), and the front by majority."""
    change = seen[SEEN_SHAPE] - table[SHAPE]
    if np.abs(change[2]).max() > np.pi / 4:
        _turn_back(change, table, seen)
    # a gain of 1/hits at first, 1 − e^(−dt/τ) in the long run; here with its sign turned
    early = -1.0 / (table[HITS] + 1.0)
    table[SHAPE] -= np.minimum(early, np.expm1(RATES * table[GAP])) * change
    _measure(table)
    unknown = np.isnan(seen[SEEN_HEADING])
    doubtful = np.count_nonzero(unknown)
    if doubtful < len(unknown):
        votes = votes_after(table[FRONT], vote_of(seen[SEEN_HEADING], table[AXIS]))
        table[FRONT] = np.where(unknown, table[FRONT], votes) if doubtful else votes


def _turn_back(change: Floats, table: Floats, seen: Floats) -> None:
    """Correct ``change`` where the axis is seen the other way round, or the sides of nearly square boxes exchanged."""
    turn = change[2] = _near_zero(change[2], np.pi)
    swapped = (np.abs(turn) > np.pi / 4) & np.isnan(seen[SEEN_HEADING])
    if np.count_nonzero(swapped):
        sides = seen[2:4]
        swapped &= sides.max(axis=0) < NEARLY_SQUARE * np.maximum(sides.min(axis=0), 1e-9)
        change[:2, swapped] = (sides[::-1] - table[SIDES])[:, swapped]
        change[2, swapped] = _near_zero(turn[swapped] + np.pi / 2, np.pi)


def _near_zero(angle: Floats, period: float) -> Floats:
    """Return an angle modulo ``period``, nearest to 0."""
    return np.asarray((angle + period / 2) % period - period / 2)
