"""Folders of others under ``sessions/`` when a flight starts: links out of it, pipes, and files that are too much."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

from bench.attacks.report import AttackRow
from bench.attacks.run import Options
from bench.ports import free_port
from bench.station import FlyingStation, StationError, mission_text

PATIENCE_S = 25.0
MOST_S = 8.0
"""A start may take so much longer than one without any old session."""
VICTIM = "must stay as it is\n"
INTERRUPTED = 'ugv = []\n[uav]\nsystem_id = 1\n[session]\nformat = 1\nprogram = "x"\nstarted = 2026-01-01T00:00:00Z\n'
NESTED = 50_000
SPARSE_BYTES = 3_000_000_000


def _link_new(folder: Path, victim: Path) -> None:
    (folder / "session.toml").write_text(INTERRUPTED)
    (folder / "telemetry.tlog").touch()
    (folder / "session.toml.new").symlink_to(victim)


def _link_session(folder: Path, victim: Path) -> None:
    victim.write_text(INTERRUPTED)
    (folder / "telemetry.tlog").touch()
    (folder / "session.toml").symlink_to(victim)


def _fifo_session(folder: Path, victim: Path) -> None:
    os.mkfifo(folder / "session.toml")


def _fifo_log(folder: Path, victim: Path) -> None:
    (folder / "session.toml").write_text(INTERRUPTED)
    os.mkfifo(folder / "telemetry.tlog")


def _fifo_table(folder: Path, victim: Path) -> None:
    (folder / "session.toml").write_text(INTERRUPTED)
    (folder / "telemetry.tlog").touch()
    for name in ("refused.csv", "senders.csv", "clock.csv", "frames.csv"):
        os.mkfifo(folder / name)


def _nested(folder: Path, victim: Path) -> None:
    (folder / "session.toml").write_text("a = " + "[" * NESTED + "]" * NESTED + "\n")


def _huge(folder: Path, victim: Path) -> None:
    (folder / "session.toml").write_text(INTERRUPTED)
    for name in ("session.toml", "telemetry.tlog"):
        os.truncate(folder / name, SPARSE_BYTES) if (folder / name).exists() else _sparse(folder / name)


def _sparse(path: Path) -> None:
    path.touch()
    os.truncate(path, SPARSE_BYTES)


def _device(folder: Path, victim: Path) -> None:
    (folder / "session.toml").symlink_to("/dev/zero")


def _link_folder(folder: Path, victim: Path) -> None:
    elsewhere = victim.parent / "elsewhere"
    elsewhere.mkdir()
    (elsewhere / "session.toml").write_text(INTERRUPTED)
    (elsewhere / "telemetry.tlog").touch()
    folder.rmdir()
    folder.symlink_to(elsewhere)


CASES: dict[str, Callable[[Path, Path], None]] = {
    "session.toml.new is a link to a file elsewhere": _link_new,
    "session.toml is a link to a file elsewhere": _link_session,
    "the folder is a link to one elsewhere": _link_folder,
    "session.toml is a pipe": _fifo_session,
    "telemetry.tlog is a pipe": _fifo_log,
    "its tables are pipes": _fifo_table,
    "session.toml is a link to /dev/zero": _device,
    f"TOML nested {NESTED:,} deep": _nested,
    "session.toml and log of 3 GB of zeros": _huge,
}


def hostile_folders(options: Options) -> list[AttackRow]:
    """Hostile folders under sessions/: whether a flight starts, how soon, and whether anything outside is changed."""
    usual_s = _start(options, "none", lambda folder, victim: folder.rmdir())[0]
    return [one_folder(options, k, name, make, usual_s) for k, (name, make) in enumerate(CASES.items())]


def one_folder(options: Options, k: int, name: str, make: Callable[[Path, Path], None], usual_s: float) -> AttackRow:
    """One flight that starts beside a folder that ``make`` has filled; ``usual_s`` is how long a start takes."""
    took_s, output, changed = _start(options, str(k), make)
    late = not took_s <= usual_s + MOST_S
    note = (
        f"starts in {took_s:.1f} s (without: {usual_s:.1f} s)" if took_s < PATIENCE_S else f"does not start: {output}"
    )
    notes = [note, *(["a file outside is written over"] if changed else [])]
    notes += ["traceback"] if "Traceback" in output else []
    return AttackRow(
        attack="hostile folders",
        case=name,
        held=not late and not changed and "Traceback" not in output,
        note="; ".join(notes),
    )


def _start(options: Options, name: str, make: Callable[[Path, Path], None]) -> tuple[float, str, bool]:
    """Seconds that the start took, what was printed, and whether the file outside has changed."""
    base = options.folder / f"folders-{name}"
    folder = base / "sessions" / "2026-01-01_00-00-00Z"
    folder.mkdir(parents=True)
    victim = base / "victim.txt"
    victim.write_text(VICTIM)
    make(folder, victim)
    outside = {path: path.read_bytes() for path in [victim, *base.glob("elsewhere/*")]}
    try:
        station = FlyingStation(
            options.gcs, base, mission_text([11]), [f"udpin:127.0.0.1:{free_port()}"], patience_s=PATIENCE_S
        )
    except StationError as error:
        took_s, output = float("inf"), str(error)
    else:
        took_s, output = station.start_s, station.output
        station.end()
    changed = any(not path.exists() or path.read_bytes() != data for path, data in outside.items())
    return took_s, " ".join(output.split())[-160:], changed
