"""Vehicles heard that are not in the fleet, and those of them that are offered: a ground vehicle near it that reports
where it is."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np

from gcs.mission.roster import HeardVehicle, Roster
from gcs.snapshot import Event, Snapshot
from gcs.station import Newcomer
from mavlink.protocol.packet import Auth, Packet

MIN_POSITIONS = 5
"""Positions after which a vehicle is offered: who passes by or is made up for a moment is not."""
NEAR_M = 2000.0
"""Distance from every vehicle of the fleet beyond which a vehicle is of another flight."""
MAX_OFFERED = 8
"""Most newcomers offered: more at once are made up, or another fleet; they can be taken in all the same."""
MAX_PACKETS = 1000
"""Most packets of unknown senders that are examined from one check for new vehicles to the next: enough under a
flood."""


class Newcomers:
    """Listens to senders that are not in the fleet; ``add_packets`` is of one thread, all else of another.

    Args:
        known: system ids that the operator knows and has left out: they are never offered.
    """

    def __init__(self, known: Collection[int] = ()) -> None:
        self._roster = Roster()
        self._known = set(known)
        self._budget = MAX_PACKETS
        self._offered: set[int] = set()
        self._crowded = False
        self.heard: tuple[Newcomer, ...] = ()
        """Vehicles that are not in the fleet, by system id."""

    def add_packets(self, packets: Sequence[Packet], fleet: Collection[int]) -> None:
        """Take in packets of any system; fleet: system ids of those who fly."""
        for packet in packets:
            if packet.system_id not in fleet and self._budget > 0:
                self._budget -= 1
                self._roster.add_packet(packet)

    def look(self, t_us: int, fleet: Collection[int], snapshot: Snapshot | None) -> list[Event]:
        """See who is there; an event for everyone who is new and may be one of ours.

        Args:
            t_us: now, Unix µs.
            fleet: system ids of those who fly.
            snapshot: the newest.
        """
        self._budget = MAX_PACKETS
        self._known |= set(fleet)
        before = {each.system_id for each in self.heard if each.offered}
        ours = [self._judged(each, snapshot) for each in self._roster.vehicles if each.system_id not in fleet]
        new = [each for each in ours if each.offered and each.system_id not in before]
        room = max(MAX_OFFERED - len(self._offered), 0)
        self._offered |= {each.system_id for each in new[:room]}
        self.heard = tuple(replace(each, offered=each.offered and each.system_id in self._offered) for each in ours)
        events = [
            Event(t_us=t_us, level="info", kind="vehicle", text=each.offer, system_id=each.system_id)
            for each in new[:room]
        ]
        if new[room:] and not self._crowded:
            self._crowded = True
            text = f"more than {MAX_OFFERED} new vehicles are heard: no more are offered; F shows all who are heard"
            events.append(Event(t_us=t_us, level="warning", kind="vehicle", text=text))
        return events

    def _judged(self, each: HeardVehicle, snapshot: Snapshot | None) -> Newcomer:
        """A vehicle that is not in the fleet, offered where it may be one of ours."""
        away_m = _away_m(each, snapshot)
        reports = len(each.positions) >= MIN_POSITIONS and each.auth <= Auth.GOOD
        near = each.system_id in self._offered or (reports and away_m <= NEAR_M)
        ours = each.role == "named" and near and each.system_id not in self._known
        return Newcomer(system_id=each.system_id, kind=each.kind, away_m=away_m, offered=ours)


def _away_m(each: HeardVehicle, snapshot: Snapshot | None) -> float:
    """Distance over ground to the nearest vehicle of the fleet, metres; inf where a place is not known."""
    if snapshot is None or snapshot.origin is None or not math.isfinite(each.lat_deg):
        return math.inf
    place = snapshot.origin.to_enu(each.lat_deg, each.lon_deg, snapshot.origin.alt_m)
    away = [float(np.hypot(*(row.p_enu - place)[:2])) for row in snapshot.vehicles]
    return min((each for each in away if math.isfinite(each)), default=math.inf)
