"""The cameras of a recorded flight folded in step: each hears of the others what it heard in flight.

A flight kept which frames those were (``elsewhere.csv``). Of other recordings it is all that the others took before.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from gcs.errors import GcsError, SessionError
from gcs.session.tables import read_table
from gcs.snapshot import Snapshot
from infra.files.segment import segments
from infra.session_format import ELSEWHERE
from mavlink.errors import MavlinkError
from vision.errors import VisionError

if TYPE_CHECKING:
    from gcs.fold.view_exchange import ExchangeMember, ViewExchange
    from gcs.playback.analysis import Analysis

Moment = tuple[int, Snapshot]
Heard = Mapping[int, Mapping[int, int]]


class _FoldedCamera:
    """A camera's recording while it is folded.

    Args:
        analysis: folds it.
        followed: it is folded for others' sake, and not shown.
        tell: called with the time, Unix µs, from which on one that is followed goes no further, and why.
    """

    def __init__(self, analysis: Analysis, *, followed: bool, tell: Callable[[int, str], None]) -> None:
        self.analysis, self.followed, self._tell = analysis, followed, tell
        self.heard, self.trouble = _heard_in(analysis.opened.session.folder) if analysis.as_flown else (None, "")
        self._moments: Iterator[Moment] = iter(())
        self._kept = deque[Moment]()
        self._frame, self._moves = -1, False
        self.latest: Snapshot | None = None
        """The newest moment of one that is followed."""

    def begin(self, moments: Iterator[Moment]) -> None:
        """Begin at the start."""
        self._moments, self._frame = moments, -1

    def shown(self) -> Iterator[Moment]:
        """All moments in order, beginning with those that were folded because others needed them."""
        while self._kept or self.advance():
            yield self._kept.popleft()

    def advance(self) -> bool:
        """Fold one moment more; false at the end, and while one is being folded."""
        if self._moves:
            return False
        self._moves = True
        try:
            moment = next(self._moments, None)
        except (GcsError, MavlinkError, VisionError) as error:
            if not self.followed:
                raise
            since_us = self.latest.t_us if self.latest else int(self.analysis.times_us[0])
            self._tell(since_us, f"what another camera saw does not count from here on: {error}")
            return False
        finally:
            self._moves = False
        if moment is None:
            return False
        self._frame = max(self._frame, moment[1].frame)
        if self.followed:
            self.latest = moment[1]
        else:
            self._kept.append(moment)
        return True

    def advance_before(self, t_us: int) -> None:
        """Fold all frames that were taken before a time."""
        while self.taken_us(self._frame + 1) < t_us and self.advance():
            pass

    def advance_to(self, frame: int) -> None:
        """Fold all frames up to one; no further where a recording lost it."""
        while self._frame < frame and self.advance():
            pass

    def taken_us(self, frame: int) -> int:
        """The time of a frame, Unix µs by the offset that the mission declares; past the last: never."""
        if frame >= len(self.analysis.times_us):
            return int(np.iinfo(np.int64).max)
        return int(self.analysis.times_us[frame]) - round(1e6 * self.analysis.mission.clock.declared_offset_s)


class InStep:
    """Folds of a flight's cameras in step: each goes as far as another one needs it.

    Args:
        tell: called with the time, Unix µs, from which on a camera that is folded for others' sake is lost, and why.
    """

    def __init__(self, tell: Callable[[int, str], None] = lambda t_us, text: None) -> None:
        self._tell = tell
        self._cameras: dict[int, _FoldedCamera] = {}
        self._exchange: ViewExchange | None = None

    def join(self, analysis: Analysis, *, followed: bool) -> str:
        """Add a camera.

        Returns:
            What is wrong with what it heard in flight, empty for nothing.
        """
        camera = self._cameras[analysis.uav_id] = _FoldedCamera(analysis, followed=followed, tell=self._tell)
        return camera.trouble

    def begin(self, uav_id: int) -> ExchangeMember | None:
        """Join a fold that begins at the start to the others; those that are not shown start again, too."""
        if len(self._cameras) == 1:
            return None
        # it needs scipy, which the screens of a flight with one camera need not wait for
        from gcs.fold.view_exchange import ViewExchange

        followed = {other: camera for other, camera in self._cameras.items() if camera.followed}
        if followed or self._exchange is None:
            self._exchange = ViewExchange(self._heard)
        for other, camera in followed.items():
            camera.begin(camera.analysis.folded(self._exchange.join(other)))
        return self._exchange.join(uav_id)

    def shown(self, uav_id: int, moments: Iterator[Moment]) -> Iterator[Moment]:
        """The moments of a camera, which others may have folded before they are wanted."""
        camera = self._cameras[uav_id]
        camera.begin(moments)
        return camera.shown()

    def followed(self) -> list[tuple[str, Snapshot]]:
        """Name of the aircraft of each camera that is folded for others' sake, and its newest snapshot."""
        return [
            (camera.analysis.mission.name_of(uav_id), camera.latest)
            for uav_id, camera in self._cameras.items()
            if camera.latest is not None
        ]

    def _heard(self, uav_id: int, frame: int) -> Mapping[int, int]:
        """The last frame of each other camera that one hears at a frame, once they are folded so far."""
        own, others = self._cameras[uav_id], {k: each for k, each in self._cameras.items() if k != uav_id}
        if own.heard is not None:
            heard = {other: of for other, of in own.heard.get(frame, {}).items() if other in others}
            for other, of_frame in heard.items():
                others[other].advance_to(of_frame)
            return heard
        t_us, before = own.taken_us(frame), {}
        assert self._exchange is not None, "nobody but the exchange asks"
        for other, camera in others.items():
            camera.advance_before(t_us)
            before[other] = self._exchange.newest(other)
            while before[other] >= 0 and camera.taken_us(before[other]) >= t_us:
                before[other] -= 1
        return before

    def close(self) -> None:
        """Close those that are not shown."""
        for camera in self._cameras.values():
            if camera.followed:
                camera.analysis.opened.close()


def _heard_in(folder: Path) -> tuple[Heard | None, str]:
    """Last frame, by frame of a flight, of each other camera that it heard, and what is wrong with the table.

    A flight that kept its order is as it was, also where it heard nothing. Where the table cannot be read it is None.
    """
    heard: dict[int, dict[int, int]] = {}
    if not segments(folder / ELSEWHERE.name):
        return heard, ""
    try:
        table = read_table(folder / ELSEWHERE.name, ELSEWHERE)
    except SessionError as error:
        return None, f"{error}; other cameras count as far as they had taken frames before"
    columns = (table[name].astype(np.int64).tolist() for name in ELSEWHERE.columns)
    for frame, camera, of_frame in zip(*columns, strict=True):
        heard.setdefault(frame, {})[camera] = of_frame
    skipped = f"{ELSEWHERE.name}: {table.skipped} rows could not be read and were skipped: names may differ there"
    return heard, skipped if table.skipped else ""
