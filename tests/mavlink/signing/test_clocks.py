"""Who is believed, and when, for autopilots as they sign: stations that start late, end, and are killed."""

import contextlib
import os
import time
from dataclasses import replace
from pathlib import Path

import pytest

from mavlink.protocol.packet import Auth
from mavlink.signing.store import StreamStore
from mavlink.signing.verifier import Verifier
from tests.support.signed_vehicles import ArduPilot, Px4, S, Vehicle, ring_of

NOW = time.time_ns() // 1000 // S * S + 100 * S
MINUTE, HOUR, DAY = 60 * S, 3600 * S, 86_400 * S


class Station:
    """Keys, table and verifier of one station after the other, in simulated time."""

    def __init__(self, folder, **options):
        self.folder, self.options = folder, options
        self.journals = set()
        self.t_us = NOW - DAY
        self.start()

    def start(self):
        self.store = StreamStore(self.folder, period_s=3600.0, wall_ns=lambda: self.t_us * 1000, **self.options)
        self.runs = True
        self.journals.add(self.store._journal.path)
        self.checker = Verifier(ring_of(7, 8), streams=self.store.streams, steady_ns=lambda: (self.t_us - NOW) * 1000)

    def hear(self, packets):
        verdicts = []
        for packet in packets:
            self.t_us = packet.t_us
            verdicts.append(self.checker.check(packet))
        return verdicts

    def end(self, how):
        self.runs = False
        if how == "orderly":
            self.store.close()
            return
        self.store._stop.set()
        self.store._thread.join()
        os.close(self.store._lock)
        self.store._journal.newest.release()
        self.store._journal._map.close()
        if how == "power cut":
            self.store._journal.path.unlink()

    def clean(self):
        for path in self.journals:
            with contextlib.suppress(FileNotFoundError):
                path.unlink()


@pytest.fixture
def station(tmp_path):
    made = []

    def make(**options):
        made.append(Station(tmp_path / f"{len(made)}", **options))
        return made[-1]

    for name in "0123":
        (tmp_path / name).mkdir()
    yield make
    for one in made:
        if one.runs:
            one.end("kill")
        one.clean()


def believed_after_s(packets, verdicts):
    """Until the first of those that are all believed from then on, to the end."""
    last = max((k for k, verdict in enumerate(verdicts) if verdict is not Auth.GOOD), default=-1)
    return (packets[last + 1].t_us - packets[0].t_us) / S if last + 1 < len(packets) else float("inf")


def again(packets, t_us, *, link=5):
    """A recording, played at another time from elsewhere."""
    return [replace(packet, t_us=t_us + packet.t_us - packets[0].t_us, link=link, peer=9) for packet in packets]


def good(verdicts):
    return verdicts.count(Auth.GOOD)


FIRST_PX4 = "PX4, first version"
CLOCKS = {
    "ArduPilot": lambda t: ArduPilot(t, key_set_us=t - DAY),
    "ArduPilot, fast crystal": lambda t: ArduPilot(t, key_set_us=t - DAY, drift_ppm=40.0),
    "ArduPilot, slow crystal": lambda t: ArduPilot(t, key_set_us=t - DAY, drift_ppm=-40.0),
    "PX4": lambda t: Px4(t, key_set_us=t - DAY),
    FIRST_PX4: lambda t: Px4(t, key_set_us=t - 30 * DAY, first=True),
}


@pytest.mark.parametrize("name", CLOCKS)
@pytest.mark.parametrize("armed_min", [None, 2, 5, 20, 90])
def test_a_station_that_starts_late_believes_within_two_seconds(station, name, armed_min):
    minutes = (armed_min or 20) + 3
    clock = CLOCKS[name](NOW - minutes * MINUTE)
    vehicle = Vehicle(clock)
    t_us = vehicle.runs(NOW - minutes * MINUTE, minutes * 60, arms_after_s=180 if armed_min else None)
    heard = vehicle.speaks(t_us, 6)
    assert believed_after_s(heard, station().hear(heard)) <= 2.0


