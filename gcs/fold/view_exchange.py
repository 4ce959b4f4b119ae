"""Exchange between the folds of a flight's cameras: each shares what it found by itself, and uses what others shared.

Which frames of the others a frame heard is up to who folds: in flight the newest that are folded, and these are
recorded; of a recording the same ones again.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import dropwhile

import numpy as np
from numpy.typing import NDArray

from assoc.other_views.first_seen import FirstSeen, FirstSeenTracks, Heard
from assoc.other_views.hearing import Hearing
from assoc.other_views.reconcile import Cause
from assoc.records import Sighting
from gcs.mission.mission import Mission
from mavlink.geodesy import LocalFrame

FloatArray = NDArray[np.float64]

_MAX_KEPT = 256
"""Frames of a view that are kept for the others: some seconds."""
_LAST_US = 2_500_000
"""Time of a view's last frames that others are given, µs."""
_SIDE_M = 1000.0


@dataclass(frozen=True, slots=True, kw_only=True)
class _SharedFrame:
    """A frame as a view shared it with the others."""

    frame: int
    sighting: Sighting
    origin: LocalFrame
    system_ids: tuple[int, ...]
    first_seen: Mapping[int, FirstSeen]
    """Objects that its tracks were before it heard the others."""


class ViewExchange:
    """Frames that the views of a flight share, by the system id of the aircraft that carries each.

    Args:
        heard: which frame of each other view counts for a frame of one: system id and frame in, frames by system id
            out. None: the newest.
    """

    def __init__(self, heard: Callable[[int, int], Mapping[int, int]] | None = None) -> None:
        self._heard = heard
        self._shared: dict[int, deque[_SharedFrame]] = {}

    def join(self, system_id: int, note: Callable[[int, int, int], None] = lambda *heard: None) -> ExchangeMember:
        """Join a view to the others.

        Args:
            system_id: of its aircraft.
            note: called with a frame, the aircraft of another view and the frame of that one that it heard.
        """
        return ExchangeMember(self, system_id, note)

    def newest(self, system_id: int) -> int:
        """The last frame that a view shared; -1: none."""
        shared = self._shared.get(system_id)
        return shared[-1].frame if shared else -1

    def share(self, system_id: int, shared: _SharedFrame) -> None:
        """Keep what a view has of a frame."""
        self._shared.setdefault(system_id, deque(maxlen=_MAX_KEPT)).append(shared)

    def frames_of_others(self, system_id: int, frame: int) -> Mapping[int, Sequence[_SharedFrame]]:
        """The last frames of each other view that a view hears at a frame."""
        others = [other for other in self._shared if other != system_id]
        until = (
            {other: self.newest(other) for other in others} if self._heard is None else self._heard(system_id, frame)
        )
        return {other: last for other, newest in until.items() if (last := self._until(other, newest))}

    def _until(self, system_id: int, frame: int) -> list[_SharedFrame]:
        left = [each for each in self._shared.get(system_id, ()) if each.frame <= frame]
        return list(dropwhile(lambda each: each.sighting.t_us < left[-1].sighting.t_us - _LAST_US, left))


class ExchangeMember:
    """One view in the exchange: it shares what it found and uses what others found."""

    def __init__(self, exchange: ViewExchange, system_id: int, note: Callable[[int, int, int], None]) -> None:
        self._exchange, self._system_id, self._note = exchange, system_id, note
        self._hearing, self._system_ids = Hearing(), tuple[int, ...]()
        self._first_seen = FirstSeenTracks(system_id)
        self._moves: dict[LocalFrame, tuple[LocalFrame, FloatArray, FloatArray]] = {}

    def answers(self, frame: int, origin: LocalFrame, system_ids: tuple[int, ...], mine: Sighting) -> FloatArray:
        """(m, n + 1) what the tracks of a frame are by all that views know; share with the others what this one has."""
        if system_ids != self._system_ids:  # what was heard is of the fleet as it was
            self._hearing, self._system_ids = Hearing(), system_ids
        theirs = self._exchange.frames_of_others(self._system_id, frame)
        for other, last in theirs.items():
            self._note(frame, other, last[-1].frame)
        mine_before = self._first_seen.all
        left = _SharedFrame(frame=frame, sighting=mine, origin=origin, system_ids=system_ids, first_seen=mine_before)
        self._exchange.share(self._system_id, left)
        usable = {
            other: [self._moved(each, origin) for each in left if each.system_ids == system_ids]
            for other, left in theirs.items()
        }
        answers = self._hearing.answers(mine, {other: sightings for other, sightings in usable.items() if sightings})
        pairs = self._hearing.pairs.items()
        heard = (Heard(other, tracks, same, theirs[other][-1].first_seen) for other, (tracks, same) in pairs)
        self._first_seen.update(mine.t_us, mine.track_id, heard)
        return answers

    def first_seen(self, track_id: int) -> tuple[int, int]:
        """The camera that saw the object of a track first, by its aircraft, and its track there."""
        first = self._first_seen.of(track_id)
        return first.view, first.track_id

    def contradictions(self, mission: Mission) -> str:
        """Contradictions of another camera in the last frame, in words, and which is likelier wrong; empty: nothing."""
        names = [*(mission.name_of(system_id) for system_id in mission.ugv_ids), "none of ours"]
        for each in self._hearing.contradictions:
            if max(each.mine, each.theirs) < len(names):
                other = mission.name_of(each.view)
                wrong = {-1: "this one is likelier wrong", 1: f"{other} is likelier wrong", 0: "either may be wrong"}
                why = f": {_words(each.cause)} would explain it" if each.cause else ""
                return f"{names[each.mine]} is {names[each.theirs]} by {other}; {wrong[each.wrong]}{why}"
        return ""

    def _moved(self, shared: _SharedFrame, origin: LocalFrame) -> Sighting:
        """A frame that another view shared, with its places in this one's world."""
        if shared.origin == origin:
            return shared.sighting
        into, R, t = self._moves.get(shared.origin, (None, None, None))
        if into is not origin or R is None or t is None:
            corners = np.array([[0.0, 0.0, 0.0], [_SIDE_M, 0.0, 0.0], [0.0, _SIDE_M, 0.0]])
            moved = origin.to_enu(*shared.origin.to_geodetic(corners))[:, :2]
            t, R = moved[0], (moved[1:] - moved[0]).T / _SIDE_M
            self._moves = {shared.origin: (origin, R, t)}
        return replace(shared.sighting, place=shared.sighting.place @ R.T + t)


def _words(cause: Cause) -> str:
    """Cause in words, with how far it is off."""
    if cause.kind == "clock":
        return f"a clock {cause.value:.1f} s off"
    if cause.kind == "position":
        return f"a camera {cause.value:.0f} m from where it is said to be"
    turned_deg, scaled = math.degrees(cause.value), max(cause.scale, 1.0 / cause.scale)
    return (
        f"a camera turned by {turned_deg:.0f}°"
        if turned_deg > 100.0 * (scaled - 1.0)
        else f"a scale {scaled:.2f} times off"
    )
