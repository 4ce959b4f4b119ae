"""A recording on the screens: analysed once from the start in one thread, shown at any place and speed by another.

What is shown at a moment is the very snapshot that ``gcs identify`` computes for it. A place that the analysis has not
reached yet shows the frame alone, and playing waits there. Marks that are made meanwhile go to a ``marks.jsonl``, and
nothing else is written.
"""

from __future__ import annotations

import threading
import time
from bisect import insort
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gcs.playback.analysis import Analysis
from gcs.playback.confidence import ConfidenceHistory
from gcs.playback.gaps import find_gaps
from gcs.session.event_log import append_event, marks_path, read_events
from gcs.session.session import Session
from gcs.snapshot import Alarm, Event, Snapshot
from gcs.trails import Trail, Trails
from mavlink.geodesy import LocalFrame
from vision.video.video import Frame, VideoFile

__all__ = ["Replay"]

SPEED_LEAST, SPEED_MOST = 0.1, 20.0
# Decoding on is cheaper than seeking for jumps up to this many frames.
DECODE_ON = 30
MOST_EVENTS = 5000
TICK_S = 0.02


class Replay:
    """A station (``gcs.station.Station``) over a recording, with its timeline (``gcs.station.Timeline``)."""

    commands = None
    folder = None

    def __init__(self, session: Session, *, redetect: bool = False) -> None:
        """Open the recording and start both threads.

        Raises:
            SessionError, TlogError, VideoError, ModelError: a part that cannot be used.
        """
        self._analysis = Analysis(session, redetect=redetect)
        self._decoded = _DecodedFrames(session, self._analysis.video)
        self._times = self._analysis.times_us
        self._done: list[Snapshot] = []
        self._events: list[Event] = []
        self._marks_path = marks_path(session.path)
        self._added = _read_marks(self._marks_path, int(self._times[0]))
        """Marks and what else the operator did, in order of time."""
        self._latest: Snapshot | None = None
        self._lock = threading.Lock()
        self._stop = threading.Event()
        self._now_us = float(self._times[0])
        self._trails = Trails()
        self._confidence = ConfidenceHistory(self.start_us, self.stop_us)
        self.gaps = find_gaps(self._analysis.frames_us, self._analysis.packets_us, self.start_us, self.stop_us)
        self._playing = True
        self._speed = 1.0
        self._title = session.name
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
        share = len(self._done) / len(self._times)
        return self._title if share >= 1 else f"{self._title} (analysed {share:.0%})"

    @property
    def timeline(self) -> Replay:
        """This replay's own clock."""
        return self

    @property
    def start_us(self) -> int:
        """First frame."""
        return int(self._times[0])

    @property
    def stop_us(self) -> int:
        """Last frame."""
        return int(self._times[-1])

    @property
    def now_us(self) -> int:
        """Where it is."""
        return int(self._now_us)

    @property
    def analysed(self) -> Sequence[tuple[int, int]]:
        """The part from the start that the analysis has been through."""
        done = len(self._done)
        return [(self.start_us, int(self._times[done - 1]))] if done else []

    def confidence(self, system_id: int) -> NDArray[np.float32]:
        """Least confidence in a vehicle's name in each of equal parts of the recording, as far as it is analysed."""
        with self._lock:
            return self._confidence.of(system_id)

    def trails(self, t_us: int, span_s: float, origin: LocalFrame | None) -> Sequence[Trail]:
        """Where vehicles were in the seconds before a moment."""
        with self._lock:
            return self._trails.before(t_us, span_s, origin)

    @property
    def playing(self) -> bool:
        """Whether time runs."""
        return self._playing

    @property
    def speed(self) -> float:
        """Times real time."""
        return self._speed

    def latest(self) -> Snapshot | None:
        """The snapshot on show."""
        return self._latest

    def events(self) -> Sequence[Event]:
        """All events found so far, also those ahead of the place on show."""
        with self._lock:
            return tuple(sorted((*self._events, *self._added), key=lambda event: event.t_us))

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
            place = int(np.clip(self._place() + frames, 0, len(self._times) - 1))
            self._now_us = float(self._times[place])

    def set_speed(self, speed: float) -> None:
        """Set the speed, clamped to 0.1..20."""
        self._speed = float(np.clip(speed, SPEED_LEAST, SPEED_MOST))

    def mark(self, t_us: int, text: str, system_id: int = 0) -> None:
        """Keep the operator's note on a moment, in a file beside those of the flight."""
        event = Event(t_us=t_us, level="info", kind="mark", text=text, system_id=system_id)
        append_event(self._marks_path, event)
        self.add_event(event)

    def add_event(self, event: Event) -> None:
        """For the event log on the screen alone."""
        with self._lock:
            insort(self._added, event, key=lambda other: other.t_us)

    def acknowledge(self, alarms: Sequence[Alarm]) -> None:
        """Nothing is written into a recording."""

    def accept_held(self, system_ids: Sequence[int]) -> None:
        """What was held in flight stays held."""

    def stop(self) -> None:
        """End both threads and close the video."""
        self._stop.set()
        for thread in self._threads:
            thread.join(timeout=5)
        self._analysis.close()
        self._decoded.close()

    def _guard(self, work: Callable[[], None]) -> None:
        """Run a thread's work; an error that ends it is kept for the screen."""
        try:
            work()
        except Exception as error:  # noqa: BLE001 - shown on the screen, never swallowed
            self.error = error

    def _analyse(self) -> None:
        for snapshot in self._analysis.snapshots(images=False):
            with self._lock:
                self._done.append(snapshot)
                self._confidence.add(snapshot)
                self._trails.add(snapshot)
                self._events += snapshot.events
                del self._events[:-MOST_EVENTS]
            if self._stop.is_set():
                return

    def _place(self) -> int:
        return max(int(np.searchsorted(self._times, self._now_us, side="right")) - 1, 0)

    def _play(self) -> None:
        shown: tuple[int, bool] = (-1, False)
        before = time.monotonic()
        while not self._stop.wait(TICK_S):
            now = time.monotonic()
            with self._lock:
                if self._playing:
                    self._advance((now - before) * self._speed)
                place, analysed = self._place(), self._place() < len(self._done)
            before = now
            if (place, analysed) != shown:
                self._show(place)
                shown = (place, analysed)

    def _advance(self, seconds: float) -> None:
        """Let time run, but not past the analysis and not past the end."""
        reached = self._times[min(len(self._done), len(self._times)) - 1] if self._done else self._times[0]
        limit = max(float(reached), self._now_us) if len(self._done) < len(self._times) else float(self.stop_us)
        self._now_us = min(self._now_us + seconds * 1e6, limit)
        if self._now_us >= self.stop_us:
            self._playing = False

    def _show(self, place: int) -> None:
        with self._lock:
            done = self._done[place] if place < len(self._done) else None
            last = self._done[-1] if self._done else None
        frame = self._decoded.at(place)
        base = done or (replace(last, boxes=(), events=(), t_us=int(self._times[place]), frame=place) if last else None)
        if base is not None:
            self._latest = replace(base, image=frame.image if frame else None)


def _read_marks(path: Path, start_us: int) -> list[Event]:
    """Marks of earlier replays in order of time; what cannot be read of them is reported beside them."""
    try:
        marks, skipped = read_events(path)
    except OSError as error:
        text = f"{path.name} cannot be read: {error.strerror}"
        return [Event(t_us=start_us, level="warning", kind="recording", text=text)]
    if skipped:
        text = f"{path.name}: {skipped} lines could not be read and were skipped"
        marks.append(Event(t_us=start_us, level="warning", kind="recording", text=text))
    return sorted(marks, key=lambda event: event.t_us)


class _DecodedFrames:
    """Decoded frames by place, by decoding on where that is near and seeking where it is not."""

    def __init__(self, session: Session, video: VideoFile | None) -> None:
        self._video = VideoFile.open(session.video, video.times_us) if session.video and video else None
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

    def close(self) -> None:
        if self._video is not None:
            self._video.close()
