"""A film's coded frames at the times at which the session has them, for copies that are not coded again."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
from av.packet import Packet
from av.video.stream import VideoStream
from numpy.typing import NDArray

from gcs.errors import GcsError
from infra.files.disk import OF_THE_DISK
from vision.video.coded_frames import CodedFilm
from vision.video.frame_index import reason


def shown_times(times_us: NDArray[np.int64], time_base: Fraction) -> NDArray[np.int64]:
    """(n,) when each frame is shown, in ticks after the first: later ones later, whatever clocks did.

    Args:
        times_us: (n,) when each was taken.
        time_base: seconds of a tick.
    """
    ticks = np.round((times_us - times_us[:1]) * (1e-6 / float(time_base))).astype(np.int64)
    count = np.arange(len(ticks))
    return np.asarray(np.maximum.accumulate(ticks - count) + count, dtype=np.int64)


def retimed(film: CodedFilm, shown: NDArray[np.int64], time_base: Fraction) -> Iterator[Packet[VideoStream]]:
    """The film's packets in the order of decoding, those left out that have no time.

    Args:
        shown: (n,) when each frame is shown, ascending ticks.
        time_base: seconds of a tick.
    """
    with CodedFilm(film.path) as ahead:
        order = [frame.index for frame in ahead.frames() if frame.index < len(shown)]
    stamps = iter(_decoding_times(shown[order]).tolist())
    for frame in film.frames():
        if frame.index < len(shown):
            packet = frame.packet
            packet.time_base = time_base
            packet.pts, packet.dts, packet.duration = int(shown[frame.index]), next(stamps), 0
            yield packet


@contextmanager
def copying(film: Path | None, kind: str) -> Iterator[None]:
    """Make one line of what FFmpeg says against a copy.

    Raises:
        GcsError: in place of FFmpeg's errors.
        OSError: the disk takes no more.
    """
    try:
        yield
    except (av.FFmpegError, ValueError) as error:
        if isinstance(error, OSError) and error.errno in OF_THE_DISK:
            raise
        raise GcsError(f"{film or 'export'}: cannot be written as {kind} ({reason(error)})") from error


def _decoding_times(shown: NDArray[np.int64]) -> NDArray[np.int64]:
    """(n,) times to decode frames at, ascending, none after its frame is shown; given in the order of decoding."""
    ascending = np.sort(shown)
    return np.asarray(ascending - max(0, int((ascending - shown).max(initial=0))), dtype=np.int64)
