"""Times of calls: thread CPU time, which neighbours on the machine do not change much, and wall time."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from assoc.methods.topology import topology_angles, topology_cost
from bench.paper.projection import reprojection_errors
from sim.world.scenario import Gnss, Scenario, ScenarioCamera, ScenarioFlight, ScenarioGround


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


FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

FRAMES, HEIGHT_M, FOCAL_PX = 12, 40.0, 1200.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Snap:
    """Input of the single-frame and the window methods."""

    x: FloatArray
    """(T, n, 3) vehicles minus UAV, metres."""
    y: FloatArray
    """(T, m, 2) pixels from the image centre, v downwards."""
    heading: FloatArray
    """(n,) reported."""
    front: FloatArray
    """(m,) clockwise from image up."""
    errors: FloatArray
    """(m, n) E of the last frame, pixels."""
    cost: FloatArray
    """(m, n) C of the last frame."""
    vehicle: IntArray
    """(m,) the truth."""


def snap(n: int, m: int, seed: int) -> Snap:
    """Vehicles that turn on their way, seen from straight above with 1 px and 0.5 m noise."""
    rng = np.random.default_rng([seed, n, m])
    side = 9.0 * np.sqrt(n)
    t = 0.1 * np.arange(FRAMES)[:, None]
    course = rng.uniform(-np.pi, np.pi, n) + rng.uniform(-0.4, 0.4, n) * t
    speed = rng.uniform(2.0, 6.0, n)
    step = 0.1 * speed[:, None] * np.stack([np.sin(course), np.cos(course)], axis=-1)
    xy = rng.uniform(-0.5 * side, 0.5 * side, (n, 2)) + np.cumsum(step, axis=0)
    vehicle = rng.permutation(n)[:m]
    y = FOCAL_PX / HEIGHT_M * xy[:, vehicle] * (1.0, -1.0) + rng.normal(0.0, 1.0, (FRAMES, m, 2))
    x = np.concatenate([xy, np.full((FRAMES, n, 1), -HEIGHT_M)], axis=2) + rng.normal(0.0, 0.5, (FRAMES, n, 3))
    noise = np.radians(3.0)
    heading, front = course[-1] + rng.normal(0.0, noise, n), course[-1, vehicle] + rng.normal(0.0, noise, m)
    theta = FOCAL_PX / HEIGHT_M * np.array([[1.0, 0.0], [0.0, -1.0], [0.0, 0.0]])
    world = topology_angles(x[-1, :, :2], heading)
    return Snap(
        x=x,
        y=y,
        heading=heading,
        front=front,
        errors=reprojection_errors(x[-1], y[-1], theta),
        cost=topology_cost(topology_angles(y[-1] * (1.0, -1.0), front), world),
        vehicle=vehicle,
    )


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
