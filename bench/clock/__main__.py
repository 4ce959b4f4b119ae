"""Share of fleets' clocks that are found, refused and wrong.

python -m bench.clock [--draws 50] [--first 1] [--film 60]

Of each draw the heading is known, unknown, and then the film's time is missing in the log: whatever is found then is
wrong.
"""

from __future__ import annotations

import argparse
import time
from collections import Counter

import numpy as np

from assoc.clock_search.search import ClockVerdict, find_clock
from bench.clock.draws import ClockDraw, draw
from bench.command_line import count

GOOD_S, USABLE_S = 0.2, 0.5
"""What is found so near is right, and can be used: the identifier finds the rest."""
ANY_S = (-1e6, 1e6)
FARTHEST_S = 150.0
"""So long before and after the film's beginning the log is cut."""


def judged(flight: ClockDraw, *, present: bool) -> tuple[str, float]:
    """What comes of the search, in words, and by how much it is off, NaN where nothing is found."""
    found = find_clock(flight.tracks, flight.path, flight.log, ANY_S)
    if found.verdict is not ClockVerdict.FOUND or found.best is None:
        return "refused", float("nan")
    off_s = abs(found.best.offset_s)
    if not present or off_s > USABLE_S:
        return "wrong", off_s
    return ("found" if off_s <= GOOD_S else "found within 0.5 s"), off_s


def main() -> None:
    """Measure and print a table."""
    parser = argparse.ArgumentParser(prog="python -m bench.clock", description="Clocks found in simulated films.")
    parser.add_argument("--draws", type=count, default=50)
    parser.add_argument("--first", type=count, default=1)
    parser.add_argument("--film", type=float, default=60.0, help="length of the film, s (%(default)s)")
    given = parser.parse_args()
    print("| case | found within 0.2 s | within 0.5 s | refused | wrong | median off, s | processor, s a search |")
    print("|---|---|---|---|---|---|---|")
    for case in ("heading known", "heading unknown", "the film's time is not in the log"):
        words: Counter[str] = Counter()
        off, begun, spent = [], 0.0, 0.0
        for seed in range(given.first, given.first + given.draws):
            flight = draw(seed, given.film, heading_known=case != "heading unknown")
            present = case.startswith("heading")
            flight = flight if present else flight.without(-FARTHEST_S, FARTHEST_S)
            begun = time.process_time()
            word, off_s = judged(flight, present=present)
            spent += time.process_time() - begun
            words[word] += 1
            off.append(off_s)
        found = words["found"], words["found within 0.5 s"], words["refused"], words["wrong"]
        median = f"{np.nanmedian(off):.3f}" if np.isfinite(off).any() else "–"
        print(f"| {case} | {' | '.join(map(str, found))} | {median} | {spent / given.draws:.1f} |")


if __name__ == "__main__":
    main()
