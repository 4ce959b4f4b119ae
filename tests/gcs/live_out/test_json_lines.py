"""Snapshots as JSON lines: the documented keys, the exports' rows, and clients that read or do not."""

import json
import re
import socket
from contextlib import ExitStack
from dataclasses import replace

import numpy as np
import pytest

from gcs.live_out.json_lines import BEHIND_BYTES, MAX_CLIENTS, MUTE_S, JsonTcp, JsonUdp, json_line
from gcs.live_out.sink import SinkSource
from gcs.live_out.sink_url import parse_publish_url
from gcs.session.box_table import json_row
from gcs.snapshot import Alarm, Candidate
from mavlink.geodesy import LocalFrame
from tests.support.bundled import ROOT
from tests.support.fake_station import HOSTILE
from tests.support.ports import free_port, udp_socket
from tests.support.snapshots import box, snapshot
from tests.support.waiting import until

SOURCE = SinkSource(name="2026-11-20_10-33-12Z")
ALARM = Alarm(key="k", level="warning", kind="link", text="silent", advice="look", since_us=0)


def full(frame=3):
    missing = (Candidate(system_id=2, confidence=0.4, missing="no position for 27 s"),)
    boxes = [
        box(1, 2, stated=True),
        box(2, 0, candidates=missing, doubt="a vehicle of ours is not accounted for"),
        box(3, 3, coasting=True),
    ]
    shown = snapshot(frame, boxes=boxes)
    rows = tuple(replace(row, p_enu=np.array([10.0, 0.0, 0.0])) for row in shown.vehicles)
    return replace(shown, origin=LocalFrame(47.0, 8.0), vehicles=rows, alarms=(ALARM,))


def documented(heading):
    """Keys of the table that follows some words of the page."""
    page = (ROOT / "docs" / "live-out.md").read_text().partition(heading)[2]
    table = page.partition("|---|---|\n")[2].partition("\n\n")[0]
    return {key for row in table.splitlines() for key in re.findall(r"`(\w+)`", row.split("|")[1])}


def test_a_line_has_the_documented_keys_and_the_rows_of_the_export():
    shown = full()
    line = json_line(shown, SOURCE)
    assert line.count(b"\n") == 1
    told = json.loads(line)
    assert set(told) == documented("## JSON, version 1")
    assert set(told["vehicles"][0]) == documented("A row of `vehicles`")
    assert set(told["boxes"][0]) | set(told["boxes"][1]) == documented("A row of `boxes`")
    assert told["boxes"] == [json.loads(json_row(shown, one)) for one in shown.boxes[:2]]
    assert (told["version"], told["time_us"], told["frame"]) == (1, shown.t_us, 3)
    assert told["vehicles"][1]["lat"] == pytest.approx(47.0)
    assert told["alarms"] == [{"level": "warning", "kind": "link", "text": "silent"}]


def test_boxes_of_an_earlier_frame_are_told_once():
    told = json.loads(json_line(replace(full(), seen_us=1), SOURCE))
    assert told["held"]
    assert told["boxes"] == []


@pytest.mark.parametrize("words", HOSTILE)
def test_words_from_the_air_are_plain(words):
    shown = full()
    rows = tuple(replace(row, name=words) for row in shown.vehicles)
    line = json_line(replace(shown, vehicles=rows, alarms=(replace(ALARM, text=words),)), SinkSource(name=words))
    told = json.loads(line)
    assert line.count(b"\n") == 1
    assert all(text.isprintable() for text in (told["source"], told["boxes"][0]["name"], told["alarms"][0]["text"]))


def test_a_datagram_for_each_snapshot_and_none_that_is_too_large():
    with udp_socket() as reader:
        reader.settimeout(30)
        sink = JsonUdp(parse_publish_url(f"json+udp://127.0.0.1:{reader.getsockname()[1]}"), SOURCE)
        sink.write(replace(full(), boxes=tuple(box(i, 0) for i in range(1, 1000))))
        sink.write(full(4))
        assert json.loads(reader.recv(70_000))["frame"] == 4
        assert (sink.sent, sink.dropped) == (1, 1)
        sink.close()


def test_nobody_who_receives_datagrams_is_no_trouble():
    sink = JsonUdp(parse_publish_url(f"json+udp://127.0.0.1:{free_port()}"), SOURCE)
    for frame in range(20):
        sink.write(full(frame))
    assert sink.sent == 20
    sink.close()


def test_clients_come_and_go_and_one_that_does_not_read_is_dropped():
    url = parse_publish_url(f"json+tcp://127.0.0.1:{free_port(socket.SOCK_STREAM)}")
    sink = JsonTcp(url, SOURCE)
    sink.write(full(0))
    assert sink.sent == 0
    with (
        socket.create_connection((url.host, url.port), timeout=30) as reads,
        socket.create_connection((url.host, url.port), timeout=30) as sleeps,
        reads.makefile() as lines,
    ):
        sleeps.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        assert until(lambda: sink.serve() or sink.clients == 2)
        large = replace(full(), vehicles=full().vehicles * 100)
        size = len(json_line(large, SOURCE))
        frames = 0
        while sink.clients == 2 and frames * size < 100 * BEHIND_BYTES:
            frames += 1
            sink.write(replace(large, frame=frames))
            assert json.loads(lines.readline())["frame"] == frames
        assert (sink.clients, sink.dropped) == (1, 1)
        sink.write(full(7))
        assert json.loads(lines.readline())["frame"] == 7
    assert until(lambda: sink.serve() or sink.clients == 0)
    sink.close()


def test_clients_that_take_nothing_make_room_after_five_seconds():
    url = parse_publish_url(f"json+tcp://127.0.0.1:{free_port(socket.SOCK_STREAM)}")
    clock = [0.0]
    sink = JsonTcp(url, SOURCE, lambda: clock[0])
    large = replace(full(), vehicles=full().vehicles * 200)
    with ExitStack() as open_clients:
        for _ in range(MAX_CLIENTS):
            mute = open_clients.enter_context(socket.socket())
            mute.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
            mute.connect((url.host, url.port))
        assert until(lambda: sink.serve() or sink.clients == MAX_CLIENTS)
        later = open_clients.enter_context(socket.create_connection((url.host, url.port), timeout=30))
        size = len(json_line(large, SOURCE))
        for frame in range(BEHIND_BYTES // 2 // size):
            sink.write(replace(large, frame=frame))
        clock[0] = MUTE_S - 0.1
        sink.serve()
        assert sink.clients == MAX_CLIENTS
        clock[0] = MUTE_S + 0.1
        sink.serve()
        assert until(lambda: sink.serve() or sink.clients == 1)
        sink.write(replace(large, frame=99))
        with later.makefile() as lines:
            assert until(lambda: sink.serve() or not sink._waiting[next(iter(sink._waiting))])
            assert json.loads(lines.readline())["frame"] == 99
    sink.close()


def test_a_port_that_is_taken_is_an_error_that_goes_away():
    with socket.create_server(("127.0.0.1", 0)) as taken:
        url = parse_publish_url(f"json+tcp://127.0.0.1:{taken.getsockname()[1]}")
        with pytest.raises(OSError, match="in use"):
            JsonTcp(url, SOURCE)
    JsonTcp(url, SOURCE).close()
