"""Names from one frame to the next: which came, changed or went, and why."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

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
FADES_US = 1_000_000
"""Time for which the evidence must not suffice until that is said: a name that is back by then was never gone."""
BACK_US = 2_000_000
"""Time that a name must last on the box that lost it until it is said to be back: near its limit it comes and goes."""


class NameChanges:
    """Compares the identities of each frame with those before.

    Attributes:
        by_track: system id by the track that carries its name now.
        began_anew: set when all evidence is given up, until the next frame.
    """

    def __init__(self, mission: Mission) -> None:
        self.mission = mission
        self._at_border: frozenset[int] = frozenset()
        self.by_track: dict[int, int] = {}
        self.began_anew = False
        self._fading: dict[int, Event] = {}
        """Event that is told once the name has been gone for long enough, by vehicle."""
        self._lost: dict[int, int] = {}
        """Track that lost its name, by vehicle: what was said last of it."""
        self._back_us: dict[int, int] = {}
        """Time at which the name came back to that track, by vehicle, until that is said."""

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
            if self._back_us.pop(vehicle, None) is not None:
                continue  # that it was lost is what was said last
            self._lost[vehicle] = track
            reason = self._reason(track, vehicle, identities, state)
            why = reason or self._doubt(track, vehicle, identities, suspected)
            text = f"track {track} is no longer {self.mission.name_of(vehicle)}: {why}"
            event = Event(t_us=t_us, level="info", kind="identity", text=text, system_id=vehicle)
            if reason:
                events.append(event)
            else:
                self._fading[vehicle] = event
        events += self._faded(t_us)
        self._at_border = _tracks_at_border(tracks, size)
        self.began_anew = False
        return events

    def _given(self, t_us: int, before: dict[int, int], found: dict[int, tuple[int, float]]) -> list[Event]:
        events = []
        for track, (vehicle, sure) in found.items():
            former = before.get(track)
            if not vehicle or not self._is_to_tell(t_us, track, vehicle, former):
                continue
            self._lost.pop(vehicle, None)
            self._back_us.pop(vehicle, None)
            self._fading.pop(vehicle, None)
            text = f"track {track} is {self.mission.name_of(vehicle)} ({certainty(sure)})"
            replaced = former if former != vehicle else None
            text += f", no longer {self.mission.name_of(replaced)}" if replaced else ""
            level: Level = "warning" if replaced else "info"
            events.append(Event(t_us=t_us, level=level, kind="identity", text=text, system_id=vehicle))
        return events

    def _is_to_tell(self, t_us: int, track: int, vehicle: int, former: int | None) -> bool:
        """Tell whether a name is new on its track, and for long enough where it is back on the one that lost it."""
        if vehicle == former:
            return t_us - self._back_us.get(vehicle, t_us) >= BACK_US
        if former is not None or self._lost.get(vehicle) != track:
            return True
        if self._fading.pop(vehicle, None) is None:
            self._back_us[vehicle] = t_us
        else:
            del self._lost[vehicle]
        return False

    def _faded(self, t_us: int) -> list[Event]:
        """Events of names that have been gone for long enough."""
        faded = [vehicle for vehicle, event in self._fading.items() if t_us - event.t_us >= FADES_US]
        return [replace(self._fading.pop(vehicle), t_us=t_us) for vehicle in faded]

    def _reason(self, track: int, vehicle: int, identities: Identities | None, state: FleetState) -> str:
        """Why a track cannot carry a vehicle's name any more; empty: it could."""
        if vehicle not in self.mission.ugv_ids:
            return "it is left out of the fleet"
        status = {each.system_id: each for each in state.vehicles}[vehicle]
        if self.began_anew:
            return "names begin anew"
        if state.vehicles[0].contested:
            return "several senders use the UAV's id"
        if identities is None:
            return "the camera's pose is unknown" if state.uav.position_valid else "the UAV's position is lost"
        if status.contested:
            return "several senders use its id"
        if track not in identities.track_id:
            return "it left the picture" if track in self._at_border else "the track was lost"
        if track in self.by_track:
            return f"it is {self.mission.name_of(self.by_track[track])}"
        if status.position_state in ("refused", "lost"):
            because = f": {status.refused_for}" if status.position_state == "refused" and status.refused_for else ""
            return f"its positions are {status.position_state}{because}"
        return ""

    def _doubt(self, track: int, vehicle: int, identities: Identities | None, suspected: Collection[int]) -> str:
        """What takes a vehicle's name from a track that could carry it."""
        assert identities is not None
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
