"""A kind of link that the product does not have: datagrams over Unix sockets, one frame each."""

import socket
from pathlib import Path

from infra.wall_clock import now_us
from mavlink.errors import LinkError
from mavlink.links.base import Link, LinkOptions
from mavlink.links.batch import Batch
from mavlink.links.url import LinkUrl
from mavlink.protocol.framing import split

PEER = ".peer"


class UnixLink(Link):
    """Listens at a path, and sends to the path beside it."""

    example = "unix:/run/mavlink"

    def __init__(self, url: LinkUrl, options: LinkOptions) -> None:
        super().__init__(url, options)
        self._peer = url.device + PEER
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self._socket.bind(url.device)

    @classmethod
    def parse(cls, rest: str) -> LinkUrl:
        if not Path(rest).is_absolute():
            raise LinkError("no absolute path")
        return LinkUrl(scheme="unix", device=rest)

    @property
    def fds(self) -> tuple[int, ...]:
        return (self._socket.fileno(),)

    def read_batch(self) -> Batch:
        batch = Batch()
        try:
            data = self._socket.recv(4096)
        except BlockingIOError:
            return batch
        frames, counts = split(data)
        self._counters.add(len(data), counts)
        for frame in frames:
            batch.times_us.append(now_us())
            batch.frames.append(frame)
            batch.peers.append(1)
        return batch

    def send(self, frame: bytes, peer: int = 0) -> bool:
        try:
            self._socket.sendto(frame, self._peer)
        except OSError as error:
            raise LinkError(f"{self.name}: cannot send: {error}") from error
        return True

    def close(self) -> None:
        self._socket.close()
