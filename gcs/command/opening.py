"""A command desk for a mission: who is the UAV, who is a ground vehicle, and where it is for sure."""

from __future__ import annotations

import math
import time
from collections.abc import Callable

from gcs.command.desk import COMPONENT_ID, SYSTEM_ID, CommandDesk
from gcs.command.wire import Place
from gcs.config import Mission
from gcs.snapshot import Event, Snapshot
from mavlink.geodesy import LocalFrame
from mavlink.outgoing import Outgoing, Send

__all__ = ["open_desk", "places"]

FRESH_US = 2_000_000
"""A snapshot older than this says nothing about now."""


def open_desk(
    mission: Mission,
    *,
    send: Send,
    latest: Callable[[], Snapshot | None],
    origin: Callable[[], LocalFrame | None],
    tell: Callable[[Event], None],
    sign: Callable[[bytes], bytes] | None = None,
    sent: Callable[[int, bytes], None] = lambda link, raw: None,
    own: tuple[int, int] = (SYSTEM_ID, COMPONENT_ID),
) -> CommandDesk:
    """Opens a desk; close it when the flight ends.

    Args:
        mission: who flies.
        send: brings a frame to one peer of a link, see :class:`mavlink.outgoing.Outgoing`.
        latest: the newest snapshot.
        origin: of the ENU frame, None while it is not known.
        tell: given events, in any thread.
        sign: makes a signed frame of an unsigned one, where the UAV has a key.
        sent: told every frame that left.
        own: system and component id of the station.
    """
    return CommandDesk(
        uav=mission.uav.system_id,
        ground={vehicle.system_id: mission.name_of(vehicle.system_id) for vehicle in mission.ugv},
        uav_name=mission.name_of(mission.uav.system_id),
        outgoing=Outgoing(mission.uav.system_id, send, sign=sign, sent=sent),
        where=places(latest, origin),
        tell=tell,
        own=own,
    )


def places(
    latest: Callable[[], Snapshot | None],
    origin: Callable[[], LocalFrame | None],
    now_us: Callable[[], int] = lambda: time.time_ns() // 1000,
) -> Callable[[int], Place | None]:
    """Where a vehicle is: by its row in the newest snapshot, only while that is fresh and its position is good."""

    def where(system_id: int) -> Place | None:
        snapshot, frame = latest(), origin()
        if snapshot is None or frame is None or abs(now_us() - snapshot.t_us) > FRESH_US:
            return None
        row = next((row for row in snapshot.vehicles if row.system_id == system_id), None)
        if row is None or row.position_state != "ok" or not all(map(math.isfinite, row.p_enu)):
            return None
        lat, lon, _ = frame.to_geodetic(row.p_enu)
        return Place(float(lat), float(lon))

    return where
