"""What an operator practises with is told by the alarms that a real trouble has, and is over when it ends."""

import threading
from dataclasses import replace

import pytest

from gcs.flight.flight import Flight
from gcs.flight.plan import FlightPlan
from gcs.mission.mission import Mission, MissionVehicle
from sim.live import play
from sim.world.presets import nominal
from tests.support.ports import free_port
from tests.support.waiting import until

ALARMS = {
    "battery": "battery 11",
    "link": "silent 12",
    "loss": "loss 13",
    "impostor": "contested 14",
    "fix": "refused 15",
    "sensor": "part 16",
    "text": "text 17",
}
MORE = {
    "arming": ("arming", 17),
    "charge": ("battery", 15),
    "satellites": ("reception", 11),
    "filter": ("doubted", 13),
    "compass": ("compass", 16),
    "clock": ("clock", 17),
}


def is_placed(row):
    return row.position_state == "ok"


@pytest.mark.slow
def test_each_trouble_raises_its_alarm(tmp_path):
    port, practise = free_port(), free_port()
    scenario = replace(nominal(7), duration_s=240.0)
    ids = scenario.ugv_ids
    mission = Mission(uav=MissionVehicle(system_id=1), ugv=tuple(MissionVehicle(system_id=i) for i in ids))
    stop = threading.Event()
    fleet = threading.Thread(
        target=play,
        args=(scenario, f"udpout:127.0.0.1:{port}", None),
        kwargs={"stop": stop, "practise_port": practise},
    )
    links = (f"udpin:127.0.0.1:{port}",)
    flight = Flight(FlightPlan(mission=mission, links=links, video="", sessions=tmp_path, practise_port=practise))
    fleet.start()
    try:
        assert until(lambda: flight.latest() and all(row.kind and is_placed(row) for row in flight.latest().vehicles))
        for system_id, name in zip(ids, ALARMS, strict=True):
            flight.practice.toggle(name, system_id)
        for key in ALARMS.values():
            assert until(lambda: any(alarm.key.startswith(key) for alarm in flight.latest().alarms)), key  # noqa: B023
        for name, (_, system_id) in MORE.items():
            flight.practice.toggle(name, system_id)
        for name, system_id in MORE.values():
            key = f"{name} {system_id}"
            assert until(lambda: any(alarm.key.startswith(key) for alarm in flight.latest().alarms)), key  # noqa: B023
    finally:
        stop.set()
        fleet.join()
        flight.stop()
    assert sum("practised: " in event.text for event in flight.events()) == len(ALARMS) + len(MORE)
