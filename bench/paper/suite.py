"""All experiments, two at a time; results as tables, and as figures where they can be drawn."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

from bench.paper.experiments import Condition, Count, Miss, conditions, evaluate
from bench.paper.figures import MATPLOTLIB_MISSING, draw
from bench.paper.occlusion import Kept, play
from bench.paper.tables import write_tables
from bench.rows import write
from bench.workers import one_threaded

FLIGHTS, QUICK_FLIGHTS = 20, 1


def run(out: Path, quick: bool, report: Callable[[int, int], None] = lambda done, total: None) -> str:
    """Measure everything and write tables, rows and figures.

    Args:
        out: Folder, made if need be; files of an earlier run are replaced.
        quick: A few noise levels and one flight each, to see that it works: its figures mean little.
        report: Called with the experiments that are done so far, and all there are.

    Returns:
        One line on what was written.
    """
    out.mkdir(parents=True, exist_ok=True)
    began = time.monotonic()
    counts, misses, kept = _measure(conditions(quick), range(1, 1 + (QUICK_FLIGHTS if quick else FLIGHTS)), report)
    write(out / "results.csv", Count, counts)
    write(out / "identifier_misses.csv", Miss, misses)
    write(out / "occlusion.csv", Kept, kept)
    write_tables(out, counts, kept, quick)
    drawn = draw(out)
    minutes = (time.monotonic() - began) / 60.0
    return f"{out}: {len(counts)} rows in {minutes:.1f} min" + ("" if drawn else f"; no figures: {MATPLOTLIB_MISSING}")


def _measure(
    plan: list[Condition], flights: range, report: Callable[[int, int], None]
) -> tuple[list[Count], list[Miss], list[Kept]]:
    """In processes of their own; the order of the results is the plan's."""
    with one_threaded() as pool:
        walked = pool.map(play, flights)
        results = []
        for result in pool.map(evaluate, plan):
            results.append(result)
            report(len(results), len(plan))
        kept = [one for flight in walked for one in flight]
    counts = [count for some, _ in results for count in some]
    return counts, [miss for _, some in results for miss in some], kept
