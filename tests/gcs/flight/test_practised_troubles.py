"""What an operator practises with is told by the alarms that a real trouble has, and is over when it ends."""

import threading
from contextlib import contextmanager
from dataclasses import replace

import pytest

from gcs.flight.flight import Flight
from gcs.flight.plan import FlightPlan
from gcs.mission.mission import Mission, MissionVehicle, SigningChoice
from mavlink.signing.keys import write_key
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


NO_SIGNING = SigningChoice(keys="none")


def is_placed(row):
    return row.position_state == "ok"


@contextmanager
def practising(folder, signing=NO_SIGNING, keys=None):
    """A flight with a simulated fleet of seven, everybody in place."""
    port, practise = free_port(), free_port()
    scenario = replace(nominal(7), duration_s=240.0)
    ugv = tuple(MissionVehicle(system_id=i) for i in scenario.ugv_ids)
    mission = Mission(uav=MissionVehicle(system_id=1), ugv=ugv, signing=signing)
    stop = threading.Event()
    fleet = threading.Thread(
        target=play,
        args=(scenario, f"udpout:127.0.0.1:{port}", None),
        kwargs={"stop": stop, "practise_port": practise, "keys": keys},
    )
    links = (f"udpin:127.0.0.1:{port}",)
    flight = Flight(FlightPlan(mission=mission, links=links, video="", sessions=folder, practise_port=practise))
    fleet.start()
    try:
        assert until(lambda: flight.latest() and all(row.kind and is_placed(row) for row in flight.latest().vehicles))
        yield flight
    finally:
        stop.set()
        fleet.join()
        flight.stop()


def raises(flight, key):
    return until(lambda: any(alarm.key.startswith(key) for alarm in flight.latest().alarms))


@pytest.mark.slow
def test_each_trouble_raises_its_alarm(tmp_path):
    with practising(tmp_path) as flight:
        for system_id, name in enumerate(ALARMS, 11):
            flight.practice.toggle(name, system_id)
        assert [key for key in ALARMS.values() if not raises(flight, key)] == []
        for name, (_, system_id) in MORE.items():
            flight.practice.toggle(name, system_id)
        assert [name for name, system_id in MORE.values() if not raises(flight, f"{name} {system_id}")] == []
    assert sum("practised: " in event.text for event in flight.events()) == len(ALARMS) + len(MORE)


@pytest.mark.slow
def test_troubles_of_signing_raise_their_alarms(tmp_path):
    keys = {i: bytes([i, *range(31)]) for i in (1, *range(11, 18))}
    for system_id, secret in keys.items():
        write_key(tmp_path / "keys", system_id, secret)
    with practising(tmp_path / "sessions", SigningChoice(keys=str(tmp_path / "keys")), keys) as flight:
        for system_id, name in enumerate(("unsigned", "signature", "stale"), 11):
            flight.practice.toggle(name, system_id)
        wanted = ("unsigned 11", "signature 12", "replay 13")
        assert [key for key in wanted if not raises(flight, key)] == []
