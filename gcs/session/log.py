"""The telemetry of a session as one log: its segments joined, on one time line, with what was rejected marked.

``senders.csv`` has who sent a record, as far as it is noted.
"""

from __future__ import annotations

import csv
import itertools
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gcs.session.clock_steps import ClockSteps, close_leaps, infer_steps
from gcs.session.tables import read_table
from infra.files.safe_open import open_to_read
from infra.files.segment import segments
from infra.plain_text import from_cell
from infra.session_format import CLOCK, FRAMES, LOG, REFUSED, SENDERS, TableFormat
from mavlink.errors import TlogError
from mavlink.protocol.packet import Auth, Packet
from mavlink.tlog.log import Tlog

Ints = NDArray[np.int64]
Flags = NDArray[np.bool_]

_NUMBERS = SENDERS.columns.index("address")
"""The columns before are numbers, those from there on are words."""
_BOUND = 1 << 62
_SILENT = f"{LOG}: nothing was received in flight; there is only the video"


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordSenders:
    """Links and senders of n records."""

    link: Ints
    """(n,) index of the link, 0 where it is not known."""
    peer: Ints
    """(n,) number of the sender on that link, 0 where it is not known."""
    names: tuple[str, ...]
    """Names of the links, by index."""
    addresses: Mapping[tuple[int, int], str]
    """Addresses of link and sender, in words."""
    skipped: int
    """Rows that cannot be read."""

    @classmethod
    def unknown(cls, count: int) -> RecordSenders:
        """Senders of a log without that table."""
        link, peer = np.zeros((2, count), dtype=np.int64)
        return cls(link=link, peer=peer, names=(), addresses={}, skipped=0)

    @classmethod
    def read(cls, path: Path, t_us: Ints, system_id: NDArray[np.uint8]) -> RecordSenders:
        """Read ``senders.csv`` and its further segments.

        A row holds from its record on, for one system id. Where numbers and times do not agree, because records were
        lost, it holds from its time on.

        Args:
            t_us: (n,) stamps of all records.
            system_id: (n,) of their senders.
        """
        rows, skipped = _read_rows(path)
        link, peer = np.zeros((2, len(t_us)), dtype=np.int64)
        table = np.array([row[:_NUMBERS] for row, _ in rows], dtype=np.int64).reshape(len(rows), _NUMBERS)
        table = table[np.argsort(table[:, 0], kind="stable")]
        numbered = _match_records(table, t_us, system_id)
        for i in np.unique(table[:, 2]).tolist():
            of_id, mine = table[table[:, 2] == i], np.flatnonzero(system_id == i)
            since, moments = (of_id[:, 0], mine) if numbered else (of_id[:, 1], t_us[mine])
            row = np.searchsorted(since, moments, side="right") - 1
            link[mine], peer[mine] = np.where(row >= 0, of_id[row, 3:5].T, 0)
        last = max((numbers[3] for numbers, _ in rows), default=-1)
        named = {numbers[3]: words[1] for numbers, words in rows}
        return cls(
            link=link,
            peer=peer,
            names=tuple(named.get(k, f"link {k}") for k in range(min(last + 1, 256))),
            addresses={(numbers[3], numbers[4]): words[0] for numbers, words in rows},
            skipped=skipped,
        )

    def address(self, link: int, peer: int) -> str:
        """Address of a sender, in words; empty where it is not known."""
        return self.addresses.get((link, peer), "")


def _match_records(table: Ints, t_us: Ints, system_id: NDArray[np.uint8]) -> bool:
    """Tell whether every row is about the record that has its number."""
    number = table[:, 0]
    if not len(t_us) or (number >= len(t_us)).any():
        return False
    return bool((t_us[number] == table[:, 1]).all() and (system_id[number] == table[:, 2]).all())


def _read_rows(path: Path) -> tuple[list[tuple[tuple[int, ...], tuple[str, str]]], int]:
    """Numbers and words of each row of all segments, and how many cannot be read: they are no reason to do without."""
    rows, skipped = [], 0
    for part in segments(path):
        try:
            with os.fdopen(open_to_read(part), encoding="utf-8", errors="replace", newline="") as lines:
                for cells in filter(None, itertools.islice(csv.reader(lines), 1, None)):
                    row = _parse_row(cells)
                    rows += [row] if row else []
                    skipped += not row
        except (OSError, csv.Error):
            skipped += 1
    return rows, skipped


