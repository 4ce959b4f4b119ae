"""Who flies and who drives in a log that comes without a mission."""

from __future__ import annotations

from gcs.errors import SessionError
from gcs.mission.mission import Mission, MissionVehicle
from gcs.session.log import SessionLog
from mavlink.protocol.decode import decode
from mavlink.protocol.messages import Heartbeat
from mavlink.protocol.modes import is_aircraft, is_ground_vehicle

__all__ = ["discover"]


def discover(log: SessionLog) -> Mission:
    """Who flies and who drives, from the heartbeats of a log.

    Raises:
        SessionError: no aircraft or no ground vehicle sends in it.
    """
    kinds: dict[int, int] = {}
    for packet in log.accepted_packets(0):
        sample = decode(packet)
        if isinstance(sample, Heartbeat):
            kinds.setdefault(sample.system_id, sample.type)
    aircraft = sorted(i for i, kind in kinds.items() if is_aircraft(kind))
    ground = sorted(i for i, kind in kinds.items() if is_ground_vehicle(kind))
    if not aircraft or not ground:
        missing = "aircraft" if not aircraft else "ground vehicle"
        raise SessionError(f"{log.path}: no {missing} heartbeat in it; name the vehicles with --mission")
    return Mission(uav=MissionVehicle(system_id=aircraft[0]), ugv=tuple(MissionVehicle(system_id=i) for i in ground))
