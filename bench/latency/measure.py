"""Times of calls: thread CPU time, which neighbours on the machine do not change much, and wall time."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True, kw_only=True)
class MethodTiming:
    """Times of the calls of one method at one size, ms."""

    method: str
    variant: str
    vehicles: int
    tracks: int
    calls: int
    cpu_mean_ms: float
    cpu_median_ms: float
    cpu_p95_ms: float
    wall_median_ms: float
    wall_p95_ms: float

    @staticmethod
    def of(method: str, variant: str, size: tuple[int, int], cpu_s: list[float], wall_s: list[float]) -> MethodTiming:
        """Summary of single calls, in seconds."""

        def ms(values: list[float], q: float) -> float:
            return float(1e3 * np.percentile(np.array(values), q))

        return MethodTiming(
            method=method,
            variant=variant,
            vehicles=size[0],
            tracks=size[1],
            calls=len(cpu_s),
            cpu_mean_ms=float(1e3 * np.mean(cpu_s)),
            cpu_median_ms=ms(cpu_s, 50.0),
            cpu_p95_ms=ms(cpu_s, 95.0),
            wall_median_ms=ms(wall_s, 50.0),
            wall_p95_ms=ms(wall_s, 95.0),
        )


def timed(
    call: Callable[[int], NDArray[np.generic]], calls: int
) -> tuple[list[float], list[float], list[NDArray[np.generic]]]:
    """CPU seconds, wall seconds and results of ``call(0) … call(calls − 1)``; an untimed call(0) goes before."""
    cpu, wall, results = [], [], []
    if calls > 1:
        call(0)
    for k in range(calls):
        wall_s, cpu_s = time.perf_counter(), time.thread_time()
        result = call(k)
        cpu.append(time.thread_time() - cpu_s)
        wall.append(time.perf_counter() - wall_s)
        results.append(result)
    return cpu, wall, results
