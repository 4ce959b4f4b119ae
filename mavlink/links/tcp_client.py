"""A TCP link that connects, and connects again.

Nothing here waits: a peer that does not answer, or does not take what is sent, never holds up another link.
"""

from __future__ import annotations

import errno
import select
import socket
import time

from mavlink.errors import LinkError
from mavlink.links.base import LinkOptions
from mavlink.links.byte_stream import Connection, FrameStream, queue_bytes
from mavlink.links.stream_link import StreamLink
from mavlink.links.url import LinkUrl, network_url

DEFAULT_PORT = 5760
"""Where ArduPilot's simulator and most bridges listen."""
_CHUNK = 65536
_CONNECT_S = 5.0
"""An answer that takes longer is not waited for."""
_PENDING = (errno.EINPROGRESS, errno.EWOULDBLOCK, errno.EALREADY, errno.EINTR)


def tcp_connection(sock: socket.socket, frames: FrameStream, options: LinkOptions) -> Connection:
    """An open connection, as a stream of frames."""
    sock.setblocking(False)

    def receive() -> bytes | None:
        try:
            return sock.recv(_CHUNK)
        except (BlockingIOError, InterruptedError):
            return None
        except (OSError, ValueError):
            return b""

    return Connection(sock, receive, frames, queue_bytes=queue_bytes(options.is_output))


class TcpOut(StreamLink):
    """Connects to a server, and again soon after the connection was lost or refused.

    Raises:
        LinkError: no such host.
    """

    example = "tcp:host:port"

    def __init__(self, url: LinkUrl, options: LinkOptions | None = None) -> None:
        self._options = options or LinkOptions()
        super().__init__(url, self._options)
        self._address = _resolve(url)
        self._calling: socket.socket | None = None
        """A connection that the server has not answered yet."""
        self._give_up_s = 0.0

    @classmethod
    def parse(cls, rest: str) -> LinkUrl:
        """Host and port of a server."""
        return network_url("tcp", rest, default_port=DEFAULT_PORT)

    @classmethod
    def prepare(cls, url: LinkUrl) -> tuple[LinkUrl, socket.socket | None]:
        """Looks the host up: a process that receives must not wait for that."""
        host, port = _resolve(url)
        return LinkUrl(scheme=url.scheme, host=host, port=port), None

    def maintain(self) -> None:
        """Connects when need be."""
        now_s = time.monotonic()
        if self._calling is not None:
            self._look_for_answer(self._calling, now_s)
        elif self._connection is None and self._open and self._backoff.due(now_s):
            self._call(now_s)

    def _call(self, now_s: float) -> None:
        sock = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        sock.setblocking(False)
        code = sock.connect_ex(self._address)
        if code and code not in _PENDING:
            sock.close()
            return
        self._calling, self._give_up_s = sock, now_s + _CONNECT_S
        self._look_for_answer(sock, now_s)

    def _look_for_answer(self, sock: socket.socket, now_s: float) -> None:
        if not select.select([], [sock], [], 0.0)[1]:
            if now_s > self._give_up_s:
                self._hang_up()
            return
        if sock.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR):
            self._hang_up()
            return
        sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._calling = None
        self._opened(tcp_connection(sock, FrameStream(self._counters, 1), self._options))

    def _hang_up(self) -> None:
        sock, self._calling = self._calling, None
        if sock is not None:
            sock.close()

    def _lose(self) -> None:
        self._hang_up()
        super()._lose()


def _resolve(url: LinkUrl) -> tuple[str, int]:
    try:
        host, port = socket.getaddrinfo(url.host, url.port, socket.AF_INET, socket.SOCK_STREAM)[0][4][:2]
    except (OSError, UnicodeError) as error:
        raise LinkError(f"{url.name}: no such host: {error}") from error
    return str(host), int(port)
