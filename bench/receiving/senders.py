"""Processes that send telemetry to a UDP port: a fleet at a steady rate, and an unknown sender that floods."""

from __future__ import annotations

import ctypes
import multiprocessing
import random
import socket
import time
from collections.abc import Callable, Iterator, Sequence
from multiprocessing.connection import Connection
from multiprocessing.context import SpawnProcess

from mavlink.links.recvmmsg import _Header, _IoVec
from mavlink.protocol.encoder import MavlinkEncoder
from mavlink.signing.keys import Key
from mavlink.signing.signer import Signer

FLOODER = 200
"""System id that the flood's well-made frames carry."""
_STEP_S = 0.01
_BATCH = 64


def start_sender(send: Callable[..., None], *arguments: object, **options: object) -> tuple[SpawnProcess, Connection]:
    """A process of a sender, started, and what brings its counts."""
    spawn = multiprocessing.get_context("spawn")
    ours, theirs = spawn.Pipe()
    process = spawn.Process(target=send, args=(*arguments, theirs), kwargs=options)
    process.start()
    return process, ours


def fleet_frames(system_id: int) -> list[bytes]:
    """256 frames of one vehicle, by sequence number: two positions and two attitudes to a heartbeat."""
    speaker = MavlinkEncoder(system_id)
    frames = []
    for k in range(256):
        if k % 5 == 0:
            frames.append(speaker.heartbeat())
        elif k % 5 < 3:
            place = (46.5 + k * 1e-6, 8.5, 500.0, 0.0)
            frames.append(speaker.global_position_int(k * 50, *place, (1.0, 0.5, 0.0), 0.5))
        else:
            frames.append(speaker.attitude(k * 50, 0.01, 0.02, 0.5, (0.1, 0.2, 0.3)))
    return frames


def send_fleet(
    port: int,
    vehicles: int,
    rate: float,
    duration_s: float,
    counts: Connection,
    *,
    ports: Sequence[int] = (),
    keys: Sequence[bytes] = (),
) -> None:
    """Sends as this many vehicles, each from a port of its own, and reports how many frames each has sent.

    Args:
        port: of the station.
        vehicles: how many, with the system ids from 1 on.
        rate: frames a second of all.
        duration_s: for how long.
        counts: gets the list of counts.
        ports: to send from, which others may take as well; empty: any.
        keys: to sign with, one for each vehicle; empty: unsigned.
    """
    frames = [fleet_frames(k + 1) for k in range(vehicles)]
    signers = [Signer(Key(key)) for key in keys]
    sockets = [source_socket(port, own) for own in ports or [0] * vehicles]
    sent = 0
    began = time.monotonic()
    while (elapsed := time.monotonic() - began) < duration_s:
        due = int(elapsed * rate)
        for k in range(sent, due):
            vehicle = k % vehicles
            frame = frames[vehicle][k // vehicles % 256]
            sockets[vehicle].send(signers[vehicle].sign(frame, time.time_ns() // 1000) if signers else frame)
        sent = max(sent, due)
        time.sleep(_STEP_S)
    counts.send([sent // vehicles + (k < sent % vehicles) for k in range(vehicles)])
    for sock in sockets:
        sock.close()


def source_socket(port: int, own: int = 0) -> socket.socket:
    """A socket that sends to the station, from a port that several processes may take; 0: any."""
    sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    sock.bind(("127.0.0.1", own))
    sock.connect(("127.0.0.1", port))
    return sock


def send_flood(
    port: int,
    rate: float,
    duration_s: float,
    counts: Connection,
    *,
    datagrams: Sequence[bytes] = (),
    sources: int = 1,
    own: int = 0,
) -> None:
    """Sends datagrams, many to a system call, and reports how many.

    Args:
        port: of the station.
        rate: datagrams a second.
        duration_s: for how long.
        counts: gets the count.
        datagrams: sent in turn; empty: junk, poison and forged frames.
        sources: from this many ports.
        own: the port to send from, which a vehicle may have as well; 0: any.
    """
    sockets = [source_socket(port, own) for _ in range(sources)]
    call = ctypes.CDLL(None, use_errno=True).sendmmsg
    messages = list(datagrams) or list(_flood_datagrams())
    batch, _keep = _messages(messages)
    sent = turn = 0
    began = time.monotonic()
    while (elapsed := time.monotonic() - began) < duration_s:
        if sent >= elapsed * rate:
            time.sleep(0.0005)
            continue
        sent += max(call(sockets[turn % sources].fileno(), batch, len(messages), 0), 0)
        turn += 1
    counts.send(sent)
    for sock in sockets:
        sock.close()


def _flood_datagrams() -> Iterator[bytes]:
    rng = random.Random(1)
    forged = bytearray(MavlinkEncoder(FLOODER).heartbeat())
    for k in range(_BATCH):
        if k % 4 == 0:
            yield (b"\xfd\xff\x00", b"\xfd\xff\x01")[k // 4 % 2]
        elif k % 4 == 1:
            yield rng.randbytes(rng.randrange(1, 200))
        elif k % 4 == 2:
            yield bytes(forged)
        else:
            forged[-1] ^= 1  # a wrong checksum
            yield bytes(forged)
            forged[-1] ^= 1


def _messages(datagrams: list[bytes]) -> tuple[ctypes.Array[_Header], list[object]]:
    headers = (_Header * len(datagrams))()
    keep: list[object] = []
    for k, data in enumerate(datagrams):
        memory = ctypes.create_string_buffer(data, len(data))
        vector = _IoVec(ctypes.addressof(memory), len(data))
        headers[k] = _Header(vectors=ctypes.addressof(vector), vector_count=1)
        keep += [memory, vector]
    return headers, keep
