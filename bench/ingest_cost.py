"""What one packet costs the ingest process, from its socket to the shared ring, and what decoding one costs.

    python -m bench.ingest_cost

CPU time of the process (user and system, as the kernel accounts it) over the packets it has recorded, at steady rates
and for a full socket buffer. Nothing else should run meanwhile.
"""

from __future__ import annotations

import multiprocessing
import socket
import tempfile
import time
import timeit
from collections.abc import Callable
from pathlib import Path

from bench.flood import free_port
from bench.senders import fleet_frames, send_fleet
from mavlink.decode import decode
from mavlink.ingest.ingest import Ingest
from mavlink.link import Link, open_link
from mavlink.packet import Packet

RATES = (2000.0, 5000.0, 20_000.0)
_SECONDS = 5.0
_BURST = 8000
_BURSTS = 10


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


def burst() -> float:
    """CPU µs for each packet of a full socket buffer, socket to frames; no record, no ring."""
    frames = fleet_frames(1)
    port = free_port()
    link: Link = open_link(f"udpin:127.0.0.1:{port}")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.connect(("127.0.0.1", port))
        spent = 0.0
        for _ in range(_BURSTS):
            for k in range(_BURST):
                sock.send(frames[k % 256])
            began = time.process_time()
            while link.take().frames:
                continue
            spent += time.process_time() - began
    link.close()
    return spent * 1e6 / _BURST / _BURSTS


def each(act: Callable[[], object], count: int = 100_000) -> float:
    """µs of one call, the least of five runs."""
    return min(timeit.repeat(act, number=count, repeat=5)) * 1e6 / count


def main() -> None:
    position = Packet(0, fleet_frames(1)[1])
    print("| what | µs |\n|---|---|")
    print(f"| decode a GLOBAL_POSITION_INT | {each(lambda: decode(position)):.2f} |")
    print(f"| socket to frames, full buffer | {burst():.2f} |")
    for rate in RATES:
        ingest_us, station_us = steady(rate)
        print(f"| socket to record and ring at {rate:,.0f}/s | {ingest_us:.2f} |")
        print(f"| ring to packets in the station at {rate:,.0f}/s | {station_us:.2f} |", flush=True)


if __name__ == "__main__":
    main()
