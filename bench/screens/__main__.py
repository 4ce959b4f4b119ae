"""Screens held against the truth: scripted flights at five sizes, every screen checked.

    python -m bench.screens
    python -m bench.screens --flights "2 frames/s" --sizes 80x24 --examples 3
    python -m bench.screens --out bench/results/screens.md

Names that are cut or damaged, names of vehicles that are not named, clocks that go back, values older than they look,
alarms that are neither visible nor counted, hidden troubles (``bench.screens.checker``).
"""

from __future__ import annotations

import argparse
import asyncio
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

from bench.command_line import RESULTS, write_page
from bench.flights import FlightScript, Span, polls_of
from bench.screens.checker import check_screens
from infra.markdown import markdown_table
from sim.world.scenario import FIRST_UGV_ID, ScenarioFault
from tests.support.scripted import InjectedFaults

SIZES = ((60, 20), (80, 24), (100, 30), (120, 40), (160, 48))
NAMES = MappingProxyType({11: "Hauler North 7", 12: "UGV-1", 13: "UGV-16", 14: "Bravo", 15: "漢字-15", 16: "Bravo-2"})
"""Names with spaces, wide letters, and names with which others begin."""
QUICK = 24
WHILE_S = (5.0, 11.0)
"""Part of a flight in which most troubles are, from and to, s."""

DETECTOR_S = (0.015, 0.02)
"""The detector is quick: every frame is shown."""


def script_of(
    name: str,
    *,
    latency_s: float = 0.06,
    silent: Mapping[int, Span] = MappingProxyType({}),
    faults: tuple[ScenarioFault, ...] = (),
    injected: Mapping[str, Any] = MappingProxyType({}),
    **parts: Any,  # noqa: ANN401 - the fields of a script
) -> FlightScript:
    """A flight for screens.

    Args:
        name: of the flight.
        latency_s: from a frame's exposure until it is here.
        silent: when nothing of a vehicle is received, by system id.
        faults: what else is wrong with what vehicles report.
        injected: fields of ``InjectedFaults``.
        parts: fields of ``FlightScript``.
    """
    ordinary: dict[str, Any] = {"seconds": 16.0, "fps": 15.0, "vehicles": 6, "strangers": 0}
    silences = (
        ScenarioFault(vehicle=system_id - FIRST_UGV_ID, kind="silent", start_s=start_s, stop_s=stop_s)
        for system_id, (start_s, stop_s) in silent.items()
    )
    return FlightScript(
        name=name,
        faults=(*faults, *silences),
        injected=InjectedFaults(arrives_s=(latency_s, latency_s), detector_s=DETECTOR_S, **injected),
        **(ordinary | parts),
    )


SCRIPTS: tuple[FlightScript, ...] = (
    *(script_of(f"{fps:g} frames/s", fps=fps, latency_s=0.3 if fps < 10 else 0.06) for fps in (1, 2, 5, 15, 30)),
    script_of("hiccups of 0.4, 0.8 and 1.6 s", injected={"no_video": ((3.0, 3.4), (6.0, 6.8), (10.0, 11.6))}),
    script_of("no frames for 6 s", injected={"no_video": (WHILE_S,)}),
    script_of("the video starts after 8 s", injected={"no_video": ((-5.0, 8.0),)}),
    script_of(
        "two vehicles switched off and on",
        silent={11: WHILE_S, 13: WHILE_S},
        injected={"restarted": frozenset((11, 13))},
    ),
    script_of("nothing received for 6 s", injected={"no_telemetry": WHILE_S}),
    script_of("a vehicle lost for two minutes", silent={12: (10.0, 150.0)}, seconds=135.0, fps=2, poll_us=1_000_000),
    script_of("a second sender of one system id", injected={"impostor": WHILE_S}),
    script_of(
        "positions that cannot be right",
        faults=(
            ScenarioFault(vehicle=0, kind="jump", start_s=5.0, stop_s=11.0, size=400.0),
            ScenarioFault(vehicle=1, kind="zero", start_s=5.0, stop_s=11.0),
            ScenarioFault(vehicle=2, kind="spoof", start_s=5.0, stop_s=11.0, other=3),
        ),
    ),
    script_of("a flood of texts", injected={"texts": WHILE_S}),
    script_of("a flood of events", events=WHILE_S),
    script_of("the disk fails", disk_fails=WHILE_S),
    script_of("names with which others begin", names=NAMES),
    script_of("40 vehicles", vehicles=40, ground="open", fps=10),
    script_of(
        "40 vehicles, all at once",
        vehicles=40,
        ground="open",
        fps=5,
        latency_s=0.3,
        names=NAMES,
        silent={12: (4.0, 12.0), 20: (8.0, 99.0)},
        events=(6.0, 14.0),
        disk_fails=(10.0, 12.0),
        injected={
            "no_video": ((7.0, 9.0), (12.0, 15.0)),
            "restarted": frozenset((12,)),
            "impostor": WHILE_S,
            "texts": (6.0, 14.0),
        },
    ),
)


