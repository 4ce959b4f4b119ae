"""A flight without a mission file: who is heard flies, from the first packet on, and can be flown again."""

import json
import os
import socket
import threading
import tomllib
import tty
from contextlib import ExitStack, closing
from dataclasses import replace
from datetime import datetime
from itertools import pairwise

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.cli import contact
from gcs.cli.contact import parse_ids
from gcs.errors import GcsError
from gcs.flight import listening
from gcs.flight.listening import Listening
from gcs.mission.mission import SigningChoice, load_mission
from gcs.mission.roster import Roster, mission_of, proposed_roles
from gcs.mission.written import save_mission
from gcs.session.session import open_session
from mavlink.errors import LinkError
from mavlink.protocol.encoder import COPTER, ROVER
from mavlink.protocol.packet import Auth, Packet
from mavlink.tlog.log import Tlog
from sim.live import play
from sim.world.presets import nominal
from sim.world.scenario import ScenarioCamera
from tests.support.command_line import run_gcs, run_gcs_process
from tests.support.fake_vehicles import FakeVehicle
from tests.support.frames import MessageEncoder
from tests.support.ports import free_port

GIMBAL, STATION, BOAT = 26, 6, 11
SMALL = ScenarioCamera(width=640, height=360, fx=400.0, fy=400.0, cx=320.0, cy=180.0)


@pytest.mark.parametrize(
    ("texts", "ids"),
    [
        (["11-13"], (11, 12, 13)),
        (["11,13-15", "12"], (11, 13, 14, 15, 12)),
        (["11, 11 - 12"], (11, 12)),
        ([], ()),
    ],
)
def test_ids_are_ranges_and_lists(texts, ids):
    assert parse_ids(texts) == ids


@pytest.mark.parametrize("text", ["", "11-", "a", "0", "11-256", "12-11", "1-2-3", "²"])
def test_other_ids_are_refused_with_what_to_write(text):
    with pytest.raises(GcsError, match="give"):
        parse_ids([text])


def heard(*rows):
    """A roster that heard heartbeats: system id, type, and what the signature was worth."""
    roster = Roster()
    for system_id, kind, auth in rows:
        if kind == CAMERA:
            told = dialect.MAVLink_camera_fov_status_message(0, *([0] * 6), [1.0, 0.0, 0.0, 0.0], 70.0, 43.0)
            roster.add_packet(Packet(1_000_000, MessageEncoder(system_id).pack(told), auth=auth))
            continue
        beat = MessageEncoder(system_id).pack(dialect.MAVLink_heartbeat_message(kind, 3, 0, 0, 4, 3))
        roster.add_packet(Packet(1_000_000, beat, auth=auth))
    return roster.vehicles


CAMERA = "camera"
ALL = ((1, COPTER, Auth.OPEN), (11, ROVER, Auth.OPEN), (12, BOAT, Auth.GOOD), (255, STATION, Auth.OPEN))


TWO_WITH_CAMERA = (*ALL, (2, COPTER, Auth.OPEN), (2, CAMERA, Auth.OPEN))


@pytest.mark.parametrize(
    ("rows", "chosen", "roles"),
    [
        (ALL, {}, {1: "films", 11: "named", 12: "named"}),
        # its gimbal beats too; forged beats take nothing from who is believed
        ([(1, GIMBAL, Auth.OPEN), *ALL, (11, COPTER, Auth.UNSIGNED)], {}, {1: "films", 11: "named", 12: "named"}),
        ([*ALL, (13, ROVER, Auth.UNSIGNED)], {}, {1: "films", 11: "named", 12: "named", 13: "out"}),
        ([*ALL, (2, COPTER, Auth.OPEN)], {}, {1: "films", 2: "films", 11: "named", 12: "named"}),
        ([*ALL, (2, COPTER, Auth.OPEN)], {2: "films"}, {1: "out", 2: "films", 11: "named", 12: "named"}),
        # of several aircraft the one with a camera films, unless the operator chose otherwise
        (TWO_WITH_CAMERA, {}, {1: "out", 2: "films", 11: "named", 12: "named"}),
        (TWO_WITH_CAMERA, {1: "films"}, {1: "films", 2: "out", 11: "named", 12: "named"}),
        (TWO_WITH_CAMERA, {2: "out"}, {1: "films", 2: "out", 11: "named", 12: "named"}),
        (ALL, {12: "out", 17: "named"}, {1: "films", 11: "named", 12: "out", 17: "named"}),
    ],
)
def test_roles_follow_from_what_a_vehicle_is(rows, chosen, roles):
    assert proposed_roles(heard(*rows), chosen) == roles


