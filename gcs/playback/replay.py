"""A recording on the screens: analysed once from the start in one thread, shown at any place and speed by another.

What is shown at a frame has the names that ``gcs identify`` computes for it; in between, where no frame came, the fleet
goes on as it did in flight. A place that the analysis has not reached yet shows the frame alone until it is worked out
provisionally (``gcs.playback.preview``). What the flight itself reported is shown beside it. Marks that are made
meanwhile go to a ``marks.jsonl``, and nothing else is written.
"""

from __future__ import annotations

import math
import threading
import time
from bisect import insort
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gcs.playback.analysis import Analysis
from gcs.playback.as_flown import FlownReports
from gcs.playback.preview import Preview
from gcs.playback.snapshot_store import SnapshotStore
from gcs.session.event_log import append_event, marks_path, read_marks
from gcs.session.session import Session
from gcs.snapshot import NAMED, Alarm, Event, FleetChange, Snapshot
from gcs.station import CameraPicture, Gap, Newcomer
from gcs.trails import Trail, Trails
from mavlink.geodesy import LocalFrame
from mavlink.state import SILENT_S
from mavlink.transmit.message_rates import Rate
from vision.stream.pace import stall_after_s
from vision.video.video import Frame, VideoFile

MIN_SPEED, MAX_SPEED = 0.1, 20.0
DECODE_ON = 30
"""Longest jump, frames, for which decoding on is cheaper than seeking."""
TICK_S = 0.02
SOON_US = 5_000_000
"""The analysis itself will be at a place that is no farther ahead."""
PERIOD_US = 200_000
"""Rate at which a place is drawn again of which nothing is known but its frame."""
PARTS: Final = 1000
"""Parts of a recording: several for each cell of the widest screens."""
UNSEEN_S = 2.0
"""Longest time, s, for which the analysis waits until a first picture was taken: its imports would hold that up."""
HELD_US: Final = 2_000_000
"""A name counts for this long without another snapshot, as on the screen."""


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


