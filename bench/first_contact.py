"""First contact: from an empty folder to names, with nothing configured, against fleets that send on their own.

    python -m bench.first_contact --film /data/autopilot_film

A real ``gcs fly`` is started in an empty folder while a fleet already sends, once on a terminal, where the keys are
pressed that its start screen asks for, and once with ``-l`` and ``-v`` alone. What it recorded is held against the
truth: seconds from the command to the first right name, and names that were wrong. The ports 14550 and 5600 have to be
free.

The fleets: ``demo``, which ``gcs demo --live`` sends; ``strangers``, four of ours and our UAV, with two aircraft in the
air that are none of ours; and ``film``, a recorded flight of real autopilots whose film was not kept: its packets
go out as they came, dated anew, and its frames show their own numbers, by which the recorded boxes are given back.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import pty
import re
import select
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from unittest.mock import patch

import av
import cv2
import numpy as np
from numpy.typing import NDArray
from pymavlink.dialects.v20 import ardupilotmega as dialect

from bench.station import FLY
from gcs.cli.start import main as gcs
from gcs.report.score import match_files
from gcs.session.frame_tables import read_detections, read_times
from infra.markdown import markdown_table
from infra.session_format import FRAMES, IDENTITY, TRUTH
from mavlink.protocol.encoder import COPTER
from mavlink.tlog.log import Tlog
from sim.render.broadcast import DATAGRAM, TIME_BASE
from sim.world.presets import nominal
from sim.world.scenario_file import save_scenario
from vision.detect.detections import Detections

TELEMETRY, VIDEO = 14550, 5600
WAIT_S, NAMES_S, SEAL_S = 40.0, 40.0, 60.0
"""Patience with the start screen; time that is flown; patience with the end of a flight."""
OURS = replace(nominal(), ground=replace(nominal().ground, vehicles=4))
STRANGERS = (21, 22)
"""System ids of others' aircraft."""
STATIONS = frozenset({252, 253, 254, 255})
"""System ids of programs in the recorded log."""
DELAYS_S = np.arange(0.0, 1.0, 0.02)
"""From the exposure of a frame to its stamp."""
BITS, CELL = 12, 40
"""Size of a frame's number in its picture."""
SIZE = (1280, 720)
READY = re.compile(rb"enter flies")
SEES = re.compile(rb"heard at udp|offered by the UAV")


@dataclass(frozen=True, slots=True, kw_only=True)
class Contact:
    """One flight from an empty folder."""

    fleet: str
    way: str
    keys: str
    """Keys that were pressed."""
    first_s: float
    """From the command to the first right name, NaN never."""
    named: int
    """Names given to boxes."""
    wrong: int
    """Of these on another vehicle, or on what is none of ours."""
    wrong_words: str


