"""Telemetry logs: the format that every MAVLink ground station writes and reads.

A record is eight bytes of big-endian Unix µs and the raw frame, nothing else: a log is valid after every record.
"""

from __future__ import annotations

import mmap
import os
import struct
from collections.abc import Collection, Iterator
from contextlib import suppress
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pymavlink.dialects.v20 import ardupilotmega

from infra.files.safe_open import open_to_read
from mavlink.errors import TlogError
from mavlink.protocol.packet import MAGIC_V2, Packet
from mavlink.tlog.file_type import looks_like
from mavlink.tlog.index import TlogIndex, build_index
from mavlink.tlog.scan import Bytes, Ints, gather

_TIME = struct.Struct(">Q")


def message_number(name: str) -> int:
    """Number of a message by its name.

    Raises:
        TlogError: the dialect has no such message.
    """
    for number, message in ardupilotmega.mavlink_map.items():
        if message.msgname == name:
            return int(number)
    raise TlogError(f"message {name!r}: not in the ardupilotmega dialect; names are as in GLOBAL_POSITION_INT")


@cache
def message_dtype(message_id: int) -> np.dtype[np.void]:
    """Packed dtype of a message's payload with all extensions, fields in wire order under their own names.

    Raises:
        TlogError: the dialect has no such message.
    """
    message = ardupilotmega.mavlink_map.get(message_id)
    if message is None:
        raise TlogError(f"message {message_id}: not in the ardupilotmega dialect")
    fields = []
    for name in message.ordered_fieldnames:
        position = message.fieldnames.index(name)
        count = message.array_lengths[message.ordered_fieldnames.index(name)]
        kind = message.fieldtypes[position]
        fields.append((name, *_field(kind, count)))
    dtype = np.dtype(fields)
    if dtype.itemsize != message.unpacker.size:
        raise TlogError(f"message {message_id}: its definition has {message.unpacker.size} bytes, not {dtype.itemsize}")
    return dtype


def _field(kind: str, count: int) -> tuple[str] | tuple[str, tuple[int]]:
    """numpy type of a field; text is bytes, cut at NUL by numpy."""
    if kind == "char":
        return (f"S{max(count, 1)}",)
    code = {"uint8_t_mavlink_version": "u1", "float": "<f4", "double": "<f8"}.get(kind)
    if code is None:
        sign = "u" if kind.startswith("u") else "i"
        bits = int(kind.removeprefix("u").removeprefix("int").removesuffix("_t"))
        code = f"<{sign}{bits // 8}"
    return (code, (count,)) if count else (code,)


def read_columns(data: Bytes, offset: Ints, message_id: int) -> NDArray[np.void]:
    """Payloads of the frames at these offsets, which must all be of this message and undamaged.

    Args:
        data: (size,) the file.
        offset: (n,) where the frames begin.

    Returns:
        (n,) structured array; bytes that MAVLink 2 left out are zero.

    Raises:
        TlogError: the dialect has no such message.
    """
    dtype = message_dtype(message_id)
    payload = np.zeros((offset.size, dtype.itemsize), dtype=np.uint8)
    if offset.size:
        start = offset + np.where(data[offset] == MAGIC_V2, 10, 6)
        length = data[offset + 1]
        for width in np.unique(length):
            if width:
                chosen = length == width
                payload[chosen, :width] = gather(data, start[chosen], int(width))
    return payload.view(dtype).ravel()


