"""Many datagrams with one system call: Linux's recvmmsg, which the standard library does not have.

Each datagram comes with its sender and the kernel's time of its arrival. All memory is reserved once; pages of it that
no datagram reaches are never touched.

Reference: recvmmsg(2), cmsg(3), socket(7).
"""

from __future__ import annotations

import ctypes
import errno
import os
import socket
import struct
import sys
from collections.abc import Iterator

__all__ = ["BATCH", "SO_TIMESTAMPNS", "STRIDE", "Datagrams", "available"]

SO_TIMESTAMPNS = 35
BATCH = 256
STRIDE = 65536
# A row beside each datagram: the sender, whose family, port and address are its first eight bytes, then one control
# message: 16 bytes of header (length, level, kind) and 16 of time.
_ROW = struct.Struct("=q8xQiiqq")
_NAME_BYTES, _CONTROL_BYTES = 16, 32
_LENGTH = struct.Struct("=56xI4x")
_DONT_WAIT = 0x40


class _IoVec(ctypes.Structure):
    _fields_ = (("base", ctypes.c_void_p), ("length", ctypes.c_size_t))


class _Header(ctypes.Structure):
    """struct mmsghdr on 64 bits: the kernel fills in the lengths and the flags."""

    _fields_ = (
        ("name", ctypes.c_void_p),
        ("name_length", ctypes.c_uint32),
        ("vectors", ctypes.c_void_p),
        ("vector_count", ctypes.c_size_t),
        ("control", ctypes.c_void_p),
        ("control_length", ctypes.c_size_t),
        ("flags", ctypes.c_int),
        ("received", ctypes.c_uint32),
        ("padding", ctypes.c_uint32),
    )


def available() -> bool:
    """Whether this system has the call, in the layout that is written down here."""
    return sys.platform.startswith("linux") and ctypes.sizeof(_Header) == _LENGTH.size and hasattr(_libc(), "recvmmsg")


def _libc() -> ctypes.CDLL:
    return ctypes.CDLL(None, use_errno=True)


class Datagrams:
    """Room for a batch of datagrams of one socket, filled again by every call of :meth:`receive`."""

    def __init__(self, sock: socket.socket) -> None:
        self._fd = sock.fileno()
        self._call = _libc().recvmmsg
        self._call.argtypes = (ctypes.c_int, ctypes.c_void_p, ctypes.c_uint, ctypes.c_int, ctypes.c_void_p)
        self._call.restype = ctypes.c_int
        self._data = ctypes.create_string_buffer(BATCH * STRIDE)
        self._rows = ctypes.create_string_buffer(BATCH * _ROW.size)
        self._vectors = (_IoVec * BATCH)()
        self._headers = (_Header * BATCH)()
        self._lay_out()
        self._fresh = bytes(self._headers)
        self.view = memoryview(self._data).cast("B")
        """Datagram k begins at k · STRIDE."""
        self._row_view = memoryview(self._rows).cast("B")
        self._header_view = memoryview(self._headers).cast("B")

    def _lay_out(self) -> None:
        data, rows = ctypes.addressof(self._data), ctypes.addressof(self._rows)
        for k in range(BATCH):
            row = rows + k * _ROW.size
            self._vectors[k] = _IoVec(data + k * STRIDE, STRIDE)
            self._headers[k] = _Header(
                name=row,
                name_length=_NAME_BYTES,
                vectors=ctypes.addressof(self._vectors[k]),
                vector_count=1,
                control=row + _NAME_BYTES,
                control_length=_CONTROL_BYTES,
            )

    def receive(self) -> int:
        """Takes what is there, without waiting.

        Returns:
            How many datagrams, at most 256; 0 when there are none.

        Raises:
            OSError: the socket is gone.
        """
        count = int(self._call(self._fd, self._headers, BATCH, _DONT_WAIT, None))
        if count >= 0:
            return count
        code = ctypes.get_errno()
        if code in (errno.EAGAIN, errno.EINTR, errno.ECONNREFUSED):
            return 0  # nothing there, or an earlier datagram of ours found nobody
        raise OSError(code, os.strerror(code))

    def lengths(self, count: int) -> list[int]:
        """Bytes of the first ``count`` datagrams."""
        return [length for (length,) in _LENGTH.iter_unpack(self._header_view[: count * _LENGTH.size])]

    def rows(self, count: int) -> Iterator[tuple[int, int, int, int, int, int]]:
        """What came beside the first ``count`` datagrams.

        Yields:
            sender (as :func:`mavlink.link_peers.key_of` has it), length, level and kind of the control message, and,
            where the kind is ``SO_TIMESTAMPNS``, seconds and nanoseconds of arrival in Unix time.
        """
        return _ROW.iter_unpack(self._row_view[: count * _ROW.size])

    def reset(self, count: int) -> None:
        """Makes the first ``count`` places ready for the next call."""
        ctypes.memmove(self._headers, self._fresh, count * _LENGTH.size)
        ctypes.memset(self._rows, 0, count * _ROW.size)
