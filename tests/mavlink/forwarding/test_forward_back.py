"""What a program behind an output may say, and to whom: nothing, the UAV, or the vehicles that are named."""

from __future__ import annotations

import os
import socket

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.flight.flight import Flight
from gcs.flight.plan import FlightPlan
from gcs.mission.mission import Mission, MissionVehicle
from mavlink.errors import LinkError
from mavlink.forwarding.forward import Forwarder
from mavlink.forwarding.outputs import parse_output
from mavlink.ingest.health import IngestHealth
from mavlink.ingest.health_events import HealthEvents
from mavlink.ingest.plan import Outputs
from mavlink.protocol.encoder import GCS, NO_AUTOPILOT, ROVER, MavlinkEncoder
from mavlink.protocol.packet import Packet
from tests.support.ports import free_port
from tests.support.receiving import HOST, recorded, wait_for
from tests.support.waiting import until

UAV, ROVER_ID, OTHER = 1, 11, 12
PROGRAM = MavlinkEncoder(255, 190)
_TARGETS = ("target_system", "target")


def every_message(target: int) -> dict[str, bytes]:
    """A frame of each message of the dialect, for one system where it has a field for that."""
    mav = dialect.MAVLink(None, srcSystem=255, srcComponent=190)
    made = {}
    for message in dialect.mavlink_map.values():
        values = [
            b"" if kind == "char" else [0] * length if length > 1 else 0
            for kind, length in zip(message.fieldtypes, (message.lengths[i] for i in message.orders), strict=True)
        ]
        for name in _TARGETS:
            if name in message.fieldnames:
                values[message.fieldnames.index(name)] = target
        made[message.msgname] = message(*values).pack(mav)
    return made


def addressed(name: str) -> bool:
    message = next(message for message in dialect.mavlink_map.values() if message.msgname == name)
    return bool(set(_TARGETS) & set(message.fieldnames))


class Behind:
    """An output with a program behind it, and one vehicle to each sender's number: the UAV 1, the rovers 2 and 3."""

    def __init__(self, option: str, *, at: tuple[int, int, int] = (1, 2, 3)) -> None:
        self.program = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.program.bind((HOST, 0))
        self.program.settimeout(60.0)
        url = f"udpout:{HOST}:{self.program.getsockname()[1]}{option}"
        self.forwarder = Forwarder([url], uav=UAV, vehicles=(UAV, ROVER_ID, OTHER), own=254)
        ids = (UAV, ROVER_ID, OTHER)
        heard = [
            Packet(k, MavlinkEncoder(i).heartbeat(), 0, peer) for k, (i, peer) in enumerate(zip(ids, at, strict=True))
        ]
        self.forwarder.forward(heard, lambda *way: pytest.fail(f"sent {way}"))
        for _ in heard:
            self.here = self.program.recvfrom(4096)[1]

    def says(self, raw: bytes) -> list[int]:
        """Numbers of the senders that get it."""
        went: list[int] = []
        before = self.counted()
        self.program.sendto(raw, self.here)
        while self.counted() == before:
            self.forwarder.forward([], lambda link, frame, peer: went.append(peer))
        assert len(went) == len(set(went))
        return went

    def counted(self) -> int:
        counts = self.forwarder.counts[0]
        return counts.returned + counts.stopped

    def close(self) -> None:
        self.forwarder.close()
        self.program.close()


@pytest.fixture
def behind():
    made: list[Behind] = []

    def make(option: str, **more: tuple[int, int, int]) -> Behind:
        made.append(Behind(option, **more))
        return made[-1]

    yield make
    for each in made:
        each.close()


def test_every_message_of_the_dialect_reaches_only_who_is_named(behind):
    uav_only, none, all_named = behind("?rw"), behind(""), behind("?rw=11,12")
    tried = 0
    for target, number in ((UAV, 1), (ROVER_ID, 2), (0, 0)):
        for name, raw in every_message(target).items():
            harmless = name in ("HEARTBEAT", "TIMESYNC")
            whom = target if addressed(name) else 0
            key = name == "SETUP_SIGNING"
            assert none.says(raw) == [], name
            expected = [1] if (whom == UAV and not key) or harmless else []
            assert uav_only.says(raw) == expected, (name, target)
            everybody = [] if key else [1, 2, 3] if not whom else [number]
            assert all_named.says(raw) == everybody, (name, target)
            tried += 1
    assert tried > 600


def test_a_vehicle_that_is_named_and_no_other(behind):
    one = behind("?rw=11")
    for target, gets in ((UAV, [1]), (ROVER_ID, [2]), (OTHER, []), (0, [])):
        raw = PROGRAM.pack(dialect.MAVLink_command_long_message(target, 1, 176, 0, 1, 4, 0, 0, 0, 0, 0))
        assert one.says(raw) == gets, target


@pytest.mark.parametrize(
    ("at", "beats"),
    [
        ((1, 2, 3), [1]),
        ((1, 1, 3), []),  # one address for the UAV and a rover: a router, or a radio
        ((1, 1, 1), []),
    ],
)
def test_what_is_for_everybody_goes_to_no_address_that_others_hear_too(behind, at, beats):
    shared = behind("?rw", at=at)
    assert shared.says(PROGRAM.heartbeat(GCS, autopilot=NO_AUTOPILOT)) == beats
    order = PROGRAM.pack(dialect.MAVLink_command_long_message(UAV, 1, 400, 0, 1, 0, 0, 0, 0, 0, 0))
    assert shared.says(order) == [1], "who else hears it sees that it is for the UAV"


