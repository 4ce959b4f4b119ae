"""A fleet's telemetry log as it is: who sends in it, and where the ground vehicles were."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gcs.importing.messages import TlogRecord
from gcs.importing.vehicle_log import PlaceTrack, whole_places
from mavlink.protocol.modes import is_aircraft, is_ground_vehicle, is_vehicle
from mavlink.tlog.log import Tlog

__all__ = ["FleetTlog", "open_fleet"]

_HEARTBEAT, _GLOBAL_POSITION = 0, 33
_UNKNOWN_SPEED = 32767
_UNKNOWN_HEADING = 36000


@dataclass(frozen=True, slots=True, kw_only=True)
class FleetTlog:
    """A telemetry log, opened."""

    tlog: Tlog
    aircraft: tuple[int, ...]
    """System ids by their heartbeats, ascending."""
    ground: tuple[int, ...]

    @property
    def system_ids(self) -> frozenset[int]:
        """Of all who send."""
        return frozenset(map(int, np.unique(self.tlog.index.system_id)))

    def places(self, system_id: int) -> PlaceTrack:
        """Positions of a vehicle by arrival, Unix µs."""
        rows, wire = self.tlog.columns(_GLOBAL_POSITION, system_id)
        order = np.argsort(self.tlog.index.t_us[rows], kind="stable")
        wire, t_us = wire[order], self.tlog.index.t_us[rows][order].astype(np.int64)
        v = np.column_stack([wire[name].astype(np.float64) for name in ("vx", "vy", "vz")])
        heading = np.radians(wire["hdg"] * 0.01)
        places = PlaceTrack(
            t_us=t_us,
            lat_deg=wire["lat"] * 1e-7,
            lon_deg=wire["lon"] * 1e-7,
            alt_m=wire["alt"] * 1e-3,
            height_m=wire["relative_alt"] * 1e-3,
            v_ned=np.where(np.abs(v) < _UNKNOWN_SPEED, v * 0.01, np.nan),
            heading=np.where(wire["hdg"] <= _UNKNOWN_HEADING, heading, np.nan),
            std_m=float("nan"),
        )
        return places.select(whole_places(places.lat_deg, places.lon_deg))

    def records_of(self, system_id: int) -> Iterator[TlogRecord]:
        """The records of one system, by arrival."""
        packets = sorted(self.tlog.packets(system_ids=(system_id,)), key=lambda packet: packet.t_us)
        return ((packet.t_us, packet.raw) for packet in packets)

    def records(self, without: Collection[int]) -> Iterator[TlogRecord]:
        """All records but those of some systems, as they are, in the order of the file."""
        for packet in self.tlog.packets():
            if packet.system_id not in without:
                yield packet.t_us, packet.raw


def open_fleet(path: Path) -> FleetTlog:
    """Open a telemetry log.

    Raises:
        TlogError: it cannot be read as one.
    """
    tlog = Tlog.open(path)
    rows, wire = tlog.columns(_HEARTBEAT)
    kinds: dict[int, int] = {}
    senders = tlog.index.system_id[rows].tolist()
    for system_id, kind, autopilot in zip(senders, wire["type"].tolist(), wire["autopilot"].tolist(), strict=True):
        if is_vehicle(kind, autopilot):
            kinds.setdefault(system_id, kind)
    return FleetTlog(
        tlog=tlog,
        aircraft=tuple(sorted(i for i, kind in kinds.items() if is_aircraft(kind))),
        ground=tuple(sorted(i for i, kind in kinds.items() if is_ground_vehicle(kind))),
    )
