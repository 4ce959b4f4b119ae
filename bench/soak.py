"""``gcs fly --headless`` for hours beside a fake fleet: does it grow, does it stall, does it lose anything?

    python -m bench.soak --seconds 1200 --rate 500 [--video sitl_logs/curved-road/video.mp4] [-- --flood 1000 ...]

The flight is the command that a user gives, in a process of its own, and the fleet is ``sim.fleet_process``; what
comes after ``--`` goes to the fleet. A video is sent round and round as MPEG-TS over UDP. Every ten seconds the whole
process tree is measured from outside. Writes ``soak.csv`` and ``soak.md``, and ends all that it started.
"""

from __future__ import annotations

import argparse
import csv
import json
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import av
import numpy as np
from numpy.typing import NDArray

from bench.command_line import RESULTS, write_page
from bench.station import FlyingStation, cost_of, mission_text
from gcs.session.event_log import read_events
from infra.files.segment import segments
from infra.markdown import markdown_table
from mavlink.tlog.log import Tlog
from sim.fleet_process import system_ids
from tests.support.ports import free_port

ROUNDS = 10_000
"""Rounds of a film that is sent: for days."""


class VideoLoop:
    """Sends a film round and round until closed."""

    def __init__(self, path: Path, url: str) -> None:
        self._path, self._url = path, url
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._send, daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stop sending."""
        self._stop.set()
        self._thread.join(timeout=5)

    def _send(self) -> None:
        with tempfile.NamedTemporaryFile("w", suffix=".ffconcat") as films:
            films.write("ffconcat version 1.0\n" + f"file '{self._path}'\n" * ROUNDS)
            films.flush()
            with (
                av.open(films.name, format="concat", options={"safe": "0"}) as source,
                av.open(self._url, "w", format="mpegts") as sink,
            ):
                stream = source.streams.video[0]
                outlet = sink.add_stream_from_template(stream)
                start_s = time.monotonic()
                for packet in source.demux(stream):
                    due_s = start_s + float((packet.dts or 0) * packet.time_base)
                    if self._stop.wait(max(0.0, due_s - time.monotonic())):
                        return
                    packet.stream = outlet
                    sink.mux(packet)


POLL_S = 0.05
STALL_S = 0.2


class LogWatch:
    """Follows ``telemetry*.tlog`` of one session folder from the outside, until closed.

    Growth is looked for twenty times a second. A stall is a longer time without it while the watch itself was awake;
    counting begins with the first record.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._size = 0
        self._grown_s = 0.0
        self._polls = 0
        self._worst_s = 0.0
        self.stalls = 0
        """Times of more than 200 ms without growth."""
        self.longest_s = 0.0
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._watch, daemon=True)
        self._thread.start()

    def take_longest_s(self) -> float:
        """Longest time without growth since the last call."""
        worst, self._worst_s = self._worst_s, 0.0
        return worst

    def close(self) -> None:
        """Stop watching."""
        self._stop.set()
        self._thread.join()

    def _watch(self) -> None:
        while not self._stop.wait(POLL_S):
            now = time.monotonic()
            size = sum(path.stat().st_size for path in self._folder.glob("telemetry*.tlog"))
            self._polls += 1
            if size <= self._size:
                continue
            gap_s = now - self._grown_s if self._grown_s else 0.0
            # long, and hardly a poll in it: it was this thread that slept
            if gap_s <= STALL_S or self._polls > 2:
                self._worst_s, self.longest_s = max(self._worst_s, gap_s), max(self.longest_s, gap_s)
                self.stalls += gap_s > STALL_S
            self._size, self._grown_s, self._polls = size, now, 0


HELD = ("processes", "rss_mb", "own_mb", "threads", "descriptors")
COLUMNS = ("t_s", *HELD[:3], "cpu_percent", *HELD[3:], "longest_stall_ms", "stalls")
WARM_UP = 0.1
"""Share of the run after which memory is taken as the beginning's."""
MAX_TOLD = 5
"""Different warnings and alarms that the page quotes."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Run:
    """One soak."""

    samples: Sequence[Mapping[str, float]]
    sent: Mapping[str, Any]
    """Account that ``sim.fleet_process`` printed."""
    recorded: Mapping[int, int]
    """Records by system id."""
    stalls: int
    longest_s: float
    told: Sequence[str]
    """Warnings and alarms of the flight: without troubles of the fleet's, that nothing is authenticated alone."""
    exit_code: int
    last_line: str
    """The flight's last line."""


