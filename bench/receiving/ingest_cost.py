"""What one packet costs the ingest process, from its socket to the shared ring, and what decoding one costs.

    python -m bench.receiving.ingest_cost

First the quickest of many batches in this process, then, at steady rates, the CPU time (user and system, as the kernel
accounts it) of the ingest process over the packets it has recorded. Nothing else should run meanwhile.
"""

from __future__ import annotations

import math
import multiprocessing
import os
import socket
import tempfile
import time
import timeit
from collections.abc import Callable
from pathlib import Path

from bench.ports import free_port
from bench.receiving.senders import fleet_frames, send_fleet
from infra.files.journal import Journal, make_journal
from mavlink.ingest.ingest import Ingest
from mavlink.ingest.ingest_memory import IngestMemory, make_ingest_memory
from mavlink.ingest.plan import Signing
from mavlink.ingest.receiver import Receiver, Signatures
from mavlink.links.kinds import parse_url
from mavlink.links.udp import UdpIn
from mavlink.protocol.decode import decode
from mavlink.protocol.packet import Packet
from mavlink.tlog.writer import TlogWriter

RATES = (2000.0, 5000.0, 20_000.0)
_SECONDS = 5.0
_BATCH = 64
_BATCHES = 500


def steady(rate: float, vehicles: int = 100) -> tuple[float, float]:
    """CPU µs of the ingest process and of the reading station for each packet."""
    port = free_port()
    spawn = multiprocessing.get_context("spawn")
    ours, theirs = spawn.Pipe()
    with tempfile.TemporaryDirectory() as folder:
        ingest = Ingest([f"udpin:127.0.0.1:{port}"], Path(folder) / "telemetry.tlog")
        time.sleep(1.5)  # the spare process has started
        idle, idle_s = ingest.health().cpu_s, time.monotonic()
        time.sleep(1.0)
        rest = (ingest.health().cpu_s - idle) / (time.monotonic() - idle_s)
        fleet = spawn.Process(target=send_fleet, args=(port, vehicles, rate, _SECONDS, theirs))
        before, before_s = ingest.health().cpu_s, time.monotonic()
        fleet.start()
        ours_s, taken = 0.0, 0
        while fleet.is_alive():
            began_s = time.thread_time()
            taken += len(ingest.read(0.2))
            ours_s += time.thread_time() - began_s
        sent = sum(ours.recv())
        time.sleep(0.5)
        taken += len(ingest.read(0.0))
        spent = ingest.health().cpu_s - before - rest * (time.monotonic() - before_s)
        ingest.stop()
    assert taken == sent, f"{sent - taken} of {sent} lost"
    return spent * 1e6 / sent, ours_s * 1e6 / sent


def quiet_moment() -> tuple[float, float]:
    """µs a packet of the quickest of many batches: socket to record and ring, and ring to packets.

    The least, because on a shared machine most batches wait for other processes.
    """
    frames = fleet_frames(1)[:_BATCH]
    link = UdpIn(parse_url(f"udpin:127.0.0.1:{free_port()}"))
    memory_fd = make_ingest_memory()
    memory = IngestMemory(memory_fd)
    journal_fd = make_journal()
    receive_s = read_s = math.inf
    with (
        tempfile.TemporaryDirectory() as folder,
        TlogWriter(Path(folder) / "telemetry.tlog", journal=Journal(journal_fd)) as log,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock,
    ):
        receiver = Receiver([link], log, memory, Signatures(Signing()), None)
        sock.connect(("127.0.0.1", link.port))
        for _ in range(_BATCHES):
            for frame in frames:
                sock.send(frame)
            began = time.perf_counter()
            batch = link.read_batch()
            receiver.receive_batch(0, batch)
            put = time.perf_counter()
            packets = memory.take_packets()
            read_s = min(read_s, time.perf_counter() - put)
            receive_s = min(receive_s, put - began)
            assert len(packets) == _BATCH
    link.close()
    os.close(memory_fd)
    os.close(journal_fd)
    return receive_s * 1e6 / _BATCH, read_s * 1e6 / _BATCH


def each(act: Callable[[], object], count: int = 100_000) -> float:
    """µs of one call, the least of five runs."""
    return min(timeit.repeat(act, number=count, repeat=5)) * 1e6 / count


def main() -> None:
    position = Packet(0, fleet_frames(1)[1])
    print("| what | µs |\n|---|---|")
    print(f"| decode a GLOBAL_POSITION_INT | {each(lambda: decode(position)):.2f} |")
    receive_us, read_us = quiet_moment()
    print(f"| socket to record and ring, {_BATCH} at a time, quickest | {receive_us:.2f} |")
    print(f"| ring to packets in the station, quickest | {read_us:.2f} |")
    for rate in RATES:
        ingest_us, station_us = steady(rate)
        print(f"| socket to record and ring at {rate:,.0f}/s | {ingest_us:.2f} |")
        print(f"| ring to packets in the station at {rate:,.0f}/s | {station_us:.2f} |", flush=True)


if __name__ == "__main__":
    main()
