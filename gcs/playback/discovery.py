"""Roles of the vehicles in a log that comes without a mission."""

from __future__ import annotations

from gcs.errors import SessionError
from gcs.mission.mission import Mission
from gcs.mission.roster import Role, Roster, mission_of, proposed_roles
from gcs.session.log import SessionLog


def discover(log: SessionLog) -> Mission:
    """Roles by the heartbeats of a log; of several aircraft the one of the lowest id films.

    Raises:
        SessionError: no aircraft or no ground vehicle sends in it.
    """
    roster = Roster()
    for packet in log.accepted_packets(0):
        roster.add_packet(packet)
    roles = proposed_roles(roster.vehicles, {})
    aircraft = [i for i, role in roles.items() if role == "films"]
    ground = [i for i, role in roles.items() if role == "named"]
    if not aircraft or not ground:
        missing = "aircraft" if not aircraft else "ground vehicle"
        raise SessionError(f"{log.path}: no {missing} heartbeat in it; name the vehicles with --mission")
    films: dict[int, Role] = {aircraft[0]: "films"}
    return mission_of(films | dict.fromkeys(ground, "named"))
