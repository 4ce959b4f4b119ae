"""The tables of a latency run."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

from bench.latency.measure import MethodTiming
from bench.latency.methods import OURS, measure_methods
from bench.latency.stream import FrameWait, measure_streams, measure_waits
from bench.latency.stream import text_of as waits_text
from bench.paper.published import LATENCY_MS
from bench.rows import write
from infra.markdown import markdown_table

TIMES = ("CPU mean", "CPU median", "CPU p95", "wall median", "wall p95")


def measure(out: Path, quick: bool, machine: str, report: Callable[[int, int], None] = lambda done, total: None) -> str:
    """Time everything.

    Args:
        out: Folder for ``latency.csv`` and ``latency.md``, ``waits.csv`` and ``waits.md``.
        quick: Few calls, small sizes.
        machine: What the times are of.
        report: Called with the measurements that are done so far, and all there are.

    Returns:
        The tables in Markdown.
    """
    methods, odd = measure_methods(quick, report)
    timings = methods + measure_streams(quick)
    text = _text(timings, odd, machine)
    out.mkdir(parents=True, exist_ok=True)
    write(out / "latency.csv", MethodTiming, timings)
    (out / "latency.md").write_text(text, encoding="utf-8")
    waits = measure_waits(quick)
    write(out / "waits.csv", FrameWait, waits)
    (out / "waits.md").write_text(waits_text(waits), encoding="utf-8")
    return f"{text}\n{waits_text(waits)}"


def _text(timings: list[MethodTiming], odd: list[str], machine: str) -> str:
    load = os.getloadavg()[0]
    head = (
        f"# Latency\n\nMilliseconds. One thread, {machine}, load {load:.1f} on {os.cpu_count()} cores at the end. "
        "Where there are several calls, one before them is not timed. Projection takes 10 + 2 frames; topology, TTS "
        "(first step) and fusion one frame. Per frame: 30 s of a flight at ten frames a second, from the first, "
        "with ordinary errors of position and attitude and five reports a second of every vehicle. Published: "
        "i9-13900HX and RTX 3090; those of topology and TTS cannot be the association alone, so the peer to compare "
        "with is the literal one. Faster: CPU median of the fastest peer of this run at the same size by that of the "
        "row.\n\n"
    )
    header = ("method", "variant", "vehicles × tracks", "calls", *TIMES, "faster", "published")
    rows = []
    for t in timings:
        published = f"{LATENCY_MS[t.method]:.2f}" if t.method in LATENCY_MS and t.vehicles == 7 else ""
        values = (t.cpu_mean_ms, t.cpu_median_ms, t.cpu_p95_ms, t.wall_median_ms, t.wall_p95_ms)
        numbers = [f"{value:.3f}" if value < 10.0 else f"{value:.1f}" for value in values]
        size = f"{t.vehicles} × {t.tracks}"
        rows.append([t.method, t.variant, size, str(t.calls), *numbers, _faster(t, timings), published])
    tail = "\n".join(odd) if odd else "All variants of a method gave the same answers on the same inputs."
    return head + markdown_table(header, rows) + f"\n\n{tail}\n"


def _faster(t: MethodTiming, timings: list[MethodTiming]) -> str:
    """How many times faster than the fastest peer; empty for peers and where there is none."""
    what = (t.method, t.vehicles, t.tracks)
    peers = [o.cpu_median_ms for o in timings if (o.method, o.vehicles, o.tracks) == what and o.variant != OURS]
    return f"{min(peers) / t.cpu_median_ms:.1f} ×" if peers and t.variant == OURS else ""