def test_a_vehicle_outside_the_mission_is_not_spoken_to_either(behind):
    named = behind("?rw=11,12")
    named.forwarder.forward([Packet(9, MavlinkEncoder(77).heartbeat(), 0, 2)], lambda *way: None)
    assert named.says(PROGRAM.heartbeat(GCS, autopilot=NO_AUTOPILOT)) == [1, 3]


def test_who_said_what_is_counted_and_bounded(behind):
    place = behind("?rw")
    for number in range(300, 400):
        place.says(PROGRAM.pack(dialect.MAVLink_command_long_message(ROVER_ID, 1, number, 0, 1, 0, 0, 0, 0, 0, 0)))
    for _ in range(3):
        place.says(PROGRAM.pack(dialect.MAVLink_set_mode_message(UAV, 1, 4)))
    said = place.forwarder.counts[0].inbound
    assert len(said) <= 26 and sum(each.count for each in said) == 103
    arm = Behind("?rw")
    arm.says(PROGRAM.pack(dialect.MAVLink_command_long_message(ROVER_ID, 1, 400, 0, 1, 0, 0, 0, 0, 0, 0)))
    arm.says(PROGRAM.pack(dialect.MAVLink_command_int_message(UAV, 1, 0, 192, 0, 0, 0, 0, 0, 0, 1, 2, 3)))
    who = f"{HOST}:{arm.here[1] and arm.program.getsockname()[1]}"
    found = [(each.sender, each.message, each.target, each.refusal) for each in arm.forwarder.counts[0].inbound]
    assert found == [
        (who, "COMMAND_LONG COMPONENT_ARM_DISARM", ROVER_ID, "?rw does not name system 11"),
        (who, "COMMAND_INT DO_REPOSITION", UAV, ""),
    ]
    arm.close()


def test_what_a_program_says_is_told_when_it_begins_and_when_it_is_twice_as_much(behind):
    place, events = behind("?rw"), HealthEvents()
    name = place.forwarder.counts[0].name
    told: list[tuple[str, str]] = []
    for k in range(70):
        if k < 20 or k == 65:
            place.says(PROGRAM.pack(dialect.MAVLink_set_mode_message(UAV, 1, 4)))
        told += events.since_last(IngestHealth(outputs=place.forwarder.counts))
    text = f"{name}: {HOST}:{place.program.getsockname()[1]} sent SET_MODE to system 1 through this station"
    assert told == [("warning", text), *(("warning", f"{text}, {n} times so far") for n in (2, 4, 8, 16, 21))]


@pytest.mark.parametrize(
    ("option", "named"),
    [("", None), ("?ro", None), ("?rw", set()), ("?rw=11", {11}), ("?rw=1,11,12", {1, 11, 12})],
)
def test_options_of_an_output(option, named):
    assert parse_output(f"udpout:10.0.0.1:14551{option}") == ("udpout:10.0.0.1:14551", named)


def test_speaking_to_vehicles_takes_the_command_option(tmp_path):
    mission = Mission(uav=MissionVehicle(system_id=1), ugv=(MissionVehicle(system_id=11),))
    plan = FlightPlan(
        mission=mission,
        links=(f"udpin:{HOST}:{free_port()}",),
        video="",
        sessions=tmp_path,
        forward=("udpout:127.0.0.1:14551?rw",),
    )
    with pytest.raises(LinkError, match="takes --command"):
        Flight(plan)
    assert [path for path in tmp_path.rglob("*") if path.is_file()] == []


@pytest.mark.skipif(os.name != "posix", reason="sockets are lent to another process")
def test_a_program_reaches_the_uav_alone_is_recorded_and_told(started, tmp_path):
    ids = (UAV, ROVER_ID, OTHER)
    socks = [socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in (*ids, "program")]
    try:
        *vehicles, program = socks
        program.bind((HOST, 0))
        program.settimeout(60.0)
        port = free_port()
        out = f"udpout:{HOST}:{program.getsockname()[1]}?rw"
        ingest = started(f"udpin:{HOST}:{port}", system_ids=ids, outputs=Outputs(urls=(out,), uav=UAV, own=254))
        for i, sock in zip(ids, vehicles, strict=True):
            sock.sendto(MavlinkEncoder(i).heartbeat(ROVER), (HOST, port))
            sock.settimeout(60.0)
        assert len(wait_for(ingest, 3)) == 3
        for _ in ids:
            here = program.recvfrom(4096)[1]
        to_uav, to_rover, to_all = (
            PROGRAM.pack(dialect.MAVLink_command_long_message(target, 1, 176, 0, 1, 4, 0, 0, 0, 0, 0))
            for target in (UAV, ROVER_ID, 0)
        )
        for raw in (to_rover, to_all, to_uav):
            program.sendto(raw, here)
        assert vehicles[0].recv(4096) == to_uav
        assert until(lambda: [(o.returned, o.stopped) for o in ingest.health().outputs] == [(1, 2)])
        for sock in vehicles:
            sock.settimeout(0.2)
            with pytest.raises(TimeoutError):
                sock.recv(4096)
        texts: list[str] = []
        assert until(
            lambda: texts.extend(n.text for n in ingest.notices()) or any("sent COMMAND_LONG" in t for t in texts)
        )
        who = f"{HOST}:{program.getsockname()[1]}"
        assert any(f"{who} sent COMMAND_LONG DO_SET_MODE to system 1 through this station" in text for text in texts)
        assert any(f"DO_SET_MODE of {who} for system 11 was stopped: ?rw does not name" in text for text in texts)
        assert any(f"DO_SET_MODE of {who} for all systems was stopped" in text for text in texts)
        assert until(lambda: ingest.health().packets == 4)
        assert ingest.health().sent == 1
        ingest.stop()
        assert recorded(tmp_path)[3:] == [to_uav], "what was sent is in the log, and nothing else"
    finally:
        for sock in socks:
            sock.close()
