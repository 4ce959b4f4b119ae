"""Tables in Markdown: published beside our implementation of the published method beside our identifier."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

from bench.paper.experiments import CONTINUOUS, Count
from bench.paper.methods import MethodTime
from bench.paper.occlusion import Kept
from infra.markdown import markdown_table

FIG7_LOW = {"straight": 90.0, "curved": 80.0}
"""Projection without rotation at low noise, %: above 90, about 80."""
FIG7_STEP = {"straight": 1.98, "curved": 1.67}
"""Loss of projection per 0.25 m of σ, %."""
FIG8_LOW = 87.6
"""Topology at low noise, %."""
FIG8_STEP = {"straight": 1.06, "curved": 0.96}
"""Loss of topology per 0.25 of σ, %, as the text has it."""
PUBLISHED_MS = {"projection": 148.49, "topology": 34.48, "TTS": 22.52, "fusion": 0.27}
"""Latency of the methods, ms."""
PUBLISHED_FALSE_BOX = {"projection": (99.07, 100.00), "topology": (96.53, 98.53), "TTS": (88.43, 45.71)}
"""Precision and FPER, %."""
PUBLISHED_FIELD = {"projection": (74.20, 75.00), "TTS": (19.50, 82.00)}
"""Precision and FPER, %."""
SETTING = """\
The paper's scenes are not public: the published column is theirs, the others are of our simulated flights, the same
frames for every method. Windows of 12 frames at 10 frames a second, each a cold start, the last frame labelled;
perfect tracks, boxes with 1 px noise, fronts with 3° noise and 4 % turned about; white noise on all three relative
coordinates. The identifier gets the same noisy reports and the UAV's telemetry (position 0.5 m, heading 2° off).
"""


def write_tables(out: Path, counts: list[Count], kept: list[Kept], times: list[MethodTime], quick: bool) -> None:
    """Write every table.

    Args:
        out: Folder.
        counts: Results of the association experiments.
        kept: Results of the occlusion experiment.
        times: What the methods take.
        quick: State in each table that the run was a short one.
    """
    note = "A short run: few windows.\n\n" if quick else ""
    texts = {
        "figure_7.md": _sweep(counts, "figure 7", "projection", "Figure 7: projection against white noise", "sigma_m"),
        "figure_8.md": _sweep(counts, "figure 8", "topology", "Figure 8: topology against noise", "sigma_topology"),
        "figure_9.md": _sweep(counts, "figure 9", "fusion", "Figure 9: both fused", "sigma_m"),
        "figure_10.md": _figure10(counts),
        "table_1.md": _table1(times),
        "table_2.md": _table2(counts),
        "table_3.md": _table3(counts),
        "occlusion.md": _occlusion(kept),
    }
    for name, text in texts.items():
        (out / name).write_text(note + text, encoding="utf-8")


def pooled(counts: Iterable[Count], experiment: str, method: str, **where: object) -> Count | None:
    """Counts of one method added up over everything that ``where`` leaves open."""
    some = [
        c
        for c in counts
        if c.experiment == experiment and c.method == method and all(getattr(c, k) == v for k, v in where.items())
    ]
    if not some:
        return None
    names = ("frames", "ours", "named", "right", "false", "excluded")
    return replace(some[0], **{name: sum(getattr(c, name) for c in some) for name in names})


def percent(value: float | None) -> str:
    """Two digits, or a dash."""
    return "–" if value is None or value != value else f"{value:.2f}"


def _precision(count: Count | None) -> str:
    return percent(count.precision if count else None)


def _both(count: Count | None) -> str:
    """Precision / share of our boxes named rightly."""
    return f"{percent(count.precision)} / {percent(count.recall)}" if count else "–"


def published_at(experiment: str, road: str, sigma: float) -> float | None:
    """The straight line that the published low-noise value and step give, %."""
    if experiment == "figure 7":
        return FIG7_LOW[road] - FIG7_STEP[road] * sigma / 0.25
    if experiment == "figure 8":
        return FIG8_LOW - FIG8_STEP[road] * sigma / 0.25
    return None


def _sweep(counts: list[Count], experiment: str, method: str, title: str, axis: str) -> str:
    levels = sorted({getattr(c, axis) for c in counts if c.experiment == experiment})
    rotations = sorted({c.rotation_deg for c in counts if c.experiment == experiment})
    parts = [f"# {title}\n\nPrecision in %.\n\n{SETTING}"]
    for road in ("straight", "curved"):
        rows = []
        for level in levels:
            where = {"case": road, axis: level}
            theirs = [_precision(pooled(counts, experiment, method, rotation_deg=r, **where)) for r in rotations]
            ours = pooled(counts, experiment, "identifier", **where)
            rows.append([f"{level:g}", percent(published_at(experiment, road, level)), *theirs, _both(ours)])
        theirs = [f"{method}, {r:g}°" for r in rotations]
        header = ["σ", "published, 0°", *theirs, "identifier: precision / right of all"]
        parts.append(f"\n## {road.capitalize()} road\n\n" + markdown_table(header, rows) + "\n")
    return "".join(parts) + "\n" + _REMARKS[experiment]


_REMARKS = {
    "figure 7": "Published: 90 % (straight) and 80 % (curved) at low noise, then 1.98 and 1.67 % less per 0.25 m, "
    "drawn as a line; the text has about 60 and 50 % at σ = 4. The identifier's column pools the "
    "rotations; at 90° and 180° it is asked at whole metres.\n",
    "figure 8": "Published: 87.6 % at low noise, then 1.06 and 0.96 % less per 0.25, as the text has it. σ is metres "
    "on positions and degrees on headings. The identifier is asked without rotation, at every other level.\n",
    "figure 9": "σ is that of projection in metres; topology has 0.5 more, in metres and degrees. Published: 10–20 % "
    "more than either method alone, 79.9 % under high noise. The identifier is asked without rotation, at every third "
    "level.\n",
}


def _figure10(counts: list[Count]) -> str:
    levels = sorted({c.sigma_topology for c in counts if c.experiment == "figure 8"})
    methods = ("topology", "topology signed", "TTS", "TTS one step", "identifier")
    parts = [f"# Figure 10: topology and TTS\n\nPrecision in %, no rotation.\n\n{SETTING}"]
    for road in ("straight", "curved"):
        rows = []
        for level in levels:
            where = {"case": road, "rotation_deg": 0.0, "sigma_topology": level}
            rows.append([f"{level:g}", *(_precision(pooled(counts, "figure 8", m, **where)) for m in methods)])
        parts.append(f"\n## {road.capitalize()} road\n\n" + markdown_table(["σ", *methods], rows) + "\n")
    parts.append("\nPublished: TTS is acceptable at low noise and falls behind topology under noise (a plot).\n")
    return "".join(parts)


def _pair(count: Count | None) -> str:
    return f"{percent(count.precision)} / {percent(count.fper)}" if count else "–"


def _table2(counts: list[Count]) -> str:
    methods = ("projection", "topology", "TTS", "TTS one step")
    parts = [f"# Table 2: six vehicles, seven boxes\n\nPrecision / FPER in %.\n\n{SETTING}\n"]
    for sigma in sorted({c.sigma_m for c in counts if c.experiment == "false box"}):
        ours = pooled(counts, "false box", "identifier", sigma_m=sigma)
        rows = []
        for method in methods:
            printed = PUBLISHED_FALSE_BOX.get(method)
            count = pooled(counts, "false box", method, sigma_m=sigma)
            rows.append([method, f"{printed[0]:.2f} / {printed[1]:.2f}" if printed else "–", _pair(count), ""])
        rows.append(["identifier", "", "", f"{_pair(ours)}, right of all {percent(ours.recall if ours else None)}"])
        frames = ours.frames if ours else 0
        header = ["method", "published", "our implementation", "identifier"]
        parts.append(f"σ = {sigma:g} m and degrees, {frames} frames\n\n" + markdown_table(header, rows) + "\n\n")
    return "".join(parts) + "Half of the frames have a look-alike among the vehicles, half something by the road.\n"


def _table3(counts: list[Count]) -> str:
    rows = []
    for method in ("projection", "topology", "TTS", "TTS one step", "mean residual"):
        printed = PUBLISHED_FIELD.get(method)
        count = pooled(counts, "field", method, case="12 frames")
        rows.append([method, f"{printed[0]:.2f} / {printed[1]:.2f}" if printed else "–", _pair(count), ""])
    for name, case, method in (
        ("identifier, 12 frames", "12 frames", "identifier"),
        ("identifier, 36 frames", "36 frames", "identifier"),
        ("identifier, all frames of whole flights", "flights", CONTINUOUS),
    ):
        ours = pooled(counts, "field", method, case=case)
        rows.append([name, "", "", f"{_pair(ours)}, right of all {percent(ours.recall if ours else None)}"])
    frames = pooled(counts, "field", "identifier", case="12 frames")
    head = (
        "# Table 3: three vehicles and a person\n\nPrecision / FPER in %; simulated, 39 m high, receivers that wander "
        f"by 1.5 m (τ 60 s) and 0.2 m white, twelve flights, {frames.frames if frames else 0} frames. The published "
        "column is their field recording.\n\n"
    )
    return head + markdown_table(["method", "published", "our implementation", "identifier"], rows) + "\n"


def _table1(times: list[MethodTime]) -> str:
    rows = [
        [name, f"{PUBLISHED_MS[name]:.2f}", *(f"{t.cpu_ms:.2f}" for t in times if t.method == name)]
        for name in PUBLISHED_MS
    ]
    head = (
        "# Table 1: latency, ms\n\nPublished on an i9-13900HX with an RTX 3090; ours is the median processor time of "
        "one thread for a window of seven vehicles and six boxes.\n\n"
    )
    return head + markdown_table(["method", "published", "ours"], rows) + "\n"


def _occlusion(kept: list[Kept]) -> str:
    rows = []
    for keeper in dict.fromkeys(k.keeper for k in kept):
        mine = [k for k in kept if k.keeper == keeper]
        sums = [sum(getattr(k, name) for k in mine) for name in ("frames", "hidden", "switches", "taken")]
        rows.append([keeper, *map(str, sums)])
    head = "# Occlusion: id switches\n\nCurved road, each vehicle hidden for 1.2–2.2 s at its three sharpest turns. "
    head += "Published: in the two cases shown, ByteTrack switches and the enhanced one does not.\n\n"
    columns = ["tracker", "frames", "returns after ≥ 0.5 s", "id switches", "tracks gone to another vehicle"]
    return head + markdown_table(columns, rows) + "\n"