@pytest.mark.slow_but_first
@pytest.mark.parametrize("ended", ["orderly", "kill", "power cut"])
@pytest.mark.parametrize("pause_s", [0, 4, 60, 3600])
@pytest.mark.parametrize(
    ("name", "reboots"),
    [
        *((name, n) for name in ("ArduPilot", "PX4") for n in (0, 1, 2)),
        ("ArduPilot, fast crystal", 0),
        # switched off and on it signs with timestamps that it has used before: see the test of its own
        (FIRST_PX4, 0),
    ],
)
def test_restarts_of_station_and_vehicle(station, name, ended, pause_s, reboots):
    place = station()
    vehicle = Vehicle(CLOCKS[name](NOW - 20 * MINUTE), links=2)
    t_us = vehicle.runs(NOW - 20 * MINUTE, 20 * 60, arms_after_s=120)
    place.hear(vehicle.speaks(t_us, 4))
    place.store._save(ended=False)  # as it does every second
    assert good(place.hear(vehicle.speaks(t_us + 4 * S, 1))) > 0
    place.end(ended)

    t_us += 5 * S
    if reboots:
        t_us += pause_s * S
        for _ in range(reboots):
            vehicle.clock.boot(t_us + 5 * S)
            t_us = vehicle.runs(t_us + 5 * S, 8)
    else:
        t_us = vehicle.runs(t_us, pause_s)

    place.start()
    recording = list(vehicle.heard)
    assert good(place.hear(again(recording, t_us))) == 0
    heard = vehicle.speaks(t_us + 6 * S, 4)
    first_link = [packet for packet in heard if packet.link == 0]
    verdicts = place.hear(heard)
    assert believed_after_s(first_link, verdicts[::2]) <= 2.0
    assert good(place.hear(again(recording, t_us + 12 * S))) == 0
    assert good(place.hear(again(heard, t_us + 20 * S))) == 0
    place.end("kill")


@pytest.mark.parametrize("name", CLOCKS)
@pytest.mark.parametrize("age_us", [2 * MINUTE, HOUR, DAY])
def test_recordings_of_somebody_never_heard_are_held(station, name, age_us):
    start_us = NOW - age_us - 30 * MINUTE
    vehicle = Vehicle(CLOCKS[name](start_us))
    t_us = vehicle.runs(start_us, 1800, arms_after_s=600)
    recording = vehicle.speaks(t_us, 20)
    assert good(station().hear(again(recording, NOW))) == 0


@pytest.mark.parametrize("name", CLOCKS)
def test_recordings_of_the_time_between_two_flights_are_held(station, name):
    place = station()
    vehicle = Vehicle(CLOCKS[name](NOW - 20 * MINUTE))
    t_us = vehicle.runs(NOW - 20 * MINUTE, 1200, arms_after_s=120)
    place.hear(vehicle.speaks(t_us, 5))
    place.end("orderly")
    t_us = vehicle.runs(t_us + 5 * S, 600)
    recording = vehicle.speaks(t_us, 30)
    place.start()
    assert good(place.hear(again(recording, t_us + 600 * S))) == 0
    # and whoever is alive is believed beside it
    t_us = vehicle.runs(t_us + 30 * S, 600)
    heard = vehicle.speaks(t_us, 4)
    assert believed_after_s(heard, place.hear(heard)) <= 2.0
    assert good(place.hear(again(recording, t_us + 5 * S))) == 0


def test_in_flight_too_what_was_not_heard_cannot_be_played_later(station):
    place = station()
    vehicle = Vehicle(ArduPilot(NOW - 10 * MINUTE))
    t_us = vehicle.runs(NOW - 10 * MINUTE, 600, arms_after_s=60)
    place.hear(vehicle.speaks(t_us, 5))
    beyond = vehicle.speaks(t_us + 5 * S, 20)  # out of range
    assert good(place.hear(again(beyond, t_us + 90 * S))) == 0
    t_us = vehicle.runs(t_us + 25 * S, 300)
    heard = vehicle.speaks(t_us, 3)
    assert believed_after_s(heard, place.hear(heard)) <= 0.5


