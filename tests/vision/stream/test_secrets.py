"""A password in a video's address is given to FFmpeg, and stands nowhere else."""

import contextlib
import signal
import subprocess
import sys
import threading

import psutil
import pytest

from gcs.flight.video import FlightVideo, check_source
from gcs.health.faults import Faults
from gcs.session.recorder import Recorder
from infra.secrets import conceal_in, concealed, secrets_of
from mavlink.protocol.messages import VideoStreamInformation
from tests.support.ports import free_port
from tests.support.snapshots import ONE_UGV
from tests.support.waiting import until
from vision.errors import VideoError
from vision.stream.source import parse_source
from vision.stream.stream import VideoStream

PASSWORD = "hunter2-Zx9"
MISSION_TOML = """
[uav]
system_id = 1
[[ugv]]
system_id = 2
[links]
video = "{video}"
"""


@pytest.mark.parametrize(
    ("address", "shown"),
    [
        ("rtsp://admin:PW@10.0.0.2:554/main", "rtsp://***@10.0.0.2:554/main"),
        ("rtsp://admin:a/PW@b@10.0.0.2/x?token=PW&channel=1", "rtsp://***@10.0.0.2/x?token=***&channel=***"),
        ("rtsp://10.0.0.2/user=admin&password=PW&stream=0.sdp?real", "rtsp://10.0.0.2/user=***&password=***&stream=***?real"),
        ("rtsp://10.0.0.2/user=admin_password=PW_channel=1", "rtsp://10.0.0.2/user=***"),
        ("http://10.0.0.2/x?password=a@PW&y=2", "http://***&y=***"),
        ("rtmp://u:PW@h/x", "rtmp://***@h/x"),
        ("rtmp://10.0.0.2/live/PW", "rtmp://10.0.0.2/live/***"),
        ("rtsp://10.0.0.2/live/PW/", "rtsp://10.0.0.2/live/***/"),
        ("rtsp://10.0.0.2/Streaming/Channels/101", "rtsp://10.0.0.2/Streaming/Channels/101"),
        ("rtsp://192.168.144.25:8554/main.264", "rtsp://192.168.144.25:8554/main.264"),
        ("admin:PW@10.0.0.2/x", "***@10.0.0.2/x"),
        ("udp://@:1234", "udp://@:1234"),
        ("rtp://:5600?codec=h265", "rtp://:5600?codec=h265"),
        ("/home/a@b/x=3.mp4", "/home/a@b/x=3.mp4"),
        ("flight.mp4", "flight.mp4"),
    ],
)  # fmt: skip
def test_what_is_shown_of_an_address(address, shown):
    address = address.replace("PW", PASSWORD)
    assert concealed(address) == shown
    assert any(PASSWORD in secret for secret in secrets_of(address)) == (PASSWORD in address)
    try:
        told = parse_source(address).text
    except VideoError as error:
        told = str(error)
    assert shown in told
    assert PASSWORD not in told


@pytest.mark.parametrize(
    "path",
    [
        "Streaming/Channels/101", "h264/ch1/main/av_stream", "cam/realmonitor", "axis-media/media.amp", "onvif-media1",
        "h264Preview_01_main", "h264Preview_01_sub", "videostream", "videostream12", "stream1", "streaming/live/1",
        "main.264", "video1", "MediaInput/h264stream.sdp",
    ],
)  # fmt: skip
def test_a_camera_s_name_for_its_stream_is_no_key(path):
    assert not secrets_of(f"rtsp://10.0.0.2/{path}")


@pytest.mark.parametrize(
    "key",
    [
        "5nPr7RCmueGTKMP7", "x7f9k2m4q8", "d41d8cd98f00b204e9800998ecf8427e", "Zr3x_kd9-Q0a-main-77xyPq",
        "550e8400-beef-41d4-a716-446655440000", "q4Zt-9Wn2_b",
    ],
)  # fmt: skip
def test_a_random_end_of_a_path_is_a_key(key):
    address = f"rtsp://10.0.0.2/live/{key}"
    assert concealed(address) == "rtsp://10.0.0.2/live/***"
    for said, shown in ((f"no {key}.", "no ***."), (f"%2F{key}_720p", "%2F***_720p"), (f"{key}s", f"{key}s")):
        assert conceal_in(said, address) == shown