@pytest.mark.parametrize(
    ("roles", "told"),
    [
        ({}, "no aircraft that films is heard; name it with --uav"),
        ({1: "films"}, "no ground vehicle is heard; name it with --ugv"),
        ({1: "films", 2: "films", 11: "named"}, "aircraft 1, 2 are heard: name the one that films with --uav"),
    ],
)
def test_an_unclear_fleet_is_told_with_what_to_give(roles, told):
    with pytest.raises(GcsError, match=told):
        mission_of(roles)


@pytest.fixture
def air(tmp_path, monkeypatch):
    """A function that has vehicles speak to a port and flies on it, in an empty folder."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(contact, "SETTLED_S", 0.3)
    monkeypatch.setattr(contact, "TELL_S", 0.0)
    with ExitStack() as ending:

        def fly(*words, vehicles=((1, COPTER), (11, ROVER), (12, ROVER))):
            port = free_port()
            for system_id, kind in vehicles:
                ending.callback(FakeVehicle(("127.0.0.1", port), system_id, kind=kind).close)
            return run_gcs("fly", "-l", f"udpin:127.0.0.1:{port}", "-v", "", "--headless", "--duration", 0.4, *words)

        yield fly


def test_a_serial_port_is_listened_to_beside_the_other_links(tmp_path):
    ours, theirs = os.openpty()
    tty.setraw(theirs)
    port, device = free_port(), f"{os.ttyname(theirs)},57600"
    with closing(Listening([f"udpin:127.0.0.1:{port}"], tmp_path, SigningChoice(), for_video=False)) as heard:
        with pytest.raises(LinkError, match="is it plugged in"):
            heard.add_link("/dev/ttyNone7,57600")
        assert len(heard.links) == 1 and len(list(tmp_path.iterdir())) == 1
        heard.add_link(device)
        with pytest.raises(LinkError, match="listened to already"):
            heard.add_link(device)
        beat = dialect.MAVLink_heartbeat_message(ROVER, 3, 0, 0, 4, 3)
        with closing(FakeVehicle(("127.0.0.1", port), 1, kind=COPTER)):
            encoder = MessageEncoder(11)
            for _ in range(100):
                os.write(ours, encoder.pack(beat))
                heard.poll(0.1)
                if len(heard.roster.vehicles) == 2:
                    break
        assert [(each.system_id, each.link) for each in heard.roster.vehicles] == [(1, 0), (11, 1)]
        assert [each for each in tmp_path.iterdir()] == [heard.folder]
    os.close(ours)
    os.close(theirs)


def test_who_is_heard_flies_and_the_saved_mission_is_the_same(air, tmp_path):
    code, _, told = air()
    assert code == 0 and "the mission is saved in mission.toml" in told and "heard: 1 copter" in told, told
    [folder] = (tmp_path / "sessions").iterdir()
    saved, flown = load_mission(tmp_path / "mission.toml"), open_session(folder).mission
    assert (saved.uav, saved.ugv, saved.camera) == (flown.uav, flown.ugv, flown.camera)
    assert [v.name for v in (saved.uav, *saved.ugv)] == ["UAV", "UGV-11", "UGV-12"]
    lines = (tmp_path / "mission.toml").read_text().splitlines()
    comments = [line for line in lines if line.startswith("# ")]
    told_of = [line for above, line in pairwise(lines) if line.startswith("[") and above.startswith("# ")]
    assert told_of == [line for line in lines if line.startswith("[")] == ["[uav]", "[[ugv]]", "[[ugv]]", "[links]"]
    assert len(comments) == 6 and "ArduPilot rover, by its heartbeats; heard on udpin:127.0.0.1:" in comments[2]
    # the packets that were listened to are the beginning of the recording
    began_us = tomllib.loads((folder / "session.toml").read_text())["session"]["started"].timestamp() * 1e6
    first_us = Tlog.open(folder / "telemetry.tlog").packet(0).t_us
    flew = (folder / "program.log").read_text().partition(" ")[0]
    assert began_us <= first_us < datetime.fromisoformat(flew).timestamp() * 1e6 - 200_000


@pytest.mark.slow
def test_nothing_is_saved_over_a_file_and_nothing_twice(air, tmp_path):
    (tmp_path / "mission.toml").write_text("mine\n")
    assert "saved in mission-2.toml" in air("--uav", 1, "--ugv", "11-12")[2]
    assert (tmp_path / "mission.toml").read_text() == "mine\n"
    saved = load_mission(tmp_path / "mission-2.toml")
    path, new = save_mission(saved, {}, tmp_path)
    assert (path.name, new) == ("mission-2.toml", False) and path.stat().st_mode & 0o077 == 0


@pytest.mark.slow_but_first
@pytest.mark.parametrize(
    ("words", "vehicles", "code", "told"),
    [
        ((), ((1, COPTER), (2, COPTER), (11, ROVER)), 2, "aircraft 1, 2 are heard: name the one that films with --uav"),
        (("--uav", 2), ((1, COPTER), (2, COPTER), (11, ROVER)), 0, "saved in mission.toml"),
        (("--listen", 0.3), (), 3, "nothing is heard on udpin:127.0.0.1:"),
        (("--listen", 0.6), ((1, COPTER),), 2, "no ground vehicle is heard; name it with --ugv"),
        (("--uav", 1, "--ugv", "11-13"), (), 0, "saved in mission.toml"),
        (
            ("--forward", "udpout:127.0.0.1:9?rw=11"),
            (),
            3,
            "?rw lets a program send to vehicles",
        ),
    ],
)
def test_what_is_unclear_ends_with_what_to_do(words, vehicles, code, told, air, tmp_path):
    ended, _, text = air(*words, vehicles=vehicles)
    assert ended == code and told in text, text
    left = list((tmp_path / "sessions").glob("*"))
    assert bool(left) == (code == 0), "what was only listened to leaves no folder"


def test_usual_ports_that_others_have_are_told(monkeypatch, tmp_path):
    ports = [free_port() for _ in range(3)]
    monkeypatch.setattr(listening, "USUAL_LINKS", tuple(f"udpin:127.0.0.1:{port}" for port in ports))
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.1", ports[1]))
        links, taken = listening.usual_links()
    assert links == (f"udpin:127.0.0.1:{ports[0]}", f"udpin:127.0.0.1:{ports[2]}")
    assert len(taken) == 1 and f"UDP port {ports[1]} is in use by process" in taken[0]


@pytest.mark.slow
def test_a_camera_that_tells_of_itself_gets_its_vehicles_named(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    telemetry, video = free_port(), free_port()
    scenario = replace(nominal(5), camera=SMALL, duration_s=90.0)
    stop = threading.Event()
    words = (scenario, f"udpout:127.0.0.1:{telemetry}", f"udp://127.0.0.1:{video}?pkt_size=1316")
    air = threading.Thread(target=play, args=words, kwargs={"stop": stop, "tells_camera": True})
    air.start()
    try:
        link = f"udpin:127.0.0.1:{telemetry}"
        code, out, told = run_gcs_process("fly", "-l", link, "--headless", "--json", "--duration", 30)
    finally:
        stop.set()
        air.join()
    assert code == 0 and "video: the UAV offers" in told, told
    assert json.loads(out)["named"] >= 1, out
    saved = load_mission(tmp_path / "mission.toml")
    assert (saved.links.video, saved.ugv_ids) == ("auto", scenario.ugv_ids)
