"""All vehicles speak to one UDP port, as most do: what is for the UAV goes to the UAV's socket alone."""

from __future__ import annotations

import time

from gcs.command import CommandService
from gcs.flight.flight import Flight
from gcs.flight.plan import FlightPlan
from gcs.mission.mission import Mission, MissionVehicle
from mavlink.ingest.ingest import Ingest
from mavlink.tlog.log import Tlog
from mavlink.transmit.transmitter import Transmitter
from tests.support.fake_vehicles import FakeVehicle, rover
from tests.support.ports import free_port
from tests.support.waiting import until


def test_ground_vehicles_on_the_same_port_hear_nothing(tmp_path):
    port = free_port()
    ingest = Ingest([f"udpin:127.0.0.1:{port}"], tmp_path / "telemetry.tlog", system_ids=(1, 3, 4))
    uav, ugvs = FakeVehicle(("127.0.0.1", port), 1), [rover(("127.0.0.1", port), k) for k in (3, 4)]
    events = []
    transmitter = Transmitter(1, lambda link, peer, raw: ingest.send(link, raw, peer))
    desk = CommandService(
        uav=1,
        ground={3: "UGV-3", 4: "UGV-4"},
        uav_name="UAV-1",
        transmitter=transmitter,
        where=lambda system_id: None,
        on_event=events.append,
    )
    try:
        end_s, ordered = time.monotonic() + 60.0, False
        while time.monotonic() < end_s and not any("accepted" in event.text for event in events):
            for packet in ingest.read(0.02):
                desk.receive(packet)
            desk.poll()
            if not ordered and desk._mavsdk._direct_to_uav() is not None:
                ordered = True
                desk.submit("point", 3)
        assert any("accepted" in event.text for event in events)
        assert uav.bytes_heard > 0
        assert [vehicle.bytes_heard for vehicle in ugvs] == [0, 0]
    finally:
        desk.close()
        ingest.stop()
        for vehicle in (uav, *ugvs):
            vehicle.close()


def test_packets_received_are_not_those_that_were_sent(tmp_path):
    port = free_port()
    mission = Mission(uav=MissionVehicle(system_id=1), ugv=(MissionVehicle(system_id=3),))
    url = f"udpin:127.0.0.1:{port}"
    flight = Flight(FlightPlan(mission=mission, links=(url,), video="", sessions=tmp_path, command=True))
    uav = FakeVehicle(("127.0.0.1", port), 1)
    try:
        assert until(lambda: len(uav.heard) >= 10)
    finally:
        uav.close()
        flight.stop()
    senders = Tlog.open(flight.folder / "telemetry.tlog").index.system_id.tolist()
    assert senders.count(254) >= 10
    assert flight.packets == senders.count(1) == len(senders) - senders.count(254)