class ConfidenceHistory:
    """Confidence in every vehicle's name over a whole recording, in few numbers however long that is.

    Snapshots that were worked out provisionally count for nothing.
    """

    def __init__(self, start_us: int, stop_us: int) -> None:
        self._start_us, self._span_us = start_us, max(1, stop_us - start_us)
        self._least: dict[int, NDArray[np.float32]] = {}
        self._last_us: int | None = None
        self._last: dict[int, float] = {}

    def add(self, snapshot: Snapshot) -> None:
        """Take in the next snapshot: until it came, the names of the one before counted."""
        if snapshot.provisional or not snapshot.analysed:
            return
        part = self._part(snapshot.t_us)
        last_us = snapshot.t_us if self._last_us is None else self._last_us
        last, held = self._part(last_us), snapshot.t_us - last_us <= HELD_US
        now = {
            row.system_id: row.confidence if row.standing in NAMED and row.confidence == row.confidence else 0.0
            for row in snapshot.vehicles
            if row.role == "ugv"
        }
        for system_id, confidence in now.items():
            least = self._least.setdefault(system_id, np.full(PARTS, np.nan, dtype=np.float32))
            # the worst of a part counts
            least[last + 1 : part] = self._last.get(system_id, 0.0) if held else 0.0
            least[part] = np.fmin(least[part], confidence)
        self._last, self._last_us = now, snapshot.t_us

    def of(self, system_id: int) -> NDArray[np.float32]:
        """(PARTS,) least confidence in each part of the recording; 0 without a name, NaN where nothing is known yet."""
        known = self._least.get(system_id)
        return np.full(PARTS, np.nan, dtype=np.float32) if known is None else known.copy()

    def _part(self, t_us: int) -> int:
        return min(max((t_us - self._start_us) * PARTS // self._span_us, 0), PARTS - 1)


class ReplayPlace(NamedTuple):
    """Snapshot that is shown at a time."""

    store: SnapshotStore | None
    """None: nothing is worked out."""
    number: int
    """Number of the snapshot in it."""
    frame: int
    """The newest one then, -1 before the first."""
    final: bool
    """True if all of the recording is analysed: what differs from the flight is known then."""


class Replay:
    """A station (``gcs.station.Station``) over a recording, with its timeline (``gcs.station.Timeline``)."""

    commands = practice = None
    folder = None

    def __init__(self, session: Session, *, redetect: bool = False) -> None:
        """Open the recording and start both threads.

        Raises:
            SessionError, TlogError, VideoError, ModelError: a part that cannot be used.
        """
        self._lock = threading.Lock()
        self._analysis = analysis = Analysis(session, redetect=redetect)
        self._decoded = _DecodedFrames(analysis.video)
        self._times = np.maximum.accumulate(analysis.times_us)
        self._reports, trouble = FlownReports.of(analysis.opened)
        self._start_us, self._stop_us = self._reports.start_us, self._reports.stop_us
        self._done = SnapshotStore()
        self._finished = False
        self._preview = Preview(lambda t_us: analysis.moments(self._reports.flown, provisional_from_us=t_us))
        self._marks_path = marks_path(session.path)
        self._added = read_marks(session.path, self._start_us)
        """Marks and what else the operator did, in order of time."""
        if trouble:
            self.add_event(Event(t_us=self._start_us, level="warning", kind="recording", text=trouble))
        self._reported: tuple[Event, ...] = ()
        self._events: tuple[Event, ...] = ()
        self._latest: Snapshot | None = None
        self._stop, self._seen = threading.Event(), threading.Event()
        self._now_us = float(self._begin_us())
        self._trails = Trails()
        self._confidence = ConfidenceHistory(self.start_us, self.stop_us)
        opened = analysis.opened
        self.gaps = find_gaps(opened.frames_us, opened.packets_us, self.start_us, self.stop_us)
        self._playing = True
        self._speed = 1.0
        self._title = session.name
        self._redetect, self._views = redetect, [self]
        """All cameras on show so far, the same list in each."""
        self._unseen = deque(session.other_views)
        if self._unseen:
            uav = analysis.mission.uav
            self._title = f"{session.tlog.parent.resolve().name} from {analysis.mission.name_of(uav.system_id)}"
        self.error: BaseException | None = None
        self._threads = [
            threading.Thread(target=self._guard, args=(work,), name=name, daemon=True)
            for name, work in (("analysis", self._analyse), ("player", self._play))
        ]
        for thread in self._threads:
            thread.start()

    @property
    def title(self) -> str:
        """The session's name, and how far the analysis is while it runs."""
        if self._finished:
            return self._title
        share = (self._reached_us - self._start_us) / max(1, self._stop_us - self._start_us)
        return f"{self._title} (analysed {min(share, 0.99):.0%})"

    @property
    def timeline(self) -> Replay:
        """This replay's own clock."""
        return self

    @property
    def start_us(self) -> int:
        """First frame, packet or event."""
        return self._start_us

    @property
    def stop_us(self) -> int:
        """Last one."""
        return self._stop_us

    @property
    def now_us(self) -> int:
        """Present place."""
        return int(self._now_us)

    @property
    def analysed(self) -> Sequence[tuple[int, int]]:
        """The part from the start that the analysis has been through."""
        return [(self._start_us, self._reached_us)] if len(self._done) else []

    def confidence(self, system_id: int) -> NDArray[np.float32]:
        """Least confidence in a vehicle's name in each of equal parts of the recording, as far as it is analysed."""
        with self._lock:
            return self._confidence.of(system_id)

    def trails(self, t_us: int, span_s: float, origin: LocalFrame | None) -> Sequence[Trail]:
        """Places of vehicles in the seconds before a moment."""
        with self._lock:
            return self._trails.before(t_us, span_s, origin)

    @property
    def playing(self) -> bool:
        """True if time runs."""
        return self._playing

    @property
    def speed(self) -> float:
        """Speed as a multiple of real time."""
        return self._speed

    @property
    def tiles(self) -> Path | None:
        """Tiles of the recorded mission, or the one given in its place."""
        return self._analysis.mission.tiles

    def latest(self) -> Snapshot | None:
        """The snapshot on show."""
        if (latest := self._latest) is not None:
            self._seen.set()
        return latest

    def events(self) -> Sequence[Event]:
        """Events that the flight reported or that were found so far, also ahead of the place on show."""
        with self._lock:
            reported = self._reports.events()
            if reported is not self._reported or len(self._events) != len(reported) + len(self._added):
                self._reported = reported
                self._events = tuple(sorted((*reported, *self._added), key=lambda event: event.t_us))
            return self._events

    def play(self) -> None:
        """Let time run; at the end, from the start again."""
        with self._lock:
            if self._now_us >= self.stop_us:
                self._now_us = float(self.start_us)
            self._playing = True

    def pause(self) -> None:
        """Stop time; the frame stays."""
        self._playing = False

    def seek(self, t_us: int) -> None:
        """Go to a time, clamped to the recording."""
        with self._lock:
            self._now_us = float(np.clip(t_us, self.start_us, self.stop_us))

    def step(self, frames: int) -> None:
        """Pause and move by frames."""
        with self._lock:
            self._playing = False
            frame = int(np.clip(self._frame_at(self._now_us) + frames, 0, len(self._times) - 1))
            goal_us = float(self._times[frame])
            if (goal_us - self._now_us) * frames > 0:
                self._now_us = goal_us

    def next_view(self) -> Replay | None:
        """The flight's next camera: opened when it is wanted first, and going on from here."""
        place = self._views.index(self) + 1
        if place == len(self._views) and self._unseen:
            self._open_next()
        if len(self._views) == 1:
            return None
        view = self._views[place % len(self._views)]
        playing, self._playing = self._playing, False
        view.seek(self.now_us)
        view._playing, view._speed = playing, self._speed
        return view

    def _open_next(self) -> None:
        new = Replay(self._unseen.popleft(), redetect=self._redetect)
        new._views, new._unseen = self._views, self._unseen
        self._views.append(new)
        new._playing = False

    def pictures(self) -> Sequence[CameraPicture]:
        """Pictures of all cameras at this moment; they are opened by that."""
        while self._unseen:
            self._open_next()
        for view in self._views:
            if view is not self:
                view.seek(self.now_us)
        in_order = sorted(self._views, key=lambda view: view._analysis.opened.session.folder)
        return [
            CameraPicture(name=view._analysis.uav_name, snapshot=view.latest(), on_show=view is self)
            for view in in_order
        ]

    def set_speed(self, speed: float) -> None:
        """Set the speed, clamped to 0.1..20."""
        self._speed = float(np.clip(speed, MIN_SPEED, MAX_SPEED))

    def mark(self, t_us: int, text: str, system_id: int = 0) -> None:
        """Keep the operator's note on a moment, in a file beside those of the flight."""
        event = Event(t_us=t_us, level="info", kind="mark", text=text, system_id=system_id)
        append_event(self._marks_path, event)
        self.add_event(event)

    def add_event(self, event: Event) -> None:
        """Add an event for the event log on the screen alone."""
        with self._lock:
            insort(self._added, event, key=lambda other: other.t_us)

    def acknowledge(self, alarms: Sequence[Alarm]) -> None:
        """Do nothing: nothing is written into a recording."""

    def state_name(self, track_id: int, system_id: int) -> None:
        """Leave what was stated in flight as it is."""

    def undo_statement(self, track_id: int = 0) -> None:
        """Leave what was stated in flight as it is."""

    def rates(self) -> Sequence[Rate]:
        """Return nothing: a recording measures no rates."""
        return ()

    def newcomers(self) -> Sequence[Newcomer]:
        """Return nobody: a recording hears nobody new."""
        return ()

    def change_fleet(self, change: FleetChange) -> None:
        """Do nothing: the fleet of a recording is as it flew."""

    def accept_held(self, system_ids: Sequence[int]) -> None:
        """Leave what was held in flight."""

    def save_mission(self) -> str:
        """Say that a recording has a mission of its own."""
        return "a recording has its mission in its session.toml"

    def take_rival_video(self) -> None:
        """Do nothing: the video of a flight stays as it was recorded."""

    def stop(self) -> None:
        """End both threads and close the video, of all cameras."""
        for view in self._views:
            view._stop.set()
            view._seen.set()
        for view in self._views:
            for thread in view._threads:
                thread.join(timeout=5)
            view._analysis.close()

    def _begin_us(self) -> int:
        """Place where it begins to play: at the first frame if it comes soon, so that nobody waits for a picture; or
        soon after a flight began to wait for one: before that it had only been listened to who is there."""
        awaited_us = self._analysis.awaited_us
        soon_us = SOON_US + max(self._start_us, awaited_us if math.isfinite(awaited_us) else 0.0)
        if self._analysis.opened.frames_us is None or self._times[0] > soon_us:
            return self._start_us
        return int(self._times[0])

    def _guard(self, work: Callable[[], None]) -> None:
        """Run a thread's work; an error that ends it is kept for the screen."""
        try:
            work()
        except Exception as error:  # noqa: BLE001 - shown on the screen, never swallowed
            self.error = error

    def _analyse(self) -> None:
        """Work out all of it from the start, but first what is looked at far ahead."""
        self._seen.wait(UNSEEN_S)
        moments = self._analysis.moments(self._reports.flown)
        while not self._stop.is_set():
            t_us = self.now_us
            if t_us > self._reached_us + SOON_US and self._preview.wants(t_us):
                self._preview.advance(t_us)
                continue
            moment = next(moments, None)
            if moment is None:
                break
            at_us, snapshot = moment
            with self._lock:
                self._done.add(at_us, self._analysis.seen_elsewhere(snapshot))
                self._confidence.add(snapshot)
                self._trails.add(snapshot)
                self._reports.add(at_us, snapshot.events, snapshot.alarms)
        if not self._stop.is_set():
            with self._lock:
                self._reports.finish()
            self._finished = True
        self._preview.clear()

    @property
    def _reached_us(self) -> int:
        """Progress of the analysis."""
        if self._finished:
            return self._stop_us
        return self._done.stop_us if len(self._done) else self._start_us

    def _frame_at(self, t_us: float) -> int:
        """The newest frame at or before a time, -1 before the first."""
        return int(np.searchsorted(self._times, t_us, side="right")) - 1

    def _play(self) -> None:
        shown: ReplayPlace | None = None
        before = time.monotonic()
        while not self._stop.wait(TICK_S):
            now = time.monotonic()
            with self._lock:
                if self._playing:
                    self._advance((now - before) * self._speed)
                place = self._place()
            before = now
            if place != shown:
                self._show(place)
                shown = place

    def _place(self) -> ReplayPlace:
        """Snapshot that is to be shown now."""
        t_us = self.now_us
        frame = self._frame_at(t_us)
        if len(self._done) and t_us <= self._reached_us:
            place = self._done.place(t_us)
            store = self._done if place >= 0 else None
            return ReplayPlace(store, place if store else -t_us // PERIOD_US, frame, self._finished)
        provisional = self._preview.at(t_us)
        if provisional:
            return ReplayPlace(*provisional, frame, final=False)
        return ReplayPlace(None, t_us // PERIOD_US, frame, final=False)

    def _advance(self, seconds: float) -> None:
        """Let time run, but not past what is worked out and not past the end."""
        t_us = self.now_us
        limit_us = self._reached_us
        if t_us > limit_us:
            provisional = self._preview.at(t_us)
            limit_us = provisional[0].stop_us if provisional else t_us
        self._now_us = max(min(self._now_us + seconds * 1e6, float(limit_us)), self._now_us)
        if self._now_us >= self.stop_us:
            self._playing = False

    def _show(self, place: ReplayPlace) -> None:
        frame = self._decoded.at(place.frame) if place.frame >= 0 else None
        image = frame.image if frame else None
        base = place.store.snapshot(place.number) if place.store else self._blank(place.frame, image)
        with self._lock:
            alarms = self._reports.alarms(base.now_us, base.alarms)
        # a frame that the flight did not look at came after what it is shown with
        frame_us = base.frame_us if base.frame == place.frame else base.t_us
        self._latest = replace(base, image=image, frame=place.frame, frame_us=frame_us, alarms=alarms)

    def _blank(self, frame: int, image: NDArray[np.uint8] | None) -> Snapshot:
        """A place of which nothing is known but its frame: not reached by the analysis, or before the flight."""
        mission = self._analysis.mission
        begins_us = self._done.start_us if len(self._done) else 0
        width, height = self._analysis.opened.size.size or (0, 0) if image is None else (image.shape[1], image.shape[0])
        return Snapshot(
            t_us=self.now_us,
            frame=frame,
            frame_us=int(self._times[frame]) if frame >= 0 else 0,
            analysed=False,
            begins_us=begins_us if self.now_us < begins_us else 0,
            width=width,
            height=height,
            image=image,
            vehicles=(),
            names={each: mission.name_of(each) for each in (mission.uav.system_id, *mission.ugv_ids)},
            boxes=(),
            footprint_enu=None,
            uav_enu=np.full(3, np.nan),
            uav_heading=np.nan,
            health=self._analysis.health_at(self.now_us, frame),
        )


class _DecodedFrames:
    """Decoded frames by place, by decoding on where that is near and seeking where it is not."""

    def __init__(self, video: VideoFile | None) -> None:
        self._video = video
        self._frames: Iterator[Frame] = iter(())
        self._held: Frame | None = None

    def at(self, place: int) -> Frame | None:
        if self._video is None or place >= self._video.n:
            return None
        if self._held is not None and self._held.index == place:
            return self._held
        ahead = place - self._held.index if self._held else -1
        if not 0 < ahead <= DECODE_ON:
            self._frames = self._video.frames(place)
        for frame in self._frames:
            if frame.index >= place:
                self._held = frame
                return frame
        return self._held
