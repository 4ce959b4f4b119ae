"""Files of strangers, opened by the commands that users open them with: each is read, or refused in a line."""

from __future__ import annotations

import contextlib
import os
import pty
import resource
import select
import signal
import sqlite3
import struct
import subprocess
import time
from collections.abc import Callable
from pathlib import Path

from bench.attacks.report import AttackRow
from bench.attacks.run import Options
from bench.attacks.video_port import DARK, coded_film
from bench.ports import free_port
from bench.station import mission_text

MOST_S, MOST_MB, LIMIT_BYTES = 60.0, 1000.0, 6 << 30
"""A command may take so long and so much; what asks for more is kept from harming the computer."""
SCREENS_S = 15.0
"""After which screens that are up are ended: by then every file of the mission was opened."""
NESTED = 100_000
LEVELS = 8
ENDLESS = "WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n) SELECT i FROM n WHERE i < 0"
PLAYLIST = "#EXTM3U\n#EXTINF:9,\n/etc/hostname\n#EXT-X-ENDLIST\n"
Words = tuple[str, ...]


def _fly(folder: Path, more: str) -> Words:
    (folder / "mission.toml").write_text(mission_text([11], more=more))
    return ("fly", "mission.toml", "-l", f"udpin:127.0.0.1:{free_port()}", "--sessions", "sessions")


def _briefly(folder: Path, more: str) -> Words:
    return (*_fly(folder, more), "--headless", "--duration", "1")


def _px4_log(folder: Path) -> Words:
    formats = [f"t{k}:t{k + 1}[99] a;" for k in range(LEVELS)] + [f"t{LEVELS}:uint8_t[99] a;"]
    formats.append("vehicle_attitude:uint64_t timestamp;t0[99] a;")
    messages = [(b"B", bytes(40)), *((b"F", text.encode()) for text in formats)]
    messages.append((b"A", struct.pack("<BH", 0, 1) + b"vehicle_attitude"))
    packed = b"".join(struct.pack("<Hc", len(data), kind) + data for kind, data in messages)
    (folder / "a.ulg").write_bytes(b"ULog\x01\x12\x35\x01" + bytes(8) + packed)
    (folder / "film.ts").write_bytes(b"".join(data for frame in coded_film(DARK) for data in frame))
    return ("import", "--video", "film.ts", "--uav", "a.ulg", "--ugv", "11=a.ulg", "--fov", "60", "-o", "out")


def _lens(folder: Path) -> Words:
    (folder / "lens.yaml").write_text("camera_matrix: " + "[" * NESTED)
    return _briefly(folder, '[camera]\nlens = "lens.yaml"\n')


def _terrain(folder: Path) -> Words:
    """A GeoTIFF of four pixels whose place is one short number."""
    tags = [(256, 3, 1, 2), (257, 3, 1, 2), (258, 3, 1, 32), (259, 3, 1, 1), (262, 3, 1, 1), (273, 4, 1, 122)]
    tags += [(278, 3, 1, 2), (279, 4, 1, 16), (339, 3, 1, 3), (33550, 3, 1, 1), (34735, 3, 1, 1)]
    packed = b"".join(struct.pack("<HHII", *tag) for tag in tags)
    head = struct.pack("<2sHIH", b"II", 42, 8, len(tags)) + packed + bytes(4)
    (folder / "area.tif").write_bytes(head.ljust(122 + 16 + 10, b"\0"))
    return _briefly(folder, '[map]\nterrain = "area.tif"\n')


def _tiles(folder: Path) -> Words:
    with contextlib.closing(sqlite3.connect(folder / "area.mbtiles")) as area:
        area.execute("CREATE TABLE metadata (name, value)")
        area.execute("INSERT INTO metadata VALUES ('format', 'png')")
        area.execute(
            f"CREATE VIEW tiles AS SELECT 1 AS zoom_level, 0 AS tile_column, 0 AS tile_row, ({ENDLESS}) AS tile_data"
        )
        area.commit()
    return _fly(folder, '[map]\ntiles = "area.mbtiles"\n')


def _labelled(folder: Path) -> Path:
    (folder / "images").mkdir()
    (folder / "labels").mkdir()
    (folder / "labels" / "a.txt").write_text("0 0.5 0.5 0.1 0.1\n")
    return folder / "images" / "a.jpg"


def _endless_image(folder: Path) -> Words:
    _labelled(folder).symlink_to("/dev/zero")
    return ("eval-detector", ".", "--names", "car")


def _piped_image(folder: Path) -> Words:
    os.mkfifo(_labelled(folder))
    return ("eval-detector", ".", "--names", "car")


def _nested_mission(folder: Path) -> Words:
    return _briefly(folder, "a = " + "[" * NESTED + "]" * NESTED + "\n")


