"""All experiments, two at a time; results as rows and tables."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

from bench.paper.experiments import Condition, Count, conditions, evaluate
from bench.paper.tables import write_tables
from bench.rows import write
from bench.workers import one_threaded


def run(out: Path, quick: bool, report: Callable[[int, int], None] = lambda done, total: None) -> str:
    """Measure everything and write rows and tables.

    Args:
        out: Folder, made if need be; files of an earlier run are replaced.
        quick: A few noise levels and one flight each, to see that it works: its figures mean little.
        report: Called with the experiments that are done so far, and all there are.

    Returns:
        One line on what was written.
    """
    out.mkdir(parents=True, exist_ok=True)
    began = time.monotonic()
    counts = _measure(conditions(quick), report)
    write(out / "results.csv", Count, counts)
    write_tables(out, counts, quick)
    return f"{out}: {len(counts)} rows in {(time.monotonic() - began) / 60.0:.1f} min"


def _measure(plan: list[Condition], report: Callable[[int, int], None]) -> list[Count]:
    """In processes of their own; the order of the results is the plan's."""
    with one_threaded() as pool:
        results = []
        for result in pool.map(evaluate, plan):
            results.append(result)
            report(len(results), len(plan))
    return [count for some in results for count in some]
