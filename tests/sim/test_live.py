import csv
import dataclasses
import itertools
import socket
import threading
import time
from collections import Counter

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from sim import live
from sim.errors import PlayError
from sim.live import play
from sim.telemetry.vehicle_telemetry import TelemetryPacket
from sim.world.presets import curved_road
from sim.world.scenario import ScenarioCamera

CAMERA = ScenarioCamera(width=480, height=270, fx=300.0, fy=300.0, cx=240.0, cy=135.0)
SMALL = dataclasses.replace(curved_road(), camera=CAMERA, occlusions=())


class Receiver:
    """Everything that arrives on a free port of this machine."""

    def __init__(self):
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.socket.settimeout(0.1)
        self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 22)
        self.port = self.socket.getsockname()[1]
        self.datagrams, self._stop = [], threading.Event()
        self._thread = threading.Thread(target=self._run)

    def __enter__(self):
        self._thread.start()
        return self

    def __exit__(self, *_):
        self._stop.set()
        self._thread.join()
        self.socket.close()

    def _run(self):
        while True:
            try:
                data, source = self.socket.recvfrom(4096)
            except TimeoutError:
                if self._stop.is_set():
                    return  # all that came before it was told to stop has been taken
                continue
            self.datagrams.append((time.time(), source[1], data))


def test_two_seconds_live(tmp_path):
    ticks = []
    with Receiver() as telemetry, Receiver() as video:
        played = play(
            SMALL,
            f"udpout:127.0.0.1:{telemetry.port}",
            f"udp://127.0.0.1:{video.port}",
            2.0,
            ticks.append,
            boot_noise=True,
            truth_path=tmp_path / "truth.csv",
        )
    parser, counts, ports = dialect.MAVLink(None), Counter(), {}
    parser.robust_parsing = True
    noise, said = 0, []
    for _, port, data in telemetry.datagrams:
        if data[0] != 0xFD:
            noise += 1
            continue
        message = parser.parse_buffer(data)[0]
        said += [message.text] if message.get_type() == "STATUSTEXT" else []
        system_id = message.get_srcSystem()
        counts[system_id] += 1
        ports.setdefault(system_id, set()).add(port)
    assert dict(counts) == played.packets
    assert set(counts) == {1, *range(11, 18)}
    assert all(len(used) == 1 for used in ports.values())
    assert len(set.union(*ports.values())) == 8
    assert noise == 4 * 8
    assert said[-1] == "The simulated flight is over"
    # in real time: the last packets come three seconds after the first frame's time, or later on a busy machine
    assert telemetry.datagrams[-1][0] > played.start_us / 1e6 + 2.9
    assert ticks and all(b - a > 0.199 for a, b in itertools.pairwise(ticks))
    assert all(len(data) % 188 == 0 and data[0] == 0x47 for _, _, data in video.datagrams)
    assert max(len(data) for _, _, data in video.datagrams) == 1316
    assert played.frames + played.frames_skipped == 20
    assert played.frames > 0
    with (tmp_path / "truth.csv").open(newline="") as file:
        truth = list(csv.DictReader(file))
    stamps = sorted({int(row["time_us"]) for row in truth})
    assert len(stamps) == played.frames
    assert stamps[0] == played.start_us
    assert all((b - a) % 100_000 == 0 for a, b in itertools.pairwise(stamps))
    assert {int(row["system_id"]) for row in truth} - {0} == set(range(11, 17))


