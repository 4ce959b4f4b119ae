"""How long frames wait for the telemetry of their own time, by how often the UAV reports its attitude."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from unittest.mock import patch

import numpy as np

from bench.latency.scenes import crowd
from gcs.fold.pipeline import WAIT_US, Pipeline
from gcs.playback import recorded_order
from gcs.playback.analysis import Analysis
from gcs.playback.recorded_order import PacketsInOrder
from gcs.session.session import open_session
from mavlink.protocol.packet import Packet
from sim.session import write_session
from sim.world.scenario import ScenarioTiming

RATES_HZ = (4.0, 10.0, 20.0, 50.0)
"""Rates of the attitude, from that of a slow radio link to that of a companion computer."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameWait:
    """Waits of the frames of one flight, ms from when a frame was taken."""

    attitude_hz: float
    frames: int
    median_ms: float
    p95_ms: float
    at_bound: float
    """Percent of the frames that waited in vain, as long as they may."""


def measure_waits(quick: bool) -> list[FrameWait]:
    """Waits on flights of two vehicles, ten frames a second, one flight for each rate of the attitude."""
    return [_flight(rate_hz, 3.0 if quick else 30.0) for rate_hz in RATES_HZ]


def text_of(rows: list[FrameWait]) -> str:
    """The table in Markdown."""
    head = (
        "# What frames wait for telemetry\n\nFrom when a frame was taken until attitude and position after its time "
        f"have come, {WAIT_US // 1000} ms at most; the packets' own delay is in it. Position comes ten times a second. "
        "A live picture that is later than that waits for nothing.\n\n"
        "| attitude, Hz | frames | median, ms | 95 %, ms | at the bound, % |\n|---|---|---|---|---|\n"
    )
    lines = [
        f"| {r.attitude_hz:g} | {r.frames} | {r.median_ms:.0f} | {r.p95_ms:.0f} | {r.at_bound:.1f} |" for r in rows
    ]
    return head + "\n".join(lines) + "\n"


def _flight(attitude_hz: float, seconds: float) -> FrameWait:
    scenario = replace(crowd(2, seconds), timing=ScenarioTiming(attitude_hz=attitude_hz))
    with tempfile.TemporaryDirectory(prefix="waits-") as folder, _waits_us() as waits_us:
        write_session(scenario, Path(folder) / "session")
        analysis = Analysis(open_session(Path(folder) / "session"))
        for _ in analysis.snapshots(images=False):
            pass
        analysis.close()
    waits = np.array(waits_us, dtype=np.float64)
    return FrameWait(
        attitude_hz=attitude_hz,
        frames=len(waits),
        median_ms=1e-3 * float(np.median(waits)),
        p95_ms=1e-3 * float(np.percentile(waits, 95)),
        at_bound=100.0 * float((waits >= WAIT_US).mean()),
    )


@contextmanager
def _waits_us() -> Iterator[list[int]]:
    """Within it the waits of all frames are collected, µs."""
    waits: list[int] = []
    awaited = PacketsInOrder.awaited

    def timed(self: PacketsInOrder, pipeline: Pipeline, t_us: int) -> Iterator[Packet]:
        taken_us = last_us = max(t_us, pipeline.telemetry_time(t_us))
        for packet in awaited(self, pipeline, t_us):
            last_us = max(last_us, packet.t_us)
            yield packet
        # it still waits for what never came in time
        waits.append(pipeline.wait_us if pipeline.awaits_telemetry(t_us, last_us) else last_us - taken_us)

    # a recording has more patience than a flight
    with patch.object(PacketsInOrder, "awaited", timed), patch.object(recorded_order, "PATIENCE_US", WAIT_US):
        yield waits
