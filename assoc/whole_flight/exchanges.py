"""Exchanges of tracks, by the names that they got later.

A tracker exchanges two tracks where their vehicles are side by side or in one box; a name changes only once the places
tell, seconds later. So a change of name is put back to the moment at which the track was nearest to one that had its
new name before, or has its old one since.
"""

from __future__ import annotations

from bisect import bisect_left
from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

_LATEST_S = 10.0
"""Longest time from an exchange to the change of a name, seconds."""
_CLOSER = 0.85
"""Factor by which tracks were nearer at an exchange, unless they stand side by side."""
_UNSEEN_S = 1.0
"""A track that was not seen is taken to be where it was this long ago, or will be then, seconds."""


@dataclass(slots=True)
class _NamedTrack:
    """The frames in which a track was seen."""

    t: list[float] = field(default_factory=list)
    place: list[FloatArray] = field(default_factory=list)
    name: list[int] = field(default_factory=list)

    def has(self, name: int, since_s: float, until_s: float) -> bool:
        """Tell whether it had a name between two times."""
        return name in self.name[bisect_left(self.t, since_s) : bisect_left(self.t, until_s)]

    def at(self, t: float) -> FloatArray:
        """(2,) where it was about then, metres, NaN unknown."""
        k = bisect_left(self.t, t)
        near = [i for i in (k - 1, k) if 0 <= i < len(self.t) and abs(self.t[i] - t) <= _UNSEEN_S]
        return self.place[min(near, key=lambda i: abs(self.t[i] - t))] if near else np.full(2, np.nan)


def names_since_exchanges(
    t: Sequence[float],
    track_id: Sequence[Sequence[int]],
    place: Sequence[FloatArray],
    name: Sequence[Sequence[int]],
    close_m: float,
) -> list[list[int]]:
    """The names of the boxes of all frames, each from when its track was exchanged on.

    Args:
        t: Time of each frame, seconds.
        track_id: The tracks of each frame's m boxes.
        place: (m, 2) of each, where they are on the ground, metres.
        name: The vehicle of each as it was known then, −1 unknown.
        close_m: Tracks nearer than this may be exchanged, metres.

    Returns:
        The vehicles in the same order.
    """
    tracks: dict[int, _NamedTrack] = defaultdict(_NamedTrack)
    for now, ids, places, names in zip(t, track_id, place, name, strict=True):
        for track, at, vehicle in zip(ids, places, names, strict=True):
            own = tracks[track]
            own.t.append(now)
            own.place.append(at)
            own.name.append(vehicle)
    named: dict[int, set[int]] = defaultdict(set)
    for track, own in tracks.items():
        for vehicle in set(own.name):
            named[vehicle].add(track)

    def rivals(track: int, before: int, after: int, t: float) -> list[_NamedTrack]:
        """Return the tracks that had the new name before, or have the old one since."""
        others = [tracks[each] for each in named[after] - {track} if tracks[each].has(after, t - _LATEST_S, t)]
        return others + [tracks[each] for each in named[before] - {track} if tracks[each].has(before, t, t + _LATEST_S)]

    told = {track: iter(_put_back(own, partial(rivals, track), close_m)) for track, own in tracks.items()}
    return [[next(told[track]) for track in ids] for ids in track_id]


def _put_back(
    own: _NamedTrack, rivals: Callable[[int, int, float], Sequence[_NamedTrack]], close_m: float
) -> list[int]:
    """The names of a track, with each change at its exchange where there was one.

    Args:
        own: The track.
        rivals: Finds tracks with which it may have been exchanged, by its old name, its new one and when it changed.
        close_m: Tracks nearer than this may be exchanged, metres.
    """
    names = own.name.copy()
    known = [k for k, vehicle in enumerate(own.name) if vehicle >= 0]
    changes = [(a, b) for a, b in pairwise(known) if own.name[a] != own.name[b]]
    ends = [*(b for _, b in changes), len(names)][1:]
    first = 0
    for (last, now), end in zip(changes, ends, strict=True):
        others = rivals(own.name[last], own.name[now], own.t[now])
        # a name that does not last is no exchange
        held_s = own.t[end - 1] - own.t[now] if end < len(names) else np.inf
        since = max(first, bisect_left(own.t, own.t[now] - min(_LATEST_S, held_s)))
        *away, parted = (_away(own.place[k], own.t[k], others) for k in range(since, now + 1))
        if away and min(away) < min(close_m, _CLOSER * parted):
            exchanged = since + int(np.argmin(away))
            names[exchanged:now] = [own.name[now]] * (now - exchanged)
        first = now
    return names


def _away(place: FloatArray, t: float, others: Sequence[_NamedTrack]) -> float:
    """Distance to the nearest of others at a time, metres, infinite where none is known."""
    away = [float(np.hypot(*(place - other.at(t)))) for other in others]
    return min((each for each in away if np.isfinite(each)), default=np.inf)
