"""A UDP port that is bound once and stays bound: nothing that is sent to it between two connections is lost.

The station binds it and hands it to the video's process, so that it outlives that, too. Only one sender is listened to
at a time (``vision.stream.senders``); another one begins a connection of its own.
"""

from __future__ import annotations

import contextlib
import errno
import select
import socket
import struct
import time
from collections import deque
from collections.abc import Callable, Sequence

from infra.stamped_udp import open_stamped_udp, receive_stamped
from vision.errors import VideoError
from vision.stream.messages import Sender
from vision.stream.senders import Senders
from vision.stream.source import Source
from vision.stream.trial import Trial

ANY = "0.0.0.0"
BUFFER_BYTES = 4 << 20
"""Receive buffer of the socket."""
REPORT_BUFFER_BYTES = 1 << 16
"""Sender reports are some dozens of bytes, every few seconds."""
SLICE_S = 0.2
"""Longest wait between two checks whether to stop."""
MAX_REPORTS = 8
"""Most reports taken at once: a sender reports every few seconds."""


def bind(host: str, port: int) -> socket.socket:
    """A UDP socket for a source's host and port.

    Args:
        host: empty for any address, one of ours, a multicast group, or the one sender to listen to.

    Raises:
        VideoError: the port cannot be had, or the host's name is none.
    """
    bound = open_stamped_udp(BUFFER_BYTES)
    try:
        _bind(bound, host, port)
    except OSError as error:
        bound.close()
        raise VideoError(
            f"video udp port {host or '*'}:{port}: cannot be bound ({(error.strerror or str(error)).lower()}); "
            "is another program listening there?"
        ) from error
    except (TypeError, ValueError) as error:
        bound.close()
        raise VideoError(f"video udp port {host}:{port}: that cannot be the name of a host; correct it") from error
    return bound


def _bind(bound: socket.socket, host: str, port: int) -> None:
    address = socket.gethostbyname(host) if host else ANY
    try:
        bound.bind((address, port))
    except OSError as error:
        if error.errno != errno.EADDRNOTAVAIL:
            raise
        bound.bind((ANY, port))
    if 224 <= int(address.partition(".")[0]) <= 239:
        membership = struct.pack("=4s4s", socket.inet_aton(address), socket.inet_aton(ANY))
        bound.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, membership)


def are_one_place(one: Source, other: Source) -> bool:
    """Tell whether two sources are one address, or one port of this computer: a sender that is named comes to any."""
    if one.kind != "datagrams" or other.kind != "datagrams":
        return (one.kind, one.address) == (other.kind, other.address)
    places = {_bound_to(source.host) for source in (one, other)}
    return one.port == other.port and (len(places) == 1 or ANY in places)


def _bound_to(host: str) -> str:
    """The address of this computer that a source's host is bound to."""
    # a name that cannot be one is a ValueError, one with a null byte a TypeError
    with contextlib.suppress(OSError, TypeError, ValueError), socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as trial:
        _bind(trial, host, 0)
        return str(trial.getsockname()[0])
    return ANY


class Port:
    """UDP port that takes the datagrams of one sender after the other.

    Args:
        bound: from ``bind``.
        proven: who has shown a picture on it before, the first with the best right.
        go_on: asked at least every 0.2 s; False ends every wait.
        silence_s: a connection without datagrams for this long is over.

    Attributes:
        senders: who sends to it, and who of them is listened to.
        arrival_s: Unix time at which the datagram read last came to this machine.
    """

    def __init__(
        self,
        bound: socket.socket,
        source: Source,
        proven: Sequence[Sender],
        go_on: Callable[[], bool],
        silence_s: float,
    ) -> None:
        self.senders = Senders(source.codec, proven)
        self.arrival_s = 0.0
        self._go_on = go_on
        self._silence_s = silence_s
        self._socket = bound
        # bound to all addresses although one was named: that one is the sender's
        self._only = socket.gethostbyname(source.host) if source.host and bound.getsockname()[0] == ANY else ""
        self._socket.setblocking(False)
        self._open = False
        self._heard_s = 0.0
        self._held: deque[tuple[bytes, float]] = deque()
        self._control: socket.socket | None = None

    def wait(self) -> Trial | None:
        """Return the sender that is listened to next, its first datagrams left to be read.

        None when it is time to end, and when ``senders.undecodable`` has something to tell.
        """
        self.senders.end()
        self._open = False
        while self._go_on():
            self._receive()
            successor = self.senders.successor()
            if successor is not None:
                trial = self.senders.begin(successor)
                self._held, self._open, self._heard_s = trial.held, True, time.monotonic()
                return trial
            if self.senders.waited_in_vain:
                return None
        return None

    @property
    def live(self) -> bool:
        """True if the connection is still open."""
        return self._open

    def read(self) -> bytes:
        """The next datagram of this connection, empty at its end and from then on until ``wait``."""
        data = self._next() if self._open else b""
        self._open = bool(data)
        return data

    def _next(self) -> bytes:
        if self._held:
            data, self.arrival_s = self._held.popleft()
            return data
        while self._go_on():
            found = self._receive()
            now = time.monotonic()
            if found is not None:
                self._heard_s = now
                data, self.arrival_s = found
                return data
            if self.senders.successor() is not None or now - self._heard_s > self._silence_s:
                return b""
        return b""

    def reports(self) -> list[tuple[bytes, float]]:
        """Datagrams of the next higher port, where RTCP of RTP on an even one is, each with its Unix time of arrival.

        That port is bound with the first call, if it is free, and only datagrams of the present sender's host are read.
        """
        if self._control is None:
            self._control = self._next_port()
        found: list[tuple[bytes, float]] = []
        try:
            while len(found) < MAX_REPORTS:
                data, peer, t_us = receive_stamped(self._control)
                present = self.senders.present
                if present is not None and peer[0] == present.host:
                    found.append((data, t_us * 1e-6))
        except OSError:
            pass  # nothing more
        return found

    def _next_port(self) -> socket.socket:
        control = open_stamped_udp(REPORT_BUFFER_BYTES)
        address, port = self._socket.getsockname()[:2]
        if port % 2 == 0:
            with contextlib.suppress(OSError):
                control.bind((address, port + 1))
        return control

    def close(self) -> None:
        """Give the port back."""
        self._socket.close()
        if self._control is not None:
            self._control.close()

    def _receive(self) -> tuple[bytes, float] | None:
        """The next datagram if it is one of the present sender, with its Unix time of arrival; waits 0.2 s at most."""
        try:
            if not select.select([self._socket], [], [], SLICE_S)[0]:
                return None
            data, peer, t_us = receive_stamped(self._socket)
        except OSError:
            # a refused answer or a lost interface is silence; the socket stays
            time.sleep(0.01)
            return None
        if not data or (self._only and peer[0] != self._only):
            self.senders.refused += bool(data)
            return None
        arrival_s = t_us * 1e-6
        return (data, arrival_s) if self.senders.hear(data, (peer[0], peer[1]), arrival_s) else None
