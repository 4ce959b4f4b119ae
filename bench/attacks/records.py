"""What a flight left: packets recorded and refused, the alarms, and what is accepted of it."""

from __future__ import annotations

import json
import re
import subprocess
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bench.attacks.stage import Party, StageCounts

FOLD_TIMEOUT_S = 900.0
"""Longest time for the replay of a recording."""
_OVERHEAD = {0xFD: 12, 0xFE: 8}
"""Bytes of a frame beside its payload, by its magic byte."""
_SIGNATURE = 13
"""Bytes of a MAVLink 2 signature."""


def frames(session: Path) -> Iterator[tuple[int, bytes]]:
    """Unix µs and frame of every record of all segments; an incomplete record at the end of a segment is left out.

    Raises:
        ValueError: a segment has bytes between records.
    """
    for path in sorted(session.glob("telemetry*.tlog")):
        data = path.read_bytes()
        for at, stop in records_in(data, path):
            yield int.from_bytes(data[at : at + 8], "big"), data[at + 8 : stop]


def records_in(data: bytes, path: Path) -> Iterator[tuple[int, int]]:
    """Start and end of each whole record in what was read from a log, which begins with one.

    Raises:
        ValueError: there are bytes between records.
    """
    at = 0
    while at + 10 < len(data):
        overhead = _OVERHEAD.get(data[at + 8], 0)
        if not overhead:
            raise ValueError(f"{path}: no record at byte {at} of what was read")
        stop = at + 8 + overhead + data[at + 9] + (_SIGNATURE if overhead == 12 and data[at + 10] & 1 else 0)
        if stop > len(data):
            break
        yield at, stop
        at = stop


def sender_of(raw: bytes) -> int:
    """System id in a frame."""
    return raw[5] if raw[0] == 0xFD else raw[3]


def recorded(session: Path, sent: StageCounts) -> Counter[Party]:
    """How many of each party's packets were recorded.

    Equal packets of two parties are assigned in the order of their first sending, to each at most as many as it sent.
    """
    found: Counter[Party] = Counter()
    for raw, count in Counter(raw for _, raw in frames(session)).items():
        left = count
        for party, often in sent.owners.get(raw, Counter()).items():
            found[party] += min(left, often)
            left -= min(left, often)
        found["unknown", 0] += left
    return found


@dataclass(frozen=True, slots=True, kw_only=True)
class LoggedEvent:
    """One line of the event log."""

    t_s: float
    """Since the stage began."""
    level: str
    kind: str
    text: str
    system_id: int

    @property
    def loud(self) -> bool:
        """Whether it is a warning or an alarm."""
        return self.level in ("warning", "alarm")


def read_events(session: Path, sent: StageCounts) -> list[LoggedEvent]:
    """Read the event log, in its order, with times relative to the beginning of the stage."""
    found = []
    for path in sorted(session.glob("events*.jsonl")):
        for line in path.read_text(errors="replace").splitlines():
            row = json.loads(line)
            found.append(
                LoggedEvent(
                    t_s=(row["time_us"] - sent.start_us) * 1e-6,
                    level=row["level"],
                    kind=row["kind"],
                    text=row["text"],
                    system_id=row["system_id"] or 0,
                )
            )
    return found


def first_warning(
    events: Sequence[LoggedEvent], pattern: str, system_id: int = 0, since_s: float = 0.0
) -> LoggedEvent | None:
    """The first warning or alarm since a time whose text has the pattern; of one system, or 0 of any."""
    for event in events:
        its = system_id in (0, event.system_id) or (not event.system_id and re.search(rf"\b{system_id}\b", event.text))
        if event.loud and its and event.t_s >= since_s and re.search(pattern, event.text, re.IGNORECASE):
            return event
    return None


@dataclass(frozen=True, slots=True, kw_only=True)
class VehicleEstimate:
    """Estimated state of one vehicle at one time."""

    t_s: float
    place: tuple[float, float] | None
    """East and north of the UAV, metres."""
    state: str
    contested: bool
    beat: bool
    """Whether there was a heartbeat recently."""

    @property
    def used(self) -> bool:
        """Whether the station uses the position for identification."""
        return self.place is not None and not self.contested and self.state in ("ok", "stale")


def fold_recording(python: str, session: Path, sent: StageCounts) -> list[dict[str, Any]]:
    """Replay a recording with the station under test: snapshots as written by ``fold_probe.py``, five times a second.

    Raises:
        RuntimeError: the replay failed.
    """
    probe = Path(__file__).with_name("fold_probe.py")
    done = subprocess.run([python, str(probe), str(session)], capture_output=True, text=True, timeout=FOLD_TIMEOUT_S)
    if done.returncode:
        raise RuntimeError(f"the recording cannot be folded: {done.stderr.strip()[-400:]}")
    return [row | {"t_s": (row["t_us"] - sent.start_us) * 1e-6} for row in map(json.loads, done.stdout.splitlines())]


def estimates_of(rows: Sequence[dict[str, Any]], system_id: int) -> list[VehicleEstimate]:
    """The estimated states of one vehicle, in order of time."""
    found = []
    for row in rows:
        if (its := row["rows"].get(str(system_id))) is not None:
            place = (its["place"][0], its["place"][1]) if its["place"] else None
            found.append(
                VehicleEstimate(
                    t_s=row["t_s"], place=place, state=its["state"], contested=its["contested"], beat=its["beat"]
                )
            )
    return found
