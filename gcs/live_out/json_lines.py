"""Snapshots as JSON, one object a line; ``docs/live-out.md`` has the schema."""

from __future__ import annotations

import math
import socket
import time
from collections.abc import Callable
from contextlib import suppress

import msgspec

from gcs.live_out.sink import Sink, SinkSource
from gcs.live_out.sink_url import SinkUrl
from gcs.session.box_table import json_row
from gcs.snapshot import Snapshot, VehicleRow
from infra.plain_text import plain

FORMAT, VERSION = "rollcall live", 1
DATAGRAM_BYTES = 65_507
"""The largest UDP datagram over IPv4."""
MAX_CLIENTS = 16
MUTE_S = 5.0
"""A client that has taken nothing for this long is dropped: it would keep another out."""
KERNEL_BYTES = 1 << 16
BEHIND_BYTES = 1 << 20
"""A client that has not taken this much is dropped: some hundred lines of a large fleet."""


def json_line(snapshot: Snapshot, source: SinkSource) -> bytes:
    """One object and the end of its line; null is unknown, boxes are those found at this very moment."""
    boxes = [msgspec.Raw(json_row(snapshot, box).encode()) for box in snapshot.new_boxes if not box.coasting]
    line = {
        "format": FORMAT,
        "version": VERSION,
        "source": plain(source.name),
        "replayed": source.replayed,
        "time_us": snapshot.t_us,
        "frame": snapshot.frame if snapshot.frame >= 0 else None,
        "width": snapshot.width,
        "height": snapshot.height,
        "held": snapshot.held,
        "provisional": snapshot.provisional or not snapshot.analysed,
        "boxes": boxes,
        "vehicles": [_vehicle(snapshot, row) for row in snapshot.vehicles],
        "alarms": [{"level": alarm.level, "kind": alarm.kind, "text": plain(alarm.text)} for alarm in snapshot.alarms],
    }
    return msgspec.json.encode(line) + b"\n"


def _vehicle(snapshot: Snapshot, row: VehicleRow) -> dict[str, object]:
    """Reported position of a vehicle, and how it is identified."""
    lat = lon = math.nan
    if snapshot.origin is not None and all(math.isfinite(value) for value in row.p_enu):
        lat, lon = (float(value) for value in snapshot.origin.to_geodetic(row.p_enu)[:2])
    return {
        "system_id": row.system_id,
        "name": plain(row.name),
        "role": row.role,
        "standing": row.standing,
        "confidence": _rounded(row.confidence, 4),
        "track_id": row.track_id or None,
        "position_state": row.position_state,
        "position_frozen": row.frozen,
        "position_age_s": _rounded(row.position_age_s, 3),
        "lat": _rounded(lat, 7),
        "lon": _rounded(lon, 7),
        "std_m": _rounded(row.std_m, 3),
    }


def _rounded(value: float, digits: int) -> float | None:
    return round(value, digits) + 0.0 if math.isfinite(value) else None


class JsonUdp(Sink):
    """Sink that sends a datagram for each snapshot; whether anybody receives it is not known."""

    def __init__(self, url: SinkUrl, source: SinkSource) -> None:
        self._source = source
        self._address = socket.getaddrinfo(url.host, url.port, socket.AF_INET, socket.SOCK_DGRAM)[0][4]
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)

    def write(self, snapshot: Snapshot) -> None:
        """Send the snapshot; one that is larger than a datagram is dropped."""
        line = json_line(snapshot, self._source)
        if len(line) > DATAGRAM_BYTES:
            self.dropped += 1
            return
        try:
            self._socket.sendto(line, self._address)
            self.sent += 1
        except BlockingIOError:
            self.dropped += 1

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()


class JsonTcp(Sink):
    """Sink that serves lines to all who connect; one that reads too slowly, or not at all, is dropped and may come
    again.

    Args:
        url: where to listen.
        now_s: a clock that is never set.
    """

    def __init__(self, url: SinkUrl, source: SinkSource, now_s: Callable[[], float] = time.monotonic) -> None:
        self._source, self._now_s = source, now_s
        self._server = socket.create_server((url.host, url.port), backlog=MAX_CLIENTS)
        self._server.setblocking(False)
        self._waiting: dict[socket.socket, bytearray] = {}
        """Bytes that each client has not taken yet."""
        self._took_s: dict[socket.socket, float] = {}
        """Time at which each took something, or there was nothing for it to take."""

    def write(self, snapshot: Snapshot) -> None:
        """Queue the snapshot for all clients."""
        self.serve()
        if not self._waiting:
            return
        line = json_line(snapshot, self._source)
        for waiting in self._waiting.values():
            waiting += line
        self.sent += 1
        self.serve()

    def serve(self) -> None:
        """Let clients in, and send what they take."""
        while len(self._waiting) < MAX_CLIENTS:
            try:
                client, _ = self._server.accept()
            except OSError:  # nobody is there, or is there any more
                break
            client.setblocking(False)
            with suppress(OSError):  # what the kernel keeps for it is waiting too
                client.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, KERNEL_BYTES)
            self._waiting[client], self._took_s[client] = bytearray(), self._now_s()
        for client in list(self._waiting):
            self._send(client)
        self.clients = len(self._waiting)

    def close(self) -> None:
        """End all connections."""
        for client in (*self._waiting, self._server):
            client.close()

    def _send(self, client: socket.socket) -> None:
        waiting = self._waiting[client]
        try:
            # what clients say is of no interest, only that they are there
            with suppress(BlockingIOError):
                if not client.recv(1024):
                    raise ConnectionResetError
            taken = 0
            with suppress(BlockingIOError):
                taken = client.send(waiting) if waiting else 0
            del waiting[:taken]
            if taken or not waiting:
                self._took_s[client] = self._now_s()
        except OSError:
            self._drop(client)
            return
        if len(waiting) > BEHIND_BYTES or self._now_s() - self._took_s[client] > MUTE_S:
            self.dropped += 1
            self._drop(client)

    def _drop(self, client: socket.socket) -> None:
        client.close()
        del self._waiting[client], self._took_s[client]
