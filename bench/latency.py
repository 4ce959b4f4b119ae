"""Thread CPU time and wall time of a frame that tracking and naming take in the fold, on whole simulated flights.

``python -m bench.latency``. What the published methods take beside their literal forms was measured once:
``bench/results/latency/latency.md``.
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
from bench.command_line import parser_of, write_page, write_rows
from bench.workers import one_threaded
from gcs.playback.analysis import Analysis
from gcs.session.session import open_session
from infra.markdown import markdown_table
from sim.session import write_session
from sim.world.scenario import Gnss, Scenario, ScenarioAttitude, ScenarioCamera, ScenarioFlight, ScenarioGround
from vision.track.tracker import Tracker


@dataclass(frozen=True, slots=True, kw_only=True)
class PartTiming:
    """Times of one part of the fold over the frames of a flight, ms."""

    part: str
    vehicles: int
    frames: int
    cpu_mean_ms: float
    cpu_median_ms: float
    cpu_p95_ms: float
    wall_median_ms: float
    wall_p95_ms: float

    @staticmethod
    def of(part: str, vehicles: int, cpu_s: list[float], wall_s: list[float]) -> PartTiming:
        """Summary of the times of single frames, in seconds."""
        cpu, wall = 1e3 * np.array(cpu_s), 1e3 * np.array(wall_s)
        return PartTiming(
            part=part,
            vehicles=vehicles,
            frames=len(cpu_s),
            cpu_mean_ms=float(cpu.mean()),
            cpu_median_ms=float(np.percentile(cpu, 50)),
            cpu_p95_ms=float(np.percentile(cpu, 95)),
            wall_median_ms=float(np.percentile(wall, 50)),
            wall_p95_ms=float(np.percentile(wall, 95)),
        )


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
        """Time of a part since the last call, s: CPU and wall; it starts again from 0."""
        return self.spent.pop(part, (0.0, 0.0))


def measure_streams(quick: bool) -> list[PartTiming]:
    """Time of each part on every frame with 7, 20 and 50 vehicles, the search of the first seconds included."""
    result = []
    for n in (7,) if quick else (7, 20, 50):
        result += _flight(n, 3.0 if quick else 30.0)
    return result


def _flight(n: int, seconds: float) -> list[PartTiming]:
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
    return [PartTiming.of(part, n, cpu, wall) for part, (cpu, wall) in times.items()]


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


def crowd(n: int, seconds: float) -> Scenario:
    """n vehicles on a winding road, all in view, ten frames a second."""
    rows = n / 4.0
    return Scenario(
        name=f"crowd-{n}",
        seed=n,
        duration_s=seconds,
        ground=ScenarioGround(
            kind="curved", vehicles=n, lanes=4, spacing_m=12.0, bend_deg=20.0, lane_changes_per_min=4.0
        ),
        flight=ScenarioFlight(height_m=max(40.0, 10.0 * rows)),
        camera=ScenarioCamera(),
        gnss=Gnss(white_m=0.0, bias_m=0.0),
    )


def text_of(timings: list[PartTiming]) -> str:
    """The table in Markdown."""
    head = (
        f"# Latency\n\nMilliseconds of one thread, {platform.processor() or platform.machine()}, load "
        f"{os.getloadavg()[0]:.1f} on {os.cpu_count()} cores at the end: 30 s of a flight at ten frames a second, from "
        "the first, with ordinary errors of position and attitude and five reports a second of every vehicle.\n\n"
    )
    header = ("part", "vehicles", "frames", "CPU mean", "CPU median", "CPU p95", "wall median", "wall p95")
    rows = []
    for t in timings:
        times = (t.cpu_mean_ms, t.cpu_median_ms, t.cpu_p95_ms, t.wall_median_ms, t.wall_p95_ms)
        rows.append([t.part, str(t.vehicles), str(t.frames), *(f"{ms:.3f}" for ms in times)])
    return head + markdown_table(header, rows) + "\n"


def main() -> None:
    parser = parser_of("latency", "What tracking and naming cost a frame", "seven vehicles, three seconds")
    options = parser.parse_args()
    with one_threaded(1) as pool:
        timings = pool.submit(measure_streams, options.quick).result()
    write_rows(options.out / "latency.csv", PartTiming, timings)
    write_page(options.out / "latency.md", text_of(timings))


if __name__ == "__main__":
    main()
