"""What the screens say, held against what is so: scripted flights at five sizes, every screen checked.

    python -m bench.screens
    python -m bench.screens --flights "2 frames/s" --sizes 80x24 --examples 3
    python -m bench.screens --before before.csv --write bench/results/screens.md

Names that are cut or damaged, names of vehicles that are not named, clocks that go back, values older than they look,
alarms that are neither visible nor counted, hidden troubles (``bench.screens.names``, ``bench.screens.values``).
"""

from __future__ import annotations

import argparse
import asyncio
import csv
from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path

from bench.command_line import RESULTS
from bench.screens.checker import check_screens
from bench.screens.flights import Script, fly
from bench.screens.scripts import SCRIPTS, SIZES
from infra.markdown import markdown_table

Size = tuple[int, int]
Row = tuple[str, str, int, str, int]
"""Flight, size, screens, rule, violations; a row with an empty rule for each flight and size."""
COLUMNS = ("flight", "size", "screens", "rule", "violations")


def check_flight(script: Script, sizes: Iterable[Size], every: int, examples: int) -> list[Row]:
    """Fly once, show it at every size."""
    moments, rows = list(fly(script))[::every], []
    for size in sizes:
        screens, found = asyncio.run(check_screens(moments, size))
        name = f"{size[0]}x{size[1]}"
        rows.append((script.name, name, screens, "", 0))
        rows += [(script.name, name, 0, rule, times) for rule, times in Counter(each.rule for each in found).items()]
        for rule in dict.fromkeys(each.rule for each in found):
            for each in [each for each in found if each.rule == rule][:examples]:
                print(f"    {name} {rule}: {each.what}", flush=True)
    return rows


def table(rows: Sequence[Row], before: Sequence[Row]) -> str:
    """By flight and by rule, in Markdown; with what was before, where that is known."""
    return "\n\n".join(_by(rows, before, column, title) for column, title in ((0, "flight"), (1, "size"), (3, "rule")))


def _by(rows: Sequence[Row], before: Sequence[Row], column: int, title: str) -> str:
    earlier, now = _sums(before, column), _sums(rows, column)
    screens = Counter[str]()
    for row in rows:
        screens[str(row[column])] += row[2]
    heads = [title, *(["screens"] if column != 3 else []), *(["violations before"] if before else []), "violations"]
    lines = []
    for name in dict.fromkeys([*(str(row[column]) for row in rows), *earlier]):
        if not name:
            continue
        cells = [name, *([f"{screens[name]:,}"] if column != 3 else [])]
        cells += [f"{earlier[name]:,}"] if before else []
        lines.append([*cells, f"**{now[name]:,}**"])
    sums = ["all", *([f"{screens.total():,}"] if column != 3 else [])]
    sums += [f"{sum(earlier.values()):,}"] if before else []
    return markdown_table(heads, [*lines, [*sums, f"**{sum(now.values()):,}**"]])


def _sums(rows: Sequence[Row], column: int) -> Counter[str]:
    sums = Counter[str]()
    for row in rows:
        sums[str(row[column])] += row[4]
    return sums


def _read(path: Path) -> list[Row]:
    with path.open(newline="", encoding="utf-8") as file:
        return [(row[0], row[1], int(row[2]), row[3], int(row[4])) for row in list(csv.reader(file))[1:]]


def _size(text: str) -> Size:
    columns, _, rows = text.partition("x")
    return int(columns), int(rows)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--flights", nargs="*", help="some of the flights, by name")
    parser.add_argument("--sizes", nargs="*", type=_size, default=SIZES, help="columns and rows, 80x24")
    parser.add_argument("--every", type=int, default=1, help="look at each nth poll of the screen (%(default)s)")
    parser.add_argument("--examples", type=int, default=0, help="print so many of each violation")
    parser.add_argument("--before", type=Path, help="rows of an earlier run, to be set beside these")
    parser.add_argument("--out", type=Path, default=RESULTS / "screens.csv", help="rows (%(default)s)")
    parser.add_argument("--write", type=Path, help="put the tables into this file")
    options = parser.parse_args()
    rows: list[Row] = []
    for script in SCRIPTS:
        if not options.flights or script.name in options.flights:
            rows += (these := check_flight(script, options.sizes, options.every, options.examples))
            print(f"{script.name}: {sum(row[4] for row in these):,} on {sum(row[2] for row in these):,}", flush=True)
    options.out.parent.mkdir(parents=True, exist_ok=True)
    with options.out.open("w", newline="", encoding="utf-8") as file:
        csv.writer(file).writerows([COLUMNS, *rows])
    text = table(rows, _read(options.before) if options.before else [])
    print(f"\n{text}")
    if options.write:
        options.write.write_text(f"# The screens held against what is so\n\n{(__doc__ or '').strip()}\n\n{text}\n")


if __name__ == "__main__":
    main()