def test_without_a_time_of_day_a_late_station_holds_until_an_operator_accepts(station):
    place = station()
    vehicle = Vehicle(ArduPilot(NOW - 30 * MINUTE), system_time=False)
    other = Vehicle(ArduPilot(NOW - 30 * MINUTE), 8, system_time=False)
    t_us = vehicle.runs(NOW - 30 * MINUTE, 1800, arms_after_s=600)
    other.runs(NOW - 30 * MINUTE, 1800, arms_after_s=600)
    recording = vehicle.speaks(t_us, 10)
    assert set(place.hear(recording)) == {Auth.HELD}
    assert set(place.hear(other.speaks(t_us, 10))) == {Auth.HELD}
    assert place.checker.accept_held(7, t_us + 10 * S) == 1
    assert place.checker.accept_held(7, t_us + 10 * S) == 0
    assert set(place.hear(again(recording, t_us + 10 * S))) == {Auth.REPLAYED}
    assert set(place.hear(vehicle.speaks(t_us + 10 * S, 5))) == {Auth.GOOD}
    assert set(place.hear(other.speaks(t_us + 10 * S, 5))) == {Auth.HELD}
    # the next station knows it by its time since boot
    place.end("kill")
    t_us = vehicle.runs(t_us + 15 * S, 3600)
    place.start()
    assert good(place.hear(again(recording, t_us))) == 0
    heard = vehicle.speaks(t_us + 20 * S, 3)
    assert believed_after_s(heard, place.hear(heard)) <= 2.0


def test_who_is_named_at_the_start_is_believed_without_a_proof(station):
    place = station(accept_late=[7])
    vehicle = Vehicle(ArduPilot(NOW - 30 * MINUTE), system_time=False, boot_times=False)
    t_us = vehicle.runs(NOW - 30 * MINUTE, 1800, arms_after_s=600)
    heard = vehicle.speaks(t_us, 5)
    assert set(place.hear(heard)) == {Auth.GOOD}
    assert set(place.hear(again(heard, t_us + 5 * S))) == {Auth.REPLAYED}


def test_a_frame_signed_by_us_raises_an_ardupilot_that_hears_it(station):
    # a station that may speak needs no proof from the UAV for longer than its answer takes
    vehicle = Vehicle(ArduPilot(NOW - 30 * MINUTE), system_time=False, boot_times=False)
    t_us = vehicle.runs(NOW - 30 * MINUTE, 1800, arms_after_s=600)
    place = station()
    assert set(place.hear(vehicle.speaks(t_us, 1))) == {Auth.HELD}
    vehicle.clock.hears((t_us + S - 1_420_070_400 * S) // 10)
    assert set(place.hear(vehicle.speaks(t_us + S, 1))) == {Auth.GOOD}


def test_a_first_px4_that_was_switched_off_and_on_repeats_itself(station):
    place = station()
    vehicle = Vehicle(Px4(NOW, key_set_us=NOW - 30 * DAY, first=True))
    heard = vehicle.speaks(NOW, 5)
    assert believed_after_s(heard, place.hear(heard)) <= 2.0
    vehicle.clock.boot(NOW + 10 * S)
    assert good(place.hear(vehicle.speaks(NOW + 10 * S, 3))) == 0


def test_an_ardupilot_that_was_started_ten_times_is_ahead_and_believed(station):
    clock = ArduPilot(NOW)
    for k in range(10):
        clock.boot(NOW + k * 5 * S)
        Vehicle(clock).runs(NOW + k * 5 * S, 5)
    heard = Vehicle(clock).speaks(NOW + 50 * S, 3)
    assert set(station().hear(heard)) == {Auth.GOOD}


def test_the_journal_is_private_and_gone_after_an_orderly_end(station):
    place = station()
    path: Path = place.store._journal.path
    assert path.stat().st_mode & 0o777 == 0o600
    place.end("orderly")
    assert not path.exists()


@pytest.mark.parametrize("what", ["link", "open to others", "folder"])
def test_a_journal_that_is_not_ours_is_left_alone(station, tmp_path, what):
    place = station()
    path: Path = place.store._journal.path
    place.end("orderly")
    victim = tmp_path / "victim"
    victim.write_bytes(b"precious")
    if what == "link":
        path.symlink_to(victim)
    elif what == "folder":
        path.mkdir()
    else:
        path.write_bytes(b"others")
        path.chmod(0o666)
    try:
        place.start()
        assert place.store._journal.path == place.folder / "streams.journal"
        heard = Vehicle(Px4(NOW)).speaks(NOW, 1)
        assert good(place.hear(heard)) == len(heard)
        place.end("kill")
        place.start()
        assert good(place.hear(again(heard, NOW + 2 * S))) == 0
    finally:
        path.rmdir() if what == "folder" else path.unlink()
    assert victim.read_bytes() == b"precious"
