"""Which alarm each fault of a flight had, when, and whether anything else was raised.

    python -m bench.faults SESSION [-o bench/results/faults.md]

SESSION is a session folder with a ``faults.log``: lines ``<Unix seconds> BEGIN|END <kind> <name>(<system id>)``. It is
folded again. When a fault can be known, and its end, is taken from the telemetry by rules of this module's own.
"""

from __future__ import annotations

import argparse
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from gcs.playback.analysis import Analysis
from gcs.session.session import open_session
from mavlink.geodesy import separation_m
from mavlink.protocol.decode import decode
from mavlink.protocol.messages import FilterStatus, GlobalPosition, GpsRaw, Sample, StatusText
from mavlink.tlog.log import Tlog

_LINE = re.compile(r"(?P<t>[\d.]+)\s+(?P<what>BEGIN|END)\s+(?P<kind>\S+)\s+(?P<name>.+)\((?P<id>\d+)\)\s*$")
SOON_S, OVER_S = 3.0, 5.0
"""An alarm comes so soon after its fault can be known, and is over so soon after that is over."""
AFTER_S = 60.0
"""Signs so long after a fault may still be of it: filters take their time."""
_GAP_M = 12.0
"""Between a receiver's fix and the position that comes next."""
_FIX_3D = 3
_BEAT_S = 1.0
"""Vehicles beat once a second: silence of so long can be known."""


@dataclass(frozen=True, slots=True)
class Fault:
    """What was done to one vehicle; Unix seconds."""

    kind: str
    name: str
    system_id: int
    begin_s: float
    end_s: float


@dataclass(slots=True)
class Raised:
    """One alarm; Unix seconds."""

    key: str
    text: str
    begin_s: float
    end_s: float = math.inf


@dataclass(frozen=True, slots=True, kw_only=True)
class FaultRow:
    """A fault and its alarms."""

    fault: Fault
    known_s: float
    """When it can be known, NaN: not from what was sent."""
    known_over_s: float
    alarms: Sequence[Raised]
    wanted: Sequence[str]
    """Kinds of alarm that are right, none: nothing is wrong with what a station sees."""

    @property
    def right(self) -> bool:
        """Whether there was the right alarm in time, and it was over in time; or none where none is due."""
        if not self.wanted:
            return not self.alarms
        first = min((alarm.begin_s for alarm in self.alarms), default=math.inf)
        last = max((alarm.end_s for alarm in self.alarms), default=math.inf)
        alike = all(alarm.key.split()[0] in self.wanted for alarm in self.alarms)
        return alike and first <= self.known_s + SOON_S and last <= max(self.known_over_s, self.fault.end_s) + OVER_S


_SILENCE, _FIX, _ESTIMATE, _COMPASS, _TWIN = "silence", "fix", "estimate", "compass", "twin"
_KINDS: Mapping[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "gpsloss": ((_FIX,), ("refused", "doubted")),
    "uavgpsloss": ((_FIX,), ("refused", "doubted")),
    "jam": ((_FIX, _ESTIMATE), ("refused", "doubted")),
    "glitch": ((_ESTIMATE,), ("doubted",)),
    "uavglitch": ((_ESTIMATE,), ("doubted",)),
    "compass": ((_COMPASS,), ("compass",)),
    "stop": ((_SILENCE,), ("silent",)),
    "uavstop": ((_SILENCE,), ("silent",)),
    "kill": ((_SILENCE,), ("silent",)),
    "twin": ((_TWIN,), ("contested",)),
    "reboot": ((), ()),
    "wind": ((), ()),
}
"""By the kind of a fault, without figures: what shows it, and the alarms that are right. A reboot that the autopilot
refuses and a wind in which the estimate stays true are nothing that a station could see."""


