"""Events for programs of TAK (``gcs.export.cot``): to a multicast group or host by UDP, to a server by TCP or TLS."""

from __future__ import annotations

import contextlib
import socket
import ssl
from abc import abstractmethod

from gcs.export.cot import XML_DECLARATION, CotPacer, cot_boxes, cot_event, cot_uid
from gcs.live_out.sink import Sink, SinkSource
from gcs.live_out.sink_url import SinkUrl
from gcs.snapshot import Snapshot
from infra.wall_clock import now_us

TTL = 1
"""TTL of multicast datagrams: they stay on the local network."""
CONNECT_S, SEND_S = 3.0, 2.0
"""A server that takes longer is tried again."""
REPLAYED = "s-replay"
"""``opex`` of a recording: simulation, not a live operation."""


class _CotSink(Sink):
    """Base of Cursor-on-Target sinks: thins events, and dates those of a replay now, as TAK's programs show nothing
    that is stale."""

    def __init__(self, url: SinkUrl, source: SinkSource) -> None:
        self._url, self._source = url, source
        self._pacer = CotPacer()
        self._open()

    @abstractmethod
    def _open(self) -> None:
        """Open the way out; OSError: it cannot be had now."""

    @abstractmethod
    def _send(self, data: bytes) -> None:
        """Send one event; OSError: the way out is gone."""

    def write(self, snapshot: Snapshot) -> None:
        """Send what is due; names that may change when the analysis gets there are not reported."""
        if snapshot.provisional:
            return
        replayed, name = self._source.replayed, self._source.name
        t_us = now_us() if replayed else snapshot.t_us
        for box in cot_boxes(snapshot):
            if self._pacer.due(cot_uid(box, name), t_us):
                event = cot_event(snapshot, box, source=name, t_us=t_us, opex=REPLAYED if replayed else "")
                self._send(XML_DECLARATION + event + b"\n")
                self.sent += 1


class CotUdp(_CotSink):
    """Sink that sends a datagram for each event; whether anybody receives it is not known."""

    def _open(self) -> None:
        self._address = socket.getaddrinfo(self._url.host, self._url.port, socket.AF_INET, socket.SOCK_DGRAM)[0][4]
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._socket.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, TTL)
            if interface := self._url.options.get("interface"):
                self._socket.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton(interface))
        except OSError:
            self._socket.close()
            raise

    def _send(self, data: bytes) -> None:
        self._socket.sendto(data, self._address)

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()


class CotTcp(_CotSink):
    """Sink that sends a stream of events to a server; what the server sends is read and forgotten."""

    def _open(self) -> None:
        self._socket = self._connected()

    def _connected(self) -> socket.socket:
        return socket.create_connection((self._url.host, self._url.port), timeout=CONNECT_S)

    def serve(self) -> None:
        """Read what the server sends, which would hold it up.

        Raises:
            OSError: the server is gone.
        """
        self._socket.settimeout(0.0)
        # TLS says by an error of its own that nothing is there
        with contextlib.suppress(BlockingIOError, ssl.SSLWantReadError):
            while self._socket.recv(65_536):
                pass
            raise ConnectionResetError("the server ended the connection")

    def _send(self, data: bytes) -> None:
        self._socket.settimeout(SEND_S)
        self._socket.sendall(data)

    def close(self) -> None:
        """End the connection."""
        self._socket.close()


class CotTls(CotTcp):
    """Sink as ``CotTcp`` to a server whose certificate is verified, and which verifies this station's."""

    def _connected(self) -> socket.socket:
        options = self._url.options
        context = ssl.create_default_context(cafile=options.get("ca"))
        if "cert" in options:
            # a password would be asked for at the terminal
            context.load_cert_chain(options["cert"], options.get("key"), password="")
        connection = super()._connected()
        try:
            return context.wrap_socket(connection, server_hostname=options.get("name", self._url.host))
        except OSError:
            connection.close()
            raise
