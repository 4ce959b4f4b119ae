"""How long the screen keeps its operator waiting while an unknown sender floods the port.

    python -m bench.receiving.screen_flood --seconds 30

The station's app runs whole, on a screen of 160 × 45 in memory, over a live flight with a hundred vehicles; a
task in the app's own loop asks to be woken every ten milliseconds and notes how late it was: that is how long a key
pressed then would have waited. Writes ``screen_flood.md``.
"""

from __future__ import annotations

import argparse
import asyncio
import multiprocessing
import os
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from bench.ports import free_port
from bench.receiving.senders import send_fleet, send_flood
from gcs.flight.flight import Flight
from gcs.flight.plan import FlightPlan
from gcs.mission.mission import parse_mission
from gcs.tui import RollcallApp

RESULTS = Path("bench-results/screen_flood.md")
VEHICLES, RATE = 100, 2000.0
WAKE_S = 0.01
SETTLE_S = 3.0


async def waits(flight: Flight, seconds: float) -> list[float]:
    """How late each waking of the app's loop was, seconds."""
    late = []
    app = RollcallApp(flight)
    async with app.run_test(size=(160, 45)):
        await asyncio.sleep(SETTLE_S)
        stop_s = time.monotonic() + seconds
        while (now_s := time.monotonic()) < stop_s:
            await asyncio.sleep(WAKE_S)
            late.append(time.monotonic() - now_s - WAKE_S)
    return late


def run(seconds: float, flood_hz: float) -> str:
    """One case; its row of the table."""
    port = free_port()
    mission = parse_mission(
        {"uav": {"system_id": 1}, "ugv": [{"system_id": k + 1} for k in range(1, VEHICLES)]}, "bench"
    )
    with tempfile.TemporaryDirectory() as folder:
        plan = FlightPlan(mission=mission, links=(f"udpin:127.0.0.1:{port}",), video="", sessions=Path(folder))
        flight = Flight(plan)
        counts_receiver, counts_sender = multiprocessing.Pipe(duplex=False)
        whole_s = seconds + 2.0 * SETTLE_S
        context = multiprocessing.get_context("spawn")
        jobs = [context.Process(target=send_fleet, args=(port, VEHICLES, RATE, whole_s, counts_sender), daemon=True)]
        if flood_hz:
            flood_receiver, flood_sender = multiprocessing.Pipe(duplex=False)
            jobs.append(context.Process(target=send_flood, args=(port, flood_hz, whole_s, flood_sender), daemon=True))
        try:
            for job in jobs:
                job.start()
            late = np.array(asyncio.run(waits(flight, seconds)))
            sent = sum(counts_receiver.recv())
            flooded = flood_receiver.recv() if flood_hz else 0
            time.sleep(1.0)
        finally:
            for job in jobs:
                job.join(timeout=10)
            flight.stop()
        recorded = flight.packets
    low, high = np.quantile(late, (0.5, 0.99)) * 1e3
    return (
        f"| {flood_hz:,.0f} | {int(np.sum(flooded)) / whole_s:,.0f} | {sent:,} | {recorded:,} | {low:.1f} | {high:.1f} "
        f"| {late.max() * 1e3:.0f} |"
    )


def main() -> None:
    """Both cases, one after the other."""
    parser = argparse.ArgumentParser(description="The screen's frame time beside a flood.")
    parser.add_argument("--seconds", type=float, default=30.0)
    parser.add_argument("--out", type=Path, default=RESULTS)
    args = parser.parse_args()
    rows = [run(args.seconds, flood_hz) for flood_hz in (0.0, 100_000.0)]
    text = (
        "# The screen beside a flood\n\n"
        f"`python -m bench.receiving.screen_flood --seconds {args.seconds:g}`: {VEHICLES} vehicles at {RATE:,.0f} "
        "packets a second, the app\nat 160 × 45, no video; load average at the end "
        f"{os.getloadavg()[0]:.1f} on {os.cpu_count()} cores, which sender, flood and station share.\n\n"
        "| flood asked for, 1/s | flood sent, 1/s | fleet's packets sent | recorded in all | wait, median ms | p99 ms "
        "| longest ms |\n"
        "|---|---|---|---|---|---|---|\n" + "\n".join(rows) + "\n"
    )
    args.out.write_text(text)
    sys.stdout.write(text)


if __name__ == "__main__":
    main()