def report(run: Run, chosen: argparse.Namespace) -> str:
    """The page, in Markdown."""
    sent, lost = _lost(run)
    flight = f"{run.sent['seconds'] / 60:.1f} min, {chosen.vehicles} vehicles, {chosen.rate:g} packets a second"
    rows: list[tuple[str, str]] = [
        ("flight", f"{flight}, video {chosen.video.name}" if chosen.video else f"{flight}, no video"),
        ("fleet's troubles", " ".join(chosen.fleet) or "none"),
        ("packets sent by vehicles", f"{sent:,}"),
        ("not in the recording", f"{lost:,}"),
        ("sender's latest datagram", f"{run.sent['late_ms']:.0f} ms late"),
        ("no growth of the recording for > 200 ms", f"{run.stalls} times, longest {1e3 * run.longest_s:.0f} ms"),
        ("warnings and alarms", "; ".join([f"{len(run.told)}", *sorted(set(run.told))[:MAX_TOLD]])),
        ("exit code of the flight", str(run.exit_code)),
    ]
    if run.samples:
        rows += _costs(run.samples)
    last = f"The flight's last words: `{run.last_line.partition(' recorded in ')[0].rstrip(';')}`"
    return f"# Soak\n\n`python -m bench.soak {_words(chosen)}`\n\n{markdown_table(('', ''), rows)}\n\n{last}\n"


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
    """Growth from a tenth of the run on, and over its second half alone: what fills once is full by then."""
    first, last = float(np.median(held[warm][:6])), float(np.median(held[-6:]))
    late = t >= 0.5 * t[-1]
    per_hour = float(np.polyfit(t[late] / 3600, held[late], 1)[0]) if late.sum() > 2 else float("nan")
    grown = f"{first:.1f} MB after a tenth, {last:.1f} MB at the end: {last / first - 1:+.1%}"
    return f"{grown}; {per_hour:+.1f} MB an hour in the second half"


SAMPLE_S = 10.0
END_S = 60.0
"""Patience with a fleet that ends."""


def mission(vehicles: int) -> str:
    """A mission file for the fleet of ``sim.fleet_process``."""
    return mission_text(system_ids(vehicles)[1:])


def soak(chosen: argparse.Namespace, out: Path) -> Run:
    """Fly, measure, and end everything.

    Args:
        chosen: the command line's.
        out: the table, which is written as it grows.
    """
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="soak-")))
        telemetry, camera = free_port(), free_port()
        more = ["-v", f"udp://127.0.0.1:{camera}"] if chosen.video else []
        flight = FlyingStation(folder, mission(chosen.vehicles), telemetry, more)
        stack.callback(flight.end)
        watch = LogWatch(flight.session)
        stack.callback(watch.close)
        if chosen.video:
            stack.callback(VideoLoop(chosen.video.absolute(), f"udp://127.0.0.1:{camera}?pkt_size=1316").close)
        sender = [sys.executable, "-m", "sim.fleet_process", "--to", f"127.0.0.1:{telemetry}"]
        sender += ["--duration", str(chosen.seconds), "--vehicles", str(chosen.vehicles), "--rate", str(chosen.rate)]
        fleet = subprocess.Popen([*sender, *chosen.fleet], stdout=subprocess.PIPE, text=True)
        stack.callback(_end, fleet)
        samples = _sample(flight, fleet, watch, chosen.seconds, out)
        sent = json.loads(fleet.communicate(timeout=END_S)[0])
        time.sleep(1.0)
        sealed = flight.end()
        logs = [Tlog.open(path) for path in segments(flight.session / "telemetry.tlog")]
        return Run(
            samples=samples,
            sent=sent,
            recorded=Counter(i for log in logs for i in log.index.system_id.tolist()),
            stalls=watch.stalls,
            longest_s=watch.longest_s,
            told=_told(flight.session),
            exit_code=sealed,
            last_line=flight.output.strip().split("\n")[-1],
        )


def _told(session: Path) -> list[str]:
    events, _ = read_events(session / "events.jsonl")
    return [event.text for event in events if event.level in ("warning", "alarm") and event.kind != "text"]


def _sample(
    flight: FlyingStation, fleet: subprocess.Popen[str], watch: LogWatch, seconds: float, out: Path
) -> list[dict[str, float]]:
    samples: list[dict[str, float]] = []
    start = time.monotonic()
    cpu_s, at_s = cost_of(flight.pid).cpu_s, start
    with out.open("w", newline="", encoding="utf-8") as file:
        table = csv.DictWriter(file, COLUMNS)
        table.writeheader()
        while fleet.poll() is None and flight.running and time.monotonic() < start + seconds + END_S:
            time.sleep(min(SAMPLE_S, seconds / 4))
            cost, now = cost_of(flight.pid), time.monotonic()
            row = {name: round(getattr(cost, name), 2) for name in HELD} | {
                "t_s": round(now - start, 1),
                "cpu_percent": round(100 * (cost.cpu_s - cpu_s) / (now - at_s), 1),
                "longest_stall_ms": round(1e3 * watch.take_longest_s()),
                "stalls": watch.stalls,
            }
            cpu_s, at_s = cost.cpu_s, now
            if fleet.poll() is None:
                samples.append(row)
                table.writerow(row)
                file.flush()
    return samples


def _end(process: subprocess.Popen[str]) -> None:
    if process.poll() is None:
        process.send_signal(signal.SIGINT)
        process.wait(timeout=END_S)


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
    run = soak(chosen, chosen.out / f"{chosen.name}.csv")
    write_page(chosen.out / f"{chosen.name}.md", report(run, chosen))


if __name__ == "__main__":
    main()