def _parse_row(cells: list[str]) -> tuple[tuple[int, ...], tuple[str, str]] | None:
    try:
        numbers = tuple(map(int, cells[:_NUMBERS]))
        address, name = map(from_cell, cells[_NUMBERS : len(SENDERS.columns)])
    except ValueError:
        return None
    return (numbers, (address, name)) if all(0 <= number < _BOUND for number in numbers) else None


class SessionLog:
    """Every record once, in the order of arrival.

    Args:
        signers: whether a system signed with a key that the flight knew: what was not refused of it was verified.

    A flight with frames during which nothing was received is a recording too, without a record.

    Attributes:
        path: of the first segment.
        stamped_us: (n,) times as in the log.
        steps: when the wall clock was set.
        senders: who sent each record.
        warnings: what an analyst should know, one line each.

    Raises:
        TlogError: there is no segment that can be read.
        SessionError: a table beside it that is no table.
    """

    def __init__(self, path: Path, signers: Callable[[int], bool] = lambda system_id: False) -> None:
        self.path = path
        self._signers = signers
        recorded = path.name == LOG  # one that we recorded may have segments and tables beside it
        silent = recorded and _any_beside(path, FRAMES) and any(path.parent.glob("video.*")) and _is_empty(path)
        self._logs, troubles = ([], [_SILENT]) if silent else _open(segments(path) if recorded else [path], path)
        self._keep = [~_repeated_later(log, self._logs[k + 1 :]) for k, log in enumerate(self._logs)]
        stamped_us: Ints = np.concatenate([np.empty(0, dtype=np.int64), *self._of_each("t_us")])
        self._leaps, self._found = 0, not (recorded and _any_beside(path, CLOCK, FRAMES))
        if self._found and len(self._logs) == 1:
            self.steps = infer_steps(self._logs[0])
            self._t_us, self._leaps = close_leaps(self.steps.correct_records(stamped_us))
        else:
            self.steps = ClockSteps.read(path.with_name(CLOCK.name)) if recorded else ClockSteps.none()
            self._t_us = self.steps.correct_records(stamped_us)
        self.stamped_us = stamped_us
        refused = path.with_name(REFUSED.name)
        has_refused = recorded and bool(segments(refused))
        nothing = np.zeros(len(stamped_us), dtype=np.uint8), 0
        self._auth, self._unread = _read_refused(refused, stamped_us) if has_refused else nothing
        system_id = np.concatenate([np.empty(0, dtype=np.uint8), *self._of_each("system_id")])
        senders = path.with_name(SENDERS.name)
        noted = recorded and bool(segments(senders))
        unknown = RecordSenders.unknown(len(stamped_us))
        self.senders = RecordSenders.read(senders, stamped_us, system_id) if noted else unknown
        self.warnings = (*troubles, *self._find_warnings())

    def __len__(self) -> int:
        return len(self._t_us)

    @property
    def times_us(self) -> Ints:
        """(n,) when each record came, on one time line."""
        return self._t_us

    @property
    def refused(self) -> int:
        """Records that were rejected."""
        return int(np.count_nonzero(self._auth > Auth.GOOD))

    @property
    def start_us(self) -> int:
        """Earliest record; 0 where there is none."""
        return int(self._t_us.min()) if len(self) else 0

    @property
    def stop_us(self) -> int:
        """Latest record; 0 where there is none."""
        return int(self._t_us.max()) if len(self) else 0

    def packets(self, *, as_stamped: bool = False) -> Iterator[Packet]:
        """All records; rejected ones carry the reason.

        Args:
            as_stamped: with the times of the log, not those of one time line.
        """
        times_us = self.stamped_us if as_stamped else self._t_us
        start = 0
        for log, keep in zip(self._logs, self._keep, strict=True):
            stop = start + int(np.count_nonzero(keep))
            kept = (packet for packet, wanted in zip(log.packets(), keep.tolist(), strict=True) if wanted)
            columns = (times_us, self.senders.link, self.senders.peer, self._auth)
            rows = zip(*(column[start:stop].tolist() for column in columns), strict=True)
            for packet, (t_us, link, peer, auth) in zip(kept, rows, strict=True):
                if not auth and packet.signed and self._signers(packet.system_id):
                    yield Packet(t_us, packet.raw, link, peer, Auth.GOOD)
                elif auth or link or peer or t_us != packet.t_us:
                    yield Packet(t_us, packet.raw, link, peer, Auth(auth))
                else:
                    yield packet
            start = stop

    def accepted_packets(self, message_id: int) -> Iterator[Packet]:
        """Records of one kind that were not refused."""
        start = 0
        for log, keep in zip(self._logs, self._keep, strict=True):
            place = start + np.cumsum(keep) - 1
            rows = log.select(message_ids=(message_id,))
            good = keep[rows] & (self._auth[place[rows]] <= Auth.GOOD)
            yield from (log.packet(row) for row in rows[good].tolist())
            start += int(np.count_nonzero(keep))

    def _of_each(self, column: str) -> list[NDArray[Any]]:
        """Yield a column of the kept records of each segment."""
        return [getattr(log.index, column)[keep] for log, keep in zip(self._logs, self._keep, strict=True)]

    def _find_warnings(self) -> Iterator[str]:
        for log in self._logs:
            if log.index.damage:
                size = sum(d.stop - d.start for d in log.index.damage)
                yield f"{log.path.name}: {len(log.index.damage)} damaged places, {size} bytes skipped"
        if self.refused:
            yield f"{REFUSED.name}: {self.refused} records were rejected in flight and are left out"
        skipped = {REFUSED: self._unread, SENDERS: self.senders.skipped, CLOCK: self.steps.skipped}
        for table, rows in skipped.items():
            if rows:
                yield f"{table.name}: {rows} rows cannot be read and are left out"
        if len(self.steps):
            times = f"the clock was set {len(self.steps)} times"
            if self._found:
                yield f"the vehicles' clocks: {times}; all times are those of the first setting"
            else:
                yield f"{CLOCK.name}: {times}; records and frames keep their order"
        if self._leaps:
            leaps = f"time leaps by half an hour back or a day ahead {self._leaps} times"
            yield f"{self.path.name}: {leaps}, which is closed up"


