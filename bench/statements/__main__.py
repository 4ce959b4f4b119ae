"""What is said of a flight, in every place where it is said, held against what is so.

    python -m bench.statements
    python -m bench.statements --flights "lying by 30 m" --places events screens --examples 5
    python -m bench.statements --write bench/results/statements.md

Scripted flights whose truth is known: members that are silent, late, stand still, lie, are refused or never heard and
that come back, a video that stops and one that comes and goes, an operator who states and marks. A sentence that no
template knows counts as false.
"""

from __future__ import annotations

import argparse
import csv
import tempfile
from collections import Counter
from pathlib import Path

from bench.command_line import RESULTS
from bench.statements.checker import PLACES, check_flight
from bench.statements.flights import fly_script
from bench.statements.scripts import SCRIPTS
from infra.markdown import markdown_table


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--flights", nargs="*", help="some of the flights, by name")
    parser.add_argument("--places", nargs="*", choices=tuple(PLACES), default=tuple(PLACES), help="where it is said")
    parser.add_argument("--examples", type=int, default=3, help="print so many false statements of each place")
    parser.add_argument("--out", type=Path, default=RESULTS / "statements.csv", help="what is false (%(default)s)")
    parser.add_argument("--write", type=Path, help="put the table into this file")
    options = parser.parse_args()
    rows, falsehoods, sums = [], [], Counter[str]()
    for script in SCRIPTS:
        if options.flights and script.name not in options.flights:
            continue
        with tempfile.TemporaryDirectory() as folder:
            flown, cells = fly_script(script, Path(folder)), []
            for place in options.places:
                count, found = check_flight(flown, Path(folder) / "out", place)
                sums.update({place: len(found), "": count})
                cells.append(str(len(found)))
                falsehoods += [(script.name, each.where, f"{each.at_s:.1f}", each.said, each.true) for each in found]
                for each in found[: options.examples]:
                    print(f"    {script.name}, {each.at_s:.1f} s, {each.where}: {each.said} | {each.true}", flush=True)
        rows.append((script.name, *cells))
        print(" | ".join(rows[-1]), flush=True)
    options.out.parent.mkdir(parents=True, exist_ok=True)
    with options.out.open("w", newline="", encoding="utf-8") as file:
        csv.writer(file).writerows([("flight", "where", "at_s", "said", "true"), *falsehoods])
    everything = ("all", *(f"**{sums[place]}**" for place in options.places))
    text = markdown_table(("false statements", *options.places), [*rows, everything])
    text += f"\n\n{sums['']:,} statements in all."
    print(f"\n{text}")
    if options.write:
        options.write.write_text(f"# What is said, held against what is so\n\n{(__doc__ or '').strip()}\n\n{text}\n")


if __name__ == "__main__":
    main()