def read_faults(path: Path) -> list[Fault]:
    """The faults of a log, in order.

    Raises:
        ValueError: one begins and does not end.
    """
    faults, begun = [], {}
    for line in path.read_text(encoding="utf-8").splitlines():
        if (match := _LINE.match(line)) is None:
            continue
        what = match["kind"], match["name"], int(match["id"])
        if match["what"] == "BEGIN":
            begun[what] = float(match["t"])
        elif what in begun:
            faults.append(Fault(*what, begin_s=begun.pop(what), end_s=float(match["t"])))
    if begun:
        raise ValueError(f"{path}: without an end: {', '.join(kind for kind, *_ in begun)}")
    return sorted(faults, key=lambda fault: fault.begin_s)


@dataclass(slots=True)
class _Signs:
    """Times, Unix seconds, at which one vehicle's packets show something."""

    received_s: list[float] = field(default_factory=list)
    shown: dict[str, list[float]] = field(default_factory=dict)

    gps: GpsRaw | None = None
    boot_ms: int = 0

    def add(self, t_s: float, sample: Sample) -> None:
        """Note what a message received at Unix ``t_s`` shows."""
        self.received_s.append(t_s)
        for sign in self._shown_by(sample):
            self.shown.setdefault(sign, []).append(t_s)

    def _shown_by(self, sample: Sample) -> Iterator[str]:
        if isinstance(sample, GpsRaw):
            self.gps = sample
            if sample.fix_type < _FIX_3D:
                yield _FIX
        elif isinstance(sample, FilterStatus):
            unaided = sample.started and not sample.aided
            if unaided or sample.glitch or max(sample.position_ratio, sample.velocity_ratio) >= 1.0:
                yield _ESTIMATE
            if sample.compass_ratio >= 1.0:
                yield _COMPASS
        elif isinstance(sample, StatusText) and "glitch" in sample.text.lower():
            yield _ESTIMATE  # and that it is cleared
        elif isinstance(sample, GlobalPosition):
            yield from self._shown_by_place(sample)

    def _shown_by_place(self, sample: GlobalPosition) -> Iterator[str]:
        if sample.boot_ms < self.boot_ms - 1000:
            yield _TWIN
        self.boot_ms = max(self.boot_ms, sample.boot_ms)
        gps, self.gps = self.gps, None  # only what comes next is of the same moment
        if gps is None or gps.fix_type < _FIX_3D:
            return
        if separation_m(gps.lat_deg, gps.lon_deg, sample.lat_deg, sample.lon_deg) > _GAP_M:
            yield _ESTIMATE


def _signs(session: Path) -> dict[int, _Signs]:
    found: dict[int, _Signs] = {}
    for packet in Tlog.open(session / "telemetry.tlog").packets():
        sample = decode(packet)
        if sample is not None:
            found.setdefault(packet.system_id, _Signs()).add(packet.t_us * 1e-6, sample)
    return found


def _known(fault: Fault, wanted: Sequence[str], signs: _Signs) -> tuple[float, float]:
    """When a fault, and its end, can be known; NaN where it cannot."""
    if _SILENCE in wanted:
        before = max((t_s for t_s in signs.received_s if t_s <= fault.begin_s + _BEAT_S), default=math.nan)
        after = min((t_s for t_s in signs.received_s if t_s >= fault.end_s - _BEAT_S), default=math.nan)
        return before + _BEAT_S, after
    shown = [t_s for sign in wanted for t_s in signs.shown.get(sign, ())]
    shown = sorted(t_s for t_s in shown if fault.begin_s <= t_s <= fault.end_s + AFTER_S)
    return (shown[0], shown[-1]) if shown else (math.nan, math.nan)


def _alarms(session: Path) -> Iterator[tuple[int, Raised]]:
    """Every alarm of level alarm, with its vehicle."""
    open_: dict[str, tuple[int, Raised]] = {}
    for snapshot in Analysis(open_session(session)).snapshots(images=False):
        t_s = snapshot.t_us * 1e-6
        now = {alarm.key: alarm for alarm in snapshot.alarms if alarm.level == "alarm"}
        for key in [key for key in open_ if key not in now]:
            open_[key][1].end_s = t_s
            yield open_.pop(key)
        for key, alarm in now.items():
            open_.setdefault(key, (alarm.system_id, Raised(key, alarm.text, t_s)))
    yield from open_.values()


