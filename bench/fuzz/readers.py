"""Every reader of files that a stranger can hand us, on damaged files and in hostile places, each in its own process.

A file is read, or refused by an error of ours in one line that names it; nothing crashes, none takes longer than a
minute, and memory stays within three times the file and 200 MB.
"""

from __future__ import annotations

import os
import random
import re
import resource
import select
import shutil
import signal
import tempfile
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from assoc.errors import AssocError
from bench.fuzz.frames import FuzzScore
from gcs.batch.flights import find_flights
from gcs.errors import GcsError
from gcs.importing.film_log import read_film_log
from gcs.importing.sources import read_vehicle_logs
from gcs.mission.mission import load_mission
from gcs.mission.terrain_file import TerrainFile
from gcs.mission.tile_file import TileFile
from gcs.playback.opened_session import OpenedSession
from gcs.session.event_log import read_marks, read_statements
from gcs.session.frame_tables import read_truth
from gcs.session.identity_log import read_identity
from gcs.session.session import open_session
from mavlink.errors import MavlinkError
from mavlink.signing.keys import read_ring
from sim.errors import SimError
from sim.world.scenario_file import load_scenario
from vision.camera.lens_file import read_lens
from vision.detect.detector import open_detector
from vision.errors import VisionError
from vision.evaluation.folder import open_folder
from vision.video.video import VideoFile

NUMBERS = (
    *(b"nan", b"inf", b"-inf", b"1e999", b"-0", b"9" * 400, b"0x1f", b"1_0", b"", b"181", b"-1", b"1e18"),
    *(b"9e18", b"9223372036854775808", b"18446744073709551615", b"4294967296", b"true", b'"a"', b"[]", b"null"),
)
WORDS = (b"\0", b"\n", b"\xff\xfe", b"[" * 2000, b"{" * 2000, b'"', b"*a", b"&a [*a]", b"%", b"\x1b[31m", b"../", b"=")
EXTREMES = (0, 1, 0x7F, 0x80, 0xFF, 0x7FFF, 0xFFFF, 0x7FFFFFFF, 0xFFFFFFFF, (1 << 63) - 1, (1 << 64) - 1)
NUMBER = re.compile(rb"\d+\.?\d*")
Mishap = Callable[[bytes, random.Random], bytes]


def _span(data: bytes, rng: random.Random) -> tuple[int, int]:
    at = rng.randrange(len(data))
    return at, min(len(data), at + rng.randrange(1, 400))


def _flipped(data: bytes, rng: random.Random) -> bytes:
    changed = bytearray(data)
    for _ in range(rng.choice((1, 3, 20))):
        changed[rng.randrange(len(changed))] ^= rng.randrange(1, 256)
    return bytes(changed)


def _cut(data: bytes, rng: random.Random) -> bytes:
    at, end = _span(data, rng)
    return rng.choice((data[:at], data[at:], data[:at] + data[end:], data[at:] + data[:at]))


def _zeroed(data: bytes, rng: random.Random) -> bytes:
    at, end = _span(data, rng)
    return data[:at] + rng.choice((b"\0", b"\xff")) * (end - at) + data[end:]


def _repeated(data: bytes, rng: random.Random) -> bytes:
    at, end = _span(data, rng)
    return data[:at] + data[at:end] * rng.choice((2, 2, 1000)) + data[end:]


def _extreme(data: bytes, rng: random.Random) -> bytes:
    """A number in the binary, little or big endian, at its largest."""
    size, order = rng.choice((1, 2, 4, 8)), rng.choice(("little", "big"))
    at = rng.randrange(len(data))
    value = rng.choice(EXTREMES) & ((1 << 8 * size) - 1)
    return data[:at] + value.to_bytes(size, "little" if order == "little" else "big") + data[at + size :]


def _renumbered(data: bytes, rng: random.Random) -> bytes:
    share = rng.choice((0.02, 0.2))
    return NUMBER.sub(lambda found: rng.choice(NUMBERS) if rng.random() < share else found[0], data)


def _shuffled(data: bytes, rng: random.Random) -> bytes:
    lines = data.splitlines(keepends=True)
    rng.shuffle(lines)
    return b"".join(lines)


def _with_words(data: bytes, rng: random.Random) -> bytes:
    at = rng.randrange(len(data))
    return data[:at] + rng.choice(WORDS) + data[at:]


def _recoded(data: bytes, rng: random.Random) -> bytes:
    return data.decode("utf-8", "replace").encode(rng.choice(("utf-16", "utf-16-be", "cp1252", "utf-7")), "replace")


ANY = (_flipped, _cut, _zeroed, _repeated, _extreme, _flipped, _extreme)
OF_TEXTS = (_renumbered, _renumbered, _shuffled, _with_words, _recoded)


def spoilt(data: bytes, rng: random.Random) -> bytes:
    """A file after one to three mishaps."""
    mishaps: tuple[Mishap, ...] = ANY if b"\0" in data[:1000] else ANY + OF_TEXTS
    for _ in range(rng.randrange(1, 4)):
        if data:
            data = rng.choice(mishaps)(data, rng)
    return data


MAX_S, MAX_WAIT_S = 60, 300.0
"""Longest time that a reader may take of a processor, and by the clock, seconds: one that waits takes no processor."""
MORE_BYTES, TIMES_LARGER = 200_000_000, 3
OURS = (GcsError, MavlinkError, VisionError, AssocError, SimError)
Reader = Callable[[Path], object]


def _film(path: Path) -> None:
    read_film_log(path, coarse=True)
    with closing(VideoFile.open(path)) as film:
        next(film.frames(), None)


def _tiles(path: Path) -> None:
    with closing(TileFile(path)) as tiles:
        for zoom in tiles.zooms:
            tiles.tile(zoom, 0, 0)


