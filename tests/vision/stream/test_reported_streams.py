"""Senders as public bug reports describe them, with the films that were handed in: ``tests/data/reported``."""

from pathlib import Path

import av
import pytest

from tests.support.ports import free_port
from tests.support.video_senders import FPS, RtspServer, Sender, sent_as_rtp
from tests.support.waiting import until
from vision.stream.stream import VideoStream

H264, H265 = (Path(f"tests/data/reported/rtp_codec_switch_{codec}.ts") for codec in ("h264", "h265"))


def pictures(path):
    """Codec of a recording, and how many pictures it decodes to."""
    with av.open(str(path)) as film:
        return film.streams.video[0].codec_context.name, sum(1 for _ in film.decode(video=0))


def test_a_camera_that_refuses_rtp_over_tcp_is_played_over_udp(tmp_path):
    frames, rows = sent_as_rtp(H264, 20), []
    with RtspServer(frames, datagrams=True) as server:
        stream = VideoStream(server.url, tmp_path / "video.mkv", on_frame=lambda *row: rows.append(row))
        assert until(lambda: len(rows) >= FPS) and stream.error == ""
        stream.close()
    assert pictures(tmp_path / "video.mkv")[1] >= FPS


@pytest.mark.slow
def test_a_sender_that_changes_its_codec_is_recorded_anew(tmp_path):
    port, rows = free_port(), []
    frames = [sent_as_rtp(film, 8) for film in (H264, H265)]
    stream = VideoStream(f"rtp://127.0.0.1:{port}", tmp_path / "video.mkv", on_frame=lambda *row: rows.append(row))
    with Sender(port, frames[0] + frames[1]) as sender:
        assert until(lambda: sender.sent == len(frames[0]) + len(frames[1]), 60.0)
        assert until(lambda: (tmp_path / "video.1.mkv").exists())
    stream.close()
    found = [pictures(path) for path in (tmp_path / "video.mkv", tmp_path / "video.1.mkv")]
    assert [codec for codec, _ in found] == ["h264", "hevc"]
    assert all(count > 30 for _, count in found), found