def compare(session: Path) -> tuple[list[FaultRow], list[Raised]]:
    """Each fault with its alarms, and the alarms that belong to none.

    Raises:
        OSError, ValueError: no faults can be read.
    """
    faults, signs = read_faults(session / "faults.log"), _signs(session)
    alarms, rows, taken = list(_alarms(session)), [], set()
    for fault in faults:
        sign, wanted = _KINDS.get(re.sub(r"\d.*", "", fault.kind), ((), ()))
        later = [
            other.begin_s for other in faults if other.system_id == fault.system_id and other.begin_s > fault.begin_s
        ]
        known_s, over_s = _known(fault, sign, signs.get(fault.system_id, _Signs()))
        until_s = min(max(fault.end_s, over_s if math.isfinite(over_s) else 0.0) + OVER_S, *later, math.inf)
        own = [
            (k, a) for k, (i, a) in enumerate(alarms) if i == fault.system_id and fault.begin_s <= a.begin_s <= until_s
        ]
        taken |= {k for k, _ in own}
        found = [alarm for _, alarm in own]
        rows.append(FaultRow(fault=fault, known_s=known_s, known_over_s=over_s, alarms=found, wanted=wanted))
    return rows, [alarm for k, (_, alarm) in enumerate(alarms) if k not in taken]


def page(rows: Sequence[FaultRow], others: Sequence[Raised], zero_s: float) -> str:
    """The table in Markdown."""
    lines = [
        "| fault | of | from, to (s) | can be known | alarm | raised after that | over after its end can be known |",
        "|---|---|---|---|---|---|---|",
    ]
    for row in rows:
        fault, over_s = row.fault, max(row.known_over_s, row.fault.end_s)
        texts = "; ".join(alarm.text.partition(": ")[2] or alarm.text for alarm in row.alarms) or "none"
        first = min((alarm.begin_s for alarm in row.alarms), default=math.nan) - row.known_s
        last = max((alarm.end_s for alarm in row.alarms), default=math.nan) - over_s
        cells = [
            fault.kind,
            fault.name,
            f"{fault.begin_s - zero_s:.1f}, {fault.end_s - zero_s:.1f}",
            _figure(row.known_s - fault.begin_s, "after {:.1f} s"),
            texts,
            _figure(first, "{:.1f} s"),
            _figure(last, "{:.1f} s") + ("" if row.right else " (not as it should be)"),
        ]
        lines.append(f"| {' | '.join(cells)} |")
    right = sum(row.right for row in rows)
    lines += ["", f"{right} of {len(rows)} faults as they should be; {len(others)} alarms of no fault."]
    lines += [f"- {alarm.text}, from {alarm.begin_s - zero_s:.1f} s" for alarm in others]
    return "\n".join(lines) + "\n"


def _figure(value: float, words: str) -> str:
    return words.format(value) if math.isfinite(value) else "–"


def main(arguments: Sequence[str] | None = None) -> int:
    """The table on stdout; exit code 1 where a fault or an alarm is not as it should be."""
    parser = argparse.ArgumentParser(prog="python -m bench.faults", description=__doc__.split("\n")[0])
    parser.add_argument("session", type=Path)
    parser.add_argument("-o", "--out", type=Path, help="write the table there too")
    chosen = parser.parse_args(arguments)
    rows, others = compare(chosen.session)
    text = page(rows, others, rows[0].fault.begin_s if rows else 0.0)
    print(text, end="")
    if chosen.out is not None:
        chosen.out.write_text(f"# Faults of real autopilots, folded again\n\n{text}", encoding="utf-8")
    return 0 if all(row.right for row in rows) and not others else 1


if __name__ == "__main__":
    raise SystemExit(main())
