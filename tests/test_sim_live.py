import csv
import dataclasses
import itertools
import socket
import threading
import time
from collections import Counter

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from sim.errors import PlayError
from sim.live import play
from sim.presets import curved_road
from sim.scenario import Camera

CAMERA = Camera(width=480, height=270, fx=300.0, fy=300.0, cx=240.0, cy=135.0)
SMALL = dataclasses.replace(curved_road(), camera=CAMERA, occlusions=())


class Receiver:
    """Everything that arrives on a free port of this machine."""

    def __init__(self):
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.socket.settimeout(0.1)
        self.port = self.socket.getsockname()[1]
        self.datagrams, self._stop = [], threading.Event()
        self._thread = threading.Thread(target=self._run)

    def __enter__(self):
        self._thread.start()
        return self

    def __exit__(self, *_):
        time.sleep(0.2)
        self._stop.set()
        self._thread.join()
        self.socket.close()

    def _run(self):
        while not self._stop.is_set():
            try:
                data, source = self.socket.recvfrom(4096)
            except TimeoutError:
                continue
            self.datagrams.append((time.time(), source[1], data))


def test_two_seconds_live(tmp_path):
    ticks = []
    with Receiver() as telemetry, Receiver() as video:
        played = play(
            SMALL, f"udpout:127.0.0.1:{telemetry.port}", f"udp://127.0.0.1:{video.port}", 2.0, ticks.append,
            boot_noise=True, truth_path=tmp_path / "truth.csv",
        )  # fmt: skip
    parser, counts, ports = dialect.MAVLink(None), Counter(), {}
    parser.robust_parsing = True
    noise = 0
    for _, port, data in telemetry.datagrams:
        if data[0] != 0xFD:
            noise += 1
            continue
        system_id = parser.parse_buffer(data)[0].get_srcSystem()
        counts[system_id] += 1
        ports.setdefault(system_id, set()).add(port)
    assert dict(counts) == played.packets
    assert set(counts) == {1, *range(11, 18)}
    assert all(len(used) == 1 for used in ports.values())
    assert len(set.union(*ports.values())) == 8
    assert noise == 4 * 8
    assert ticks == sorted(ticks)
    assert ticks[0] < -1.0
    assert ticks[-1] > 2.5
    # in real time: the last packets come three seconds after the first frame's time
    assert telemetry.datagrams[-1][0] == pytest.approx(played.start_us / 1e6 + 3.0, abs=0.5)
    assert all(len(data) % 188 == 0 and data[0] == 0x47 for _, _, data in video.datagrams)
    assert max(len(data) for _, _, data in video.datagrams) == 1316
    assert played.frames + played.frames_skipped == 20
    assert played.frames >= 5
    with (tmp_path / "truth.csv").open(newline="") as file:
        truth = list(csv.DictReader(file))
    stamps = sorted({int(row["time_us"]) for row in truth})
    assert len(stamps) == played.frames
    assert stamps[0] == played.start_us
    assert all((b - a) % 100_000 == 0 for a, b in itertools.pairwise(stamps))
    assert {int(row["system_id"]) for row in truth} - {0} == set(range(11, 17))


def test_a_play_stops_when_told():
    stop = threading.Event()
    began = time.monotonic()
    with Receiver() as telemetry:
        played = play(SMALL, f"udpout:127.0.0.1:{telemetry.port}", None, on_tick=lambda _: stop.set(), stop=stop)
    assert time.monotonic() - began < 5.0
    assert sum(played.packets.values()) < 20
    assert played.frames == 0


@pytest.mark.parametrize("url", ["udpout:127.0.0.1", "udpin:0.0.0.0:14550", "127.0.0.1:14550", "udpout:h:99999"])
def test_a_bad_telemetry_address_is_refused(url):
    with pytest.raises(PlayError, match="give udpout:host:port"):
        play(SMALL, url)


def test_a_bad_video_address_and_a_truth_file_in_the_way_are_refused(tmp_path):
    with pytest.raises(PlayError, match="give udp://host:port"):
        play(SMALL, "udpout:127.0.0.1:9", "rtsp://127.0.0.1/x", 1.0)
    (tmp_path / "truth.csv").write_text("mine")
    with pytest.raises(PlayError, match="cannot be made"):
        play(SMALL, "udpout:127.0.0.1:9", "udp://127.0.0.1:9", 1.0, truth_path=tmp_path / "truth.csv")
    assert (tmp_path / "truth.csv").read_text() == "mine"
