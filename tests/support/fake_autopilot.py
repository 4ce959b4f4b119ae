"""Vehicles on 127.0.0.1 that answer commands, and a station's socket beside them. All end by themselves."""

from __future__ import annotations

import socket
import threading
import time
from collections.abc import Callable
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as dialect

from mavlink.protocol.encoder import COPTER, ROVER
from mavlink.protocol.packet import Packet
from tests.support.message_encoder import MessageEncoder

MOST_S = 60.0


class FakeVehicle:
    """Beats, reports its position and answers commands; everything it hears is kept."""

    def __init__(self, station: tuple[str, int], system_id: int, *, kind: int = COPTER, mode: int = 4) -> None:
        self.system_id, self.kind, self.mode = system_id, kind, mode
        self.results: dict[int, int] = {}
        """MAV_CMD → MAV_RESULT, accepted for those that are not in it; None: no answer."""
        self.rule: Callable[[Any], int] | None = None
        """In place of the table: result by the command message."""
        self.texts: dict[int, str] = {}
        """MAV_CMD → STATUSTEXT said before the answer."""
        self.progress: dict[int, int] = {}
        """MAV_CMD → percent told in an answer "in progress" before the last."""
        self.place = (47.3977, 8.5456, 520.0, 40.0)
        self.heard: list[Any] = []
        self.bytes_heard = 0
        self._speaker = MessageEncoder(system_id)
        self._parser = dialect.MAVLink(None)
        self._parser.robust_parsing = True
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.settimeout(0.02)
        self._station = station
        self._start_s = time.monotonic()
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def commands(self, number: int | None = None) -> list[Any]:
        """Commands heard, all or those of one number."""
        heard = [said for said in list(self.heard) if said.get_type() in ("COMMAND_LONG", "COMMAND_INT")]
        return [said for said in heard if number is None or said.command == number]

    def say(self, message: Any) -> None:
        """Any message of the dialect, as from this vehicle."""
        self._send(MessageEncoder(self.system_id).pack(message))

    def close(self) -> None:
        self._stop.set()
        self._thread.join(2.0)
        self._socket.close()

    def _send(self, raw: bytes) -> None:
        self._socket.sendto(raw, self._station)

    def _run(self) -> None:
        due_s = 0.0
        while not self._stop.is_set() and time.monotonic() - self._start_s < MOST_S:
            if time.monotonic() >= due_s:
                due_s = time.monotonic() + 0.1
                self._report()
            try:
                data = self._socket.recv(4096)
            except TimeoutError:
                continue
            self.bytes_heard += len(data)
            for said in self._parser.parse_buffer(data) or []:
                self.heard.append(said)
                if said.get_type() in ("COMMAND_LONG", "COMMAND_INT") and said.target_system == self.system_id:
                    self._answer(said)

    def _report(self) -> None:
        boot_ms = round((time.monotonic() - self._start_s) * 1e3)
        self._send(self._speaker.heartbeat(self.kind, custom_mode=self.mode))
        lat, lon, alt, relative = self.place
        self._send(self._speaker.global_position_int(boot_ms, lat, lon, alt, relative))

    def _answer(self, said: Any) -> None:
        number = said.command
        if number in self.texts:
            self._send(self._speaker.statustext(self.texts[number]))
        if number in self.progress:
            self._ack(said, 5, self.progress[number])
        result = self.rule(said) if self.rule is not None else self.results.get(number, 0)
        if result is not None:
            self._ack(said, result, 0)
            self._obey(said, result)

    def _obey(self, said: Any, result: int) -> None:
        if result == 0 and said.command == 176:
            self.mode = int(said.param2)
        if result == 0 and said.command == 192 and int(said.param2) & 1:
            self.mode = 4

    def _ack(self, said: Any, result: int, progress: int) -> None:
        who = (said.get_srcSystem(), said.get_srcComponent())
        self._send(self._speaker.pack(dialect.MAVLink_command_ack_message(said.command, result, progress, 0, *who)))


class Socket:
    """A station's side: one UDP port for everybody, peers numbered as they come; poll it to make time pass."""

    def __init__(self) -> None:
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.socket.setblocking(False)
        self.address: tuple[str, int] = self.socket.getsockname()
        self._peers: dict[tuple[str, int], int] = {}
        self.sent: list[bytes] = []

    def send(self, link: int, peer: int, raw: bytes) -> None:
        address = next(address for address, number in self._peers.items() if number == peer)
        self.sent.append(raw)
        self.socket.sendto(raw, address)

    def packets(self) -> list[Packet]:
        got = []
        while True:
            try:
                raw, sender = self.socket.recvfrom(4096)
            except BlockingIOError:
                return got
            peer = self._peers.setdefault(sender, len(self._peers) + 1)
            got.append(Packet(time.time_ns() // 1000, raw, 0, peer))

    def close(self) -> None:
        self.socket.close()


def rover(station: tuple[str, int], system_id: int) -> FakeVehicle:
    """A ground vehicle."""
    return FakeVehicle(station, system_id, kind=ROVER)
