"""Recognition of files that are no telemetry log, or no longer one, by their first bytes and their line ends."""

from __future__ import annotations

import numpy as np

from mavlink.tlog.scan import Bytes

_PACKED = "a packed file ({}): unpack it first"
_CAPTURE = "a capture of a network ({}): frames in it are found, but without their times"
_SIGNATURES = (
    (b"\x1f\x8b", _PACKED.format("gzip")),
    (b"BZh", _PACKED.format("bzip2")),
    (b"PK\x03\x04", _PACKED.format("zip")),
    (b"\xfd7zXZ\x00", _PACKED.format("xz")),
    (b"\x28\xb5\x2f\xfd", _PACKED.format("zstd")),
    (b"7z\xbc\xaf", _PACKED.format("7z")),
    (b"Rar!", _PACKED.format("rar")),
    (b"\xd4\xc3\xb2\xa1", _CAPTURE.format("pcap")),
    (b"\xa1\xb2\xc3\xd4", _CAPTURE.format("pcap")),
    (b"\x4d\x3c\xb2\xa1", _CAPTURE.format("pcap")),
    (b"\x0a\x0d\x0d\x0a", _CAPTURE.format("pcapng")),
    (b"\xa3\x95", "the log that an ArduPilot keeps on board (DataFlash), which holds no MAVLink"),
    (b"ULog\x01\x12\x35", "the log that a PX4 keeps on board (ULog), which holds no MAVLink"),
)
_WINDOW = 1 << 23  # bytes looked at at a time
_LINE_FEEDS = 32  # by chance all of them follow a carriage return once in 256^32 logs


def looks_like(data: Bytes) -> str:
    """Name the other kind of file that the bytes begin like, in words; empty for none."""
    head = data[:8].tobytes()
    return next((kind for signature, kind in _SIGNATURES if head.startswith(signature)), "")


def sent_as_text(data: Bytes) -> bool:
    """Tell whether each line feed follows a carriage return, as after a transfer that took the file for text."""
    count = 0
    for start in range(0, data.size, _WINDOW):
        feeds = data[start : start + _WINDOW] == 0x0A
        before = data[start - 1 : start - 1 + feeds.size] if start else np.append(np.uint8(0), data[: feeds.size - 1])
        if (feeds & (before != 0x0D)).any():
            return False
        count += int(np.count_nonzero(feeds))
    return count >= _LINE_FEEDS
