"""A zoom that nothing reports: all boxes and their distances from one another grow together.

A vehicle's box is as large on the ground as it ever was, and a fleet does not spread within a second. Where both change
by one factor, for all tracks, the focal length has: places would be off by as much of their distance from the middle of
the picture, and no name would fit.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import replace
from statistics import median

import numpy as np
from numpy.typing import NDArray

from gcs.fold.camera.frame_camera import FrameCamera
from gcs.fold.ground.contact import ground_places
from vision.camera.intrinsics import zoomed
from vision.detect.detections import Detections

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

MIN_TRACKS = 3
"""Least number of tracks: two vehicles may drive apart while a detector draws their boxes larger."""
USUAL_S = 2.0
"""Time constant with which the usual size of a box follows, s: what the height is off by changes more slowly."""
MIN_AGE_S = 0.5
"""A track is compared once it has been seen for this long, s."""
BEFORE_S = 1.0
"""Places are compared with those of this long ago, s."""
MIN_CHANGE, MIN_MORE, MORE_S = 0.08, 0.03, 1.0
"""ln of the least change that counts as a zoom: less is within what boxes vary by, and the height takes it; and for
this long after a change, s, the least by which it has gone on."""
MIN_STDS, MIN_MORE_STDS = 3.0, 1.5
"""Either of them counts from this many 1σ of the tracks' median on: boxes of small vehicles vary by more."""
MIN_JUMP = 0.2
"""ln of the least change from one frame to the next that counts, where tracks may have been lost by it."""
LIKE_MOST, MOST_UNLIKE = 0.75, 0.5
"""Share of the tracks that must have changed by the common factor, and the share of its ln by which they may differ."""
ALIKE = 0.03
"""Difference in ln, besides that share, by which boxes vary."""
MIN_SPREAD = 0.5
"""Share of the change that their places must show: some drive towards one another meanwhile."""
SAME_SIZE = 0.15
"""Difference of the ln of its sizes up to which a box may be the same vehicle's."""
REACH_M, REACH_MPS = 1.0, 6.0
"""A vehicle is found again within the first distance, plus the second per second."""
CUT = 0.7
"""A box whose centre is within this many of its lengths from the border may be cut by it."""
MIN_FOUND, MAX_AS_BEFORE = 0.7, 0.3
"""Share of the vehicles that must be found where a jump puts them; and most, against that, that are there without."""


class SilentZoom:
    """Finds by how much the image is magnified beyond what is known of the camera."""

    def __init__(self) -> None:
        self._t_us = 0
        self._changed_us = 0
        self._usual: dict[int, float] = {}
        """ln of the usual size of each track's box on the ground, by track id."""
        self._since_us: dict[int, int] = {}
        self._looks: deque[tuple[int, IntArray, FloatArray]] = deque()
        """Time, track ids and places of the looks of the last second."""
        self._last: tuple[FloatArray, FloatArray] | None = None
        """Places and ln sizes of the boxes of the last look."""
        self._last_px = 0.0
        """Median √(w h) of these boxes in the picture, px."""
        self._scatter = 0.0
        """Variance of the ln of boxes' sizes about the usual one of their track, beyond what they change together."""

    def restart(self) -> None:
        """Take sizes as they are from now on: the camera or its height is known again."""
        self._usual.clear()
        self._since_us.clear()
        self._looks.clear()
        self._last = None

    def jump(self, t_us: int, view: FrameCamera, boxes: Detections) -> float:
        """Factor by which the image was magnified at once since the last look, before its boxes have tracks; 1 not."""
        if self._last is None or min(len(boxes), len(self._last[0])) < MIN_TRACKS:
            return 1.0
        boxes = boxes.select(_whole(view, boxes))
        if len(boxes) < MIN_TRACKS or abs(math.log(_median_px(boxes) / self._last_px)) < 0.5 * MIN_JUMP:
            return 1.0
        now, before = _measured(view, boxes), self._last
        change = median(now[1].tolist()) - median(before[1].tolist())
        if abs(change) < MIN_JUMP:
            return 1.0
        factor = float(np.exp(change))
        reach_m = REACH_M + REACH_MPS * (t_us - self._t_us) / 1e6
        jumped = _measured(magnified(view, factor), boxes)
        found = _found_again(before, jumped, reach_m)
        as_before = np.count_nonzero(_found_again(before, now, reach_m) >= 0)
        again = np.flatnonzero(found >= 0)
        least = max(MIN_FOUND * min(len(now[1]), len(before[1])), MIN_TRACKS)
        if len(again) < least or as_before > MAX_AS_BEFORE * len(again):
            return 1.0
        # how far apart they are tells it better than how large they are
        return factor * float(np.exp(_log_spread(jumped[0][again]) - _log_spread(before[0][found[again]])))

    def change(self, t_us: int, view: FrameCamera, boxes: Detections, track_id: IntArray, rays: FloatArray) -> float:
        """Factor by which the image is magnified beyond ``view``, by the tracks of a look; 1 not.

        Args:
            t_us: when the frame was taken.
            view: its camera, as known so far.
            boxes: (k,) those of it that tracks took.
            track_id: (k,) of these tracks.
            rays: (k, 3) through the middles of the boxes, camera frame.
        """
        whole = _whole(view, boxes)
        boxes, ids = boxes.select(whole), track_id[whole]
        places, sizes = _measured(view, boxes, rays[whole])
        keep = float(np.exp(-max(t_us - self._t_us, 0) / 1e6 / USUAL_S)) if self._t_us else 0.0
        self._t_us = t_us
        while self._looks and t_us - self._looks[0][0] > BEFORE_S * 1e6:
            self._looks.popleft()
        names = ids.tolist()
        usual = np.array([self._usual.get(i, s) for i, s in zip(names, sizes.tolist(), strict=True)])
        self._since_us = {i: self._since_us.get(i, t_us) for i in names}
        old = np.array([t_us - self._since_us[i] >= MIN_AGE_S * 1e6 for i in names], np.bool_)
        goes_on = t_us - self._changed_us < MORE_S * 1e6
        off = (sizes - usual)[old]
        change = 0.0
        if len(off) >= MIN_TRACKS:
            scatter = float(np.sum((off - median(off.tolist())) ** 2)) / (len(off) - 1)
            self._scatter = keep * self._scatter + (1.0 - keep) * scatter if self._scatter else scatter
            least, stds = (MIN_MORE, MIN_MORE_STDS) if goes_on else (MIN_CHANGE, MIN_STDS)
            # a median of k has σ √(π/2k)
            least = max(least, stds * math.sqrt(0.5 * math.pi * self._scatter / len(off)))
            change = _common(off, least)
            # those that have grown are further apart, too
            if change and self._spread(ids, places) * np.sign(change) <= MIN_SPREAD * abs(change):
                change = 0.0
        if change:
            self._changed_us = t_us
            # by the new focal length
            places, sizes = _measured(magnified(view, float(np.exp(change))), boxes)
        self._last, self._last_px = (places, sizes), _median_px(boxes)
        self._looks.append((t_us, ids, places))
        self._usual = dict(zip(names, (usual + (1.0 - keep) * (sizes - usual)).tolist(), strict=True))
        return float(np.exp(change))

    def _spread(self, ids: IntArray, places: FloatArray) -> float:
        """ln of how much further apart the tracks are than a second ago; 0 unknown."""
        if not self._looks:
            return 0.0
        _, before_ids, before = self._looks[0]
        _, now_at, before_at = np.intersect1d(ids, before_ids, return_indices=True)
        if len(now_at) < MIN_TRACKS:
            return 0.0
        return _log_spread(places[now_at]) - _log_spread(before[before_at])


