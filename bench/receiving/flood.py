"""Telemetry of a hundred vehicles while the machine is busy and the port is flooded: what arrives, at both ends.

    python -m bench.receiving.flood --seconds 60 --out bench/results/flood.md

Sender, flood and station are processes of one machine and share its cores. In the station two threads can be kept busy
in Python, as detection and screens would keep it.
"""

from __future__ import annotations

import argparse
import math
import os
import tempfile
import threading
import time
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

from bench.command_line import RESULTS, write_page
from bench.receiving.senders import FLOODER, send_fleet, send_flood, start_sender
from infra.markdown import markdown_table
from mavlink.ingest.health import IngestHealth
from mavlink.ingest.ingest import Ingest
from mavlink.tlog.log import Tlog
from tests.support.ports import free_port

VEHICLES, RATE = 100, 5000.0
"""Vehicles, and packets a second of all of them."""
FLOOD_AFTER_S = 2.0
"""The vehicles are known by then."""
_SETTLE_S = 1.5


@dataclass(frozen=True, slots=True, kw_only=True)
class FloodCase:
    """One run."""

    name: str
    busy: int = 0
    """Busy threads in the station."""
    flood: float = 0.0
    """Datagrams a second of an unknown sender."""


CASES = (
    FloodCase(name="quiet"),
    FloodCase(name="busy station", busy=2),
    FloodCase(name="flood", flood=100_000.0),
    FloodCase(name="busy station and flood", busy=2, flood=100_000.0),
)


@dataclass(frozen=True, slots=True, kw_only=True)
class FloodResult:
    """Outcome of a flood."""

    sent: int
    logged: int
    taken: int
    flooded: int
    let_in: int
    health: IngestHealth
    cpu_us: float
    """Processor time of the ingest process for each record, without its start."""
    latency_ms: float
    """99th percentile, from the kernel's stamp to the station."""


def run(case: FloodCase, seconds: float, folder: Path) -> FloodResult:
    """One case."""
    port, log = free_port(), folder / f"{case.name.replace(' ', '_')}.tlog"
    ingest = Ingest([f"udpin:127.0.0.1:{port}"], log, system_ids=range(1, VEHICLES + 1))
    time.sleep(0.5)
    before = ingest.health()
    stop = threading.Event()
    busy = [threading.Thread(target=_spin, args=(stop,), daemon=True) for _ in range(case.busy)]
    for thread in busy:
        thread.start()
    senders = [start_sender(send_fleet, port, VEHICLES, RATE, seconds)]
    fleet, _ = senders[0]
    flood_at = time.monotonic() + FLOOD_AFTER_S if case.flood else math.inf
    taken: Counter[int] = Counter()
    delays: list[int] = []
    ends = time.monotonic() + seconds + 30.0
    quiet_s = time.monotonic()
    while time.monotonic() < ends and (fleet.is_alive() or time.monotonic() - quiet_s < _SETTLE_S):
        packets = ingest.read(0.2)
        if time.monotonic() > flood_at and taken:
            senders.append(start_sender(send_flood, port, case.flood, seconds - FLOOD_AFTER_S))
            flood_at = math.inf
        now_us = time.time_ns() // 1000
        taken.update(packet.system_id for packet in packets)
        if packets:
            delays += [now_us - packet.t_us for packet in packets[:1]]
            quiet_s = time.monotonic() if any(p.system_id <= VEHICLES for p in packets) else quiet_s
    stop.set()
    sent, *flooded = (counts.recv() for _, counts in senders)
    for process, _ in senders:
        process.join()
    ingest.stop()
    logged = Counter(Tlog.open(log).index.system_id.tolist())
    delays.sort()
    return FloodResult(
        sent=sum(sent),
        logged=sum(count for system_id, count in logged.items() if system_id <= VEHICLES),
        taken=sum(count for system_id, count in taken.items() if system_id <= VEHICLES),
        flooded=sum(flooded),
        let_in=logged[FLOODER],
        health=(health := ingest.health()),
        cpu_us=(health.cpu_s - before.cpu_s) * 1e6 / max(health.packets, 1),
        latency_ms=delays[int(len(delays) * 0.99)] / 1000.0 if delays else 0.0,
    )


def _spin(stop: threading.Event) -> None:
    k = 0
    while not stop.is_set():
        k = (k * 31 + 7) % 1_000_003


def table(rows: list[tuple[FloodCase, FloodResult]], seconds: float) -> str:
    """The results as Markdown."""
    names = ["case", "sent", "recorded", "lost", "handed over", "flood sent", "of it recorded", "turned away"]
    names += ["dropped by the system", "restarts", "p99 to the station", "CPU a record"]
    about = f"{VEHICLES} vehicles, {seconds:.0f} s a case, {os.cpu_count()} cores shared by sender, flood and station."
    lines = []
    for case, r in rows:
        link = r.health.links[0].counts
        counts = [r.sent, r.logged, r.sent - r.logged, r.taken, r.flooded, r.let_in]
        counts += [link.turned_away, link.dropped, r.health.restarts]
        lines.append([case.name, *(f"{count:,}" for count in counts), f"{r.latency_ms:.1f} ms", f"{r.cpu_us:.1f} µs"])
    return f"{about}\n\n{markdown_table(names, lines)}\n"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--out", type=Path, default=RESULTS / "flood.md", help="the table (%(default)s)")
    options = parser.parse_args()
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for case in CASES:
            rows.append((case, run(case, options.seconds, Path(folder))))
            print(table(rows[-1:], options.seconds), flush=True)
    write_page(options.out, table(rows, options.seconds))


if __name__ == "__main__":
    main()
