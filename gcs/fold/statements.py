"""Statements of the operator about boxes: made, withdrawn, contradicted or ended with its track, each an event."""

from __future__ import annotations

from collections import deque
from collections.abc import Collection
from dataclasses import dataclass, replace

import numpy as np

from assoc.identification.identifier import Identifier
from assoc.records import Identities
from gcs.certainty import CONFIRMED, certainty
from gcs.mission.mission import Mission
from gcs.snapshot import Event, Statement
from mavlink.state import FleetState, Level
from vision.track.tracks import Tracks

CONTRADICTED_US = 3_000_000
"""Time for which another answer must have been sure to withdraw a statement: doubts about neighbours pass in a
second."""
HOLE_US, HOLE_STEPS = 1_000_000, 2
"""Gap after which a contradiction is counted again: this long without a frame, and this many times the interval
before."""


LATE_FRAMES = 30
"""Age beyond which a recorded statement is not used: a replay that begins later does not know which box was there."""


@dataclass(slots=True)
class _ActiveStatement:
    """Statement that holds."""

    made: Statement
    contradicted_us: int = 0
    """Time since which the statement is contradicted, 0 while it is not."""


class Statements:
    """Holds statements from when they are made, by the operator or in a recording, until they end.

    A statement counts from the first frame that is looked at after it was made.
    """

    def __init__(self, mission: Mission) -> None:
        self.mission = mission
        self._waiting: deque[Statement] = deque()
        self._standing: dict[int, _ActiveStatement] = {}
        self._reviewed_us = self._step_us = 0
        self._recorded_as: dict[int, int] = {}
        """Track of this fold by the recording's."""

    @property
    def by_track(self) -> dict[int, int]:
        """System id, or 0 for none of ours, by track."""
        return {track: standing.made.system_id for track, standing in self._standing.items()}

    def make(self, statement: Statement) -> None:
        """State something, or withdraw it (of track 0: what was stated last), from its frame or else the next one on.

        Raises:
            ValueError: the mission has no such ground vehicle now.
        """
        if statement.frame < 0 and not self._is_about_ours(statement):
            raise ValueError(f"system {statement.system_id} is no ground vehicle of the mission")
        self._waiting.append(statement)

    def count_again(self, identifier: Identifier) -> None:
        """Give all that stand to an identifier that starts again; those about who was left out end."""
        self._standing = {track: each for track, each in self._standing.items() if self._is_about_ours(each.made)}
        for track, standing in self._standing.items():
            identifier.state(track, standing.made.system_id)

    def apply(self, t_us: int, frame: int, tracks: Tracks, identifier: Identifier) -> list[Event]:
        """Let what waits count from this frame on."""
        events: list[Event] = []
        while self._waiting and self._waiting[0].frame <= frame:
            asked = self._waiting.popleft()
            if asked.undone:
                events += self._undo(t_us, frame, asked.track_id, identifier)
                continue
            late = asked.frame >= 0 and frame - asked.frame > LATE_FRAMES
            ours = self._is_about_ours(asked)
            row = None if late or not ours else _row_of(asked, tracks)
            if row is None:
                text = f"{self._words(asked)}; not used: {'the track has ended' if ours else 'it is left out'}"
                events.append(_event(t_us, "warning", text, asked.system_id))
                continue
            track = int(tracks.track_id[row])
            self._recorded_as[asked.track_id] = track
            if self.by_track.get(track) == asked.system_id:
                continue  # said twice it counts once
            cx, cy = float(tracks.cx[row]), float(tracks.cy[row])
            made = replace(asked, track_id=track, frame=frame, cx=cx, cy=cy)
            events += self._replace_others(t_us, made, identifier)
            self._standing.pop(track, None)  # the last in order is the latest
            self._standing[track] = _ActiveStatement(made)
            identifier.state(track, made.system_id)
            events.append(_event(t_us, "info", self._words(made), made.system_id, made))
        return events

    def review(
        self,
        t_us: int,
        identities: Identities | None,
        state: FleetState,
        identifier: Identifier,
        living: Collection[int],
    ) -> list[Event]:
        """End statements whose tracks have ended, and those that the reports contradict.

        Args:
            t_us: the frame's time.
            identities: of its tracks, None without a camera pose: then nothing contradicts.
            state: the fleet then.
            identifier: takes the evidence back.
            living: all tracks, with those that have too little evidence to be shown just now.
        """
        if identities is None or not self._standing:
            return []
        events: list[Event] = []
        rows = {track: row for row, track in enumerate(identities.track_id.tolist())}
        refused = state.contested
        step_us = t_us - self._reviewed_us
        hole = step_us > max(HOLE_US, HOLE_STEPS * self._step_us)
        self._reviewed_us, self._step_us = t_us, step_us
        for track, standing in list(self._standing.items()):
            made = standing.made
            row = rows.get(track)
            if row is None:
                if track not in living:
                    self._end(track, identifier)
                    text = f"{self._words(made)}; it ended with the track"
                    events.append(_event(t_us, "info", text, made.system_id))
                continue
            other = int(identities.system_id[row]) != made.system_id and identities.confidence[row] >= CONFIRMED
            if not other or hole or made.system_id in refused or self.mission.uav.system_id in refused:
                standing.contradicted_us = 0
            elif not standing.contradicted_us:
                standing.contradicted_us = t_us
            elif t_us - standing.contradicted_us >= CONTRADICTED_US:
                self._end(track, identifier)
                text = f"{self._words(made)}; contradicted: {self._against(identities, row)}"
                events.append(_event(t_us, "warning", text, made.system_id))
        return events

    def _undo(self, t_us: int, frame: int, track: int, identifier: Identifier) -> list[Event]:
        track = self._recorded_as.get(track, track) or next(reversed(self._standing), 0)
        standing = self._standing.get(track)
        if standing is None:
            return []
        self._end(track, identifier)
        undone = replace(standing.made, frame=frame, undone=True)
        return [_event(t_us, "info", f"{self._words(undone)}; withdrawn", undone.system_id, undone)]

    def _replace_others(self, t_us: int, made: Statement, identifier: Identifier) -> list[Event]:
        """Let the later of two statements about one vehicle count."""
        events = []
        for track, standing in list(self._standing.items()):
            if track != made.track_id and made.system_id and standing.made.system_id == made.system_id:
                self._end(track, identifier)
                text = f"{self._words(standing.made)}; it ends: that is track {made.track_id} now"
                events.append(_event(t_us, "info", text, made.system_id))
        return events

    def _is_about_ours(self, statement: Statement) -> bool:
        """Tell whether the vehicle is in the fleet now, or none of ours is meant."""
        return statement.system_id in (0, *self.mission.ugv_ids)

    def _end(self, track: int, identifier: Identifier) -> None:
        del self._standing[track]
        identifier.unstate(track)

    def _words(self, statement: Statement) -> str:
        name = self.mission.name_of(statement.system_id) if statement.system_id else "none of ours"
        return f"stated: track {statement.track_id} is {name}"

    def _against(self, identities: Identities, row: int) -> str:
        """Name that the reports say instead."""
        sure, other = certainty(float(identities.confidence[row])), int(identities.system_id[row])
        if other:
            return f"by its reports it is {self.mission.name_of(other)} ({sure})"
        return f"by the reports it is none of ours ({sure})"


def _row_of(asked: Statement, tracks: Tracks) -> int | None:
    """The track that is meant: of that id, at the place that was recorded; else what is at that place."""
    rows = np.flatnonzero(tracks.track_id == asked.track_id)
    if not np.isfinite([asked.cx, asked.cy]).all():
        return int(rows[0]) if len(rows) else None
    away = np.hypot(tracks.cx - asked.cx, tracks.cy - asked.cy)
    near = away <= np.maximum(tracks.w, tracks.h)
    if len(rows) and near[rows[0]]:
        return int(rows[0])
    return int(np.argmin(np.where(near, away, np.inf))) if near.any() else None


def _event(t_us: int, level: Level, text: str, system_id: int, statement: Statement | None = None) -> Event:
    return Event(t_us=t_us, level=level, kind="operator", text=text, system_id=system_id, statement=statement)
