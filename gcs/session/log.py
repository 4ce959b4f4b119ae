"""The telemetry of a session as one log: its segments joined, on one time line, with what was rejected marked."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gcs.session.clock_steps import ClockSteps, close_leaps, infer_steps
from gcs.session.sender_table import RecordSenders
from gcs.session.tables import read_table
from infra.files.segment import segments
from infra.session_format import CLOCK, FRAMES, LOG, REFUSED, SENDERS, TableFormat
from mavlink.errors import TlogError
from mavlink.protocol.packet import Auth, Packet
from mavlink.tlog.log import Tlog

Ints = NDArray[np.int64]
Flags = NDArray[np.bool_]

_SILENT = f"{LOG}: nothing was received in flight; there is only the video"


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
        """A column of the kept records of each segment."""
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