@pytest.mark.slow
def test_each_of_two_cameras_sends_its_own(tmp_path, monkeypatch):
    with Receiver() as telemetry, Receiver() as video, Receiver() as other:
        url = f"udp://127.0.0.1:{video.port}?pkt_size=1316"
        second = live._nth_url(url, other.port - video.port)
        assert second == f"udp://127.0.0.1:{other.port}?pkt_size=1316"
        monkeypatch.setattr(live, "_nth_url", lambda _, k: (url, second)[k])
        truth, to = tmp_path / "truth.csv", f"udpout:127.0.0.1:{telemetry.port}"
        played = play(SMALL.filmed_by(2), to, url, 1.0, truth_path=truth, tells_camera=True)
    parser = dialect.MAVLink(None)
    messages = [parser.decode(bytearray(data)) for _, _, data in telemetry.datagrams]
    assert set(played.packets) == {1, 2, *range(11, 18)} == {each.get_srcSystem() for each in messages}
    told = {each.get_srcSystem(): each.uri for each in messages if each.get_type() == "VIDEO_STREAM_INFORMATION"}
    assert told == {1: str(video.port), 2: str(other.port)}
    assert video.datagrams and other.datagrams and played.frames > 1
    assert [len((tmp_path / name).read_text().splitlines()) > 1 for name in ("truth.csv", "truth-2.csv")] == [True] * 2


def test_a_play_stops_when_told():
    stop = threading.Event()
    stop.set()
    with Receiver() as telemetry:
        played = play(SMALL, f"udpout:127.0.0.1:{telemetry.port}", None, stop=stop)
    assert sum(played.packets.values()) == len(telemetry.datagrams) == played.frames == 0


class Clock:
    """Time that passes only while somebody waits for it, and the event that ends the wait."""

    def __init__(self, now_s, stop_s):
        self.now_s, self.stop_s = now_s, stop_s

    def time(self):
        return self.now_s

    def is_set(self):
        return self.now_s >= self.stop_s

    def wait(self, seconds):
        self.now_s = min(self.now_s + seconds, self.stop_s)
        return self.is_set()


def test_every_packet_goes_out_at_its_time_until_told_to_stop(monkeypatch):
    clock, ticks = Clock(1000.0, stop_s=1004.0), []
    monkeypatch.setattr(live, "time", clock)
    due_s = [999.0, 1000.7, 1000.7, 1001.0, 1003.5, 1004.5, 1005.0]
    packets = [TelemetryPacket(t_us=round(t * 1e6), vehicle=0, raw=b"") for t in due_s]
    sent_s = [clock.now_s for _ in live._on_time(packets, 1_002_000_000, clock, ticks.append)]
    assert sent_s == pytest.approx([1000.0, 1000.7, 1000.7, 1001.0, 1003.5])
    assert clock.now_s == 1004.0
    assert ticks[0] == -2.0 and ticks[-1] > 1.7
    assert all(0.199 < b - a < 0.401 for a, b in itertools.pairwise(ticks))


@pytest.mark.parametrize("url", ["udpout:127.0.0.1", "udpin:0.0.0.0:14550", "127.0.0.1:14550", "udpout:h:99999"])
def test_a_bad_telemetry_address_is_refused(url):
    with pytest.raises(PlayError, match="give udpout:host:port"):
        play(SMALL, url)


@pytest.mark.slow
def test_a_bad_video_address_and_a_truth_file_in_the_way_are_refused(tmp_path):
    with pytest.raises(PlayError, match="give udp://host:port"):
        play(SMALL, "udpout:127.0.0.1:9", "rtsp://127.0.0.1/x", 1.0)
    (tmp_path / "truth.csv").write_text("mine")
    with pytest.raises(PlayError, match="cannot be made"):
        play(SMALL, "udpout:127.0.0.1:9", "udp://127.0.0.1:9", 1.0, truth_path=tmp_path / "truth.csv")
    assert (tmp_path / "truth.csv").read_text() == "mine"


@pytest.mark.parametrize(("url", "names"), [(None, 1), ("udp://127.0.0.1:5605?pkt_size=1316", 2)])
def test_a_camera_tells_how_wide_it_sees_and_where_its_video_goes(url, names):
    frames = live._camera_frames(SMALL, url)
    first, second = next(frames), next(frames)
    parser = dialect.MAVLink(None)
    view, *stream = (parser.decode(bytearray(raw)) for raw in first)
    assert view.hfov == pytest.approx(77.32, abs=0.01) and view.vfov == pytest.approx(48.46, abs=0.01)
    assert len(first) == names and not set(first) & set(second), "none looks like a repeated frame"
    assert [each.uri for each in stream] == ["5605"] * (names - 1)
