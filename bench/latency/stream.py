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

from assoc.identification.identifier import Identifier
from bench.latency.measure import MethodTiming
from bench.latency.scenes import crowd
from gcs.playback.analysis import Analysis
from gcs.session.session import open_session
from sim.session import write_session
from sim.world.scenario import Gnss, Scenario, ScenarioAttitude
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
        """What the part took since it was asked last."""
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
