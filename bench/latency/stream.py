"""The tracker and the identifier on whole simulated flights with ordinary errors, frame by frame, within the fold."""

from __future__ import annotations

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
from bench.latency.measure import MethodTiming, crowd
from gcs.fold.pipeline import WAIT_US, Pipeline
from gcs.playback import recorded_order
from gcs.playback.analysis import Analysis
from gcs.playback.recorded_order import PacketsInOrder
from gcs.session.session import open_session
from mavlink.protocol.packet import Packet
from sim.session import write_session
from sim.world.scenario import Gnss, Scenario, ScenarioAttitude, ScenarioTiming
from vision.track.tracker import Tracker

P = ParamSpec("P")
R = TypeVar("R")


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
        """Time of a part since the last call, s: CPU and wall; it starts anew from 0."""
        return self.spent.pop(part, (0.0, 0.0))


def measure_streams(quick: bool) -> list[MethodTiming]:
    """Time of each part on every frame with 7, 20 and 50 vehicles, the search of the first seconds included."""
    result = []
    for n in (7,) if quick else (7, 20, 50):
        result += _flight(n, 3.0 if quick else 30.0)
    return result


def _flight(n: int, seconds: float) -> list[MethodTiming]:
    times: dict[str, tuple[list[float], list[float]]] = {"tracker": ([], []), "identifier": ([], []), "both": ([], [])}
    with tempfile.TemporaryDirectory(prefix="latency-") as folder, timed_parts() as clock:
        write_session(_with_errors(crowd(n, seconds)), Path(folder) / "session")
        analysis = Analysis(open_session(Path(folder) / "session"))
        for _ in analysis.snapshots(images=False):
            tracker, identifier = clock.lap("tracker"), clock.lap("identifier")
            both = tracker[0] + identifier[0], tracker[1] + identifier[1]
            for part, spent in (("tracker", tracker), ("identifier", identifier), ("both", both)):
                for kind in (0, 1):
                    times[part][kind].append(spent[kind])
        analysis.close()
    return [MethodTiming.of(part, "per frame", (n, n), cpu, wall) for part, (cpu, wall) in times.items()]


def _with_errors(scenario: Scenario) -> Scenario:
    """Errors of the suite's nominal family: with none the search would lock at once."""
    attitude = ScenarioAttitude(compass_bias_deg=2.0, tilt_pitch_deg=0.4, tilt_roll_deg=-0.3)
    return replace(scenario, gnss=Gnss(white_m=0.3, bias_m=0.5), attitude=attitude)


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
    return [_flight_of_two(rate_hz, 3.0 if quick else 30.0) for rate_hz in RATES_HZ]


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


def _flight_of_two(attitude_hz: float, seconds: float) -> FrameWait:
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
