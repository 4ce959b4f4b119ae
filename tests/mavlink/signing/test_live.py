"""Signed and hostile frames through the receiving process, over a real socket and the real clock."""

import os
import signal
import socket
import time
from collections import Counter
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import ardupilotmega

from mavlink.ingest.ingest import Ingest
from mavlink.ingest.plan import Signing
from mavlink.signing.keys import write_key
from mavlink.signing.streams import ticks_of
from tests.support.ports import free_port
from tests.support.receiving import in_pieces, wait_for
from tests.support.signed_vehicles import Sender, secret_of
from tests.support.waiting import until

SECRET = b"an open secret, for this test   "


@pytest.fixture
def station(tmp_path):
    write_key(tmp_path / "keys", 7, secret_of(7))
    made = []

    def start():
        port = free_port()
        ingest = Ingest(
            [f"udpin:127.0.0.1:{port}"],
            tmp_path / f"{len(made)}.tlog",
            system_ids=(7,),
            signing=Signing(keys=str(tmp_path / "keys")),
        )
        made.append(ingest)
        return ingest, ("127.0.0.1", port)

    yield start
    for ingest in made:
        ingest.stop()


class Vehicle:
    """Speaks as system 7 and remembers all it said."""

    def __init__(self):
        self.sender = Sender(7)
        self.said = []
        self.behind = 0
        self.out = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)

    def speak(self, to, count):
        for _ in range(count):
            self.said.append(self.sender.frame(timestamp=ticks_of(time.time_ns() // 1000) - self.behind))
            self.out.sendto(self.said[-1], to)
            time.sleep(0.0005)


@pytest.fixture
def vehicle():
    vehicle = Vehicle()
    yield vehicle
    vehicle.out.close()


def holds_no_key(data):
    return not any(part in data for key in (SECRET, secret_of(7)) for part in (key[:8], key.hex()[:16].encode()))


def test_what_is_held_is_believed_once_an_operator_accepts_it(station, vehicle):
    ingest, to = station()
    vehicle.behind = 1700 * 100_000
    vehicle.speak(to, 100)
    assert judged(ingest, 100) == {"HELD": 100}
    ingest.accept_held(8)
    vehicle.speak(to, 10)
    assert judged(ingest, 10) == {"HELD": 10}
    ingest.accept_held(7)
    assert until(lambda: (vehicle.speak(to, 1), judged(ingest, 1))[1] == {"GOOD": 1})
    vehicle.speak(to, 100)
    assert judged(ingest, 100) == {"GOOD": 100}
    # a process that takes over knows it
    os.kill(ingest.pid, signal.SIGKILL)
    assert until(lambda: ingest.health().restarts == 1)
    assert set(heard(ingest, vehicle.out, to, vehicle.said)) == {"REPLAYED"}
    vehicle.speak(to, 100)
    assert judged(ingest, 100) == {"GOOD": 100}


def judged(ingest, count):
    return Counter(packet.auth.name for packet in wait_for(ingest, count))


def heard(ingest, out, to, frames):
    """The verdicts on frames, of which no more are on the way than any system's buffer holds."""
    verdicts = Counter()
    for piece in in_pieces(frames):
        for frame in piece:
            out.sendto(frame, to)
        verdicts += judged(ingest, len(piece))
    return verdicts


def test_only_the_vehicle_itself_is_believed_across_crash_and_restart(station, vehicle, tmp_path):
    ingest, to = station()
    vehicle.speak(to, 300)
    assert judged(ingest, 300) == {"GOOD": 300}
    forged = [Sender(7, secret=b"x" * 32, timestamp=2**48 - 1).frame() for _ in range(50)]
    unsigned = [Sender(7, signs=False).frame() for _ in range(50)]
    setup = ardupilotmega.MAVLink_setup_signing_message(7, 1, list(SECRET), 1)
    hostile = [*vehicle.said, *forged, *unsigned, Sender(255, 190).frame(setup)]
    assert heard(ingest, vehicle.out, to, hostile) == {"REPLAYED": 300, "BAD": 50, "UNSIGNED": 51}

    vehicle.speak(to, 200)
    assert judged(ingest, 200) == {"GOOD": 200}
    for name in ("cmdline", "environ"):
        assert holds_no_key(Path(f"/proc/{ingest.pid}/{name}").read_bytes())
    os.kill(ingest.pid, signal.SIGKILL)
    assert until(lambda: ingest.health().restarts == 1)
    assert heard(ingest, vehicle.out, to, vehicle.said) == {"REPLAYED": 500}
    vehicle.speak(to, 100)
    assert judged(ingest, 100) == {"GOOD": 100}
    ingest.stop()

    ingest, to = station()
    assert heard(ingest, vehicle.out, to, vehicle.said) == {"REPLAYED": 600}
    vehicle.speak(to, 100)
    assert judged(ingest, 100) == {"GOOD": 100}
    ingest.stop()
    for path in tmp_path.rglob("*"):
        if path.is_file() and path.suffix != ".key":
            assert holds_no_key(path.read_bytes()), path
