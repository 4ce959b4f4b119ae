"""Every method beside its literal peer, on the same inputs, in one run."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from assoc.methods.belief import fuse, masses
from assoc.methods.topology import associate_by_topology, topology_angles, topology_cost
from bench.latency import literal
from bench.latency.measure import MethodTiming, Snap, snap, timed
from bench.paper.projection import associate_by_projection
from bench.paper.tts import associate_by_tts_once, tts_similarity

FloatArray = NDArray[np.float64]
Solve = Callable[[Snap], NDArray[np.generic]]

SCENES = 10
OURS = "ours"


@dataclass(frozen=True, slots=True, kw_only=True)
class TimedMethod:
    """One way of solving one problem."""

    method: str
    variant: str
    solve: Solve
    calls: dict[tuple[int, int], int]
    """Timed calls at each size (vehicles, tracks)."""


def entries(quick: bool) -> list[TimedMethod]:
    """All ways, literal ones first."""
    few = 1 if quick else 5
    small = {(7, 6): few} if quick else {(7, 6): few, (8, 7): 1}
    grown = {(7, 6): few} if quick else {(7, 6): 10, (8, 7): 3}
    exhaustive = {(7, 6): 20} if quick else {(7, 6): 200, (8, 7): 20, (9, 8): 5}
    sizes = ((7, 6), (20, 20)) if quick else ((7, 6), (20, 20), (50, 50))
    slow, fast = {size: 5 if quick else 20 for size in sizes}, {size: 20 if quick else 200 for size in sizes}
    return [
        TimedMethod(method="projection", variant="literal, lstsq", solve=_projection_literal, calls=small),
        TimedMethod(method="projection", variant="loop, arrays inside", solve=_projection_loop, calls=grown),
        TimedMethod(method="projection", variant=OURS, solve=_projection, calls=exhaustive),
        TimedMethod(method="topology", variant="literal", solve=_topology_literal, calls=slow),
        TimedMethod(method="topology", variant=OURS, solve=_topology, calls=fast),
        TimedMethod(method="TTS", variant="literal", solve=_tts_literal, calls=slow),
        TimedMethod(method="TTS", variant=OURS, solve=_tts, calls=fast),
        TimedMethod(method="fusion", variant="literal", solve=_fusion_literal, calls=slow),
        TimedMethod(method="fusion", variant=OURS, solve=_fusion, calls=fast),
    ]


def measure_methods(
    quick: bool, report: Callable[[int, int], None] = lambda done, total: None
) -> tuple[list[MethodTiming], list[str]]:
    """Time every method at every size.

    Returns:
        The timings, and sentences about answers that differ from the first variant's on the same input.
    """
    ways = entries(quick)
    # what comes after the methods takes about as long as one of them
    total = sum(len(entry.calls) for entry in ways) + 1
    timings, odd = [], []
    first: dict[tuple[str, tuple[int, int]], list[NDArray[np.generic]]] = {}
    for entry in ways:
        for size, calls in entry.calls.items():
            scenes = [snap(*size, seed) for seed in range(min(calls, SCENES))]
            cpu, wall, results = timed(_over(entry.solve, scenes), calls)
            timings.append(MethodTiming.of(entry.method, entry.variant, size, cpu, wall))
            report(len(timings), total)
            peer = first.setdefault((entry.method, size), results[: len(scenes)])
            if not all(_same(a, b) for a, b in zip(peer, results, strict=False)):
                odd.append(f"{entry.method}, {entry.variant}, {size[0]} × {size[1]}: not the first variant's answer")
    return timings, odd


def _over(solve: Solve, scenes: list[Snap]) -> Callable[[int], NDArray[np.generic]]:
    """Call number → answer, round the scenes."""
    return lambda k: solve(scenes[k % len(scenes)])


def _same(a: NDArray[np.generic], b: NDArray[np.generic]) -> bool:
    if np.issubdtype(a.dtype, np.integer):
        return bool(np.array_equal(a, b))
    return bool(np.allclose(a, b, atol=1e-9))


def _projection_literal(s: Snap) -> NDArray[np.generic]:
    return literal.projection(s.x, s.y)


def _projection_loop(s: Snap) -> NDArray[np.generic]:
    return literal.projection_array_loop(s.x, s.y)


def _projection(s: Snap) -> NDArray[np.generic]:
    return associate_by_projection(s.x, s.y).vehicle


def _views(s: Snap) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    return s.y[-1] * (1.0, -1.0), s.front, s.x[-1, :, :2], s.heading


def _topology_literal(s: Snap) -> NDArray[np.generic]:
    return literal.topology(*_views(s), 0.0)[1]


def _topology(s: Snap) -> NDArray[np.generic]:
    image, front, world, heading = _views(s)
    return associate_by_topology(topology_cost(topology_angles(image, front), topology_angles(world, heading)))


def _tts_literal(s: Snap) -> NDArray[np.generic]:
    image, _, world, _ = _views(s)
    return literal.tts(image, world)[1]


def _tts(s: Snap) -> NDArray[np.generic]:
    image, _, world, _ = _views(s)
    return associate_by_tts_once(tts_similarity(image, world))


def _fusion_literal(s: Snap) -> NDArray[np.generic]:
    return literal.fusion(s.errors, s.cost)


def _fusion(s: Snap) -> NDArray[np.generic]:
    return fuse(masses(s.errors), masses(s.cost))
