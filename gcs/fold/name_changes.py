"""Names from one frame to the next: which came, changed or went, and why."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from assoc.records import Identities
from gcs.certainty import certainty
from gcs.health.vehicle_alarms import CONTRADICTED
from gcs.mission.mission import Mission
from gcs.snapshot import Event
from mavlink.state import FleetState, Level
from vision.track.tracks import Tracks

NONE_LIKELIER = 0.5
"""Probability of "none of ours" above which it is why a name went."""


class NameChanges:
    """Compares the identities of each frame with those before.

    Attributes:
        by_track: system id by the track that carries its name now.
        evidence_forgotten: set when all evidence is given up, until the next frame.
    """

    def __init__(self, mission: Mission) -> None:
        self.mission = mission
        self._at_border: frozenset[int] = frozenset()
        self.by_track: dict[int, int] = {}
        self.evidence_forgotten = False

    def update(
        self,
        t_us: int,
        identities: Identities | None,
        state: FleetState,
        tracks: Tracks,
        size: tuple[int, int] | None,
        suspected: Collection[int] = (),
    ) -> list[Event]:
        """Take in one frame; returns an event for each name that came, changed or went.

        Args:
            t_us: its time.
            identities: of its tracks, None without a camera pose.
            state: the fleet then.
            tracks: after it.
            size: its width and height, px, None unknown.
            suspected: vehicles whose positions contradict the video now.
        """
        before = self.by_track
        found: dict[int, tuple[int, float]] = {}
        if identities is not None:
            columns = identities.track_id.tolist(), identities.system_id.tolist(), identities.confidence.tolist()
            found = {track: (vehicle, sure) for track, vehicle, sure in zip(*columns, strict=True)}
        self.by_track = {track: vehicle for track, (vehicle, _) in found.items() if vehicle}
        lost = {track: vehicle for track, vehicle in before.items() if vehicle not in self.by_track.values()}
        events = self._given(t_us, before, found)
        for track, vehicle in lost.items():
            text = f"track {track} is no longer {self.mission.name_of(vehicle)}: "
            if vehicle in self.mission.ugv_ids:
                text += self._reason(track, vehicle, identities, state, suspected)
            else:
                text += "it is left out of the fleet"
            events.append(Event(t_us=t_us, level="info", kind="identity", text=text, system_id=vehicle))
        self._at_border = _tracks_at_border(tracks, size)
        self.evidence_forgotten = False
        return events

    def _given(self, t_us: int, before: dict[int, int], found: dict[int, tuple[int, float]]) -> list[Event]:
        events = []
        for track, (vehicle, sure) in found.items():
            former = before.get(track)
            if vehicle and vehicle != former:
                text = f"track {track} is {self.mission.name_of(vehicle)} ({certainty(sure)})"
                text += f", no longer {self.mission.name_of(former)}" if former else ""
                level: Level = "warning" if former else "info"
                events.append(Event(t_us=t_us, level=level, kind="identity", text=text, system_id=vehicle))
        return events

    def _reason(
        self,
        track: int,
        vehicle: int,
        identities: Identities | None,
        state: FleetState,
        suspected: Collection[int],
    ) -> str:
        """Return why a track does not carry a vehicle's name any more."""
        status = {each.system_id: each for each in state.vehicles}[vehicle]
        if self.evidence_forgotten:
            return "names begin anew"
        if state.vehicles[0].contested:
            return "several senders use the UAV's id"
        if identities is None:
            return "the camera's pose is unknown" if state.uav.position_valid else "the UAV's position is lost"
        if status.contested:
            return "several senders use its id"
        rows = np.flatnonzero(identities.track_id == track)
        if not len(rows):
            return "it left the picture" if track in self._at_border else "the track was lost"
        if track in self.by_track:
            return f"it is {self.mission.name_of(self.by_track[track])}"
        if status.position_state in ("refused", "lost"):
            because = f": {status.refused_for}" if status.position_state == "refused" and status.refused_for else ""
            return f"its positions are {status.position_state}{because}"
        if vehicle in suspected:
            return CONTRADICTED
        none = float(identities.candidates.none_of_ours[rows[0]])
        if none > NONE_LIKELIER:
            return f"none of ours is likelier ({certainty(none)})"
        return "the evidence does not suffice"


def _tracks_at_border(tracks: Tracks, size: tuple[int, int] | None) -> frozenset[int]:
    """Tracks whose boxes reach to the border of the frame or beyond it."""
    if size is None:
        return frozenset()
    centre, reach = np.column_stack([tracks.cx, tracks.cy]), 0.5 * np.maximum(tracks.w, tracks.h)[:, None]
    reaching = ((centre < reach) | (centre > np.array(size) - reach)).any(axis=1)
    return frozenset(tracks.track_id[reaching].tolist())
