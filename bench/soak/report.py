"""What a soak found: the page and the figure."""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.drawing import pyplot, read_rows

COLUMNS = ("t_s", "processes", "rss_mb", "own_mb", "cpu_percent", "threads", "descriptors", "records")
COLUMNS += ("longest_stall_ms", "stalls")
WARM_UP = 0.1
"""Share of the run after which memory is taken as the beginning's."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Run:
    """One soak."""

    samples: Sequence[Mapping[str, float]]
    sent: Mapping[str, Any]
    """What ``sim.fleet_process`` printed."""
    recorded: Mapping[int, int]
    """Records by system id."""
    stalls: int
    longest_s: float
    exit_code: int
    last_line: str
    """The flight's last line."""


def report(run: Run, chosen: argparse.Namespace, *, plot: str) -> str:
    """The page, in Markdown."""
    sent, lost = _lost(run)
    rows: list[tuple[str, str]] = [
        (
            "flight",
            f"{run.sent['seconds'] / 60:.1f} min, {chosen.vehicles} vehicles, {chosen.rate:g} packets a second, "
            + (f"video {chosen.video.name}" if chosen.video else "no video"),
        ),
        ("fleet's troubles", " ".join(chosen.fleet) or "none"),
        ("packets sent by vehicles", f"{sent:,}"),
        ("not in the recording", f"{lost:,}"),
        ("sender's latest datagram", f"{run.sent['late_ms']:.0f} ms late"),
        ("no growth of the recording for > 200 ms", f"{run.stalls} times, longest {1e3 * run.longest_s:.0f} ms"),
        ("exit code of the flight", str(run.exit_code)),
    ]
    if run.samples:
        rows += _costs(run.samples)
    lines = ["# Soak", "", f"`python -m bench.soak {_words(chosen)}`", "", "| | |", "|---|---|"]
    lines += [f"| {name} | {value} |" for name, value in rows]
    lines += ["", f"The flight's last words: `{run.last_line.partition(' recorded in ')[0].rstrip(';')}`"]
    lines += ["", f"![memory, processor, stalls]({plot})"] if plot else []
    return "\n".join(lines) + "\n"


def _words(chosen: argparse.Namespace) -> str:
    words = [f"--seconds {chosen.seconds:g} --rate {chosen.rate:g} --vehicles {chosen.vehicles}"]
    words += [f"--video {chosen.video}"] if chosen.video else []
    return " ".join(words + (["--", *chosen.fleet] if chosen.fleet else []))


def _lost(run: Run) -> tuple[int, int]:
    """Packets that vehicles sent, and how many of them were not recorded; of what is no vehicle's own, nothing."""
    sent: Counter[int] = Counter()
    for label, number in run.sent["packets"].items():
        last = label.rpartition(" ")[2]
        if last.isdecimal():
            sent[int(last)] += number
        elif label == "texts":
            sent[11] += number
    return sent.total(), sum(max(0, sent[i] - run.recorded.get(i, 0)) for i in sent)


def _costs(samples: Sequence[Mapping[str, float]]) -> list[tuple[str, str]]:
    t = np.array([row["t_s"] for row in samples])
    warm = t >= WARM_UP * t[-1]
    cpu = np.array([row["cpu_percent"] for row in samples])
    held = {name: {int(row[name]) for row in samples} for name in ("processes", "threads", "descriptors")}
    return [
        ("memory of the processes' own", _growth(t, np.array([row["own_mb"] for row in samples]), warm)),
        ("with what is shared and of files", _growth(t, np.array([row["rss_mb"] for row in samples]), warm)),
        ("processor", f"median {np.median(cpu):.0f} %, most {cpu.max():.0f} % of one core"),
        *((name, f"{min(seen)} to {max(seen)}") for name, seen in held.items()),
    ]


def _growth(t: NDArray[np.float64], held: NDArray[np.float64], warm: NDArray[np.bool_]) -> str:
    """From a tenth of the run on, and over its second half alone: what fills once is full by then."""
    first, last = float(np.median(held[warm][:6])), float(np.median(held[-6:]))
    late = t >= 0.5 * t[-1]
    per_hour = float(np.polyfit(t[late] / 3600, held[late], 1)[0]) if late.sum() > 2 else float("nan")
    grown = f"{first:.1f} MB after a tenth, {last:.1f} MB at the end: {last / first - 1:+.1%}"
    return f"{grown}; {per_hour:+.1f} MB an hour in the second half"


def draw(table: Path, out: Path) -> bool:
    """Draw memory, processor and stalls over time; False when matplotlib is missing."""
    plot = pyplot()
    rows = read_rows(table)
    if plot is None or not rows:
        return False
    minutes = [float(row["t_s"]) / 60 for row in rows]
    figure, axes = plot.subplots(3, 1, figsize=(7, 6), sharex=True)
    for axis, (name, label) in zip(
        axes,
        (("own_mb", "own MB"), ("cpu_percent", "% of one core"), ("longest_stall_ms", "longest stall, ms")),
        strict=True,
    ):
        axis.plot(minutes, [float(row[name]) for row in rows], linewidth=1)
        axis.set(ylabel=label)
        axis.set_ylim(bottom=0)
    axes[2].axhline(200.0, color="0.7", linewidth=1)
    axes[2].set(xlabel="minutes")
    figure.tight_layout()
    figure.savefig(out, dpi=110)
    plot.close(figure)
    return True
