"""Who may be one of ours is offered; nobody else, and a flood of made-up ids offers nothing endless."""

from dataclasses import replace

import numpy as np
import pytest

from gcs.flight.flight import Flight
from gcs.flight.newcomers import MAX_OFFERED, MAX_PACKETS, Newcomers
from gcs.flight.plan import FlightPlan
from gcs.mission.mission import Mission, MissionVehicle, load_mission
from gcs.playback.analysis import Analysis
from gcs.session.session import open_session
from gcs.snapshot import FleetChange, VehicleRow
from mavlink.geodesy import LocalFrame
from mavlink.protocol.encoder import COPTER, ROVER, MavlinkEncoder
from mavlink.protocol.packet import Auth, Packet
from tests.support.fake_station import make_snapshot
from tests.support.fake_vehicles import FakeVehicle
from tests.support.ports import free_port
from tests.support.waiting import until

ORIGIN = LocalFrame(48.0, 11.0, 500.0)
FLEET = (1, 11)


ROW = VehicleRow(system_id=11, name="UGV-11", role="ugv", p_enu=np.zeros(3))
SHOWN = replace(make_snapshot(), origin=ORIGIN, vehicles=(ROW,))


def packets(system_id, kind=ROVER, *, north_m=40.0, count=6, auth=Auth.OPEN):
    encoder = MavlinkEncoder(system_id)
    place = (48.0 + north_m / 111_195.0, 11.0, 500.0)
    yield Packet(1_000_000, encoder.heartbeat(kind), auth=auth)
    for k in range(count):
        raw = encoder.global_position_int(1000 + 200 * k, *place, 0.0, (1.0, 0.0, 0.0), 0.0)
        yield Packet(1_000_000 + 200_000 * k, raw, auth=auth)


@pytest.mark.parametrize(
    ("sent", "told"),
    [
        (packets(18), "rover 18 is heard, 40 m from the fleet: F takes it in"),
        (packets(18, COPTER), ""),
        (packets(18, north_m=5000.0), ""),
        (packets(18, count=3), ""),
        (packets(18, auth=Auth.UNSIGNED), ""),
        (packets(11), ""),
        (packets(17), ""),
    ],
    ids=["one of ours", "aircraft", "far away", "for a moment", "refused", "in the fleet", "left out before"],
)
def test_a_ground_vehicle_near_the_fleet_is_offered_once(sent, told):
    newcomers = Newcomers(known=(17,))
    newcomers.add_packets(list(sent), FLEET)
    texts = [[event.text for event in newcomers.look(0, FLEET, SHOWN)] for _ in range(2)]
    assert texts == [[told] if told else [], []]
    assert any(each.offered for each in newcomers.heard) == bool(told)


def test_who_was_left_out_in_flight_is_not_offered_and_can_be_taken_in_again():
    newcomers = Newcomers()
    newcomers.look(0, (1, 18), None)
    newcomers.add_packets(list(packets(18)), FLEET)
    assert newcomers.look(0, FLEET, SHOWN) == []
    assert [(each.system_id, each.offered) for each in newcomers.heard] == [(18, False)]


@pytest.mark.slow
def test_made_up_ids_are_offered_a_few_times_and_told_once():
    newcomers = Newcomers()
    told = []
    for system_id in range(12, 250):
        newcomers.add_packets(list(packets(system_id)), FLEET)
        told += newcomers.look(0, FLEET, SHOWN)
    assert len(told) == MAX_OFFERED + 1 and "no more are offered" in told[-1].text
    flood = [packet for _ in range(400) for packet in packets(250)]
    newcomers.add_packets(flood, FLEET)
    found = next(each for each in newcomers._roster.vehicles if each.system_id == 250)
    assert len(flood) > found.packets == MAX_PACKETS


def test_a_vehicle_that_comes_in_flight_is_taken_in_and_is_in_the_saved_mission(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    port = free_port()
    mission = Mission(uav=MissionVehicle(system_id=1), ugv=(MissionVehicle(system_id=11),))
    flight = Flight(FlightPlan(mission=mission, links=(f"udpin:127.0.0.1:{port}",), video="", sessions=tmp_path))
    vehicles = [FakeVehicle(("127.0.0.1", port), i, kind=ROVER if i > 1 else COPTER) for i in (1, 11, 18)]
    try:
        until(lambda: any(each.offered for each in flight.newcomers()))
        flight.change_fleet(FleetChange(what="added", system_id=18, name="Eve"))
        until(lambda: any(row.name == "Eve" and row.position_state == "ok" for row in flight.latest().vehicles))
        until(lambda: not flight.newcomers())
        with pytest.raises(ValueError, match="Eve is already in the fleet"):
            flight.change_fleet(FleetChange(what="added", system_id=18))
        assert "saved in mission.toml" in flight.save_mission()
    finally:
        flight.stop()
        for each in vehicles:
            each.close()
    saved = load_mission(tmp_path / "mission.toml")
    assert "# taken in during the flight\n[[ugv]]\nsystem_id = 18" in (tmp_path / "mission.toml").read_text()
    assert [(each.system_id, each.name) for each in saved.ugv] == [(11, "UGV-11"), (18, "Eve")]
    session = open_session(flight.folder)
    assert (session.began.ugv_ids, session.mission.ugv_ids) == ((11,), (11, 18))
    *_, (_, last) = Analysis(session).moments()
    assert [row.name for row in last.vehicles] == ["UAV", "UGV-11", "Eve"] and last.vehicles[2].position_state == "ok"