def _endless_mission(folder: Path) -> Words:
    words = _briefly(folder, "")
    (folder / "mission.toml").unlink()
    (folder / "mission.toml").symlink_to("/dev/zero")
    return words


def _piped_key(folder: Path) -> Words:
    (folder / "keys").mkdir(mode=0o700)
    os.mkfifo(folder / "keys" / "11.key", 0o600)
    return ("keys", "list", "--keys", "keys")


def _playlist(folder: Path) -> Words:
    (folder / "film.mp4").write_text(PLAYLIST)
    (folder / "uav.csv").write_text("time_us,lat,lon,alt_m\n1790000000000000,47,8,500\n1790000001000000,47,8,500\n")
    return ("import", "--video", "film.mp4", "--uav", "uav.csv", "--ugv", "11=uav.csv", "--fov", "60", "-o", "out")


def _list_of_itself(folder: Path) -> Words:
    (folder / "flights.list").write_text("flights.list\n\0\n" + "x" * 5000 + "\n")
    return ("batch", "run", "--list", "flights.list", "-o", "out")


CASES: dict[str, Callable[[Path], Words]] = {
    "PX4 log of 300 bytes, formats within formats": _px4_log,
    f"lens file of {NESTED:,} brackets": _lens,
    "GeoTIFF with short tags": _terrain,
    "MBTiles over an endless query": _tiles,
    "label's image is /dev/zero": _endless_image,
    "label's image is a pipe": _piped_image,
    f"mission nested {NESTED:,} deep": _nested_mission,
    "mission is /dev/zero": _endless_mission,
    "a key is a pipe": _piped_key,
    "film that is a playlist of a file": _playlist,
    "list of itself, NUL, names without end": _list_of_itself,
}


def hostile_files(options: Options) -> list[AttackRow]:
    """Files of strangers by the real commands: how long, how much memory, and what is said."""
    return [open_file(options, k, name, make) for k, (name, make) in enumerate(CASES.items())]


def open_file(options: Options, k: int, name: str, make: Callable[[Path], Words]) -> AttackRow:
    """One file that ``make`` writes into a folder, by the command that it returns."""
    folder = options.folder / f"file-{k}"
    folder.mkdir()
    code, took_s, megabytes, said = _run([*options.gcs, *make(folder)], folder)
    said = said.replace(f"{folder}/", "")
    faults = ["not over in time"] * (code is None) + [f"signal {-(code or 0)}"] * (code is not None and code < 0)
    faults += ["traceback"] * ("Traceback" in said) + [f"{megabytes:.0f} MB"] * (megabytes > MOST_MB)
    line = next((line for line in said.splitlines()[::-1] if line.startswith("gcs:")), "").strip()
    note = f"{took_s:.1f} s, {megabytes:.0f} MB; {'; '.join(faults) or line or f'exit code {code}'}"
    return AttackRow(attack="files of strangers", case=name, held=not faults, note=note[:200])


def _run(words: list[str], folder: Path) -> tuple[int | None, float, float, str]:
    """Exit code, None where it did not end, seconds, megabytes and output of a command on a terminal."""
    keeper, terminal = pty.openpty()
    home = {"HOME": str(folder), "TERM": "xterm-256color", "COLUMNS": "500", "LINES": "40"}
    began_s = time.monotonic()
    process = subprocess.Popen(
        words, stdin=terminal, stdout=terminal, stderr=terminal, cwd=folder, env=os.environ | home
    )
    os.close(terminal)
    resource.prlimit(process.pid, resource.RLIMIT_AS, (LIMIT_BYTES, LIMIT_BYTES))
    said, code, took_s, over, megabytes = b"", None, 0.0, False, 0.0
    while not over:
        megabytes = _peak_mb(process.pid) or megabytes
        took_s = time.monotonic() - began_s
        if select.select([keeper], [], [], 0.1)[0]:
            with contextlib.suppress(OSError):
                said += os.read(keeper, 65536)
        pid, status = os.waitpid(process.pid, os.WNOHANG)
        if pid:
            code, over = os.waitstatus_to_exitcode(status), True
        elif took_s > SCREENS_S and b"\x1b[?1049h" in said:
            process.send_signal(signal.SIGTERM)
        if not pid and took_s > MOST_S:
            os.kill(process.pid, signal.SIGKILL)
            os.waitpid(process.pid, 0)
            over = True
    process.returncode = code if code is not None else -signal.SIGKILL
    os.close(keeper)
    return code, took_s, megabytes, said.decode(errors="replace")


def _peak_mb(pid: int) -> float:
    """Most memory that a process has had since it began its program, MB; 0 once it is over.

    What wait4 counts has that of the process it was forked from.
    """
    words = Path(f"/proc/{pid}/status").read_text(encoding="utf-8").split()
    return int(words[words.index("VmHWM:") + 1]) * 1.024e-3 if "VmHWM:" in words else 0.0
