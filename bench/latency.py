"""Time that a frame takes, and that it waits for telemetry, within the fold, on whole simulated flights.

    python -m bench.latency [--quick]

The tracker and the identifier on flights with ordinary errors, frame by frame: CPU time of the thread, which neighbours
on the machine do not change much, and wall time.
"""

from __future__ import annotations

import os
import platform
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import wraps
from pathlib import Path
from typing import ParamSpec, TypeVar
from unittest.mock import patch

import numpy as np

from assoc.identification.identifier import Identifier
from bench.command_line import parser_of, print_results
from bench.rows import write
from gcs.fold.pipeline import WAIT_US, Pipeline
from gcs.playback import recorded_order
from gcs.playback.analysis import Analysis
from gcs.playback.recorded_order import PacketsInOrder
from gcs.session.session import open_session
from infra.markdown import markdown_table
from mavlink.protocol.packet import Packet
from sim.session import write_session
from sim.world.scenario import Gnss, Scenario, ScenarioAttitude, ScenarioFlight, ScenarioGround, ScenarioTiming
from vision.track.tracker import Tracker

P = ParamSpec("P")
R = TypeVar("R")
RATES_HZ = (4.0, 10.0, 20.0, 50.0)
"""Rates of the attitude, from that of a slow radio link to that of a companion computer."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PartTiming:
    """Times of one part on all frames of a flight, ms."""

    part: str
    vehicles: int
    frames: int
    cpu_mean_ms: float
    cpu_median_ms: float
    cpu_p95_ms: float
    wall_median_ms: float
    wall_p95_ms: float


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameWait:
    """Waits of the frames of one flight, ms from when a frame was taken."""

    attitude_hz: float
    frames: int
    median_ms: float
    p95_ms: float
    at_bound: float
    """Percent of the frames that waited in vain, as long as they may."""


@dataclass(slots=True)
class _PartTimes:
    """Seconds that parts took since the last frame: CPU time of the thread, and wall time."""

    spent: dict[str, tuple[float, float]] = field(default_factory=dict)

    def around(self, part: str, call: Callable[P, R]) -> Callable[P, R]:
        """The same call, its time added to that of the part."""

        @wraps(call)
        def timed(*args: P.args, **kwargs: P.kwargs) -> R:
            cpu, wall = time.thread_time(), time.perf_counter()
            result = call(*args, **kwargs)
            before = self.spent.get(part, (0.0, 0.0))
            self.spent[part] = before[0] + time.thread_time() - cpu, before[1] + time.perf_counter() - wall
            return result

        return timed

    def lap(self, part: str) -> tuple[float, float]:
        """What the part took since it was asked last."""
        return self.spent.pop(part, (0.0, 0.0))


@contextmanager
def timed_parts() -> Iterator[_PartTimes]:
    """Within it the time of every tracker and identifier is taken."""
    clock = _PartTimes()
    with (
        patch.object(Tracker, "update", clock.around("tracker", Tracker.update)),
        patch.object(Identifier, "update", clock.around("identifier", Identifier.update)),
        patch.object(Identifier, "add_reports", clock.around("identifier", Identifier.add_reports)),
    ):
        yield clock


def crowd(n: int, seconds: float) -> Scenario:
    """n vehicles on a winding road, all in view, ten frames a second."""
    return Scenario(
        name=f"crowd-{n}",
        seed=n,
        duration_s=seconds,
        ground=ScenarioGround(
            kind="curved", vehicles=n, lanes=4, spacing_m=12.0, bend_deg=20.0, lane_changes_per_min=4.0
        ),
        flight=ScenarioFlight(height_m=max(40.0, 2.5 * n)),
        gnss=Gnss(white_m=0.0, bias_m=0.0),
    )


def measure_streams(quick: bool) -> list[PartTiming]:
    """Time of each part on every frame with 7, 20 and 50 vehicles, the search of the first seconds included."""
    sizes = (7,) if quick else (7, 20, 50)
    return [timing for n in sizes for timing in _flight(n, 3.0 if quick else 30.0)]


def _flight(n: int, seconds: float) -> list[PartTiming]:
    # the errors of the field suite's nominal family: with none the search would lock at once
    attitude = ScenarioAttitude(compass_bias_deg=2.0, tilt_pitch_deg=0.4, tilt_roll_deg=-0.3)
    scenario = replace(crowd(n, seconds), gnss=Gnss(white_m=0.3, bias_m=0.5), attitude=attitude)
    with timed_parts() as clock:
        laps = [(clock.lap("tracker"), clock.lap("identifier")) for _ in _frames(scenario)]
    ms = 1e3 * np.array(laps)  # (frames, parts, CPU and wall)
    parts = {"tracker": ms[:, 0], "identifier": ms[:, 1], "both": ms.sum(axis=1)}
    return [
        PartTiming(
            part=part,
            vehicles=n,
            frames=len(ms),
            cpu_mean_ms=float(spent[:, 0].mean()),
            cpu_median_ms=float(np.median(spent[:, 0])),
            cpu_p95_ms=float(np.percentile(spent[:, 0], 95)),
            wall_median_ms=float(np.median(spent[:, 1])),
            wall_p95_ms=float(np.percentile(spent[:, 1], 95)),
        )
        for part, spent in parts.items()
    ]


def _frames(scenario: Scenario) -> Iterator[None]:
    """Fold a flight; yields after each frame."""
    with tempfile.TemporaryDirectory(prefix="latency-") as folder:
        write_session(scenario, Path(folder) / "session")
        analysis = Analysis(open_session(Path(folder) / "session"))
        for _ in analysis.snapshots(images=False):
            yield
        analysis.close()


def measure_waits(quick: bool) -> list[FrameWait]:
    """Waits on flights of two vehicles, ten frames a second, one flight for each rate of the attitude."""
    return [_waits(rate_hz, 3.0 if quick else 30.0) for rate_hz in RATES_HZ]


def _waits(attitude_hz: float, seconds: float) -> FrameWait:
    with _waits_us() as waits_us:
        for _ in _frames(replace(crowd(2, seconds), timing=ScenarioTiming(attitude_hz=attitude_hz))):
            pass
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


def streams_text(rows: list[PartTiming]) -> str:
    """The times as a page in Markdown."""
    names = ("CPU mean", "CPU median", "CPU p95", "wall median", "wall p95")
    cells = []
    for r in rows:
        times = (r.cpu_mean_ms, r.cpu_median_ms, r.cpu_p95_ms, r.wall_median_ms, r.wall_p95_ms)
        cells.append([r.part, str(r.vehicles), str(r.frames), *(f"{ms:.2f}" for ms in times)])
    machine = platform.processor() or platform.machine()
    return (
        f"# Latency\n\nMilliseconds a frame. One thread, {machine}, load {os.getloadavg()[0]:.1f} on {os.cpu_count()} "
        "cores at the end; ten frames a second, from the first, with ordinary errors of position and attitude and five "
        f"reports a second of every vehicle.\n\n{markdown_table(('part', 'vehicles', 'frames', *names), cells)}\n"
    )


def waits_text(rows: list[FrameWait]) -> str:
    """The waits as a page in Markdown."""
    heads = ("attitude, Hz", "frames", "median, ms", "95 %, ms", "at the bound, %")
    cells = [
        [f"{r.attitude_hz:g}", str(r.frames), f"{r.median_ms:.0f}", f"{r.p95_ms:.0f}", f"{r.at_bound:.1f}"]
        for r in rows
    ]
    return (
        "# What frames wait for telemetry\n\nFrom when a frame was taken until attitude and position after its time "
        f"have come, {WAIT_US // 1000} ms at most; the packets' own delay is in it. Position comes ten times a second. "
        f"A live picture that is later than that waits for nothing.\n\n{markdown_table(heads, cells)}\n"
    )


def main() -> None:
    parser = parser_of("latency", "What a frame takes, and what it waits for telemetry", "short flights, few vehicles")
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    timings, waits = measure_streams(options.quick), measure_waits(options.quick)
    texts = streams_text(timings), waits_text(waits)
    write(options.out / "latency.csv", PartTiming, timings)
    write(options.out / "waits.csv", FrameWait, waits)
    for name, text in zip(("latency.md", "waits.md"), texts, strict=True):
        (options.out / name).write_text(text, encoding="utf-8")
    print_results("\n".join(texts), options.out / "latency.csv", as_json=options.json)


if __name__ == "__main__":
    main()
