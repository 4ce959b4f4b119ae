"""Times until a key shows and until the first picture is there, and what the screens cost.

    python -m bench.screens.speed
    python -m bench.screens.speed --keys 100 --write bench/results/screens_speed.md

The program runs in a pseudo-terminal, on copies of a bundled recording and beside a simulated 1080p flight. A key
counts as shown when the terminal has got the row that it picks. Shares are of one core: of the main thread, which
draws, and of the whole program, which also decodes.
"""

from __future__ import annotations

import argparse
import os
import random
import re
import shutil
import subprocess
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from bench.command_line import RESULTS, write_page
from bench.screens.station import DOWN, RECORDING, SETTLE_S, TerminalSession, replaying
from infra.markdown import markdown_table
from tests.support.command_line import GCS
from tests.support.ports import free_port

WIDE, DENSE = (120, 40), (160, 45)
KEY_S, CPU_S = 0.4, 15.0
"""Time between two keys, about, and for which the processor is watched, s."""
FASTER_FPS, FASTER_S = 15, 20.0
PICKED = re.compile(r"▸(\S+)")
UP = b"\x1b[A"


@dataclass(slots=True)
class Figures:
    """Times and shares of a core that were measured, by case, of all turns."""

    key_ms: dict[str, list[float]] = field(default_factory=dict)
    drawing: dict[str, list[float]] = field(default_factory=dict)
    """Share of a core that the main thread takes."""
    whole: dict[str, list[float]] = field(default_factory=dict)
    first_s: list[float] = field(default_factory=list)


def measure_keys(session: TerminalSession, keys: int, case: str, figures: Figures) -> None:
    """Pick the one vehicle and the other."""
    rng = random.Random(7)
    for k in range(keys + 1):
        before = PICKED.findall(session.catch_up())
        pressed_s = time.monotonic()
        session.press(UP if k % 2 else DOWN)

        def moved(text: str, before: list[str] = before) -> bool:
            return PICKED.findall(text) != before

        shown_s = session.wait_until(moved, limit_s=10.0)
        if k:  # before the first nothing is picked
            figures.key_ms.setdefault(case, []).append(1e3 * (shown_s - pressed_s))
        time.sleep(KEY_S * rng.uniform(0.7, 1.3))


def measure_cpu(session: TerminalSession, case: str, figures: Figures, seconds: float = CPU_S) -> None:
    """Watch the processor."""
    before, start_s = session.cpu_s(), time.monotonic()
    time.sleep(seconds)
    after, lasted_s = session.cpu_s(), time.monotonic() - start_s
    figures.drawing.setdefault(case, []).append((after[0] - before[0]) / lasted_s)
    figures.whole.setdefault(case, []).append((after[1] - before[1]) / lasted_s)


def measure_replay(recording: Path, keys: int, figures: Figures) -> None:
    """A recording of 10 frames a second, paused and playing."""
    with replaying(recording, WIDE) as session:
        shown_s = session.wait_until(lambda text: "▀" in text)
        figures.first_s.append(shown_s - session.started_s)
        session.wait_analysed()
        session.go_to_start(playing=False)
        measure_keys(session, keys, "paused", figures)
        measure_cpu(session, "idle", figures)
        session.go_to_start(playing=True)
        measure_cpu(session, "replay, 10 frames/s, 120×40", figures)
        session.go_to_start(playing=True)
        measure_keys(session, keys, "playing", figures)


def measure_faster(recording: Path, figures: Figures) -> None:
    """A recording of 15 frames a second on a larger screen."""
    with replaying(recording, DENSE) as session:
        session.wait_until(lambda text: "▀" in text)
        session.wait_analysed()
        session.go_to_start(playing=True)
        measure_cpu(session, f"replay, {FASTER_FPS} frames/s, 160×45", figures, FASTER_S - 2 * SETTLE_S)


def measure_flight(keys: int, figures: Figures) -> None:
    """A simulated flight with its video of 1920 × 1080."""
    links, video = free_port(), free_port()
    with tempfile.TemporaryDirectory() as folder:
        mission = shutil.copy(RECORDING / "session.toml", folder)
        stream = f"udp://127.0.0.1:{video}"
        flight = [*GCS, "fly", mission, "-l", str(links), "-v", stream, "--sessions", f"{folder}/sessions"]
        simulator = [*GCS, "sim", "run", "curved-road", "--live", "--telemetry", f"udpout:127.0.0.1:{links}"]
        with TerminalSession([*map(str, flight), "--ui", "graphics=blocks"], WIDE) as session:
            session.wait_until(lambda text: "● REC" in text)
            with TerminalSession([*simulator, "--stream", stream, "--truth", f"{folder}/truth.csv"], WIDE):
                session.wait_until(lambda text: "▀" in text)
                time.sleep(SETTLE_S)
                measure_cpu(session, "live, 10 frames/s of 1080p, 120×40", figures, CPU_S / 2)
                measure_keys(session, min(keys, 40), "beside a 1080p flight", figures)


def simulate(folder: Path) -> Path:
    """A recording with more frames a second, as every checkout can replay it."""
    scenario = folder / "faster.toml"
    scenario.write_text(f'name = "faster"\nfps = {FASTER_FPS}.0\nduration_s = {FASTER_S}\n')
    subprocess.run([*GCS, "sim", "run", scenario, "--video", "-o", folder / "faster"], check=True, capture_output=True)
    return folder / "faster"


def table(figures: Figures) -> str:
    """Table of the figures, in Markdown."""
    rows = []
    for case, taken_ms in figures.key_ms.items():
        for name, share, most_ms in (("median", 0.5, 50), ("p99", 0.99, 120)):
            rows.append([f"key to screen, {case}, {name}", f"{np.quantile(taken_ms, share):.0f} ms", f"≤ {most_ms} ms"])
    goals = {"idle": "≤ 2 %", "live": "≤ 10 %", "replay, 10": "≤ 15 %", "replay, 15": "≤ 50 %"}
    for case, shares in figures.drawing.items():
        goal = next(text for start, text in goals.items() if case.startswith(start))
        rows.append([f"drawing, {case}", f"{np.median(shares):.1%}", goal])
        rows.append([f"the whole program, {case}", f"{np.median(figures.whole[case]):.1%}", ""])
    rows.append(["start to first picture", f"{np.median(figures.first_s):.2f} s", "≤ 1.5 s"])
    return markdown_table(["", "now", "goal"], rows)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--keys", type=int, default=50, help="keys of each case and turn (%(default)s)")
    parser.add_argument("--turns", type=int, default=2, help="times that everything is measured (%(default)s)")
    parser.add_argument("--write", type=Path, default=RESULTS / "screens_speed.md")
    options = parser.parse_args()
    figures = Figures()
    with tempfile.TemporaryDirectory() as folder:
        faster = simulate(Path(folder))
        for turn in range(options.turns):
            measure_replay(RECORDING, options.keys, figures)
            measure_faster(faster, figures)
            measure_flight(options.keys, figures)
            print(f"turn {turn + 1}\n{table(figures)}\n", flush=True)
    load = f"Load average at the end {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores."
    parts = ("# How soon keys show, and what the screens cost", (__doc__ or "").strip(), load, table(figures))
    write_page(options.write, "\n\n".join(parts) + "\n")


if __name__ == "__main__":
    main()
