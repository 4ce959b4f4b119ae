"""Exposure times of frames, for streams that carry them.

Three ways: the MISP time stamp in a frame's SEI (MISB ST 0604), the precision time stamp of KLV metadata in an MPEG
transport stream (MISB ST 0601, tag 2, in packets that have a presentation time), and RTCP sender reports (RFC 3550).
All are the sender's clock, which is used only where it agrees with the times of arrival here.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

_SEI_KEY = b"MISPmicrosectime"
_SEI_BYTES = 12
"""Status, then the time in four pairs of bytes with 0xFF between them."""
_KLV_KEY = bytes.fromhex("060e2b34020b01010e01030101000000")
_TIME_TAG = 2
"""Tag of the precision time stamp in a UAS data set (MISB ST 0601)."""
_NTP_TO_UNIX_S = 2_208_988_800
"""Seconds from 1900, where NTP time begins, to 1970."""
_SENDER_REPORT = 200
"""RTCP packet type of a sender report."""
EARLY_S, LATE_S = 0.05, 3.0
"""A frame comes after it was taken, and not later than this; otherwise the sender's clock is not set."""


@dataclass(frozen=True, slots=True)
class SenderReport:
    """RTCP: the sender's Unix time at one of its RTP times."""

    source: int
    unix_s: float
    time: int
    """90 kHz, 32 bits."""


def sei_time_s(frame: bytes) -> float | None:
    """Unix time of a coded frame by its MISP time stamp, None without one."""
    at = frame.find(_SEI_KEY) + len(_SEI_KEY)
    field = frame[at : at + _SEI_BYTES]
    if at < len(_SEI_KEY) or len(field) < _SEI_BYTES or field[3::3] != b"\xff\xff\xff":
        return None
    return int.from_bytes(field[1:3] + field[4:6] + field[7:9] + field[10:12], "big") * 1e-6


def klv_time_s(data: bytes) -> float | None:
    """Unix time of a UAS data set, None if it is none or has no time."""
    at = data.find(_KLV_KEY) + len(_KLV_KEY)
    if at < len(_KLV_KEY) or at >= len(data):
        return None
    # BER length: one byte, or how many bytes of length follow
    at += 1 + (data[at] & 0x7F if data[at] & 0x80 else 0)
    if data[at : at + 2] != bytes((_TIME_TAG, 8)) or len(data) < at + 10:
        return None
    return int.from_bytes(data[at + 2 : at + 10], "big") * 1e-6


def sender_report(data: bytes) -> SenderReport | None:
    """The first report of an RTCP packet, None when it begins with none."""
    if len(data) < 28 or data[0] >> 6 != 2 or data[1] != _SENDER_REPORT:
        return None
    source, seconds, fraction, time = struct.unpack_from("!IIII", data, 4)
    return SenderReport(source, seconds - _NTP_TO_UNIX_S + fraction / 2**32, time)


class Exposures:
    """One connection's time stamps and the exposure times that belong to them.

    Attributes:
        source: ``SEI``, ``KLV`` or ``RTCP``, empty while there was nothing usable.
        delay_s: from exposure to arrival, at the last one received.
        error_s: how far off the sender's clock is where it cannot be used, 0 where it can.
    """

    def __init__(self) -> None:
        self.source = ""
        self.delay_s = self.error_s = 0.0
        self._offset_s: float | None = None

    def add(self, source: str, stamp_s: float, taken_s: float, arrival_s: float) -> None:
        """Add an exposure time from the stream.

        Args:
            source: ``SEI``, ``KLV`` or ``RTCP``.
            stamp_s: its time stamp, s, any zero.
            taken_s: Unix time by the sender's clock.
            arrival_s: Unix time at which it came.
        """
        delay_s = arrival_s - taken_s
        if not -EARLY_S <= delay_s <= LATE_S:
            self.error_s = delay_s
            self._offset_s, self.source = None, ""
            return
        self.source, self.delay_s, self.error_s = source, delay_s, 0.0
        self._offset_s = taken_s - stamp_s

    def unix_s(self, stamp_s: float) -> float | None:
        """Unix time at which what has this time stamp was taken, None where the stream has none."""
        return None if self._offset_s is None else stamp_s + self._offset_s
