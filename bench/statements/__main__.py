"""Statements about a flight, in every place where they are made, held against the truth.

    python -m bench.statements
    python -m bench.statements --flights "lying by 30 m" --places events screens
    python -m bench.statements --draws 1 20 --places events turns identity
    python -m bench.statements --out bench/results/statements.md

Scripted flights whose truth is known: members that are silent, late, stand still, lie, are refused or never heard and
that come back, a video that stops and one that comes and goes, two cameras, an operator who states and marks. Drawn
flights have several troubles at once. A sentence that no template knows counts as false.
"""

from __future__ import annotations

import argparse
import tempfile
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np

from bench.command_line import RESULTS, write_page
from bench.flights import FlightScript, OperatorAct, fly_script
from bench.statements.checker import PLACES, check_cameras
from infra.markdown import markdown_table
from sim.world.scenario import Occlusion, ScenarioFault, ScenarioFlight, ScenarioView
from tests.support.scripted import InjectedFaults

LIES, MIN_PER_LIE = ("jump", "drift", "spoof", "frozen"), 4
"""Faults by which a vehicle reports to be elsewhere, and vehicles for each that has one: where many do nobody can know
who lies, or whether the camera is elsewhere."""


def _fault(system_id: int, kind: str, start_s: float, stop_s: float = 1e9, **more: float) -> ScenarioFault:
    return ScenarioFault(vehicle=system_id - 11, kind=kind, start_s=start_s, stop_s=stop_s, **more)  # type: ignore[arg-type]


SCRIPTS: tuple[FlightScript, ...] = (
    FlightScript(name="all is well", outside=1),
    FlightScript(name="one silent for the rest", seconds=40.0, faults=(_fault(12, "silent", 8.0),)),
    FlightScript(
        name="three silent, one by one, two come back",
        seconds=45.0,
        faults=(_fault(11, "silent", 6.0), _fault(12, "silent", 10.0, 30.0), _fault(13, "silent", 14.0, 20.0)),
    ),
    FlightScript(
        name="one silent, its box on a new track, and stated",
        seconds=36.0,
        faults=(_fault(12, "silent", 5.0, 30.0),),
        occlusions=(Occlusion(vehicle=1, t_s=10.0, duration_s=4.0),),
        acts=(OperatorAct(at_s=22.0, kind="state", of=12, says=12),),
    ),
    FlightScript(name="never on the air", faults=(_fault(14, "silent", -9.0), _fault(15, "silent", -9.0, 15.0))),
    FlightScript(name="late by 3 s", seconds=30.0, faults=(_fault(13, "lag", 8.0),)),
    FlightScript(name="frozen", seconds=30.0, faults=(_fault(12, "frozen", 8.0),)),
    FlightScript(name="lying by 15 m", seconds=35.0, faults=(_fault(13, "jump", 8.0),)),
    FlightScript(name="lying by 30 m", seconds=45.0, faults=(_fault(14, "jump", 8.0, size=30.0),)),
    FlightScript(name="drifting away", seconds=40.0, faults=(_fault(11, "drift", 5.0, size=1.0),)),
    FlightScript(name="in the place of another", seconds=30.0, faults=(_fault(11, "spoof", 8.0, other=2),)),
    FlightScript(name="without a fix", seconds=30.0, faults=(_fault(11, "zero", 8.0, 20.0),)),
    FlightScript(
        name="refused: signed with another key", injected=InjectedFaults(signed=True, wrong_keys=frozenset((12,)))
    ),
    FlightScript(name="the video stops for 8 s", injected=InjectedFaults(no_video=((8.0, 16.0),))),
    FlightScript(
        name="the video comes and goes",
        seconds=60.0,
        injected=InjectedFaults(no_video=tuple((float(t), t + 2.5) for t in range(6, 36, 5))),
    ),
    FlightScript(name="no telemetry for 6 s", seconds=30.0, injected=InjectedFaults(no_telemetry=(8.0, 14.0))),
    FlightScript(
        name="the operator states and marks",
        seconds=30.0,
        faults=(_fault(12, "silent", 5.0),),
        acts=(
            OperatorAct(at_s=9.0, kind="mark", of=12, text="it went behind the barn"),
            OperatorAct(at_s=10.0, kind="state", of=12, says=12),
            OperatorAct(at_s=16.0, kind="undo", of=12),
            OperatorAct(at_s=18.0, kind="state", of=13, says=14),
        ),
    ),
    FlightScript(
        name="stated while silent, beside one that lies",
        outside=1,
        faults=(_fault(12, "silent", 6.0, 15.0), _fault(13, "jump", 8.0, size=25.0)),
        acts=(OperatorAct(at_s=10.0, kind="state", of=12, says=12),),
    ),
    FlightScript(
        name="two cameras, one silent, and each video stops once",
        seconds=40.0,
        outside=1,
        faults=(_fault(12, "silent", 8.0, 25.0),),
        injected=InjectedFaults(no_video=((12.0, 20.0),)),
        no_video_beside=((24.0, 32.0),),
        views=(ScenarioView(aside_m=(14.0, 0.0), flight=ScenarioFlight(yaw_deg=60.0)),),
    ),
    FlightScript(
        name="a silent, a lying and a refused one",
        seconds=45.0,
        vehicles=6,
        faults=(_fault(11, "silent", 8.0, 35.0), _fault(14, "jump", 10.0, size=20.0)),
        injected=InjectedFaults(signed=True, wrong_keys=frozenset((16,))),
        acts=(OperatorAct(at_s=20.0, kind="mark", text="three are in doubt"),),
    ),
)


