"""Processor time that each published method takes for a window (Table 1)."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from assoc.methods.belief import fuse, masses
from bench.paper.films import film, paper_road
from bench.paper.methods import METHODS, ConditionNoise
from bench.paper.windows import Window, windows


@dataclass(frozen=True, slots=True, kw_only=True)
class MethodTime:
    """Time of one method."""

    method: str
    cpu_ms: float
    """Median over the windows, of one thread."""


def times(most: int) -> list[MethodTime]:
    """Times for seven vehicles and six boxes; of fusion, that of the two costs alone.

    Args:
        most: Windows used.
    """
    noise, rng = ConditionNoise(position_m=1.0, topology=1.0), np.random.default_rng(1)
    cut = windows(film(paper_road("straight", 0.0, 1)), 12, 1, boxes=6, visible=6)[:most]
    costs = rng.random((2, 6, 7))

    def fused(window: Window, noise: ConditionNoise) -> object:
        return fuse(masses(costs[0]), masses(costs[1]))

    taken = {name: METHODS[name] for name in ("projection", "topology", "TTS")} | {"fusion": fused}
    return [MethodTime(method=name, cpu_ms=_median_ms(method, cut, noise)) for name, method in taken.items()]


def _median_ms(method: Callable[[Window, ConditionNoise], object], cut: list[Window], noise: ConditionNoise) -> float:
    spent = []
    for window in cut:
        began = time.thread_time()
        method(window, noise)
        spent.append(1e3 * (time.thread_time() - began))
    return float(np.median(spent))
