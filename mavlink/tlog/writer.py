"""Telemetry logs, written as a flight goes: what was accepted survives the death of the process.

Beside ``telemetry.tlog`` and its further segments there are tables, each made with its first row:
``senders.csv`` who sent what, ``refused.csv`` the records that were rejected, and ``clock.csv`` when the wall clock
was set.
"""

from __future__ import annotations

import csv
import io
import struct
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from types import TracebackType

from infra.files.append import RAM_BYTES, AppendFile, Flusher
from infra.files.disk import OS_DISK, Disk
from infra.files.journal import Journal
from infra.files.journal_writer import JournalWriter
from infra.files.record_state import RecordState, overall
from infra.plain_text import to_cell
from infra.session_format import CLOCK, REFUSED, SENDERS, TableFormat
from infra.wall_clock import ClockWatch
from mavlink.errors import TlogError
from mavlink.protocol.framing import SIGNATURE_LENGTH
from mavlink.protocol.packet import MAGIC_V2, Auth, Packet

SYNC_S = 0.15
"""Seconds between syncs: with the sync itself a power cut costs at most 0.2 s on a disk that is well."""
_TABLE_RAM_BYTES = 8 << 20
_TIME = struct.Struct(">Q")
_LOG, _REFUSED, _CLOCK, _SENDERS = range(4)
"""The files, as a journal numbers them."""