class Tlog:
    """A log opened for reading: everything undamaged in it, at any place in it.

    Example:
        >>> log = Tlog.open("flight.tlog")
        >>> int((log.index.message_id == 0).sum())  # heartbeats
        280
    """

    def __init__(self, path: Path, data: Bytes, index: TlogIndex) -> None:
        self.path = path
        self.index = index
        self._data = data

    @property
    def data(self) -> Bytes:
        """(size,) the file's bytes, not to be written."""
        return self._data

    @classmethod
    def open(cls, path: Path | str, *, any_file: bool = False) -> Tlog:
        """Read and check the whole file; damage is listed in ``index.damage``.

        Args:
            any_file: a file without a single good frame is opened too, with an empty index.

        Raises:
            TlogError: no such file, not readable, empty, or without a single good frame.
        """
        path = Path(path)
        data = _map(path)
        index = build_index(data)
        if len(index) == 0 and not any_file:
            kind = looks_like(data)
            what = f"it begins like {kind}" if kind else "is it a telemetry log? see gcs tlog check"
            raise TlogError(f"{path}: no MAVLink frame found in {data.size} bytes; {what}")
        return cls(path, data, index)

    def packet(self, row: int) -> Packet:
        """Return the record in one row of the index."""
        start = int(self.index.offset[row])
        return Packet(int(self.index.t_us[row]), self._data[start : start + int(self.index.length[row])].tobytes())

    def packets(
        self,
        start_us: int | None = None,
        stop_us: int | None = None,
        message_ids: Collection[int] | None = None,
        system_ids: Collection[int] | None = None,
    ) -> Iterator[Packet]:
        """Packets in file order, those with start_us ≤ t_us < stop_us, of some messages and of some systems only."""
        yield from self._packets(self.select(start_us, stop_us, message_ids, system_ids))

    def select(
        self,
        start_us: int | None = None,
        stop_us: int | None = None,
        message_ids: Collection[int] | None = None,
        system_ids: Collection[int] | None = None,
    ) -> NDArray[np.int64]:
        """Rows of the index in a span of time (stop excluded), of some messages and of some systems; None is all."""
        index = self.index
        chosen = np.ones(len(index), dtype=np.bool_)
        if start_us is not None:
            chosen &= index.t_us >= start_us
        if stop_us is not None:
            chosen &= index.t_us < stop_us
        if message_ids is not None:
            chosen &= np.isin(index.message_id, list(message_ids))
        if system_ids is not None:
            chosen &= np.isin(index.system_id, list(system_ids))
        return np.flatnonzero(chosen)

    def columns(self, message: int | str, system_id: int | None = None) -> tuple[NDArray[np.int64], NDArray[np.void]]:
        """All messages of one kind as columns, in the units of the wire.

        Args:
            message: its number or name, 33 or ``GLOBAL_POSITION_INT``.
            system_id: of one vehicle only; None of all.

        Returns:
            (n,) rows of the index and (n,) structured values with the message's own field names.

        Raises:
            TlogError: the dialect has no such message.
        """
        index, message_id = self.index, message if isinstance(message, int) else message_number(message)
        chosen = (index.message_id == message_id) & index.known
        if system_id is not None:
            chosen &= index.system_id == system_id
        rows = np.flatnonzero(chosen)
        return rows, read_columns(self._data, index.offset[rows], message_id)

    def cut(
        self,
        out: Path | str,
        start_us: int | None = None,
        stop_us: int | None = None,
        message_ids: Collection[int] | None = None,
        system_ids: Collection[int] | None = None,
    ) -> int:
        """Write a part of the log into a new file, with times as in the index, and return the number of records.

        Raises:
            TlogError: the new file exists or cannot be written.
        """
        out = Path(out)
        rows = self.select(start_us, stop_us, message_ids, system_ids)
        try:
            with out.open("xb") as file:
                for packet in self._packets(rows):
                    file.write(_TIME.pack(packet.t_us) + packet.raw)
        except FileExistsError:
            raise TlogError(f"{out}: exists already, and recordings are never overwritten") from None
        except OSError as error:
            with suppress(OSError):
                out.unlink()  # a part of a copy, and only ever ours
            raise TlogError(f"{out}: cannot be written: {error.strerror}") from error
        return rows.size

    def _packets(self, rows: NDArray[np.int64]) -> Iterator[Packet]:
        buffer = self._data.data
        for block in range(0, rows.size, 4096):
            part = rows[block : block + 4096]
            starts, stops = self.index.offset[part], self.index.offset[part] + self.index.length[part]
            times = self.index.t_us[part].tolist()
            for t_us, start, stop in zip(times, starts.tolist(), stops.tolist(), strict=True):
                yield Packet(t_us, bytes(buffer[start:stop]))


def _map(path: Path) -> Bytes:
    """The file's bytes, read from the disk as they are touched."""
    try:
        with os.fdopen(open_to_read(path), "rb") as file:
            if os.fstat(file.fileno()).st_size == 0:
                raise TlogError(f"{path}: empty file")
            mapped = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
            if hasattr(mmap, "MADV_SEQUENTIAL"):
                mapped.madvise(mmap.MADV_SEQUENTIAL)  # a log is read through once, in large pieces
            return np.frombuffer(mapped, dtype=np.uint8)
    except FileNotFoundError:
        raise TlogError(f"{path}: no such file") from None
    except IsADirectoryError:
        raise TlogError(f"{path}: is a folder; name a log in it, such as {path / 'telemetry.tlog'}") from None
    except OSError as error:
        raise TlogError(f"{path}: cannot be read: {error.strerror}") from error
