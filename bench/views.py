"""Several cameras over one fleet: names in each view with and without the other, side by side in one run.

    python -m bench.views --seeds 200 201 202

Simulated flights of two cameras, boxes alone. ``alone`` is what each view names by itself, ``shared`` what it names
with what the other learnt; names are as a screen would have shown them.
"""

from __future__ import annotations

import csv
import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import astuple, dataclass, fields, replace
from multiprocessing import get_context
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from bench.command_line import count, parser_of, print_results
from gcs.playback.identification import identify_session
from gcs.report.score import match_files, score
from gcs.session.session import open_session
from infra.session_format import DETECTIONS, FRAMES, IDENTITY, TRUTH, VIEW_FOLDER
from sim.session import write_session
from sim.world.presets import hand_over
from sim.world.scenario import (
    Gnss,
    Scenario,
    ScenarioAttitude,
    ScenarioCamera,
    ScenarioDeclared,
    ScenarioFlight,
    ScenarioGround,
    ScenarioTiming,
    ScenarioView,
)

SOON_S = 0.5
"""A name that is there so long after its vehicle came into a picture is a hand-over, not a new one."""
SHARP = 3000.0
"""Focal length, px, of a view that sees two or three vehicles of a fleet that the other sees all of."""
NOISY = Gnss(white_m=0.4, bias_m=1.6, tau_s=90.0, uav_bias_m=2.0)
"""Receivers without corrections between houses."""


def _overlap(seed: int) -> Scenario:
    return replace(_formation(seed, "grid", 5.0), ground=ScenarioGround(vehicles=8, spacing_m=6.0), name="overlap")


def _formation(seed: int, kind: str, spacing_m: float) -> Scenario:
    """A formation; one camera sees all of it, the other, lower and sharper, the vehicles in its middle."""
    return Scenario(
        name="formation",
        seed=seed,
        duration_s=24.0,
        fps=5.0,
        gnss=NOISY,
        ground=ScenarioGround(kind="formation", formation=kind, vehicles=6, spacing_m=spacing_m),  # type: ignore[arg-type]
        flight=ScenarioFlight(height_m=45.0),
        views=(
            ScenarioView(
                flight=ScenarioFlight(height_m=25.0, yaw_deg=70.0),
                camera=ScenarioCamera(fx=SHARP, fy=SHARP),
                timing=ScenarioTiming(video_offset_s=0.2),
                attitude=ScenarioAttitude(compass_bias_deg=4.0),
            ),
        ),
    )


def _with_view(scenario: Scenario, **changes: object) -> Scenario:
    return replace(scenario, views=(replace(scenario.views[0], **changes),))  # type: ignore[arg-type]


def _gap(seed: int) -> Scenario:
    return replace(hand_over(seed), duration_s=45.0, fps=5.0, gnss=NOISY)


def _oblique(seed: int) -> Scenario:
    camera = ScenarioCamera(pitch_deg=-30.0)
    return _with_view(_formation(seed, "line", 3.0), camera=camera, flight=ScenarioFlight(height_m=30.0, yaw_deg=90.0))


def _wrong_pose(seed: int) -> Scenario:
    attitude = ScenarioAttitude(compass_bias_deg=14.0, tilt_roll_deg=3.0)
    return _with_view(_formation(seed, "wedge", 4.0), attitude=attitude, declared=ScenarioDeclared(pitch_deg=3.0))


def _wrong_clock(seed: int) -> Scenario:
    timing = ScenarioTiming(video_offset_s=0.8, declared_offset="zero")
    return _with_view(_formation(seed, "wedge", 4.0), timing=timing)