def drawn_script(seed: int) -> FlightScript:
    """A flight in which several troubles come together, drawn: of the fleet, of the video, of the operator's hand."""
    draw = np.random.default_rng(seed)
    vehicles, seconds = int(draw.integers(3, 9)), float(draw.integers(25, 50))
    ids = [11 + int(k) for k in draw.permutation(vehicles)]
    troubled, faults, lies = ids[: int(draw.integers(0, 4))], list[ScenarioFault](), 0
    for i in troubled:
        kind = str(draw.choice(["silent", "silent", "lag", "frozen", "jump", "drift", "spoof", "zero"]))
        lies += kind in LIES
        if lies > vehicles // MIN_PER_LIE:
            kind = "silent"
        start_s = float(draw.choice([-9.0, *draw.uniform(3.0, seconds - 8.0, 3)])) if kind == "silent" else 8.0
        stop_s = float(draw.choice([1e9, max(start_s, 0.0) + draw.uniform(2.0, 18.0)]))
        fault = _fault(i, kind, round(start_s, 1), round(stop_s, 1))
        if kind in ("jump", "drift"):
            fault = replace(fault, size=float(draw.uniform(12.0, 40.0) if kind == "jump" else draw.uniform(0.5, 2.0)))
        faults.append(replace(fault, other=ids[-2] - 11) if kind == "spoof" else fault)
    gaps = sorted(float(t_s) for t_s in draw.uniform(4.0, seconds - 6.0, int(draw.choice([0, 0, 1, 2, 6]))))
    signed = bool(draw.integers(0, 2))
    lost_s = float(draw.uniform(6.0, seconds - 8.0))
    injected = InjectedFaults(
        no_video=tuple((t_s, t_s + float(draw.uniform(0.5, 6.0))) for t_s in gaps),
        no_telemetry=(lost_s, lost_s + 5.0) if draw.random() < 0.25 else None,
        signed=signed,
        wrong_keys=frozenset(ids[-1:]) if signed and draw.random() < 0.5 else frozenset(),
    )
    acts = [
        OperatorAct(at_s=3.0 + 4.0 * k, kind="state", of=ids[k % vehicles], says=ids[k % vehicles])
        for k in range(int(draw.integers(0, 3)))
    ]
    if draw.random() < 0.5:
        acts.append(OperatorAct(at_s=12.0, kind="mark", text="something is odd"))
    occlusions = [
        Occlusion(vehicle=int(draw.integers(vehicles)), t_s=float(draw.uniform(4.0, seconds - 6.0)), duration_s=3.0)
        for _ in range(int(draw.integers(0, 3)))
    ]
    return FlightScript(
        name=f"drawn {seed}",
        seed=seed,
        seconds=seconds,
        fps=float(draw.choice([4.0, 5.0, 10.0])),
        vehicles=vehicles,
        outside=int(draw.integers(0, 2)),
        strangers=int(draw.integers(0, 4)),
        faults=tuple(faults),
        occlusions=tuple(occlusions),
        injected=injected,
        acts=tuple(acts),
    )


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
    scripts = [drawn_script(seed) for seed in range(first, first + count)] or SCRIPTS
    if unknown := {*(options.flights or ())} - {script.name for script in scripts}:
        known = "; ".join(script.name for script in scripts)
        parser.error(f"no flight is called {', '.join(sorted(unknown))}: {known}")
    for script in scripts:
        if options.flights and script.name not in options.flights:
            continue
        cells = [script.name]
        with tempfile.TemporaryDirectory() as folder:
            flown = fly_script(script, Path(folder))
            for place in options.places:
                count, found = check_cameras(flown, Path(folder) / "out", place)
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
    parts = ("# What is said, held against what is so", (__doc__ or "").strip(), table)
    write_page(options.out, "\n\n".join((*parts, f"{sums['']:,} statements in all.", "\n".join(examples))) + "\n")


if __name__ == "__main__":
    main()
