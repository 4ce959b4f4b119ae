"""``gcs fly --headless`` for hours beside a fake fleet: does it grow, does it stall, does it lose anything?

    python -m bench.soak --seconds 1200 --rate 500 [--video sitl_logs/curved-road/video.mp4] [-- --flood 1000 ...]

The flight is the command that a user gives, in a process of its own, and the fleet is ``sim.fleet_process``; what
comes after ``--`` goes to the fleet. A video is sent round and round as MPEG-TS over UDP. Every ten seconds the whole
process tree is measured from outside. Writes ``soak.csv``, ``soak.png`` and ``soak.md``, and ends all that it started.
"""

from __future__ import annotations

import argparse
import csv
import json
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.drawing import pyplot, read_rows
from bench.ports import free_port
from bench.process_tree import cost_of
from bench.receiving.log_watch import LogWatch
from bench.video.video_loop import VideoLoop
from sim.fleet_process import system_ids

_HELD = ("processes", "rss_mb", "own_mb", "cpu_percent", "threads", "descriptors")
COLUMNS = ("t_s", *_HELD, "records", "longest_stall_ms", "stalls")
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


RESULTS = Path("bench-results")
SAMPLE_S = 10.0
START_S, END_S = 60.0, 60.0
"""Patience with a flight that begins, and with one that seals its recording."""
FLY = (sys.executable, "-c", "from gcs.cli.app import main; main()", "fly")
CAMERA = "[camera]\nwidth = 1920\nheight = 1080\nfx = 1200.0\nfy = 1200.0\ncx = 960.0\ncy = 540.0\n"


def mission(vehicles: int) -> str:
    """A mission file for the fleet of ``sim.fleet_process``."""
    uav, *ugvs = system_ids(vehicles)
    return f"[uav]\nsystem_id = {uav}\n" + "".join(f"[[ugv]]\nsystem_id = {i}\n" for i in ugvs) + CAMERA


def soak(
    seconds: float,
    rate: float,
    vehicles: int,
    video: Path | None,
    fleet_words: Sequence[str],
    out: Path,
) -> Run:
    """Fly, measure, and end everything.

    Args:
        seconds: how long the fleet sends.
        rate: its packets a second.
        vehicles: how many send.
        video: sent round and round, None for no camera.
        fleet_words: further arguments of ``sim.fleet_process``.
        out: the table, which is written as it grows.
    """
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="soak-")))
        (folder / "mission.toml").write_text(mission(vehicles))
        telemetry, camera = free_port(), free_port()
        words = [*FLY, folder / "mission.toml", "--headless", "--sessions", folder / "sessions"]
        words += ["-l", f"udpin:127.0.0.1:{telemetry}"]
        words += ["-v", f"udp://127.0.0.1:{camera}"] if video else []
        output = stack.enter_context((folder / "output.txt").open("w+"))
        flight = subprocess.Popen([*map(str, words)], stdout=output, stderr=subprocess.STDOUT)
        stack.callback(_end, flight)
        watch = LogWatch(_session(folder / "sessions", flight, folder / "output.txt"))
        stack.callback(watch.close)
        if video:
            stack.callback(VideoLoop(video, f"udp://127.0.0.1:{camera}?pkt_size=1316").close)
        sender = [sys.executable, "-m", "sim.fleet_process", "--to", f"127.0.0.1:{telemetry}"]
        sender += ["--duration", str(seconds), "--vehicles", str(vehicles), "--rate", str(rate)]
        fleet = subprocess.Popen([*sender, *fleet_words], stdout=subprocess.PIPE, text=True)
        stack.callback(_end, fleet)
        samples = _sample(flight, fleet, watch, seconds, out)
        sent = json.loads(fleet.communicate(timeout=END_S)[0])
        time.sleep(1.0)
        sealed = _end(flight)
        watch.read()
        output.seek(0)
        return Run(
            samples=samples,
            sent=sent,
            recorded=dict(watch.recorded),
            stalls=watch.stalls,
            longest_s=watch.longest_s,
            exit_code=sealed,
            last_line=output.read().strip().split("\n")[-1],
        )


def _sample(
    flight: subprocess.Popen[bytes], fleet: subprocess.Popen[str], watch: LogWatch, seconds: float, out: Path
) -> list[dict[str, float]]:
    samples: list[dict[str, float]] = []
    start = time.monotonic()
    cpu_s, at_s = cost_of(flight.pid).cpu_s, start
    with out.open("w", newline="", encoding="utf-8") as file:
        table = csv.DictWriter(file, COLUMNS)
        table.writeheader()
        while fleet.poll() is None and flight.poll() is None and time.monotonic() < start + seconds + END_S:
            time.sleep(min(SAMPLE_S, seconds / 4))
            watch.read()
            cost, now = cost_of(flight.pid), time.monotonic()
            row = {
                "t_s": round(now - start, 1),
                "processes": cost.processes,
                "rss_mb": round(cost.rss_mb, 2),
                "own_mb": round(cost.own_mb, 2),
                "cpu_percent": round(100 * (cost.cpu_s - cpu_s) / (now - at_s), 1),
                "threads": cost.threads,
                "descriptors": cost.descriptors,
                "records": sum(watch.recorded.values()),
                "longest_stall_ms": round(1e3 * watch.take_longest_s()),
                "stalls": watch.stalls,
            }
            cpu_s, at_s = cost.cpu_s, now
            if fleet.poll() is None:
                samples.append(row)
                table.writerow(row)
                file.flush()
    return samples


def _session(folder: Path, flight: subprocess.Popen[bytes], output: Path) -> Path:
    until = time.monotonic() + START_S
    while time.monotonic() < until:
        if found := list(folder.glob("*/telemetry.tlog")):
            time.sleep(1.0)
            return found[0].parent
        if flight.poll() is not None:
            break
        time.sleep(0.1)
    raise RuntimeError(f"the flight did not begin: {output.read_text()}")


def _end(process: subprocess.Popen[bytes] | subprocess.Popen[str]) -> int:
    """As an operator ends it; killed when that does not help."""
    if process.poll() is None:
        process.send_signal(signal.SIGINT)
    try:
        return process.wait(timeout=END_S)
    except subprocess.TimeoutExpired:
        process.kill()
        return process.wait()


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m bench.soak", description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--seconds", type=float, default=1200.0)
    parser.add_argument("--rate", type=float, default=500.0, help="packets a second")
    parser.add_argument("--vehicles", type=int, default=20)
    parser.add_argument("--video", type=Path)
    parser.add_argument("--out", type=Path, default=RESULTS, help="folder")
    parser.add_argument("--name", default="soak", help="of the files")
    parser.add_argument("fleet", nargs="*", help="after --: for sim.fleet_process")
    chosen = parser.parse_args()
    chosen.out.mkdir(parents=True, exist_ok=True)
    table, page = chosen.out / f"{chosen.name}.csv", chosen.out / f"{chosen.name}.md"
    run = soak(chosen.seconds, chosen.rate, chosen.vehicles, chosen.video, chosen.fleet, table)
    drawn = draw(table, table.with_suffix(".png"))
    text = report(run, chosen, plot=f"{chosen.name}.png" if drawn else "")
    page.write_text(text, encoding="utf-8")
    print(text)


if __name__ == "__main__":
    main()
