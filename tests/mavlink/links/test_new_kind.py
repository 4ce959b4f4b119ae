"""A kind of link is one file and one line: here a kind that only the tests have."""

import os
import socket
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

import mavlink
from mavlink.errors import LinkError
from mavlink.ingest.plan import Outputs
from mavlink.links.kinds import KINDS, parse_url
from mavlink.protocol.encoder import MavlinkEncoder
from tests.support.receiving import PEER, UnixLink, recorded, wait_for
from tests.support.waiting import until

LINE = """from mavlink.links.kinds import KINDS
from tests.support.receiving import UnixLink
KINDS["unix"] = UnixLink
"""


@pytest.fixture
def unix(tmp_path, monkeypatch):
    """The kind's line, here and in the receiving process."""
    monkeypatch.setitem(KINDS, "unix", UnixLink)
    (tmp_path / "sitecustomize.py").write_text(LINE)
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(tmp_path), str(Path(mavlink.__file__).parents[1])]))
    return tmp_path


def program(path):
    sock = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    sock.bind(f"{path}{PEER}")
    sock.settimeout(60.0)
    return sock


def test_it_receives_and_forwards(unix, started):
    uav, ground = MavlinkEncoder(1), MavlinkEncoder(255, 190)
    order = ground.pack(dialect.MAVLink_command_long_message(1, 1, 400, 0, 1, 0, 0, 0, 0, 0, 0))
    ours = MavlinkEncoder(254).heartbeat()
    with program(unix / "in") as vehicle, program(unix / "out") as station:
        ingest = started(f"unix:{unix}/in", outputs=Outputs(urls=(f"unix:{unix}/out?rw",), uav=1))
        frames = [uav.heartbeat(custom_mode=k) for k in range(3)]
        for frame in frames:
            vehicle.sendto(frame, str(unix / "in"))
        assert [packet.raw for packet in wait_for(ingest, 3)] == frames
        assert [station.recv(4096) for _ in frames] == frames
        station.sendto(order, str(unix / "out"))
        assert vehicle.recv(4096) == order
        ingest.send(0, ours)
        assert vehicle.recv(4096) == ours
        assert until(lambda: ingest.health().links[0].counts.packets == 3)
        assert until(lambda: [(each.sent, each.returned) for each in ingest.health().outputs] == [(3, 1)])
        assert [link.name for link in ingest.health().links] == [f"unix:{unix}/in"]
        ingest.stop()
    assert recorded(unix) == [*frames, order, ours]


def test_wrong_urls_show_how_to_write_it(unix):
    for url in ("unix:relative", "smoke:signals"):
        with pytest.raises(LinkError, match="unix:/run/mavlink"):
            parse_url(url)


def test_the_mission_page_has_every_kind():
    page = (Path(__file__).parents[3] / "docs" / "mission.md").read_text()
    assert [scheme for scheme in KINDS if scheme not in page] == []