class TlogWriter:
    """Appends packets to a new log.

    ``write``, ``write_records``, ``refuse`` and ``write_sender`` never raise and never wait for a disk that fails or
    syncs slowly; ``state`` reports on the disk. Without a journal data is written to the kernel at once, so that a disk
    that hangs blocks the caller; with one it is in shared memory at once, soon in the kernel, and nothing blocks.

    Args:
        path: must not exist; nothing recorded is ever overwritten.
        resume_after: how many records the log has already, of a process that died; it is gone on with in its next
            segment.
        ram_bytes: most bytes kept in memory while the disk fails.
        disk: the operating system, or a test's.
        clock: notices when the wall clock is set.
        journal: keeps rows until they are in their files; the caller's. What it holds already is written first.

    Raises:
        TlogError: the file exists or cannot be made.
    """

    _stepped_us = 0

    def __init__(
        self,
        path: Path | str,
        *,
        resume_after: int | None = None,
        ram_bytes: int = RAM_BYTES,
        disk: Disk = OS_DISK,
        clock: ClockWatch | None = None,
        journal: Journal | None = None,
    ) -> None:
        self.path = Path(path)
        try:
            self._log = AppendFile(
                self.path, ram_bytes=ram_bytes, first=resume_after or 0, lazy=resume_after is not None, disk=disk
            )
        except FileExistsError:
            raise TlogError(f"{self.path}: exists already, and recordings are never overwritten") from None
        except OSError as error:
            raise TlogError(f"{self.path}: cannot be made: {error.strerror}") from error
        self._files = (self._log, *(_table(self.path, form, disk) for form in (REFUSED, CLOCK, SENDERS)))
        self._clock = clock or ClockWatch()
        self._journal = journal
        self._journal_writer: JournalWriter | None = None
        self._abandoned = False
        if journal is not None:
            goes_on = journal.recover()
            self._journal_writer = JournalWriter(journal, self._files, _whole, goes_on=goes_on)
        self._flusher = Flusher(self._files, SYNC_S)

    def write(self, packet: Packet) -> int | None:
        """Append one packet, and note it when it was rejected.

        Returns:
            Its running number over all segments, from 0; None when the journal has no room: it is lost, and counted.
        """
        number = self.write_records(_TIME.pack(packet.t_us) + packet.raw, 1)
        if packet.auth > Auth.GOOD and number is not None:
            self.refuse(number, packet)
        return number

    def write_records(self, data: bytes, count: int) -> int | None:
        """Append whole records, each eight bytes of big-endian Unix µs and a frame.

        Returns:
            The running number of the first of them; None when the journal has no room: they are lost, and counted.
        """
        before_us = self._clock.stepped()
        number = self._put(_LOG, data, count)
        if before_us is not None:
            self._note_step(before_us, self.records if number is None else number, data)
        return number

    def refuse(self, number: int, packet: Packet) -> None:
        """Note that a record was rejected; readers of the session leave it out."""
        row = f"{number},{packet.t_us},{packet.link},{packet.peer},{int(packet.auth)}\n"
        self._put(_REFUSED, row.encode(), 1)

    def write_sender(
        self, number: int, t_us: int, system_id: int, link: int, peer: int, address: str, name: str
    ) -> None:
        """Note that a system id has another sender than before, from this record on.

        Args:
            link: index of the link it came over.
            peer: number of the sender on that link.
            address: of the sender, in words; empty where there is none.
        """
        row = io.StringIO()
        words = to_cell(address), to_cell(name)
        csv.writer(row, lineterminator="\n").writerow((number, t_us, system_id, link, peer, *words))
        self._put(_SENDERS, row.getvalue().encode(), 1)

    @property
    def records(self) -> int:
        """Records accepted so far."""
        return self._log.rows if self._journal is None else self._journal.rows

    @property
    def state(self) -> RecordState:
        """State of log and tables."""
        state = replace(overall(file.state for file in self._files), clock_step_s=self._stepped_us * 1e-6)
        journal = self._journal
        if journal is None:
            return state
        waiting = journal.rows - journal.written
        return replace(
            state,
            rows=journal.written,
            waiting=0 if self._abandoned else waiting,
            waiting_bytes=0 if self._abandoned else journal.waiting_bytes,
            lost=state.lost + journal.lost + (waiting if self._abandoned else 0),
        )

    def close(self) -> None:
        """Write what still waits, sync and close; closing twice does nothing. ``state`` then has what was lost.

        A disk that hangs is left after a minute, with the files open.
        """
        if self._journal_writer is not None and not self._journal_writer.stop():
            self._abandoned = True
            return
        self._flusher.stop()
        for file in self._files:
            file.close()

    def _put(self, file: int, data: bytes, rows: int) -> int | None:
        return self._files[file].write(data, rows) if self._journal is None else self._journal.put(file, data, rows)

    def _note_step(self, before_us: int, number: int, data: bytes) -> None:
        """Write a row: the first record stamped by the clock that was set, its time then, its offset, and by how
        much."""
        after_us, now_us = self._clock.offset_us, self._clock.now_us()
        was_us, is_us = now_us + before_us, now_us + after_us
        stamped_before = sum(abs(t_us - was_us) < abs(t_us - is_us) for t_us in _times(data))
        row = f"{number + stamped_before},{is_us},{after_us},{after_us - before_us}\n"
        self._put(_CLOCK, row.encode(), 1)
        self._stepped_us += after_us - before_us

    def __enter__(self) -> TlogWriter:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, tb: TracebackType | None) -> None:
        self.close()


def _table(log: Path, form: TableFormat, disk: Disk) -> AppendFile:
    """Make a table beside a log."""
    return AppendFile(
        log.with_name(form.name), header=form.header.encode(), ram_bytes=_TABLE_RAM_BYTES, lazy=True, disk=disk
    )


def _places(data: bytes) -> Iterator[int]:
    """Offsets of each record that is whole but for its end, and then where the last one ends or would end."""
    place = 0
    while place + 10 < len(data):
        yield place
        length = data[place + 9]
        if data[place + 8] == MAGIC_V2:
            place += 8 + 12 + length + (SIGNATURE_LENGTH if data[place + 10] & 1 else 0)
        else:
            place += 8 + 8 + length
    yield place


def _times(data: bytes) -> Iterator[int]:
    """Stamps of whole records, Unix µs."""
    return (_TIME.unpack_from(data, place)[0] for place in list(_places(data))[:-1])


def _whole(file: int, data: bytes) -> int:
    """Bytes of the whole rows in what begins with one."""
    if file != _LOG:
        return data.rfind(b"\n") + 1
    return max(place for place in _places(data) if place <= len(data))
