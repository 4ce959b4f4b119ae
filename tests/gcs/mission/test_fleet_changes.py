"""A fleet changes by one vehicle at a time; what cannot be is refused with the reason."""

from dataclasses import replace

import pytest

from gcs.mission.fence import Fence
from gcs.mission.fleet_changes import changed, with_all
from gcs.mission.mast import Mast
from gcs.mission.mission import Camera, Mission, MissionVehicle, View
from gcs.snapshot import FleetChange

FENCE = Fence(centre=(48.0, 11.0), radius_m=50.0, vehicles=(12,))
BEGAN = Mission(
    uav=MissionVehicle(system_id=1),
    ugv=(MissionVehicle(system_id=11, name="Alpha"), MissionVehicle(system_id=12)),
    view=(View(system_id=2, name="Mast"),),
    fence=(FENCE,),
)


def change(what, system_id, name=""):
    return FleetChange(what=what, system_id=system_id, name=name)


@pytest.mark.parametrize(
    ("what", "fleet"),
    [
        (("added", 18), {1: "UAV", 2: "Mast", 11: "Alpha", 12: "UGV-12", 18: "UGV-18"}),
        (("left out", 11), {1: "UAV", 2: "Mast", 12: "UGV-12"}),
        (("renamed", 11), {1: "UAV", 2: "Mast", 11: "UGV-11", 12: "UGV-12"}),
        (("renamed", 1, "Eye"), {1: "Eye", 2: "Mast", 11: "Alpha", 12: "UGV-12"}),
        (("renamed", 2, "Eye"), {1: "UAV", 2: "Eye", 11: "Alpha", 12: "UGV-12"}),
    ],
)
def test_a_change_makes_another_mission(what, fleet):
    after = changed(BEGAN, change(*what))
    assert {i: after.name_of(i) for i in after.system_ids} == fleet


def test_a_mast_can_be_renamed():
    mast = Mast(latitude_deg=48.0, longitude_deg=11.0, height_m=12.0, heading_deg=0.0)
    after = changed(
        replace(BEGAN, view=(View(mast=mast, camera=Camera(pitch_deg=-20.0)),)), change("renamed", 257, "Gate")
    )
    assert after.name_of(257) == "Gate"
    with pytest.raises(ValueError, match="another vehicle is called Gate"):
        changed(after, change("renamed", 12, "Gate"))


@pytest.mark.parametrize(
    ("what", "why"),
    [
        (("added", 11), "Alpha is already in the fleet"),
        (("added", 1), "UAV is already"),
        (("added", 2), "Mast is already"),
        (("added", 18, "Alpha"), "another vehicle is called Alpha"),
        (("left out", 18), "UGV-18 is not in the fleet"),
        (("left out", 1), "UAV cannot be left out"),
        (("left out", 2), "Mast cannot be left out"),
        (("left out", 12), "a fence is for system id 12"),
        (("renamed", 12, "Alpha"), "another vehicle is called Alpha"),
        (("renamed", 12, "Mast"), "another vehicle is called Mast"),
        (("renamed", 18, "Eve"), "UGV-18 is not in the fleet"),
    ],
)
def test_what_cannot_be_is_refused(what, why):
    with pytest.raises(ValueError, match=why):
        changed(BEGAN, change(*what))


def test_a_recording_knows_everyone_who_ever_was_in_the_fleet():
    changes = [
        *(change("left out", 11), change("added", 18), change("renamed", 18, "Eve"), change("left out", 18)),
        *(change("added", 11), change("left out", 99)),
    ]
    everyone = with_all(BEGAN, changes)
    assert {i: everyone.name_of(i) for i in everyone.ugv_ids} == {11: "Alpha", 12: "UGV-12", 18: "Eve"}
