"""Short flights with contents of their own, cut out of the bundled swarm, and broken ones among them."""

from __future__ import annotations

import re
from pathlib import Path

from mavlink.tlog.log import Tlog

__all__ = ["cut_flights"]

SWARM = Path(__file__).parents[2] / "sitl_logs" / "ardupilot-swarm"
STEP = 7
"""Frames from the begin of one flight to that of the next; the last ones begin at the start of the recording again."""
BEFORE_US, AFTER_US = 2_000_000, 1_000_000
"""Telemetry beside the frames: an autopilot sends before a camera records, and frames wait for the attitude after."""
TABLES = ("detections.csv", "truth.csv")


def cut_flights(folder: Path, count: int, frames: int, broken: int) -> list[Path]:
    """Make flights ``0000``, ``0001``, …; broken ones lie evenly among them.

    Args:
        folder: new.
        count: of all flights.
        frames: of each flight.
        broken: how many of them cannot be named.

    Returns:
        The broken ones.
    """
    recorded = len((SWARM / "frames.csv").read_text().splitlines()) - 1
    log, rows = Tlog.open(SWARM / "telemetry.tlog"), {name: _rows(name) for name in ("frames.csv", *TABLES)}
    made = [folder / f"{k:04}" for k in range(count)]
    for k, path in enumerate(made):
        first = k * STEP % (recorded - frames)
        _cut(log, rows, path, first, first + frames)
    chosen = [made[(2 * k + 1) * count // (2 * broken)] for k in range(broken)]
    for path, breakage in zip(chosen, _BREAKAGES * broken, strict=False):
        breakage(path)
    return chosen


def _rows(name: str) -> list[tuple[int, str]]:
    """Frame and the rest of each row."""
    split = (row.split(",", 1) for row in (SWARM / name).read_text().splitlines()[1:])
    return [(int(frame), rest) for frame, rest in split]


def _cut(log: Tlog, rows: dict[str, list[tuple[int, str]]], path: Path, first: int, stop: int) -> None:
    path.mkdir(parents=True)
    times_us = dict(rows["frames.csv"])
    log.cut(path / "telemetry.tlog", int(times_us[first]) - BEFORE_US, int(times_us[stop - 1]) + AFTER_US)
    for name, table in rows.items():
        header = (SWARM / name).read_text().partition("\n")[0]
        kept = [f"{frame - first},{rest}" for frame, rest in table if first <= frame < stop]
        (path / name).write_text("\n".join([header, *kept, ""]))
    (path / "session.toml").write_text((SWARM / "session.toml").read_text())


def _break_log(path: Path) -> None:
    (path / "telemetry.tlog").write_bytes(b"no log" * 1000)


def _break_frames(path: Path) -> None:
    (path / "frames.csv").unlink()


def _break_boxes(path: Path) -> None:
    (path / "detections.csv").write_text("nothing,of,this\n1,2,3\n")


def _break_mission(path: Path) -> None:
    toml = path / "session.toml"
    toml.write_text(re.sub(r"(?m)^system_id = .*$", 'system_id = "one"', toml.read_text()))


def _break_all(path: Path) -> None:
    for file in path.iterdir():
        file.write_bytes(file.read_bytes()[:10])


_BREAKAGES = [_break_log, _break_frames, _break_boxes, _break_mission, _break_all]