def _whole(view: FrameCamera, boxes: Detections) -> BoolArray:
    """(k,) boxes that the border does not cut: what comes into the picture seems to grow."""
    x, y = boxes.centre.T
    inside = np.minimum(np.minimum(x, view.intrinsics.width - x), np.minimum(y, view.intrinsics.height - y))
    return np.asarray(inside > CUT * np.maximum(boxes.w, boxes.h))


def magnified(view: FrameCamera, factor: float) -> FrameCamera:
    """The camera with its image magnified further."""
    return replace(view, intrinsics=zoomed(view.intrinsics, factor))


def _measured(view: FrameCamera, boxes: Detections, rays: FloatArray | None = None) -> tuple[FloatArray, FloatArray]:
    """Places (k, 2) on the ground, and ln of the boxes' sizes there; ``rays`` (k, 3): through them, where known."""
    through = view.intrinsics.rays(boxes.centre) if rays is None else rays
    return ground_places(through, np.sqrt(boxes.w * boxes.h), view)


def _median_px(boxes: Detections) -> float:
    """Median √(w h), px; 1 of no box."""
    return math.sqrt(max(median((boxes.w * boxes.h).tolist()), 1.0)) if len(boxes) else 1.0


def _common(off: FloatArray, least: float) -> float:
    """ln of the factor by which boxes have grown; 0: they have not, or not alike.

    Args:
        off: (k,) ln of the size of each over its usual one.
        least: ln of the least factor.
    """
    change = float(median(off.tolist()))
    if abs(change) <= least:
        return 0.0
    alike = np.mean(np.abs(off - change) < MOST_UNLIKE * abs(change) + ALIKE)
    return change if alike >= LIKE_MOST else 0.0


def _log_spread(places: FloatArray) -> float:
    """ln of the root mean square distance of places (k, 2) from their middle."""
    return 0.5 * float(np.log(max(float(np.mean(np.sum((places - np.mean(places, axis=0)) ** 2, axis=1))), 1e-9)))


def _found_again(before: tuple[FloatArray, FloatArray], now: tuple[FloatArray, FloatArray], reach_m: float) -> IntArray:
    """(k,) the nearest box before that is within reach of each and was as large, −1 none; places and ln sizes."""
    away = np.hypot(*np.moveaxis(now[0][:, None] - before[0][None], 2, 0))
    same = (away < reach_m) & (np.abs(now[1][:, None] - before[1][None]) < SAME_SIZE)
    return np.where(np.any(same, axis=1), np.argmin(np.where(same, away, np.inf), axis=1), -1)
