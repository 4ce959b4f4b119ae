"""All cameras of a flight: whose turn it is, which one is on show, and what the others tell beside it."""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace

from gcs.flight.frame_loop import MAX_EVENTS
from gcs.flight.view import FlightView
from gcs.fold.seen_elsewhere import with_elsewhere
from gcs.fold.view_exchange import ViewExchange
from gcs.health.alarms import urgency
from gcs.snapshot import Event, Snapshot
from mavlink.protocol.packet import Packet
from vision.video.video import Frame

IDLE_S = 0.2
"""Time without a new frame after which the fleet is shown all the same, s."""
IDLE_OF_MANY_S = 0.4
"""Equivalent of ``IDLE_S`` for each of several cameras."""
WAITING_S = 0.02
"""Poll interval in seconds while frames wait for telemetry, and where several cameras have to be asked."""
OVERDUE_S = 0.35
"""Longest time for which a camera that is not in focus waits for a look, s: with the look that is under way meanwhile
that is twice a second."""


class FlightViews:
    """The cameras of a flight; the one on show is in focus. ``turn`` belongs to one thread, the rest to any.

    Args:
        on_snapshot: called with a camera's place in the mission, 0 the first, and each of its snapshots.

    Attributes:
        shown: the camera on show.
    """

    shown: FlightView

    def __init__(self, on_snapshot: Callable[[int, Snapshot], None]) -> None:
        self._on_snapshot = on_snapshot
        self._views: dict[int, FlightView] = {}
        self._exchange = ViewExchange()
        self._looked_s: dict[int, float] = {}
        self._last = -1
        self._events: deque[Event] = deque(maxlen=MAX_EVENTS)
        self._beside: tuple[Snapshot | None, Snapshot | None] = None, None

    def add(self, place: int, view: FlightView) -> None:
        """Add the camera of a place in the mission; the first one begins on show."""
        if not self._views:
            self.shown = view
        self._views[place], self._looked_s[place] = view, -math.inf
        if self.several:
            for each in self._views.values():
                each.pipeline.naming.exchange = self._exchange.join(each.uav_id, each.recorder.heard)

    @property
    def first(self) -> FlightView:
        """The camera that the mission has first."""
        return self._views[0]

    @property
    def all(self) -> Mapping[int, FlightView]:
        """All cameras by their place in the mission."""
        return self._views

    @property
    def several(self) -> bool:
        """True if there is more than one."""
        return len(self._views) > 1

    @property
    def place(self) -> int:
        """Place in the mission of the camera on show."""
        return self._place_of(self.shown)

    def show_next(self) -> None:
        """Show the next camera."""
        places = sorted(self._views)
        self.shown = self._views[places[(places.index(self.place) + 1) % len(places)]]

    def add_packets(self, packets: Sequence[Packet], heard_us: int, *, at_once: bool = False) -> None:
        """Queue packets for the next turn of every camera, or fold them in where no thread takes turns yet."""
        for view in self._views.values():
            view.loop.add_packets(packets, heard_us)
            if at_once:
                view.loop.take_in_packets()

    def turn(self, stopped_within: Callable[[float], bool]) -> None:
        """Run one turn: look at a frame, waited for, and fold whatever is due.

        Args:
            stopped_within: waits for this many seconds, or until the flight ends.
        """
        place, frame = self._next_frame(stopped_within)
        now_s, pause_s = time.monotonic(), IDLE_OF_MANY_S if self.several else 0.0
        with ExitStack() as turns:  # all are taken, whichever fails
            for each, view in self._views.items():
                if each == place or view.loop.frames_wait or now_s - view.turned_s >= pause_s:
                    turns.callback(view.loop.run_once, frame if each == place else None)
                    view.turned_s = now_s

    def latest(self) -> Snapshot | None:
        """The newest snapshot of the camera on show, with what the others tell."""
        shown = self.shown  # another thread may show the next one meanwhile
        snapshot = shown.loop.latest
        if snapshot is None or not self.several:
            return snapshot
        of, made = self._beside
        if of is not snapshot:
            made = beside(snapshot, shown, [view for view in self._views.values() if view is not shown])
            self._beside = snapshot, made
        return made

    def events(self) -> Sequence[Event]:
        """Events so far: of the fleet, and of each camera what is about that one."""
        return tuple(self._events)

    def take(self, view: FlightView, snapshot: Snapshot) -> None:
        """Keep what is new for the screen: the fleet's events once, by the first camera's fold."""
        first = view is self.first
        for event in snapshot.events:
            if first or event.is_of(view.uav_id):
                self._events.append(view.label_event(event, further=not first) if self.several else event)
        self._on_snapshot(self._place_of(view), snapshot)

    def _place_of(self, view: FlightView) -> int:
        return next(place for place, each in self._views.items() if each is view)

    def _next_frame(self, stopped_within: Callable[[float], bool]) -> tuple[int, Frame | None]:
        """The place of a camera and its newest frame; the one on show and None, or -1 of several, without any."""
        focus = self.place
        for place in self.order(focus, time.monotonic()) if self.several else ():
            if frame := self._views[place].newest():
                return self._looked(place), frame
        wait_s = WAITING_S if self.several or self.shown.loop.frames_wait else IDLE_S
        if self._views[focus].video.stream is None:
            stopped_within(wait_s)
        frame = self._views[focus].video.latest(wait_s)
        return (self._looked(focus), frame) if frame or not self.several else (-1, None)

    def _looked(self, place: int) -> int:
        """Note that a camera has its turn; its place."""
        self._looked_s[place], self._last = time.monotonic(), place
        return place

    def order(self, focus: int, now_s: float) -> list[int]:
        """Places of cameras in the order in which they are asked for a new frame.

        Args:
            focus: place of the one in focus, which comes first unless another one is overdue.
            now_s: by a clock that nobody sets.
        """
        others = sorted(self._looked_s.keys() - {focus}, key=lambda place: self._looked_s[place])
        # with more cameras than this machine carries the one in focus has every second turn
        overdue = [place for place in others if now_s - self._looked_s[place] > OVERDUE_S and self._last == focus]
        return [*overdue, focus, *(place for place in others if place not in overdue)]


def beside(snapshot: Snapshot, view: FlightView, others: Sequence[FlightView]) -> Snapshot:
    """A camera's snapshot with what the others tell: alarms that it has not, their aircraft, what they see, and who is
    named there."""
    newest = [(other, other.loop.latest) for other in others]
    alarms = [view.label_alarm(alarm) for alarm in snapshot.alarms]
    known = {(alarm.key, alarm.system_id) for alarm in alarms}
    for other, theirs in newest:
        theirs_labelled = map(other.label_alarm, theirs.alarms if theirs else ())
        alarms += [alarm for alarm in theirs_labelled if (alarm.key, alarm.system_id) not in known]
        known |= {(alarm.key, alarm.system_id) for alarm in alarms}
    seen = [(other.name, theirs) for other, theirs in newest if theirs is not None]
    return replace(with_elsewhere(snapshot, seen), alarms=tuple(sorted(alarms, key=urgency)))
