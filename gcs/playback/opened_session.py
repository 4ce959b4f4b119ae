"""A session, opened: its telemetry, its frames' times and what was seen in them.

The decoder is imported only when a recording has a video: loading it takes longer than many a fold.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from gcs.errors import SessionError
from gcs.fold.camera.frame_size import UNDESCRIBED, FrameSize, fitting_size, holds
from gcs.mission.mission import Mission
from gcs.playback.discovery import discover
from gcs.playback.looked_frames import RecordedLooks
from gcs.playback.moments import telemetry_times
from gcs.playback.recorded_order import RecordedTurns
from gcs.session.frame_tables import FrameDetections, FrameTimes, read_times
from gcs.session.log import SessionLog
from gcs.session.session import Session
from vision.camera.intrinsics import resized

if TYPE_CHECKING:
    from vision.video.video import VideoFile

LONGEST_US = 86_400_000_000
"""A flight is not this long without a packet or a frame."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class OpenedSession:
    """All parts of a session."""

    session: Session
    log: SessionLog
    """Telemetry of the session."""
    mission: Mission
    """The session's own, or what telemetry tells of who flies."""
    frames: FrameTimes | None
    """Frame times of ``frames.csv``."""
    video: VideoFile | None
    looks: RecordedLooks | None
    """Boxes seen in the frames; None: nothing was kept, or it is to be looked at again."""
    turns: RecordedTurns | None
    """The turns of the flight's fold, where it kept them."""
    times_us: NDArray[np.int64]
    """(n,) when each frame was taken, Unix µs; of telemetry alone: moments to show it at."""
    size: FrameSize
    """Size of frames that have no image, as far as it is known."""

    @classmethod
    def open(cls, session: Session, *, redetect: bool = False) -> OpenedSession:
        """Open all files of a session.

        Raises:
            SessionError, TlogError, VideoError: a part that cannot be used.
            CameraError: the mission's camera cannot have taken the video.
        """
        log = SessionLog(session.tlog, session.notes.had_key_for)
        mission = session.mission or discover(log)
        frames = read_times(session.frames) if session.frames else None
        times = log.steps.correct_frames(frames.times_us, log.start_us) if frames else None
        video = _open_video(session, log, times)
        looks = _open_looks(session, redetect)
        turns = RecordedTurns.open(session.folds, log, looks.boxes) if session.folds and looks else None
        known = video.times_us if video is not None else times
        if known is not None and turns:
            known = turns.times_from(known)
        times_us = telemetry_times(log.times_us) if known is None else known
        size = _frame_size(session, log, mission, video, looks.boxes if looks else None, turns, times_us)
        return cls(
            session=session,
            log=log,
            mission=mission,
            frames=frames,
            video=video,
            looks=looks,
            turns=turns,
            times_us=times_us,
            size=size,
        )

    @property
    def frames_us(self) -> NDArray[np.int64] | None:
        """(n,) when each frame was taken; None for telemetry alone."""
        return self.times_us if self.video is not None or self.frames is not None else None

    @property
    def packets_us(self) -> NDArray[np.int64]:
        """(k,) when each packet was received."""
        return self.log.times_us

    @property
    def known_us(self) -> NDArray[np.int64]:
        """(m,) when anything is known of the recording: each packet, each frame, its begin and its end."""
        known_us = np.concatenate([self.log.times_us, self.times_us])
        began_us = self.session.notes.started_us
        ended_us = self.session.notes.ended_us - int(self.log.steps.step_us.sum())
        first_us, last_us = int(known_us.min()), int(known_us.max())
        if not (0 <= first_us - began_us < LONGEST_US and 0 <= ended_us - last_us < LONGEST_US):
            return known_us  # by a clock that was set at another time
        return np.concatenate([known_us, np.array([began_us, ended_us], dtype=np.int64)])

    def close(self) -> None:
        """Close the video."""
        if self.video is not None:
            self.video.close()


def _open_video(session: Session, log: SessionLog, times: NDArray[np.int64] | None) -> VideoFile | None:
    if session.video is None:
        return None
    from vision.video.video import VideoFile

    start_us = log.start_us + round(session.video_start_s * 1e6)
    return VideoFile.open(session.video, times, start_us=start_us)


def _open_looks(session: Session, redetect: bool) -> RecordedLooks | None:
    if redetect and session.video is None:
        raise SessionError(f"{session.path}: no video to detect in; leave --detect out to use its detections")
    if session.detections is None or redetect:
        return None
    if session.frames is None and session.video is None:
        raise SessionError(f"{session.path}: detections.csv needs frames.csv beside it, each frame's time")
    return RecordedLooks.read(session.detections, session.motion)


def _frame_size(
    session: Session,
    log: SessionLog,
    mission: Mission,
    video: VideoFile | None,
    boxes: FrameDetections | None,
    turns: RecordedTurns | None,
    times_us: NDArray[np.int64],
) -> FrameSize:
    recorded = turns.sizes if turns else set()
    if video is not None:
        recorded = recorded | {(video.width, video.height)}
    stated = session.frame_size
    if stated and recorded and stated not in recorded:
        sizes = " and ".join(f"{width}×{height}" for width, height in sorted(recorded))
        raise SessionError(f"{session.path}: its frames are {sizes}; leave --frame-size out")
    camera = mission.camera.intrinsics if mission.camera else None
    size = stated or (None if video is None else (video.width, video.height))
    if size:
        if camera is not None:
            resized(camera, *size)
        if video is None and boxes is not None and not holds(size, boxes):
            x, y = boxes.extent
            raise SessionError(
                f"{session.path}: boxes lie at {x:.0f},{y:.0f} px, outside frames of {size[0]}×{size[1]}"
            )
        return FrameSize(size=size)
    if recorded or boxes is None:
        return FrameSize()
    if not session.notes.flown:
        return FrameSize() if camera is not None else UNDESCRIBED
    return fitting_size(mission, log, times_us, boxes)
