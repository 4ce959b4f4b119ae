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

from infra.stamped_udp import STAMP

BATCH = 256
STRIDE = 65536
# A row of six words beside each datagram: the sender, whose family, port and address are its first eight bytes of 16,
# then one control message: length, level and kind, seconds, nanoseconds.
_ROW_WORDS, _KIND, _SECONDS, _NANOSECONDS = 6, 3, 4, 5
_ROW_BYTES, _NAME_BYTES, _CONTROL_BYTES = 48, 16, 32
_HEADER_WORDS, _RECEIVED, _HEADER_BYTES = 16, 14, 64
_STAMPED = int.from_bytes(struct.pack("=ii", *STAMP), sys.byteorder)
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
    """Tell whether this system has the call, in the layout that is written down here."""
    return sys.platform.startswith("linux") and ctypes.sizeof(_Header) == _HEADER_BYTES and hasattr(_libc(), "recvmmsg")


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
        self._rows = ctypes.create_string_buffer(BATCH * _ROW_BYTES)
        self._vectors = (_IoVec * BATCH)()
        self._headers = (_Header * BATCH)()
        self._lay_out()
        self._fresh = bytes(self._headers)
        self.view = memoryview(self._data).cast("B")
        """Datagram k begins at k · STRIDE."""
        self._row_words = memoryview(self._rows).cast("B").cast("q")
        self._header_words = memoryview(self._headers).cast("B").cast("I")

    def _lay_out(self) -> None:
        data, rows = ctypes.addressof(self._data), ctypes.addressof(self._rows)
        for k in range(BATCH):
            row = rows + k * _ROW_BYTES
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
        """Take what is there, without waiting.

        Returns:
            How many datagrams, at most 256; 0 when there are none.

        Raises:
            ConnectionRefusedError: an earlier datagram of ours found no listener.
            OSError: the socket is gone.
        """
        count = int(self._call(self._fd, self._headers, BATCH, _DONT_WAIT, None))
        if count >= 0:
            return count
        code = ctypes.get_errno()
        if code in (errno.EAGAIN, errno.EINTR):
            return 0
        raise OSError(code, os.strerror(code))

    def lengths(self, count: int) -> list[int]:
        """Bytes of the first ``count`` datagrams."""
        return self._header_words[_RECEIVED : count * _HEADER_WORDS : _HEADER_WORDS].tolist()

    def senders(self, count: int) -> list[int]:
        """Senders of the first ``count`` datagrams, as :func:`mavlink.links.peers.key_of` has it."""
        return self._row_words[0 : count * _ROW_WORDS : _ROW_WORDS].tolist()

    def times_us(self, count: int) -> list[int]:
        """Arrivals of the first ``count`` datagrams, Unix µs; 0 where the kernel gives no time."""
        words, stop = self._row_words, count * _ROW_WORDS
        columns = (words[k:stop:_ROW_WORDS].tolist() for k in (_KIND, _SECONDS, _NANOSECONDS))
        return [
            seconds * 1_000_000 + nanoseconds // 1000 if kind == _STAMPED else 0
            for kind, seconds, nanoseconds in zip(*columns, strict=True)
        ]

    def reset(self, count: int) -> None:
        """Make the first ``count`` places ready for the next call."""
        ctypes.memmove(self._headers, self._fresh, count * _HEADER_BYTES)
        ctypes.memset(self._rows, 0, count * _ROW_BYTES)
