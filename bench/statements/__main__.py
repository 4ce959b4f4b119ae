"""What is said of a flight, in every place where it is said, held against what is so.

    python -m bench.statements
    python -m bench.statements --flights "lying by 30 m" --places events screens
    python -m bench.statements --draws 1 20 --places events turns identity
    python -m bench.statements --out bench/results/statements.md

Scripted flights whose truth is known: members that are silent, late, stand still, lie, are refused or never heard and
that come back, a video that stops and one that comes and goes, an operator who states and marks. Drawn flights have
several troubles at once. A sentence that no template knows counts as false.
"""

from __future__ import annotations

import argparse
import tempfile
from collections import Counter
from pathlib import Path

from bench.command_line import RESULTS
from bench.statements.checker import PLACES, check_flight
from bench.statements.flights import fly_script
from bench.statements.scripts import SCRIPTS, drawn_script
from infra.markdown import markdown_table


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--flights", nargs="*", help="some of the flights, by name")
    parser.add_argument("--draws", type=int, nargs=2, metavar=("FIRST", "COUNT"), help="drawn flights instead")
    parser.add_argument("--places", nargs="*", choices=tuple(PLACES), default=tuple(PLACES), help="where it is said")
    parser.add_argument("--examples", type=int, default=3, help="list so many false statements of each place")
    parser.add_argument("--out", type=Path, default=RESULTS / "statements.md", help="the table (%(default)s)")
    options = parser.parse_args()
    rows, examples, sums = [], list[str](), Counter[str]()
    first, count = options.draws or (0, 0)
    for script in [drawn_script(seed) for seed in range(first, first + count)] or SCRIPTS:
        if options.flights and script.name not in options.flights:
            continue
        cells = [script.name]
        with tempfile.TemporaryDirectory() as folder:
            flown = fly_script(script, Path(folder))
            for place in options.places:
                count, found = check_flight(flown, Path(folder) / "out", place)
                sums.update({place: len(found), "": count})
                cells.append(str(len(found)))
                told = {f"- {script.name}, {each.where}: {each.said}: {each.true}": each for each in reversed(found)}
                examples += [
                    f"{text} (at {told[text].at_s:.1f} s)" for text in list(told)[: -options.examples - 1 : -1]
                ]
        rows.append(cells)
        print(" | ".join(cells), flush=True)
    rows.append(["all", *(f"**{sums[place]}**" for place in options.places)])
    table = markdown_table(("false statements", *options.places), rows)
    text = "\n\n".join((table, f"{sums['']:,} statements in all.", "\n".join(examples)))
    print(f"\n{text}")
    options.out.parent.mkdir(parents=True, exist_ok=True)
    options.out.write_text(f"# What is said, held against what is so\n\n{(__doc__ or '').strip()}\n\n{text}\n")


if __name__ == "__main__":
    main()