Size = tuple[int, int]
Row = tuple[str, str, int, str, int]
"""Flight, size, screens, rule, violations; a row with an empty rule for each flight and size."""


def check_flight(script: FlightScript, sizes: Iterable[Size], every: int, examples: int) -> list[Row]:
    """Fly once, show it at every size."""
    moments, rows = polls_of(script)[::every], []
    for size in sizes:
        screens, found = asyncio.run(check_screens(moments, size))
        name = f"{size[0]}x{size[1]}"
        rows.append((script.name, name, screens, "", 0))
        rows += [(script.name, name, 0, rule, times) for rule, times in Counter(each.rule for each in found).items()]
        for rule in dict.fromkeys(each.rule for each in found):
            for each in [each for each in found if each.rule == rule][:examples]:
                print(f"    {name} {rule}: {each.what}", flush=True)
    return rows


def table(rows: Sequence[Row]) -> str:
    """Tables by flight, by size and by rule, in Markdown."""
    return "\n\n".join(_by(rows, column, title) for column, title in ((0, "flight"), (1, "size"), (3, "rule")))


def _by(rows: Sequence[Row], column: int, title: str) -> str:
    screens, violations = Counter[str](), Counter[str]()
    for row in rows:
        screens[str(row[column])] += row[2]
        violations[str(row[column])] += row[4]
    lines = [[name, f"{screens[name]:,}", f"**{violations[name]:,}**"] for name in violations if name]
    lines.append(["all", f"{screens.total():,}", f"**{violations.total():,}**"])
    if column == 3:  # every rule is held against every screen
        return markdown_table([title, "violations"], [[name, found] for name, _, found in lines])
    return markdown_table([title, "screens", "violations"], lines)


def size_of(text: str) -> Size:
    """Columns and rows of ``80x24``."""
    columns, _, rows = text.partition("x")
    return int(columns), int(rows)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--flights", nargs="*", help="some of the flights, by name")
    parser.add_argument("--sizes", nargs="*", type=size_of, default=SIZES, help="columns and rows, 80x24")
    parser.add_argument("--quick", action="store_true", help=f"look at each {QUICK}th poll")
    parser.add_argument("--examples", type=int, default=0, help="print so many of each violation")
    parser.add_argument("--out", type=Path, default=RESULTS / "screens.md", help="the tables (%(default)s)")
    options = parser.parse_args()
    rows: list[Row] = []
    for script in SCRIPTS:
        if not options.flights or script.name in options.flights:
            rows += (these := check_flight(script, options.sizes, QUICK if options.quick else 1, options.examples))
            print(f"{script.name}: {sum(row[4] for row in these):,} on {sum(row[2] for row in these):,}", flush=True)
    parts = ("# The screens held against what is so", (__doc__ or "").strip(), table(rows))
    write_page(options.out, "\n\n".join(parts) + "\n")


if __name__ == "__main__":
    main()
