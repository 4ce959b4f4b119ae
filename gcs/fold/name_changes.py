"""Names from one frame to the next: which came, changed or went, and why."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from assoc.records import Identities
from gcs.certainty import certainty
from gcs.health.vehicle_alarms import CONTRADICTED, STANDS_STILL
from gcs.mission.mission import Mission
from gcs.snapshot import Event
from mavlink.state import FleetState, Level
from vision.track.tracks import Tracks

NONE_LIKELIER = 0.5
"""Probability of "none of ours" above which it is why a name went."""
FADES_US, BACK_US = 1_000_000, 2_000_000
"""Time until it is told that a name is gone or elsewhere while its track goes on, and that it is back on the track that
lost it: near its limit it comes and goes."""


class NameChanges:
    """Compares the identities of each frame with what was told of them.

    Attributes:
        by_track: system id by the track that carries its name now.
        evidence_forgotten: set when all evidence is given up, until the next frame.
    """

    def __init__(self, mission: Mission) -> None:
        self.mission = mission
        self._at_border: frozenset[int] = frozenset()
        self.by_track: dict[int, int] = {}
        self.evidence_forgotten = False
        self._told: dict[int, int] = {}
        """Track that was told to be a vehicle, by vehicle."""
        self._last: dict[int, int] = {}
        """The same, and of vehicles without a name the track that had it."""
        self._untold: dict[int, tuple[int, int]] = {}
        """Track that a vehicle is now, 0 none, and since when, where that is not told yet."""

    def update(
        self,
        t_us: int,
        identities: Identities | None,
        state: FleetState,
        tracks: Tracks,
        size: tuple[int, int] | None,
        suspected: Collection[int] = (),
    ) -> list[Event]:
        """Take in one frame; returns an event for each name that came, changed or went, and lasts.

        Args:
            t_us: its time.
            identities: of its tracks, None without a camera pose.
            state: the fleet then.
            tracks: after it.
            size: its width and height, px, None unknown.
            suspected: vehicles whose positions contradict the video now.
        """
        found: dict[int, tuple[int, float]] = {}
        if identities is not None:
            columns = identities.track_id.tolist(), identities.system_id.tolist(), identities.confidence.tolist()
            found = {track: (vehicle, sure) for track, vehicle, sure in zip(*columns, strict=True)}
        self.by_track = {track: vehicle for track, (vehicle, _) in found.items() if vehicle}
        events = self._given(t_us, found)
        named = set(self.by_track.values())
        self._untold = {who: since for who, since in self._untold.items() if who in named or who in self._told}
        for vehicle, track in list(self._told.items()):
            if vehicle in named:
                continue
            reason = self._reason(track, vehicle, identities, state)
            if self._lasts(t_us, vehicle, 0, 0 if reason else FADES_US):
                del self._told[vehicle]
                reason = reason or self._doubt(track, vehicle, identities, suspected)
                text = f"track {track} is no longer {self.mission.name_of(vehicle)}: {reason}"
                events.append(Event(t_us=t_us, level="info", kind="identity", text=text, system_id=vehicle))
        self._at_border = _tracks_at_border(tracks, size)
        self.evidence_forgotten = False
        return events

    def _given(self, t_us: int, found: dict[int, tuple[int, float]]) -> list[Event]:
        """Events of names that tracks have and that are not told."""
        events = []
        told = {track: vehicle for vehicle, track in self._told.items()}
        for track, vehicle in self.by_track.items():
            before = self._told.get(vehicle, 0)
            back_us = BACK_US if not before and self._last.get(vehicle) == track else 0
            if before == track:
                self._untold.pop(vehicle, None)
                continue
            if not self._lasts(t_us, vehicle, track, FADES_US if before in found else back_us):
                continue
            self._told[vehicle] = self._last[vehicle] = track
            text = f"track {track} is {self.mission.name_of(vehicle)} ({certainty(found[track][1])})"
            level: Level = "info"
            if other := told.get(track):
                level, text = "warning", f"{text}, no longer {self.mission.name_of(other)}"
                if self._told[other] == track:  # else it is another one now, which is told, too
                    del self._told[other]
            events.append(Event(t_us=t_us, level=level, kind="identity", text=text, system_id=vehicle))
        return events

    def _lasts(self, t_us: int, vehicle: int, track: int, wait_us: int) -> bool:
        """Tell whether a vehicle has been a track, or none, for so long; what does is to be told."""
        was, since_us = self._untold.get(vehicle, (-1, t_us))
        since_us = since_us if was == track else t_us
        self._untold[vehicle] = track, since_us
        if t_us - since_us < wait_us:
            return False
        del self._untold[vehicle]
        return True

    def _reason(self, track: int, vehicle: int, identities: Identities | None, state: FleetState) -> str:
        """Why a track cannot carry a vehicle's name any more; empty: it could."""
        if vehicle not in self.mission.ugv_ids:
            return "it is left out of the fleet"
        status = {each.system_id: each for each in state.vehicles}[vehicle]
        if self.evidence_forgotten:
            return "names begin anew"
        if state.vehicles[0].contested:
            return "several senders use the UAV's id"
        if identities is None:
            return "the camera's pose is unknown" if state.uav.position_valid else "the UAV's position is lost"
        if status.contested:
            return "several senders use its id"
        if track not in identities.track_id:
            return "it left the picture" if track in self._at_border else "the track was lost"
        if status.frozen and status.position_state == "lost":
            return STANDS_STILL
        if status.position_state in ("refused", "lost"):
            because = f": {status.refused_for}" if status.position_state == "refused" and status.refused_for else ""
            return f"its positions are {status.position_state}{because}"
        return ""

    def _doubt(self, track: int, vehicle: int, identities: Identities | None, suspected: Collection[int]) -> str:
        """Doubt that takes a vehicle's name from a track that could carry it."""
        assert identities is not None
        if track in self.by_track:
            return f"it is {self.mission.name_of(self.by_track[track])}"
        if vehicle in suspected:
            return CONTRADICTED
        row = int(np.flatnonzero(identities.track_id == track)[0])
        none = float(identities.candidates.none_of_ours[row])
        return (
            f"none of ours is likelier ({certainty(none)})" if none > NONE_LIKELIER else "the evidence does not suffice"
        )


def _tracks_at_border(tracks: Tracks, size: tuple[int, int] | None) -> frozenset[int]:
    """Tracks whose boxes reach to the border of the frame or beyond it."""
    if size is None:
        return frozenset()
    centre, reach = np.column_stack([tracks.cx, tracks.cy]), 0.5 * np.maximum(tracks.w, tracks.h)[:, None]
    reaching = ((centre < reach) | (centre > np.array(size) - reach)).any(axis=1)
    return frozenset(tracks.track_id[reaching].tolist())
