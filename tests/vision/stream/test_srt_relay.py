"""SRT, handed on by a program: a stand-in for ffmpeg that has what a sender sent, and ffmpeg itself where it can."""

import shutil
import subprocess
import sys

import pytest

from tests.support.ports import free_port
from tests.support.video_senders import coded
from vision.errors import VideoError
from vision.stream import srt_relay
from vision.stream.connection import open_input
from vision.stream.source import parse_source

N = 24
STAND_IN = """#!{python}
import sys, time
if "-protocols" in sys.argv:
    print("file", "{protocols}")
elif "quiet" in sys.argv[sys.argv.index("-i") + 1]:
    time.sleep(30.0)
elif "away" not in sys.argv[sys.argv.index("-i") + 1]:
    sys.stdout.buffer.write(open({film!r}, "rb").read())
"""


@pytest.fixture
def stand_in(tmp_path, monkeypatch):
    """Put a program on the path that knows some protocols; returns how."""

    def put(protocols):
        (tmp_path / "film.ts").write_bytes(b"".join(piece for frame in coded(N) for piece in frame))
        program = tmp_path / "ffmpeg"
        text = STAND_IN.format(python=sys.executable, protocols=protocols, film=str(tmp_path / "film.ts"))
        program.write_text(text)
        program.chmod(0o755)
        monkeypatch.setenv("PATH", str(tmp_path))
        monkeypatch.setattr(srt_relay, "_packaged", lambda: None)
        srt_relay.ffmpeg_program.cache_clear()

    yield put
    srt_relay.ffmpeg_program.cache_clear()


def frames_of(address):
    opened = open_input(parse_source(address))
    try:
        return sum(1 for packet in opened.packets if packet.size)
    finally:
        opened.close()


def test_what_the_program_hands_on_is_the_film(stand_in):
    stand_in("srt")
    assert frames_of("srt://10.0.0.2:9000") == N


def test_nobody_there_and_no_answer_are_told(stand_in, monkeypatch):
    stand_in("srt")
    with pytest.raises(VideoError, match=r"cannot be opened .*is it being sent"):
        frames_of("srt://away:9000")
    monkeypatch.setattr("vision.stream.connection.OPEN_TIMEOUT_S", 0.05)
    with pytest.raises(VideoError, match=r"no answer within 0\.05 s"):
        frames_of("srt://quiet:9000")


def test_without_a_program_that_can_it_says_what_to_install(stand_in):
    stand_in("udp")
    with pytest.raises(VideoError, match=r"pip install 'rollcall-gcs\[srt\]', or have the sender push RTMP"):
        frames_of("srt://10.0.0.2:9000")


@pytest.mark.skipif("srt" not in srt_relay._protocols(shutil.which("ffmpeg") or "ffmpeg"), reason="no ffmpeg with SRT")
def test_a_sender_that_connects_is_received(tmp_path):
    port, film = free_port(), tmp_path / "film.ts"
    film.write_bytes(b"".join(piece for frame in coded(N) for piece in frame))
    words = ["-nostdin", "-loglevel", "error", "-re", "-i", str(film), "-c", "copy", "-f", "mpegts"]
    sender = subprocess.Popen([srt_relay.ffmpeg_program(), *words, f"srt://127.0.0.1:{port}?connect_timeout=20000"])
    try:
        assert (
            frames_of(f"srt://127.0.0.1:{port}?mode=listener") >= N // 2
        )  # a sender that ends drops what was not acknowledged
    finally:
        sender.kill()
        sender.wait()
