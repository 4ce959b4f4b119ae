"""Three bytes that look like the beginning of a long frame, in front of good ones on TCP and on a serial port."""

from __future__ import annotations

import os
import pty
import socket
import time
import tty
from collections import Counter
from collections.abc import Callable
from pathlib import Path

from bench.attacks.records import frames
from bench.attacks.report import AttackRow
from bench.attacks.run import Options
from bench.attacks.wire import ComponentEncoder
from bench.ports import free_port
from bench.station import FlyingStation, mission_text

POISON = b"\xfd\xff\x00"
GOOD = 3
WAIT_S = 2.0
SERIAL_FRAMES, SERIAL_HZ = 1_487, 200.0
EVERY = 97
"""Frames between two of poison on the serial port."""


def swallowed_frames(options: Options) -> list[AttackRow]:
    """FD FF 00 in front of good frames on TCP and on a serial port: how many are recorded, and how soon."""
    return [*over_tcp(options), over_serial(options)]


def _open_tcp(port: int) -> socket.socket:
    return socket.create_connection(("127.0.0.1", port), timeout=5.0)


def over_tcp(options: Options) -> list[AttackRow]:
    """Over a connection that stays and one that is closed at once."""
    port = free_port(socket.SOCK_STREAM)
    station = FlyingStation(options.gcs, options.folder / "tcp", mission_text([11, 12]), [f"tcpin:127.0.0.1:{port}"])
    try:
        return poison(port, station.session)
    finally:
        station.end()


def poison(port: int, session: Path) -> list[AttackRow]:
    """Three bytes and good frames over two connections to a flight, and what of them is in its log in a moment."""
    waits, closes = ComponentEncoder(11), ComponentEncoder(12)
    sent = {
        encoder: [encoder.parameter(1000.0 * encoder.system_id + k) for k in range(GOOD)] for encoder in (waits, closes)
    }
    with _open_tcp(port) as kept, _open_tcp(port) as closed:
        kept.sendall(POISON + b"".join(sent[waits]))
        closed.sendall(POISON + b"".join(sent[closes]))
        closed.shutdown(socket.SHUT_RDWR)
        time.sleep(WAIT_S)
        after = Counter(raw for _, raw in frames(session))
    return [
        _row("TCP, the connection stays", sent[waits], after, f"within {WAIT_S:.0f} s"),
        _row("TCP, the connection is closed", sent[closes], after, "at the close"),
    ]


def over_serial(options: Options) -> AttackRow:
    """Over a pseudo terminal, which a program opens as it does a serial port."""
    ours, theirs = pty.openpty()
    tty.setraw(theirs)
    station = FlyingStation(
        options.gcs, options.folder / "serial", mission_text([11]), [f"{os.ttyname(theirs)},115200"]
    )
    try:
        encoder = ComponentEncoder(11)
        sent = [encoder.parameter(float(k)) for k in range(SERIAL_FRAMES)]
        _write(sent, lambda data: _all(ours, data))
        time.sleep(WAIT_S)
    finally:
        station.end()
        os.close(ours)
        os.close(theirs)
    after = Counter(raw for _, raw in frames(Path(station.session)))
    return _row("serial port, three bytes before every 97th frame", sent, after, "at the end")


def _write(sent: list[bytes], write: Callable[[bytes], None]) -> None:
    start_s = time.monotonic()
    for k, raw in enumerate(sent):
        time.sleep(max(start_s + k / SERIAL_HZ - time.monotonic(), 0.0))
        # the last ones too: what is behind them must not be needed to find them
        poisoned = k % EVERY == 0 or k == len(sent) - 2
        write(POISON + raw if poisoned else raw)


def _all(fd: int, data: bytes) -> None:
    while data:
        data = data[os.write(fd, data) :]


def _row(case: str, sent: list[bytes], found: Counter[bytes], when: str) -> AttackRow:
    lost = sum(not found[raw] for raw in sent)
    return AttackRow(
        attack="three bytes",
        case=case,
        sent=len(sent),
        lost=lost,
        held=not lost,
        note=f"{len(sent) - lost} of {len(sent)} {when}",
    )