def _session(path: Path) -> None:
    session = open_session(path.parent)
    OpenedSession.open(session)
    read_marks(path.parent, 0)
    read_statements(path.parent, {11, 12})
    read_identity(path.parent / "identity.csv")
    read_truth(path.parent / "truth.csv")


def _labels(path: Path) -> None:
    folder = next(parent for parent in path.parents if parent.parent.name == "labels")
    for image in open_folder(folder).images:
        image.read()


READERS: dict[str, Reader] = {
    "logs": read_vehicle_logs,
    "films": _film,
    "lenses": read_lens,
    "missions": load_mission,
    "tiles": _tiles,
    "terrain": lambda path: TerrainFile(path).elevations([47.0], [8.0]),
    "keys": lambda path: read_ring(path.parent),
    "lists": lambda path: find_flights([], lists=[path]),
    "models": lambda path: open_detector(path, score=0.3),
    "scenarios": load_scenario,
    "session": _session,
    "labels": _labels,
}
"""Readers by the folder of their good files."""


@dataclass(slots=True, kw_only=True)
class ReaderScore(FuzzScore):
    """Sums over files."""

    read: int = 0
    refused: int = 0
    most_bytes: int = 0
    """Largest memory that one file took."""


def _spoil(rng: random.Random, path: Path) -> None:
    path.write_bytes(spoilt(path.read_bytes(), rng))


def _instead(make: Callable[[Path], object]) -> Callable[[Path], object]:
    def change(path: Path) -> None:
        path.unlink()
        make(path)

    return change


PLACES: dict[str, Callable[[Path], object]] = {
    "a pipe": _instead(os.mkfifo),
    "a folder": _instead(Path.mkdir),
    "an endless device": _instead(lambda path: path.symlink_to("/dev/zero")),
    "itself": _instead(lambda path: path.symlink_to(path.name)),
    "ten megabytes more": lambda path: os.truncate(path, 10_000_000),
}
"""Functions that put something else in the place of a file, by what it is."""


def fuzz_readers(good: Path, seeds: range, *, only: str = "") -> Iterator[ReaderScore]:
    """Damaged files, one for each seed and good file.

    Args:
        good: folder with a folder of good files for each reader.
        seeds: of the damage.
        only: one reader's folder; empty: all.
    """
    for seed in seeds:
        for path in _files(good, only):
            rng = random.Random(f"{seed} {path.relative_to(good)}")
            yield _try(good, path, f"seed {seed}", partial(_spoil, rng))


def fuzz_places(good: Path, *, only: str = "") -> Iterator[ReaderScore]:
    """Each good file replaced by what no file should be."""
    for path in _files(good, only):
        for what, place in PLACES.items():
            yield _try(good, path, what, place)


def _files(good: Path, only: str) -> list[Path]:
    return sorted(
        path for kind in READERS if kind.startswith(only) for path in (good / kind).rglob("*") if path.is_file()
    )


def _try(good: Path, path: Path, what: str, change: Callable[[Path], object]) -> ReaderScore:
    """Read one good file's changed copy, among copies of those beside it."""
    kind = path.relative_to(good).parts[0]
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / kind
        shutil.copytree(good / kind, copy)
        copy.chmod(0o700)
        for key in copy.glob("*.key"):
            key.chmod(0o600)
        file = Path(folder) / path.relative_to(good)
        change(file)
        size = file.stat().st_size if file.is_file() and not file.is_symlink() else 0
        told, taken = _in_a_process(READERS[kind], file, TIMES_LARGER * size + MORE_BYTES)
    if told == "read":
        return ReaderScore(read=1, most_bytes=taken)
    if told == "refused":
        return ReaderScore(refused=1, most_bytes=taken)
    return ReaderScore(failures=[f"{path.relative_to(good)}, {what}: {told}"], most_bytes=taken)


def _in_a_process(read: Reader, path: Path, most_bytes: int) -> tuple[str, int]:
    """``read``, ``refused``, or in words what should not have happened; and bytes of memory that were taken."""
    reading, writing = os.pipe()
    pid = os.fork()
    if not pid:
        os.close(reading)
        resource.setrlimit(resource.RLIMIT_CPU, (MAX_S, MAX_S))
        # what it shares with its parent is no part of it before it is used
        before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        os.write(writing, f"{before} {_told(read, path)}".encode(errors="replace")[:4000])
        os._exit(0)
    os.close(writing)
    in_time = bool(select.select([reading], [], [], MAX_WAIT_S)[0])
    if not in_time:
        os.kill(pid, signal.SIGKILL)
    began_with, _, told = os.read(reading, 4096).decode(errors="replace").partition(" ")
    os.close(reading)
    _, status, used = os.wait4(pid, 0)
    taken = 1024 * (used.ru_maxrss - int(began_with or 0))  # also of processes that it had and waited for
    if not in_time:
        return f"not read within {MAX_WAIT_S:.0f} s", taken
    if os.WIFSIGNALED(status):  # of processor time: SIGKILL
        return f"signal {os.WTERMSIG(status)}", taken
    return f"took {taken / 1e6:.0f} MB of memory" if taken > most_bytes else told, taken


def _told(read: Reader, path: Path) -> str:
    try:
        read(path)
    except OURS as error:
        text = str(error)
        return "refused" if "\n" not in text and len(text) < 2000 else f"refused in other than a line: {text[:300]!r}"
    except BaseException as error:  # noqa: BLE001 - that there is no other is what is being measured
        trace = error.__traceback__
        while trace is not None and trace.tb_next is not None:
            trace = trace.tb_next
        where = f"{trace.tb_frame.f_code.co_filename}:{trace.tb_lineno}" if trace is not None else ""
        return f"{error!r} at {where}"
    return "read"
