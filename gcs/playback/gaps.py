"""Gaps of a recording: when no frame, or no telemetry, was received."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from gcs.station import Gap
from mavlink.state import SILENT_S
from vision.stream.pace import stall_after_s

__all__ = ["find_gaps"]


def find_gaps(
    frames_us: NDArray[np.int64] | None, packets_us: NDArray[np.int64], start_us: int, stop_us: int
) -> tuple[Gap, ...]:
    """Every gap from start to stop, in order of time; also before the first and after the last frame or packet.

    Args:
        frames_us: (n,) when each frame was taken; None for a recording without video, which has no gaps of it.
        packets_us: (k,) when each packet was received.
        start_us: of the recording.
        stop_us: of the recording.
    """
    gaps = _gaps(packets_us, start_us, stop_us, "telemetry", SILENT_S)
    if frames_us is not None:
        gaps += _gaps(frames_us, start_us, stop_us, "video", stall_after_s(frames_us))
    return tuple(sorted(gaps, key=lambda gap: gap.start_us))


def _gaps(
    t_us: NDArray[np.int64], start_us: int, stop_us: int, what: Literal["telemetry", "video"], least_s: float
) -> list[Gap]:
    inside = t_us[(t_us > start_us) & (t_us < stop_us)]
    times = np.concatenate([[start_us], np.sort(inside), [stop_us]])
    starts = np.flatnonzero(np.diff(times) > least_s * 1e6)
    return [Gap(start_us=int(times[k]), stop_us=int(times[k + 1]), what=what) for k in starts]