def _open(paths: list[Path], first: Path) -> tuple[list[Tlog], list[str]]:
    """The segments that can be read, and why others cannot."""
    if len(paths) <= 1:
        return [Tlog.open(paths[0] if paths else first)], []
    logs, troubles = [], []
    for path in paths:
        try:
            logs.append(Tlog.open(path))
        except TlogError as error:
            troubles.append(str(error))
    if not logs:
        raise TlogError(troubles[0])
    return logs, troubles


def _is_empty(path: Path) -> bool:
    return bool(segments(path)) and not any(part.stat().st_size for part in segments(path))


def _any_beside(path: Path, *tables: TableFormat) -> bool:
    """Tell whether one of these tables is beside a log."""
    return any(segments(path.with_name(table.name)) for table in tables)


def _repeated_later(log: Tlog, later: Sequence[Tlog]) -> Flags:
    """(n,) which records of a segment are in a later one too, where a failed sync had them written again."""
    again = np.zeros(len(log.index), dtype=np.bool_)
    for other in later:
        rows = np.flatnonzero(np.isin(other.index.t_us, log.index.t_us))
        written = {(packet.t_us, packet.raw) for packet in map(other.packet, rows.tolist())}
        for row in np.flatnonzero(np.isin(log.index.t_us, other.index.t_us)).tolist():
            packet = log.packet(row)
            again[row] |= (packet.t_us, packet.raw) in written
    return again


def _read_refused(path: Path, t_us: Ints) -> tuple[NDArray[np.uint8], int]:
    """(n,) the verdict of ``refused.csv`` on each record, 0 where it has none, and how many of its rows cannot be read.

    A record is found by its number. Where numbers and times do not agree, because records were lost, every record of
    the same time is refused: rather a good one left out than a forged one accepted.
    """
    table = read_table(path, REFUSED, without=("link", "peer"))
    number, time_us = table["record"].astype(np.int64), table["t_us"].astype(np.int64)
    verdict = np.clip(table["auth"], Auth.UNSIGNED, max(Auth)).astype(np.uint8)
    auth = np.zeros(len(t_us), dtype=np.uint8)
    inside = (number >= 0) & (number < len(t_us))
    if inside.all() and (t_us[number] == time_us).all():
        auth[number] = verdict
        return auth, table.skipped
    order = np.argsort(time_us, kind="stable")
    place = np.clip(np.searchsorted(time_us[order], t_us), 0, max(len(order) - 1, 0))
    if len(order):
        same = time_us[order][place] == t_us
        auth[same] = verdict[order][place][same]
    return auth, table.skipped
