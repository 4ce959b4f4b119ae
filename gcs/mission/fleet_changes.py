"""A mission whose fleet an operator changes in flight: vehicles are taken in, left out and renamed."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from gcs.mission.mission import Mission, MissionVehicle
from gcs.snapshot import FleetChange


def changed(mission: Mission, change: FleetChange) -> Mission:
    """The mission after a change; one who is taken in is the last of its ground vehicles.

    Raises:
        ValueError: it cannot be made, and why not.
    """
    system_id = change.system_id
    ids = (mission.uav.system_id, *(view.system_id for view in mission.view), *mission.ugv_ids)
    called = mission.name_of(system_id)
    vehicle = MissionVehicle(system_id=system_id, name=change.name)
    if (change.what == "added") == (system_id in ids):
        raise ValueError(f"{called} is {'already' if system_id in ids else 'not'} in the fleet")
    if change.what == "left out":
        if system_id not in mission.ugv_ids or len(mission.ugv) == 1:
            raise ValueError(f"{called} cannot be left out: a flight needs its aircraft and a ground vehicle")
        return replace(mission, ugv=tuple(v for v in mission.ugv if v.system_id != system_id))
    if change.what == "added":
        after = replace(mission, ugv=(*mission.ugv, vehicle))
    elif system_id == mission.uav.system_id:
        after = replace(mission, uav=vehicle)
    else:
        views = tuple(replace(v, name=change.name) if v.system_id == system_id else v for v in mission.view)
        ugv = tuple(vehicle if v.system_id == system_id else v for v in mission.ugv)
        after = replace(mission, view=views, ugv=ugv)
    name = after.name_of(system_id)
    if name in {mission.name_of(i) for i in ids if i != system_id}:
        raise ValueError(f"another vehicle is called {name}")
    return after


def with_all(mission: Mission, changes: Iterable[FleetChange]) -> Mission:
    """The mission with everyone who was ever in it, by the names that they had last; what cannot be is passed over."""
    for change in changes:
        if change.what == "left out":
            continue
        if change.what == "added" and change.system_id in mission.ugv_ids:
            continue  # taken in again
        try:
            mission = changed(mission, change)
        except ValueError:
            continue
    return mission


def words_of(change: FleetChange, before: Mission, after: Mission) -> str:
    """Words for a change."""
    if change.what == "renamed":
        return f"{before.name_of(change.system_id)} is called {after.name_of(change.system_id)} from now on"
    if change.what == "left out":
        return f"{before.name_of(change.system_id)} is left out of the fleet: no box gets its name"
    return f"{after.name_of(change.system_id)} is in the fleet from now on"
