"""What a mission or session of others may do: describe a flight, and reach nothing."""

from __future__ import annotations

import json
import socket
import threading

import pytest

from gcs.errors import ConfigError
from gcs.mission.mission import Links, SigningChoice, load_mission, unheeded_links
from tests.support.bundled import SWARM, shortened
from tests.support.command_line import MISSION, heartbeat, run_gcs
from tests.support.ports import free_port

RECORDED = '[session]\nformat = 1\nprogram = "x"\nstarted = 2026-01-01T00:00:00Z\n'


@pytest.fixture
def outlet():
    """A socket that packets may be sent on to."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.bind(("127.0.0.1", 0))
        sock.settimeout(0.1)
        yield sock


def fly(folder, name, outlet, *words, more="", port=None):
    """A short flight by a mission file with an output: its exit code, stderr, and what came out of it."""
    port = port or free_port()
    path = folder / name
    path.write_text(f'{MISSION}[links]\nforward = ["udpout:127.0.0.1:{outlet.getsockname()[1]}{more}"]\n')
    if name == "session.toml":
        path.write_text(path.read_text() + RECORDED)
    stop = feed(port)
    try:
        code, _, stderr = run_gcs(
            *("fly", path, "-l", f"udpin:127.0.0.1:{port}", "--headless", "--duration", 2),
            *("--sessions", folder / "sessions", *words),
        )
    finally:
        stop()
    try:
        return code, stderr, outlet.recv(2048)
    except TimeoutError:
        return code, stderr, b""


def feed(port):
    """Sends heartbeats to a port until stopped."""
    halt = threading.Event()

    def send():
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as vehicle:
            while not halt.wait(0.1):
                vehicle.sendto(heartbeat(), ("127.0.0.1", port))

    thread = threading.Thread(target=send)
    thread.start()

    def stop():
        halt.set()
        thread.join()

    return stop


@pytest.mark.slow
def test_outputs_of_a_mission_are_told_at_the_start(tmp_path, outlet):
    code, stderr, came = fly(tmp_path, "mission.toml", outlet)
    assert code == 0 and came
    where = f"udpout:127.0.0.1:{outlet.getsockname()[1]}"
    assert f"packets go on to {where}; programs there only listen" in stderr
    events = [
        json.loads(line) for path in tmp_path.glob("sessions/*/events.jsonl") for line in path.read_text().splitlines()
    ]
    assert any(where in event["text"] for event in events)


def test_what_came_with_a_recording_sends_nothing_anywhere(tmp_path, outlet):
    code, stderr, came = fly(tmp_path, "session.toml", outlet)
    assert code == 0 and not came
    assert "its links do not count" in stderr and str(outlet.getsockname()[1]) in stderr


def test_who_may_write_into_a_mission_may_not_order_the_uav_by_it(tmp_path, outlet):
    path = tmp_path / "mission.toml"
    path.touch()
    path.chmod(0o666)
    code, stderr, came = fly(tmp_path, "mission.toml", outlet, "--command", more="?rw")
    assert code == 2 and not came and "others may change this file" in stderr
    path.chmod(0o600)
    code, stderr, came = fly(tmp_path, "mission.toml", outlet, "--command", more="?rw")
    assert code == 0 and came and "programs there may send to the UAV" in stderr


def test_links_and_signing_of_a_recording_do_not_count(tmp_path):
    text = (
        f'{MISSION}[links]\ntelemetry = ["14550"]\nvideo = "http://h/x"\n[signing]\nkeys = "none"\nkeyless = "open"\n'
        '[[view]]\nsystem_id = 2\nvideo = "http://h/y"\n'
    )
    (tmp_path / "mission.toml").write_text(text)
    assert load_mission(tmp_path / "mission.toml").signing.keys == "none"
    for name, more in (("session.toml", ""), ("renamed.toml", RECORDED)):
        (tmp_path / name).write_text(text + more)
        mission = load_mission(tmp_path / name)
        assert mission.links == Links() and mission.signing.keyless == SigningChoice().keyless
        assert not mission.view[0].video and unheeded_links(tmp_path / name)[1:] == ("http://h/x", "http://h/y")
        assert mission.signing.keys != "none"


@pytest.mark.parametrize("key", ["model", "front"])
@pytest.mark.parametrize("place", ["net.onnx", "../{folder}/net.onnx", "{path}/net.onnx"])
def test_a_network_that_came_along_is_not_opened(tmp_path, key, place):
    network = place.format(folder=tmp_path.name, path=tmp_path)
    (tmp_path / "session.toml").write_text(f'{MISSION}[detector]\n{key} = "{network}"\n')
    with pytest.raises(ConfigError, match="came with the recording"):
        load_mission(tmp_path / "session.toml")
    (tmp_path / "session.toml").rename(tmp_path / "mission.toml")
    assert load_mission(tmp_path / "mission.toml").detector


@pytest.mark.slow
def test_a_recording_with_links_is_identified_as_without(tmp_path):
    more = '[links]\nvideo = "http://127.0.0.1:1/x"\nforward = ["udpout:127.0.0.1:1?rw"]\n'
    shortened(SWARM, tmp_path / "a", 12)
    toml = (tmp_path / "a" / "session.toml").read_text()
    assert run_gcs("identify", tmp_path / "a", "-o", tmp_path / "plain")[0] == 0
    (tmp_path / "a" / "session.toml").write_text(toml + more)
    assert run_gcs("identify", tmp_path / "a", "-o", tmp_path / "linked")[0] == 0
    plain, linked = ((tmp_path / name / "identity.csv").read_bytes() for name in ("plain", "linked"))
    assert plain == linked
