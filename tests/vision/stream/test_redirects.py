"""Servers of video that send on: to the same host they are followed, to others and to files they are refused."""

import contextlib
import socket
import threading

import pytest

from tests.support.video_senders import mjpeg
from vision.errors import VideoError
from vision.stream.connection import open_input
from vision.stream.source import parse_source

FOUND = "HTTP/1.1 302 Found\r\nLocation: {}\r\nContent-Length: 0\r\nConnection: close\r\n\r\n"
LISTS = {
    "application/vnd.apple.mpegurl": "#EXTM3U\n#EXT-X-TARGETDURATION:9\n#EXTINF:9,\nhttp://{}/a.ts\n#EXT-X-ENDLIST\n",
    "application/sdp": "v=0\no=- 0 0 IN IP4 {0}\ns=-\nc=IN IP4 127.0.0.2\nt=0 0\nm=video 5998 RTP/AVP 33\n",
    "text/plain": "ffconcat version 1.0\nfile http://{}/a.ts\n",
}
"""What names further addresses, by its type."""
PICTURES = b"HTTP/1.1 200 OK\r\nContent-Type: multipart/x-mixed-replace;boundary=frame\r\n\r\n"


class Server:
    """Answers each request with what a function gives of it, and keeps what it was asked."""

    def __init__(self, host, answer):
        self.asked, self._answer = [], answer
        self._listener = socket.create_server((host, 0))
        self.place = "{}:{}".format(*self._listener.getsockname())
        threading.Thread(target=self._serve, daemon=True).start()

    def __enter__(self):
        return self

    def __exit__(self, *args):
        self._listener.close()

    def _serve(self):
        with contextlib.suppress(OSError):
            while True:
                client, _ = self._listener.accept()
                client.settimeout(5.0)
                with client, contextlib.suppress(OSError):
                    while asked := client.recv(4096).decode():
                        self.asked.append(asked)
                        client.sendall(self._answer(asked))
                        if asked.startswith("GET"):
                            break


@pytest.fixture
def other():
    """A server on another address of this computer, which nobody is to ask."""
    with Server("127.0.0.2", lambda _: PICTURES) as server:
        yield server
        assert server.asked == []


@pytest.mark.parametrize("goal", ["http://{}/x", "//{}/x", "https://{}/x", "file:///etc/hostname", "rtsp://{}/x"])
def test_no_other_host_and_no_file_is_opened_for_a_server_that_says_so(other, goal):
    goal = goal.format(other.place)
    with (
        Server("127.0.0.1", lambda _: FOUND.format(goal).encode()) as server,
        pytest.raises(VideoError, match=r"sends on to .*, which is not followed") as error,
    ):
        open_input(parse_source(f"http://eve:secret@{server.place}/video"))
    assert "\n" not in str(error.value) and "secret" not in str(error.value)
    assert goal.split("//")[1] in str(error.value)


@pytest.mark.parametrize("kind", LISTS)
@pytest.mark.parametrize("scheme", ["http", "HTTP"])
def test_no_address_is_opened_that_a_playlist_or_session_names(other, scheme, kind):
    body = LISTS[kind].format(other.place)
    answer = f"HTTP/1.1 200 OK\r\nContent-Type: {kind}\r\nContent-Length: {len(body)}\r\n\r\n{body}".encode()
    with (
        Server("127.0.0.1", lambda _: answer) as server,
        pytest.raises(VideoError, match="perhaps a playlist or a session, whose addresses are not followed"),
    ):
        open_input(parse_source(f"{scheme}://{server.place}/list.m3u8"))


def test_what_moved_on_the_same_host_is_followed_with_its_password():
    parts = b"".join(mjpeg(40, True))

    def answer(asked):
        return PICTURES + parts if "GET /new " in asked else FOUND.format("/new").encode()

    with Server("127.0.0.1", answer) as server:
        opened = open_input(parse_source(f"http://eve:secret@{server.place}/old"))
        assert opened is not None and next(opened.packets).size
        opened.close()
        assert any("GET /new " in asked for asked in server.asked)


def test_a_server_that_sends_in_circles_is_given_up():
    with (
        Server("127.0.0.1", lambda _: FOUND.format("/again").encode()) as server,
        pytest.raises(VideoError, match="sends on and on"),
    ):
        open_input(parse_source(f"http://{server.place}/video"))


@pytest.mark.parametrize("goal", ["rtsp://{}/x", "file:///etc/hostname"])
def test_rtsp_servers_that_send_on_are_refused(other, goal):
    goal = goal.format(other.place)

    def answer(asked):
        (sequence,) = (line for line in asked.split("\r\n") if line.startswith("CSeq"))
        return f"RTSP/1.0 302 Moved\r\n{sequence}\r\nLocation: {goal}\r\n\r\n".encode()

    with Server("127.0.0.1", answer) as server, pytest.raises(VideoError, match="sends on to another address"):
        open_input(parse_source(f"rtsp://{server.place}/video"))