@contextlib.contextmanager
def simulated(folder: Path, scenario: str, strangers: Sequence[int] = ()) -> Iterator[Path]:
    """A fleet that ``gcs sim run --live`` sends, from the time on when its film runs; its truth by time."""
    truth = folder / "live.csv"
    words = ["sim", "run", scenario, "--live", "--duration", "170", "--truth", str(truth)]
    with subprocess.Popen([*FLY, *words], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as fleet:
        done = threading.Event()
        others = [threading.Thread(target=_fly_by, args=(i, done)) for i in strangers]
        try:
            while not (truth.is_file() and truth.stat().st_size > 1000):
                time.sleep(0.1)
            for other in others:
                other.start()
            yield truth
        finally:
            done.set()
            fleet.terminate()


def _fly_by(system_id: int, done: threading.Event) -> None:
    """An aircraft of others, 300 m away and 60 m up: it beats and reports its place."""
    encoder = dialect.MAVLink(None, srcSystem=system_id, srcComponent=1)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as outlet:
        for turn in range(100_000):
            north, east = round(OURS.latitude_deg * 1e7) + 27_000, round(OURS.longitude_deg * 1e7) + 600 * turn
            place = north + 5_000 * system_id, east, round(OURS.altitude_m * 1e3) + 60_000, 60_000
            messages = [dialect.MAVLink_global_position_int_message(60_000 + 200 * turn, *place, 0, 500, 0, 9000)]
            messages += [dialect.MAVLink_heartbeat_message(COPTER, 3, 128, 4, 4, 3)] if turn % 5 == 0 else []
            for message in messages:
                outlet.sendto(bytes(message.pack(encoder)), ("127.0.0.1", TELEMETRY))
                encoder.seq = (encoder.seq + 1) % 256
            if done.wait(0.2):
                return


@contextlib.contextmanager
def recorded(session: Path) -> Iterator[Path]:
    """A recorded flight, sent again with its own timing; its truth by time."""
    done = threading.Event()
    frames_us = read_times(session / FRAMES.name).times_us
    log = Tlog.open(session / "telemetry.tlog")
    start_us = time.time_ns() // 1000 + 500_000 - log.packet(0).t_us
    senders = [threading.Thread(target=send, args=(session, start_us, done)) for send in (_send_log, _send_frames)]
    with tempfile.TemporaryDirectory() as folder:
        truth = Path(folder) / "live.csv"
        with (session / TRUTH.name).open() as rows, truth.open("w") as out:
            out.write(next(rows).replace("frame", "time_us"))
            for row in rows:
                frame, rest = row.split(",", 1)
                out.write(f"{frames_us[int(frame)] + start_us},{rest}")
        for sender in senders:
            sender.start()
        try:
            time.sleep(6.0)  # its film begins later than its telemetry
            yield truth
        finally:
            done.set()
            for sender in senders:
                sender.join()


def _send_log(session: Path, start_us: int, done: threading.Event) -> None:
    log, parser = Tlog.open(session / "telemetry.tlog"), dialect.MAVLink(None)
    encoder = dialect.MAVLink(None)
    with contextlib.ExitStack() as stack:
        outlets: dict[int, socket.socket] = {}
        for number in range(len(log.index.t_us)):
            packet = log.packet(number)
            if packet.system_id in STATIONS:
                continue
            raw = packet.raw
            if packet.message_id == dialect.MAVLINK_MSG_ID_SYSTEM_TIME:
                message = parser.decode(bytearray(raw))
                message.time_unix_usec += start_us
                encoder.srcSystem, encoder.srcComponent = packet.system_id, packet.component_id
                encoder.seq = message.get_seq()
                raw = bytes(message.pack(encoder))
            if done.wait(max(0.0, (packet.t_us + start_us) * 1e-6 - time.time())):
                return
            if packet.system_id not in outlets:
                outlet = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
                outlets[packet.system_id] = stack.enter_context(outlet)
            outlets[packet.system_id].sendto(raw, ("127.0.0.1", TELEMETRY))


def _send_frames(session: Path, start_us: int, done: threading.Event) -> None:
    frames_us = read_times(session / FRAMES.name).times_us + start_us
    url = f"udp://127.0.0.1:{VIDEO}?pkt_size={DATAGRAM}"
    with av.open(url, "w", format="mpegts", options={"flush_packets": "1"}) as container:
        stream = container.add_stream("libx264", rate=6)
        stream.width, stream.height, stream.pix_fmt = *SIZE, "yuv420p"
        stream.codec_context.time_base = TIME_BASE
        stream.options = {"preset": "ultrafast", "tune": "zerolatency", "g": "6", "threads": "1"}
        for number, t_us in enumerate(frames_us.tolist()):
            if done.wait(max(0.0, t_us * 1e-6 - time.time())):
                return
            frame = av.VideoFrame.from_ndarray(numbered(number), format="bgr24")
            frame.pts, frame.time_base = round((t_us - frames_us[0]) * 1e-6 / TIME_BASE), TIME_BASE
            for packet in stream.encode(frame):
                container.mux(packet)


def numbered(number: int) -> NDArray[np.uint8]:
    """A grey picture with its number in black and white squares."""
    image = np.full((SIZE[1], SIZE[0], 3), 128, dtype=np.uint8)
    for bit in range(BITS):
        image[:CELL, bit * CELL : (bit + 1) * CELL] = 255 * (number >> bit & 1)
    return image


class RecordedBoxes:
    """A detector that gives back what was found in the frame whose number it reads."""

    def __init__(self, session: Path) -> None:
        self._boxes = read_detections(session / "detections.csv")

    def detect(self, image: NDArray[np.uint8], *, gsd_m: float | None = None) -> Detections:
        """The boxes of a numbered frame; whatever its scale."""
        small = cv2.resize(image, SIZE)[CELL // 2, CELL // 2 : BITS * CELL : CELL].mean(axis=-1) > 128
        return self._boxes.at(sum(1 << bit for bit in np.flatnonzero(small).tolist()))


def flown(folder: Path, command: Sequence[str], words: Sequence[str], *, screen: bool) -> tuple[float, str]:
    """Fly from an empty folder; when the command was given, Unix seconds, and the keys that were pressed."""
    home = {name: str(folder / "home") for name in ("HOME", "XDG_CONFIG_HOME", "XDG_DATA_HOME")}
    env = os.environ | home | {"TERM": "xterm-256color", "COLUMNS": "120", "LINES": "40"}
    env["PYTHONPATH"] = str(Path(__file__).parents[1])  # for the flight that is given recorded boxes
    began_s, keys = time.time(), ""
    ours, theirs = pty.openpty() if screen else (-1, subprocess.DEVNULL)
    with (folder / "output.txt").open("wb") as output:
        out = theirs if screen else output
        flight = subprocess.Popen([*command, "fly", *words], cwd=folder, env=env, stdin=theirs, stdout=out, stderr=out)
        try:
            end_s, seen = time.monotonic() + WAIT_S + NAMES_S * (not screen), b""
            while screen and time.monotonic() < end_s and flight.poll() is None:
                seen += _read(ours)
                if not keys and READY.search(seen) and SEES.search(seen):
                    os.write(ours, b"\r")
                    keys, end_s = "enter", time.monotonic() + NAMES_S
            if not screen:
                with contextlib.suppress(subprocess.TimeoutExpired):
                    flight.wait(end_s - time.monotonic())
        finally:
            flight.send_signal(signal.SIGTERM)
            drain = threading.Thread(target=_drain, args=(ours, flight))
            drain.start()
            flight.wait(SEAL_S)
            drain.join()
    return began_s, keys


def _read(terminal: int) -> bytes:
    return os.read(terminal, 1 << 16) if select.select([terminal], [], [], 0.1)[0] else b""


def _drain(terminal: int, flight: subprocess.Popen[bytes]) -> None:
    while terminal >= 0 and flight.poll() is None:
        _read(terminal)


def contact(fleet: str, way: str, folder: Path, live: Path, began_s: float, keys: str) -> Contact:
    """Hold what a flight recorded against the truth by time."""
    none = Contact(fleet=fleet, way=way, keys=keys or "none", first_s=np.nan, named=0, wrong=0, wrong_words="")
    sessions = list((folder / "sessions").glob("*"))
    if not sessions or not (sessions[0] / IDENTITY.name).is_file():
        return replace(none, wrong_words=(folder / "output.txt").read_text(errors="replace")[-200:])
    frames_us = read_times(sessions[0] / FRAMES.name).times_us
    truth = sessions[0] / "truth-live.csv"
    delay_us = _write_truth(live, frames_us, _seen(sessions[0]), truth)
    matched, _ = match_files(truth, sessions[0] / IDENTITY.name)
    named = matched.named > 0
    right, wrong = named & (matched.named == matched.truth), named & (matched.named != matched.truth)
    first_s = float(matched.time_us[right].min()) * 1e-6 - began_s if right.any() else np.nan
    pairs = {(int(t), int(n)) for t, n in zip(matched.truth[wrong], matched.named[wrong], strict=True)}
    words = ", ".join(f"{t} called {n}" for t, n in sorted(pairs)[:4])
    for row in np.flatnonzero(wrong).tolist():
        at_s, sure = matched.time_us[row] * 1e-6 - began_s, matched.confidence[row]
        print(f"  {at_s:.1f} s: {matched.truth[row]} called {matched.named[row]} at {sure:.2f}", file=sys.stderr)
    print(f"{fleet} {way}: stamps {delay_us * 1e-6:.2f} s after the truth, {len(frames_us)} frames", file=sys.stderr)
    return replace(
        none, first_s=first_s, named=int(named.sum()), wrong=int(wrong.sum()), wrong_words=words if wrong.any() else ""
    )


def _seen(session: Path) -> NDArray[np.float64]:
    """(n, 3) frame and centre of each box that was seen."""
    rows = np.loadtxt(session / "detections.csv", delimiter=",", skiprows=1, usecols=(0, 1, 2, 6), ndmin=2)
    return np.asarray(rows[rows[:, 3] > 0.5, :3])


def _write_truth(live: Path, frames_us: NDArray[np.int64], seen: NDArray[np.float64], out: Path) -> int:
    """Write the truth by frames, at the delay at which most boxes lie on true ones; µs."""
    lines = live.read_text().splitlines()[1:]
    at_us = np.array([int(line.split(",", 1)[0]) for line in lines])
    rows = [line.split(",", 1)[1] for line in lines]
    centre = np.array([[float(x) for x in row.split(",")[:2]] for row in rows])
    times_us = np.unique(at_us)

    def moment(frame_us: NDArray[np.int64], delay_s: float) -> NDArray[np.int64]:
        place = np.searchsorted(times_us, frame_us - round(delay_s * 1e6)).clip(1, len(times_us) - 1)
        later = times_us[place] + times_us[place - 1] < 2 * (frame_us - round(delay_s * 1e6))
        return np.asarray(times_us[place - 1 + later])

    some = seen[:: max(len(seen) // 200, 1)]

    def distance(delay_s: float) -> float:
        then = moment(frames_us[some[:, 0].astype(int)], delay_s)
        gaps = [np.hypot(*(centre[at_us == t] - box[1:]).T).min() for t, box in zip(then, some, strict=True)]
        return float(np.median(gaps))

    delay_s = float(min(DELAYS_S, key=distance))
    with out.open("w") as file:
        file.write("frame,cx,cy,w,h,angle,system_id\n")
        for frame, t in enumerate(moment(frames_us, delay_s).tolist()):
            low, high = np.searchsorted(at_us, (t, t + 1))
            file.writelines(f"{frame},{rows[k]}\n" for k in range(low, high))
    return round(delay_s * 1e6)


def main() -> None:
    """Run the command."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--film", type=Path, help="recorded flight of the fleet film")
    parser.add_argument("--fleets", nargs="*", default=["demo", "strangers", "film"])
    parser.add_argument("--ways", nargs="*", default=["screen", "headless"])
    parser.add_argument("--as-gcs", nargs=argparse.REMAINDER, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.as_gcs is not None:
        sys.argv = ["gcs", *options.as_gcs]
        with patch("gcs.flight.plan.open_mission_detector", lambda *_, **__: RecordedBoxes(options.film)):
            gcs()
        return
    again = (sys.executable, "-m", "bench.first_contact", "--film", str(options.film), "--as-gcs")
    rows = []
    for fleet in options.fleets:
        for way in options.ways:
            with tempfile.TemporaryDirectory() as name:
                (folder := Path(name) / "empty").mkdir()
                with _fleet(fleet, Path(name), options.film) as live:
                    words = [] if way == "screen" else ["--headless", "-l", f"{TELEMETRY}", "-v", f"udp://:{VIDEO}"]
                    command = again if fleet == "film" else FLY
                    began_s, keys = flown(folder, command, words, screen=way == "screen")
                    found = contact(fleet, way, folder, live, began_s, keys)
            print(found, file=sys.stderr, flush=True)
            rows.append(found)
    heads = ("fleet", "way", "keys", "s to the first right name", "names", "wrong", "which")
    print(
        markdown_table(
            heads,
            [[r.fleet, r.way, r.keys, f"{r.first_s:.1f}", f"{r.named}", f"{r.wrong}", r.wrong_words] for r in rows],
        )
    )


def _fleet(name: str, folder: Path, film: Path | None) -> contextlib.AbstractContextManager[Path]:
    if name == "demo":
        return simulated(folder, "curved-road")
    if name == "strangers":
        save_scenario(OURS, folder / "strangers.toml")
        return simulated(folder, str(folder / "strangers.toml"), STRANGERS)
    if film is None:
        raise SystemExit("--film FOLDER is needed for the fleet film")
    return recorded(film)


if __name__ == "__main__":
    main()
