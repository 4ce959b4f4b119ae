"""A camera over RTSP, played to its faults."""

from __future__ import annotations

import numpy as np

from tests.support.video_senders import GOP, RtspServer, number_of, packed, reconnects
from tests.support.waiting import until
from vision.stream.stream import VideoStream
from vision.video.video import VideoFile

CLIP = 1000


class Watched:
    """A stream and the rows it lists."""

    def __init__(self, url, path):
        self.rows = []
        self.stream = VideoStream(url, path, on_frame=lambda index, t_us: self.rows.append((index, t_us)))

    def __enter__(self):
        return self

    def __exit__(self, *args):
        self.stream.close()

    def shows_more(self, n=30):
        seen = len(self.rows)
        return until(lambda: len(self.rows) >= seen + n and not self.stream.stalled)


def film(path, rows):
    """The numbers of all recorded frames."""
    with VideoFile.open(path, np.array([t_us for _, t_us in rows])) as video:
        assert video.missing == 0
        return [number_of(frame.image) for frame in video.frames()]


def test_a_camera_is_played_and_recorded(tmp_path):
    with RtspServer(packed(CLIP)) as server, Watched(server.url, tmp_path / "video.mkv") as watched:
        assert watched.shows_more()
        shown = watched.stream.latest(60.0)
        assert number_of(shown.image) >= shown.index
        assert watched.stream.error == "" and until(lambda: watched.stream.connected)
        watched.stream.close()
        assert server.plays == 1
    numbers = film(tmp_path / "video.mkv", watched.rows)
    assert len(numbers) == len(watched.rows) >= 30
    assert numbers == list(range(numbers[0], numbers[0] + len(numbers))) and numbers[0] % GOP == 0
    assert (np.diff([t_us for _, t_us in watched.rows]) > 0).all()


def test_a_camera_that_offers_nothing_but_datagrams_is_played(tmp_path):
    with RtspServer(packed(CLIP), datagrams=True) as server, Watched(server.url, tmp_path / "video.mkv") as watched:
        assert watched.shows_more()
        assert watched.stream.error == ""
    numbers = film(tmp_path / "video.mkv", watched.rows)
    assert len(numbers) >= 30 and (np.diff(numbers) > 0).all()


def test_a_camera_that_falls_silent_with_its_connection_open_is_stalled_once(tmp_path):
    with RtspServer(packed(CLIP)) as server, Watched(server.url, tmp_path / "video.mkv") as watched:
        assert watched.shows_more()
        server.hold.set()
        assert until(lambda: len(watched.rows) >= server.sent - server.first - 2), "all but what FFmpeg keeps"
        assert until(lambda: watched.stream.stalled)
        # FFmpeg keeps the last frame until it gives up: that is no sign of life
        assert not until(lambda: not watched.stream.stalled, 3.0)
        assert until(lambda: "nothing came for 2 s" in watched.stream.error)
        server.hold.clear()
        assert watched.shows_more()
        assert reconnects(watched.stream) >= 1 and watched.stream.restarts == 0 and watched.stream.error == ""


def test_a_camera_that_dies_and_comes_back_goes_on_in_the_same_file(tmp_path):
    server = RtspServer(packed(CLIP))
    with Watched(server.url, tmp_path / "video.mkv") as watched:
        try:
            assert watched.shows_more()
            server.close()
            assert until(lambda: watched.stream.stalled and "cannot be opened" in watched.stream.error)
            assert not watched.stream.connected
            server = RtspServer(packed(CLIP), server.port)
            assert watched.shows_more()
            assert reconnects(watched.stream) == 1 and watched.stream.restarts == 0 and watched.stream.error == ""
        finally:
            server.close()
    numbers = film(tmp_path / "video.mkv", watched.rows)
    breaks = [k for k in range(1, len(numbers)) if numbers[k] != numbers[k - 1] + 1]
    assert len(breaks) == 1 and numbers[breaks[0]] % GOP == 0
    assert [path.name for path in tmp_path.iterdir()] == ["video.mkv"]
