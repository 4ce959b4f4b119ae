"""Names from one frame to the next: which came, changed or went, and whose position contradicts the video."""

from __future__ import annotations

from assoc.identification.identifier import Identities
from gcs.certainty import certainty
from gcs.health.vehicle_alarms import APART_M, APART_S, APART_STDS
from gcs.mission.mission import Mission
from gcs.snapshot import Event, Level
from mavlink.fleet.fleet import FleetState

__all__ = ["NameChanges"]


class NameChanges:
    """Compares the identities of each frame with those before.

    Attributes:
        by_track: system id by the track that carries its name now.
        conflicts: system ids of vehicles whose positions contradict the video.
    """

    def __init__(self, mission: Mission) -> None:
        self._mission = mission
        self._apart_since_us: dict[int, int] = {}
        self.by_track: dict[int, int] = {}
        self.conflicts: frozenset[int] = frozenset()

    def update(self, t_us: int, identities: Identities | None, state: FleetState) -> list[Event]:
        """Take in one frame; returns an event for each name that came, changed or went.

        Args:
            t_us: its time.
            identities: of its tracks, None without a camera pose.
            state: the fleet then.
        """
        before, self.by_track = self.by_track, {}
        self.conflicts = self._apart_from_video(t_us, identities, state)
        if identities is None:
            return []
        self.conflicts |= frozenset(identities.conflict)
        columns = identities.track_id.tolist(), identities.system_id.tolist(), identities.confidence.tolist()
        found = {track: (vehicle, sure) for track, vehicle, sure in zip(*columns, strict=True)}
        self.by_track = {track: vehicle for track, (vehicle, _) in found.items() if vehicle}
        return [*self._given(t_us, before, found), *self._withdrawn(t_us, before, found)]

    def _given(self, t_us: int, before: dict[int, int], found: dict[int, tuple[int, float]]) -> list[Event]:
        events = []
        for track, (vehicle, sure) in found.items():
            former = before.get(track)
            if vehicle and vehicle != former:
                text = f"track {track} is {self._mission.name_of(vehicle)} ({certainty(sure)})"
                text += f", no longer {self._mission.name_of(former)}" if former else ""
                level: Level = "warning" if former else "info"
                events.append(Event(t_us=t_us, level=level, kind="identity", text=text, system_id=vehicle))
        return events

    def _withdrawn(self, t_us: int, before: dict[int, int], found: dict[int, tuple[int, float]]) -> list[Event]:
        events = []
        for track, vehicle in before.items():
            if track in found and not found[track][0]:
                text = f"track {track} is no longer {self._mission.name_of(vehicle)}: the evidence does not suffice"
                events.append(Event(t_us=t_us, level="info", kind="identity", text=text, system_id=vehicle))
        return events

    def _apart_from_video(self, t_us: int, identities: Identities | None, state: FleetState) -> frozenset[int]:
        """Vehicles that have long reported to be far from their own boxes, by more than their receivers' noise."""
        before, self._apart_since_us = self._apart_since_us, {}
        if identities is not None:
            std_m = dict(zip(state.system_id.tolist(), state.std_m.tolist(), strict=True))
            for vehicle, away_m in zip(identities.system_id.tolist(), identities.residual_m.tolist(), strict=True):
                if vehicle and away_m > APART_M + APART_STDS * std_m[vehicle]:
                    self._apart_since_us[vehicle] = before.get(vehicle, t_us)
        return frozenset(v for v, since_us in self._apart_since_us.items() if t_us - since_us >= APART_S * 1e6)