FAMILIES: Mapping[str, Callable[[int], Scenario]] = {
    "overlap on a road": _overlap,
    "formation, line": lambda seed: _formation(seed, "line", 3.0),
    "formation, column": lambda seed: _formation(seed, "column", 3.5),
    "formation, grid": lambda seed: _formation(seed, "grid", 3.5),
    "formation, low angle": _oblique,
    "hand-over with a gap": _gap,
    "one pose wrong": _wrong_pose,
    "one clock wrong": _wrong_clock,
}
"""By what is hard about them."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ViewRow:
    """One view of one flight, named by one way."""

    family: str
    seed: int
    view: int
    names: str
    """``alone`` or ``shared``."""
    right: float
    """Share of our boxes with the right name."""
    precision: float
    wrong_sure_s: float
    soon: float
    """Share of the vehicles that came into the picture with their right name ``SOON_S`` later."""


def measure(family: str, seed: int) -> list[ViewRow]:
    """Make a flight and name it both ways."""
    with TemporaryDirectory() as scratch:
        both, lone = Path(scratch, "both"), Path(scratch, "lone")
        write_session(FAMILIES[family](seed), both)
        second = VIEW_FOLDER.format(2)
        out = Path(scratch, "out")
        shutil.copytree(both, lone)
        for name in (FRAMES.name, DETECTIONS.name):
            (lone / name).unlink()
        identify_session(open_session(lone / second), out / "alone" / second, hindsight=False)
        shutil.rmtree(lone)
        shutil.copytree(both, lone, ignore=shutil.ignore_patterns(second))
        identify_session(open_session(lone), out / "alone", hindsight=False)
        identify_session(open_session(both), out / "shared", hindsight=False)
        return [
            _row(family, seed, view, names, both / folder / TRUTH.name, out / names / folder / IDENTITY.name)
            for view, folder in ((1, ""), (2, second))
            for names in ("alone", "shared")
        ]


def _row(family: str, seed: int, view: int, names: str, truth: Path, identity: Path) -> ViewRow:
    matched, _ = match_files(truth, identity)
    found = score(matched)
    return ViewRow(
        family=family,
        seed=seed,
        view=view,
        names=names,
        right=found.right,
        precision=found.precision,
        wrong_sure_s=found.wrong_sure_s,
        soon=float(np.mean([*_named_soon(matched.truth, matched.named, matched.time_us)] or np.nan)),
    )


def _named_soon(truth: np.ndarray, named: np.ndarray, time_us: np.ndarray) -> Iterator[bool]:
    """Of each vehicle whether it had its name so soon after its first box."""
    for vehicle in np.unique(truth[truth > 0]):
        rows = np.flatnonzero((truth == vehicle) & np.isfinite(time_us))
        since_s = (time_us[rows] - time_us[rows[0]]) * 1e-6 if len(rows) else np.empty(0)
        later = rows[since_s >= SOON_S]
        if len(later):
            yield bool(named[later[0]] == vehicle)


def table(rows: Sequence[ViewRow]) -> str:
    """Means by family and view, alone → shared."""
    lines = [
        "| family | view | right | right names of those given | wrong and sure | named within 0.5 s |",
        "|---|---|---|---|---|---|",
    ]
    for family in FAMILIES:
        for view in sorted({row.view for row in rows}):
            ways = [[row for row in rows if (row.family, row.view, row.names) == (family, view, n)] for n in _WAYS]
            if ways[0]:
                cells = (
                    " → ".join(f"{100.0 * np.nanmean([row.right for row in way]):.1f}" for way in ways) + " %",
                    " → ".join(f"{100.0 * np.nanmean([row.precision for row in way]):.2f}" for way in ways) + " %",
                    " → ".join(f"{sum(row.wrong_sure_s for row in way):.1f}" for way in ways) + " s",
                    " → ".join(f"{100.0 * np.nanmean([row.soon for row in way]):.0f}" for way in ways) + " %",
                )
                lines.append(f"| {family} | {view} | {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


_WAYS = ("alone", "shared")


def _measured(task: tuple[str, int]) -> list[ViewRow]:
    return measure(*task)


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure, and write rows and tables."""
    parser = parser_of("views", __doc__.split("\n")[0], "one seed a family")
    parser.add_argument("--seeds", type=int, nargs="+", default=[200, 201, 202, 203])
    parser.add_argument("--family", action="append", choices=list(FAMILIES), help="only this one; may be repeated")
    parser.add_argument("--jobs", type=count, default=1, help="processes (%(default)s)")
    chosen = parser.parse_args(arguments)
    seeds = chosen.seeds[:1] if chosen.quick else chosen.seeds
    tasks = [(family, seed) for family in chosen.family or FAMILIES for seed in seeds]
    chosen.out.mkdir(parents=True, exist_ok=True)
    rows: list[ViewRow] = []
    with (
        get_context("spawn").Pool(chosen.jobs) as pool,
        (chosen.out / "rows.csv").open("w", newline="", encoding="utf-8") as file,
    ):
        writer = csv.writer(file)
        writer.writerow(field.name for field in fields(ViewRow))
        for found in pool.imap(_measured, tasks):
            rows += found
            writer.writerows(astuple(row) for row in found)
            file.flush()
    text = table(rows)
    (chosen.out / "table.md").write_text(text, encoding="utf-8")
    print_results(text, chosen.out / "rows.csv", as_json=chosen.json)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
