"""A recorded flight in the order in which it was folded."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from gcs.fold.pipeline import Pipeline
from gcs.mission.mission import Mission
from gcs.session.fold_order import NO_FRAME, FoldOrder, FoldTurn
from gcs.session.frame_tables import FrameDetections
from gcs.session.log import SessionLog
from mavlink.protocol.packet import Packet
from vision.detect.detections import Detections

if TYPE_CHECKING:
    from vision.video.video import Frame

_MAX_BETWEEN = 1000
"""Frames that a flight skips between two that it looks at, at most."""
PATIENCE_US = 3_000_000
"""Time for which frames of a recording wait for the UAV's pose: no screen waits for them."""
_MAX_QUEUED_US = 5_000_000
"""Longest time from a record that a turn has not taken in yet to that turn."""


class PacketsInOrder:
    """Packets in the order of arrival, handed out up to a time."""

    def __init__(self, packets: Iterator[Packet]) -> None:
        self._packets = packets
        self._next = next(packets, None)

    def until(self, t_us: int) -> Iterator[Packet]:
        """The next ones up to a time, inclusive."""
        while self._next is not None and self._next.t_us <= t_us:
            yield self._next
            self._next = next(self._packets, None)

    def awaited(self, pipeline: Pipeline, t_us: int) -> Iterator[Packet]:
        """Return the packets up to a frame's time, and those until the UAV's pose at that time is known, if it
        comes."""
        # a frame that is dated before it was taken came later than its date
        yield from self.until(max(t_us, pipeline.telemetry_time(t_us)))
        uav_id, until_us = pipeline.mission.uav.system_id, pipeline.awaits_until(t_us, PATIENCE_US)
        while self._next is not None and pipeline.awaits_telemetry(t_us, self._next.t_us, most_us=PATIENCE_US):
            # nobody but the UAV ends the wait
            yield from self._through(uav_id, until_us)

    def _through(self, system_id: int, until_us: int) -> Iterator[Packet]:
        """The next ones through the first of a vehicle, if it comes before a time."""
        found = False
        while not found and self._next is not None and self._next.t_us < until_us:
            found = self._next.system_id == system_id
            yield self._next
            self._next = next(self._packets, None)


class GroundScale:
    """Ground metres a pixel of frames that the fold has not come to yet, from a fold of the telemetry of its own."""

    def __init__(self, mission: Mission, packets: PacketsInOrder) -> None:
        self._pipeline = Pipeline(mission)
        self._packets = packets

    def gsd_m(self, frame: Frame) -> float | None:
        """Return the ground resolution at the centre of a frame, metres per pixel; frames come in order."""
        for packet in self._packets.until(max(frame.t_us, self._pipeline.telemetry_time(frame.t_us))):
            self._pipeline.add_packet(packet)
        self._pipeline.follow_ground(frame.t_us)
        return self._pipeline.gsd_m(frame.t_us, frame.image)


class RecordedTurns:
    """The turns of a flight's fold over its telemetry and boxes.

    Attributes:
        sizes: width and height of its frames, px.
        warnings: what an analyst should know, one line each.
    """

    def __init__(self, folds: FoldOrder, log: SessionLog, boxes: FrameDetections) -> None:
        self._folds, self._log, self._boxes = folds, log, boxes
        self._stops, renumbered = folds.placed(log.stamped_us)
        self.sizes = folds.sizes
        self.warnings = tuple(self._find_warnings(renumbered))

    @classmethod
    def open(cls, path: Path, log: SessionLog, boxes: FrameDetections) -> RecordedTurns | None:
        """Read ``folds.csv``; None where no frame was ever looked at.

        Raises:
            SessionError: the file is no such table.
        """
        folds = FoldOrder.read(path.parent)
        return cls(folds, log, boxes) if folds and folds.sizes else None

    def times_from(self, known: NDArray[np.int64]) -> NDArray[np.int64]:
        """Times of all frames, also of the newest that the fold saw before a flight was cut off.

        Args:
            known: (n,) Unix µs of the recorded ones.

        Returns:
            (m,) m >= n.
        """
        later = {turn.frame: turn.t_us for turn in self._folds.turns if turn.frame >= len(known)}
        if not later or max(later) - len(known) > _MAX_BETWEEN * len(later):
            return known
        frames = np.arange(len(known), max(later) + 1)
        more = np.interp(frames, np.array(list(later)), np.array(list(later.values()), dtype=np.float64))
        return np.concatenate([known, np.round(more).astype(np.int64)])

    def placed_turns(
        self, frames_us: NDArray[np.int64]
    ) -> Iterator[tuple[int, FoldTurn, Iterator[Packet], Detections | None]]:
        """Yield the turns as :meth:`turns` does, each with its time on the recording's time line, Unix µs.

        Args:
            frames_us: (n,) times of the frames on it.
        """
        line_us, stamped_us, last_us = self._log.times_us, self._log.stamped_us, 0
        for turn, packets, boxes in self.turns(len(frames_us)):
            if turn.frame != NO_FRAME:
                at_us = int(frames_us[turn.frame])
            else:
                # as the clock stood at the last record before; a clock that was set since shows in the next one
                record = min(max(turn.records, 1), len(line_us))
                at_us = turn.t_us + int(line_us[record - 1] - stamped_us[record - 1]) if record else turn.t_us
                if 0 < turn.records < len(line_us):
                    at_us = min(at_us, int(line_us[turn.records]) + _MAX_QUEUED_US)
            last_us = max(last_us, at_us)
            yield last_us, turn, packets, boxes

    def packets_after(self) -> Iterator[Packet]:
        """Packets of which no turn is recorded any more, of a flight that was killed."""
        stop = int(self._stops[-1]) if len(self._stops) else 0
        return islice(self._log.packets(as_stamped=True), stop, None)

    def turns(self, frames: int) -> Iterator[tuple[FoldTurn, Iterator[Packet], Detections | None]]:
        """Each turn with the packets that were taken in before it, which are to be used up, and its boxes.

        Boxes are None where the detector was not run.

        Args:
            frames: of the recording; turns for others are left out.
        """
        taken = self._folds.taken_in(len(self._log)).tolist()
        packets = (packet for packet, wanted in zip(self._log.packets(as_stamped=True), taken, strict=True) if wanted)
        counts = np.concatenate([[0], np.cumsum(taken, dtype=np.int64)])
        fed = 0
        for turn, stop in zip(self._folds.turns, self._stops.tolist(), strict=True):
            if turn.frame >= frames:
                continue
            more = max(int(counts[min(stop, len(taken))]) - fed, 0)
            fed += more
            yield turn, islice(packets, more), None if turn.boxes is None else self._boxes.at(turn.frame)

    def _find_warnings(self, renumbered: int) -> Iterator[str]:
        if self._folds.skipped:
            yield f"folds.csv: {self._folds.skipped} rows could not be used and were skipped"
        if renumbered:
            yield f"folds.csv: the log lacks records that the flight had; {renumbered} turns are placed by time"
        wrong = sum(
            turn.frame != NO_FRAME and len(self._boxes.at(turn.frame)) != (turn.boxes or 0)
            for turn in self._folds.turns
        )
        if wrong:
            yield f"detections.csv: of {wrong} frames it has not the boxes that the flight found"
