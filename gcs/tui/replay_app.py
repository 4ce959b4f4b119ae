"""The keys of a replay: play, jump, step, speed, and what to go to."""

from __future__ import annotations

from gcs.station import Station
from gcs.tui import playback
from gcs.tui.draw.moments import KINDS, Moment, times_of
from gcs.tui.keys import LIVE_ACTIONS, REPLAY_ACTIONS
from gcs.tui.panes.event_log import EventPane
from gcs.tui.panes.timeline import TimelineBar
from gcs.tui.screens.prompts import Prompt
from gcs.tui.terminal.terminal_app import TerminalApp


class ReplayApp(TerminalApp):
    """Actions on the station's timeline; a flight has none, and they do nothing."""

    _station: Station
    _events: EventPane
    _timeline: TimelineBar | None
    _jumps: Moment | None = None
    """Events that ``n`` and ``p`` go to; None: the events of the log."""

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        """Replay keys exist only in a replay, those of a flight only there."""
        return action not in (REPLAY_ACTIONS if self._station.timeline is None else LIVE_ACTIONS)

    def action_toggle_play(self) -> None:
        """Play or pause."""
        if self._station.timeline is not None:
            playback.toggle(self._station.timeline)

    def action_jump(self, seconds: int) -> None:
        """Move by seconds."""
        if self._station.timeline is not None:
            playback.jump(self._station.timeline, seconds)

    def action_step(self, frames: int) -> None:
        """Move by frames."""
        if self._station.timeline is not None:
            self._station.timeline.step(frames)

    def action_speed(self, steps: int) -> None:
        """Play faster or slower."""
        if self._station.timeline is not None:
            playback.change_speed(self._station.timeline, steps)

    def action_edge(self, end: int) -> None:
        """Go to the first or last frame."""
        if (timeline := self._station.timeline) is not None:
            timeline.seek(timeline.stop_us if end else timeline.start_us)

    def action_event(self, steps: int) -> None:
        """Go to the next or previous moment of the kind that was chosen, else event of those that the log shows."""
        if (timeline := self._station.timeline) is None:
            return
        events = self._station.events()
        shown = [event.t_us for event in self._events.filtered(events)]
        times_us = times_of(self._jumps, events, timeline.gaps) if self._jumps else shown
        goal = playback.time_beside(times_us, timeline, steps)
        if goal is None:
            what = self._jumps or "event of those that the log shows"
            self.notify(f"no {'later' if steps > 0 else 'earlier'} {what}", markup=False, timeout=2)
        else:
            timeline.seek(goal)

    def action_jumps(self) -> None:
        """Choose what the keys for next and previous go to."""
        order = (None, *KINDS[::-1])
        self._jumps = order[(order.index(self._jumps) + 1) % len(order)]
        if self._timeline is not None:
            self._timeline.jumps = self._jumps or ""
        what = f"each {self._jumps}" if self._jumps else "the events that the log shows"
        self.notify(f"n and p go to {what}", markup=False, timeout=2)

    def action_go_to(self) -> None:
        """Prompt for a time."""
        if (timeline := self._station.timeline) is None:
            return
        start, stop, now = timeline.start_us, timeline.stop_us, timeline.now_us
        hint = "1:30 from the start, +10, -1:00, 50%, 10:33:12Z"
        ask = Prompt("Go to time", hint, lambda text: playback.parse_time(text, start, stop, now))
        self.push_screen(ask, lambda goal: None if goal is None else timeline.seek(min(max(goal, start), stop)))
