"""The newest timestamps of all streams in memory that outlives the process, so that writing them waits for no disk.

The table on disk may be a second old when a process is killed. This one is exact: it is a file in the system's shared
memory (``/dev/shm``), or beside the keys where there is none. It is lost in a power cut, and not needed after an
orderly end.

Every frame writes its timestamp, eight bytes at once, which no reader sees half written. The rest of a stream is
written once a second, alternately into two slots, each with a checksum: if writing one is interrupted, the other is
intact.
"""

from __future__ import annotations

import contextlib
import fcntl
import hashlib
import mmap
import os
import stat
import struct
from pathlib import Path
from zlib import crc32

from mavlink.errors import SigningError
from mavlink.signing.streams import MAX_STREAMS, StreamRow

RUN_BYTES = 8
"""Length of a run's identifier."""
_MAGIC = b"RCJRNL1\n"
_SHARED = Path("/dev/shm")
_HEAD, _SLOT_BYTES = struct.Struct("=8s36s8s"), 32  # magic, when the computer was started, run
_NEWEST_AT = 64
_ROWS_AT = _NEWEST_AT + MAX_STREAMS * 8
_SIZE = _ROWS_AT + MAX_STREAMS * 2 * _SLOT_BYTES
_BOOT_ID = Path("/proc/sys/kernel/random/boot_id")
_SUM, _BODY = struct.Struct("=I"), struct.Struct("=IQQQ")  # stream, timestamp, received, booted


class StreamJournal:
    """The journal of one key folder; the caller holds the folder's lock.

    Raises:
        SigningError: its file can be made neither in shared memory nor beside the keys.
    """

    def __init__(self, folder: Path) -> None:
        name = hashlib.sha256(os.fsencode(folder.resolve())).hexdigest()[:16]
        for self.path in (_SHARED / f"rollcall-{os.geteuid()}-{name}", folder / "streams.journal"):
            try:
                self._map = _mapped(self.path)
                break
            except OSError as error:
                failed = error
        else:
            raise SigningError(f"{self.path}: cannot be made: {failed.strerror or failed}") from None
        self._last_slot = bytearray(MAX_STREAMS)
        self.newest = memoryview(self._map)[_NEWEST_AT:_ROWS_AT].cast("Q")
        """The newest timestamp of the stream at each place."""

    def run(self) -> bytes:
        """Identifier of the run that wrote the journal; empty for none, or if the computer restarted since."""
        magic, boot, run = _HEAD.unpack_from(self._map)
        return run if magic == _MAGIC and boot == _boot_id() != b"" else b""

    def rows(self) -> list[StreamRow]:
        """The rows of both slots of each stream: its newest row, and perhaps the one before."""
        rows = []
        for at in range(_ROWS_AT, _SIZE, _SLOT_BYTES):
            row = _row(self._map[at : at + _SLOT_BYTES])
            if row is not None:
                newest = self.newest[(at - _ROWS_AT) // (2 * _SLOT_BYTES)]
                rows.append(row._replace(timestamp=max(row.timestamp, newest)))
        return rows

    def begin(self, run: bytes) -> None:
        """Empty the journal for a new run."""
        self._map[:] = bytes(_SIZE)
        _HEAD.pack_into(self._map, 0, _MAGIC, _boot_id(), run)

    def put(self, place: int, stream: int, timestamp: int, received: int, booted: int) -> None:
        """Write a stream's row; implements :class:`mavlink.signing.streams.StreamRecorder`."""
        slot = self._last_slot[place] = self._last_slot[place] ^ 1
        at = _ROWS_AT + (2 * place + slot) * _SLOT_BYTES
        body = _BODY.pack(stream, timestamp, received, booted)
        self._map[at : at + _SLOT_BYTES] = _SUM.pack(crc32(body)) + body
        self.newest[place] = timestamp

    def close(self, *, needed: bool) -> None:
        """Close the journal and remove its file unless it is still needed."""
        if not needed:
            with contextlib.suppress(OSError):
                self.path.unlink()
        self.newest.release()
        self._map.close()


def _boot_id() -> bytes:
    """The kernel's id of this boot; empty where the system has none."""
    try:
        return _BOOT_ID.read_bytes().strip()[:36]
    except OSError:
        return b""


def _mapped(path: Path) -> mmap.mmap:
    """Maps the file into memory, locked for this process until it is closed.

    Raises:
        OSError: it cannot be made, is not this user's own file, or another process has locked it.
    """
    fd = os.open(path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_NONBLOCK, 0o600)
    try:
        found = os.fstat(fd)
        own = stat.S_ISREG(found.st_mode) and found.st_uid == os.geteuid() and found.st_nlink == 1
        if not own or found.st_mode & 0o077:
            raise OSError("a file that is not this user's own")
        # allocated now: where memory is short, writing later would end the process
        if hasattr(os, "posix_fallocate"):
            os.posix_fallocate(fd, 0, _SIZE)
        os.ftruncate(fd, _SIZE)
        # another container may share this memory and have another folder of this name; the map keeps the file open
        fcntl.flock(fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
        return mmap.mmap(fd, _SIZE)
    finally:
        os.close(fd)


def _row(slot: bytes) -> StreamRow | None:
    """The row in a slot, None if it is empty or was not completely written."""
    body = slot[_SUM.size :]
    if _SUM.pack(crc32(body)) != slot[: _SUM.size]:
        return None
    stream, timestamp, received, booted = _BODY.unpack(body)
    return StreamRow(stream >> 16, stream >> 8 & 0xFF, stream & 0xFF, timestamp, received, booted)
