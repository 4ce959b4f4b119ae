"""Times of the names of a frame: from that frame until the next, by the clock of the film that is played.

Times are µs after the film's first frame.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gcs.export.job import ExportJob
from gcs.snapshot import HELD_SHOWN_S, Snapshot
from vision.video.video import VideoFile

HELD_US = round(HELD_SHOWN_S * 1e6)
LAST_US = 100_000
"""Time for which a single frame is shown."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Cue:
    """The names of one frame."""

    start_us: int
    end_us: int
    """Start of the next frame."""
    snapshot: Snapshot
    """Snapshot of the frame, with the boxes only that were seen in it."""


class Cues:
    """Makes cues of snapshots; each is known once the next frame is.

    Names stay through frames that the detector did not look at, for half a second at most: they would flicker.

    Args:
        times_us: (n,) when the film shows each of its frames.
    """

    def __init__(self, times_us: NDArray[np.int64]) -> None:
        self._times_us = times_us
        self._begun: tuple[int, Snapshot] | None = None
        self._gap_us = LAST_US

    def add(self, snapshot: Snapshot) -> Cue | None:
        """Take a frame, and give the cue that it ends; frames that go back in time are left out."""
        if not 0 <= snapshot.frame < len(self._times_us):
            return None
        at_us = int(self._times_us[snapshot.frame])
        if self._begun is None:
            self._begin(at_us, snapshot)
            return None
        start_us, shown = self._begun
        if at_us <= start_us or (snapshot.held and at_us - start_us < HELD_US):
            return None
        self._gap_us = self._until(shown, at_us) - start_us
        self._begin(at_us, snapshot)
        return Cue(start_us=start_us, end_us=start_us + self._gap_us, snapshot=shown)

    def last(self) -> Cue | None:
        """The cue that no frame ends: as long as the one before."""
        if self._begun is None:
            return None
        start_us, shown = self._begun
        return Cue(start_us=start_us, end_us=self._until(shown, start_us + self._gap_us), snapshot=shown)

    def _begin(self, at_us: int, snapshot: Snapshot) -> None:
        seen = tuple(box for box in snapshot.new_boxes if not box.coasting)
        self._begun = None if snapshot.held else (at_us, replace(snapshot, boxes=seen))

    def _until(self, shown: Snapshot, at_us: int) -> int:
        """End the cue at a time, or earlier where frames between were left out."""
        start_us = int(self._times_us[shown.frame])
        following_us = int(self._times_us[min(shown.frame + 1, len(self._times_us) - 1)])
        return min(at_us, max(following_us, start_us + HELD_US))


def film_times_us(job: ExportJob) -> NDArray[np.int64]:
    """(n,) when a player shows each frame: by the film's own time stamps, else by when it was taken."""
    if job.video is not None:
        with VideoFile.open(job.video) as film:
            return film.times_us
    return job.times_us - job.times_us[:1]