@pytest.mark.parametrize(
    ("address", "said", "shown"),
    [
        ("rtmp://h/live/1", "4/17 named, 3/1", "4/17 named, 3/1"),
        ("rtmp://h/live/1", "rtmp://h/live/1: no. /live/1.", "rtmp://h/live/***: no. /live/***."),
        ("rtmp://h/live/1", "rtmp://h/live/17", "rtmp://h/live/17"),
        ("rtmp://u:pass@h/live/main/", "/srv/main/x, h/live/main", "/srv/main/x, h/live/***"),
        ("rtmp://h/live/main", "/srv/mainland, /live/main-2", "/srv/mainland, /live/main-2"),
    ],
)
def test_a_short_key_is_found_with_its_path_alone(address, said, shown):
    assert conceal_in(said, address) == shown


def test_others_words_are_cleared_of_it_in_every_form():
    address = "rtsp://admin:hunter%202@10.0.0.2/main"
    said = conceal_in(f"[Errno 5] {address!r}: hunter%202, hunter 2, admin:hunter 2", address)
    assert "hunter" not in said
    assert "10.0.0.2" in said


def test_a_port_that_is_none_does_not_repeat_what_stands_there():
    with pytest.raises(VideoError) as error:
        parse_source(f"udp://admin:{PASSWORD}/x@h")
    assert PASSWORD not in str(error.value)


def test_a_process_that_dies_does_not_tell_it(tmp_path):
    stream = VideoStream(f"rtsp://admin:{PASSWORD}@127.0.0.1:{free_port()}/x")
    try:
        stream._trouble = f"its process ended with code 1 (av.error.OSError: 'rtsp://admin:{PASSWORD}@127.0.0.1/x')"
        stream._progress.error = ""
        assert PASSWORD not in stream.error
        assert PASSWORD not in stream.url
    finally:
        stream.close()


def test_what_the_uav_offers_is_told_without_it(tmp_path):
    recorder = Recorder(tmp_path, ONE_UGV, video=False)
    offer = dict.fromkeys(VideoStreamInformation.__dataclass_fields__, 0)
    uris = (f"rtsp://u:{PASSWORD}@10.0.0.2/x", f"file://u:{PASSWORD}@h/x")
    told = [
        event.text
        for uri in uris
        for event in FlightVideo("", recorder).check(VideoStreamInformation(**{**offer, "uri": uri, "name": ""}))
    ]
    recorder.close()
    assert len(told) == 2
    assert not any(PASSWORD in text for text in told)


@pytest.mark.slow
@pytest.mark.parametrize("given_by", ["mission", "option"])
def test_a_flight_keeps_it_to_itself(tmp_path, given_by):
    video = f"rtsp://admin:{PASSWORD}@127.0.0.1:{free_port()}/user=x&password={PASSWORD}"
    mission = tmp_path / "mission.toml"
    mission.write_text(MISSION_TOML.format(video=video if given_by == "mission" else ""))
    extra = ["--video", video] if given_by == "option" else []
    command = [
        *(sys.executable, "-c", "from gcs.cli.app import main; main()", "fly", mission, *extra, "--headless"),
        *("-l", f"udpin:127.0.0.1:{free_port()}", "--sessions", tmp_path / "sessions"),
    ]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as flight:
        killer = threading.Timer(300, flight.kill)
        killer.start()
        told = lambda: "".join(p.read_text() for p in tmp_path.glob("sessions/*/events.jsonl"))  # noqa: E731
        until(lambda: "cannot be opened" in told(), 120.0)
        lines = list(command_lines(psutil.Process(flight.pid)))
        flight.send_signal(signal.SIGINT)
        stdout, stderr = flight.communicate(timeout=120)
        killer.cancel()
    assert flight.returncode == 4, stderr  # nothing was named
    assert "cannot be opened" in told()
    assert len(lines) >= 3
    assert not [line for line in lines if PASSWORD in line]
    assert PASSWORD.encode() not in stdout + stderr
    assert (b"--video" in stderr) == (given_by == "option")
    files = [path for path in tmp_path.rglob("sessions/**/*") if path.is_file()]
    assert len(files) >= 5
    assert not [path for path in files if PASSWORD.encode() in path.read_bytes()]


def command_lines(station):
    """Of a process and those that it started, as far as they live."""
    for process in (station, *station.children(recursive=True)):
        with contextlib.suppress(psutil.Error):
            yield " ".join(process.cmdline())


def test_a_fault_tells_nothing(tmp_path):
    try:
        check_source(f"admin:{PASSWORD}@10.0.0.2/x")
    except VideoError as error:
        Faults(tmp_path / "faults.txt").record("video", error)
    assert "no such file" in (tmp_path / "faults.txt").read_text()
    assert PASSWORD not in (tmp_path / "faults.txt").read_text()
