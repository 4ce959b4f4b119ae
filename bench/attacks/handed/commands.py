"""Attacks by what lies in a command's way: a text among flights, secrets, a poor terminal, few descriptors, kills."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import time
from collections.abc import Callable
from pathlib import Path

from bench.attacks.report import AttackRow
from bench.attacks.run import Options
from bench.ports import free_port
from bench.station import mission_text

SECRET = "Hush0xBEEF78"
MOST_S = 120.0
FEW = 36
YOUNG_S = 61.0
"""Age of a hidden folder that no command works on any more, s: a younger one may be another command's."""
FILMED = Path("sitl_logs/curved-road")
"""A recording with a film, whose export takes long enough to be killed."""
Case = Callable[[Options, Path], tuple[bool, str]]


def _run(folder: Path, *words: str, **more: str) -> str:
    """Output of a command that has ``more`` in its environment."""
    done = subprocess.run(
        words,
        cwd=folder,
        env=os.environ | {"HOME": str(folder)} | more,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        timeout=MOST_S,
        check=False,
    )
    return done.stdout.decode(errors="replace")


def _last(said: str) -> str:
    return next((line for line in said.splitlines()[::-1] if line.startswith("gcs:")), "nothing told")


def _text_among_flights(options: Options, folder: Path) -> tuple[bool, str]:
    with socket.create_server(("127.0.0.1", 0)) as server:
        (folder / "README.txt").write_text("http://{}:{}/flight.tlog\n".format(*server.getsockname()))
        said = _run(folder, *options.gcs, "batch", "run", "README.txt", "-o", "out")
        server.setblocking(False)
        try:
            server.accept()
        except BlockingIOError:
            return "--list" in said, f"not fetched; {said.splitlines()[0]}"
    return False, "what it names is fetched"


def _secret_of_a_batch(options: Options, folder: Path) -> tuple[bool, str]:
    address = f"http://me:{SECRET}@127.0.0.1:{free_port(socket.SOCK_STREAM)}/a.tlog?sig={SECRET}"
    said = _run(folder, *options.gcs, "--log-file", "log", "batch", "run", address, "-o", "out", "--retries", "0")
    said += _run(folder, *options.gcs, "batch", "report", "out")
    found = [path.name for path in folder.rglob("*") if path.is_file() and SECRET.encode() in path.read_bytes()]
    found += ["what is printed"] * (SECRET in said)
    return not found, f"in {', '.join(found)}" if found else _last(said)


def _few_descriptors(options: Options, folder: Path) -> tuple[bool, str]:
    (folder / "mission.toml").write_text(mission_text([11]))
    fly = ("fly", "mission.toml", "-l", f"udpin:127.0.0.1:{free_port()}", "--headless", "--duration", "1")
    said = _run(folder, "prlimit", f"--nofile={FEW}", *options.gcs, *fly)
    return "may be open" in said and not [*folder.glob("sessions/*")], _last(said)


def _dumb_terminal(options: Options, folder: Path) -> tuple[bool, str]:
    session = str(options.recording.absolute())
    said = _run(folder, "script", "-qec", " ".join([*options.gcs, "replay", session]), "/dev/null", TERM="dumb")
    return "TERM=dumb" in said, _last(said.replace(session, "FLIGHT"))


def _killed_export(options: Options, folder: Path) -> tuple[bool, str]:
    session = str(FILMED.absolute())
    for number in (signal.SIGTERM, signal.SIGKILL):
        words = [*options.gcs, "export", session, "-o", str(folder / "a.mp4")]
        before = {*folder.glob(".aside-*")}
        export = subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        until_s = time.monotonic() + MOST_S
        while {*folder.glob(".aside-*")} <= before and time.monotonic() < until_s and export.poll() is None:
            time.sleep(0.05)
        export.send_signal(number)
        export.wait()
    left = len([*folder.glob(".aside-*")])
    time.sleep(YOUNG_S)
    _run(folder, *options.gcs, "export", session, "-o", "a.geojson")
    names = sorted(path.name for path in folder.iterdir() if path.name.startswith((".", "a")))
    return left > 0 and names == ["a.geojson"], f"{left} left by two kills; after the next export: {', '.join(names)}"


CASES: dict[str, Case] = {
    "a README.txt among flights has an address": _text_among_flights,
    "a password and a signature in a batch's address": _secret_of_a_batch,
    f"{FEW} descriptors": _few_descriptors,
    "TERM=dumb": _dumb_terminal,
    "exports that SIGTERM and SIGKILL end": _killed_export,
}


def hostile_surroundings(options: Options) -> list[AttackRow]:
    """Rows of the attacks by what lies in the way of commands, one for each of ``CASES``."""
    rows = []
    for k, (name, play) in enumerate(CASES.items()):
        folder = options.folder / f"command-{k}"
        folder.mkdir()
        held, note = play(options, folder)
        rows.append(AttackRow(attack="commands", case=name, held=held, note=note.replace(f"{folder}/", "")[:200]))
    return rows
