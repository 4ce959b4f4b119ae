"""Right, wrong and missing names of flights as recorded, and as imported from a drone's subtitles.

python -m bench.importing [--flights 4] [--first 1] [--length 40] [--kinds hover,straight] [--ahead 30] [--above 47]

Heading, attitude and velocity are in the recording, and in none of the subtitles. With ``--ahead`` the fleet's clock is
so many seconds ahead of the film's and searched; a refusal names nobody. With ``--above`` only altitudes are known, and
so much too high, as those above an ellipsoid are.
"""

from __future__ import annotations

import argparse
import tempfile
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np

from bench.command_line import count
from bench.field.product import identify
from bench.importing.flights import FLIGHTS, LAYOUTS, recorded
from gcs.errors import ImportFileError
from gcs.report.score import score

OWN_CLOCKS = "own clocks"
CASES = ("as recorded", OWN_CLOCKS, *LAYOUTS)
Row = tuple[str, str, int, float, float, float, float]
"""Kind of flight, case, seed; shares of the boxes right and wrong, seconds wrong and sure, 1 if refused."""


def rows_of(
    kind: str,
    seed: int,
    length_s: float,
    cases: tuple[str, ...],
    *,
    ahead_s: float | None = None,
    above_m: float | None = None,
    others: bool = False,
) -> list[Row]:
    """One flight in some cases."""
    rows: list[Row] = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        flight = recorded(next(each for each in FLIGHTS if each == kind), seed, length_s, folder, others=others)
        for case in cases:
            out = folder / case.replace(" ", "_")
            try:
                if case == OWN_CLOCKS:
                    session = flight.with_own_clocks(out)
                else:
                    session = flight.session if case not in LAYOUTS else flight.imported(case, out, ahead_s, above_m)
            except ImportFileError:
                rows.append((kind, case, seed, 0.0, 0.0, 0.0, 1.0))
                continue
            found = score(identify(session, folder / f"{out.name}_names").matched)
            boxes = max(found.ours, found.false_targets if others else 1)
            wrong = found.named * (1.0 - found.precision) / boxes if found.named else 0.0
            rows.append((kind, case, seed, 0.0 if others else found.right, wrong, found.wrong_sure_s, 0.0))
    return rows


def main() -> None:
    """Measure and print a table."""
    parser = argparse.ArgumentParser(prog="python -m bench.importing", description="Names after an import.")
    parser.add_argument("--flights", type=count, default=4, help="of each kind (%(default)s)")
    parser.add_argument("--first", type=count, default=1, help="first seed (%(default)s)")
    parser.add_argument("--length", type=float, default=40.0, help="of a flight, s (%(default)s)")
    parser.add_argument("--kinds", default=",".join(FLIGHTS), help="of flights (%(default)s)")
    parser.add_argument("--cases", default=",".join(CASES), help="how a flight is read (%(default)s)")
    parser.add_argument("--others", action="store_true", help="film another flight: nobody is ours")
    parser.add_argument("--ahead", type=float, help="the fleet's clock is so far ahead, s, and searched")
    parser.add_argument("--above", type=float, help="altitudes, and no heights, that are so much too high, m")
    parser.add_argument("--jobs", type=count, default=1, help="processes (%(default)s)")
    parser.add_argument("--each", action="store_true", help="print every flight too")
    given = parser.parse_args()
    cases = tuple(given.cases.split(","))
    with ProcessPoolExecutor(given.jobs) as pool:
        tasks = [
            pool.submit(
                rows_of, kind, seed, given.length, cases, ahead_s=given.ahead, above_m=given.above, others=given.others
            )
            for kind in given.kinds.split(",")
            for seed in range(given.first, given.first + given.flights)
        ]
        rows = []
        for task in tasks:
            rows += task.result()
            if given.each:
                for row in rows[-len(cases) :]:
                    print(*row[:3], *(f"{value:.3f}" for value in row[3:]), sep="  ", flush=True)
    print("| flight | case | right, mean | least | wrong, mean | most | wrong and sure, s | refused |")
    print("|---|---|---|---|---|---|---|---|")
    for kind in given.kinds.split(","):
        for case in cases:
            values = np.array([row[3:] for row in rows if row[:2] == (kind, case)])
            right, wrong, sure, refused = values.T
            named = refused == 0.0
            least, most = (right[named].min(), wrong.max()) if named.any() else (np.nan, np.nan)
            mean = right[named].mean() if named.any() else np.nan
            print(
                f"| {kind} | {case} | {mean:.3f} | {least:.3f} | {wrong.mean():.3f} | {most:.3f} | "
                f"{sure.sum():.1f} | {int(refused.sum())} |"
            )


if __name__ == "__main__":
    main()
