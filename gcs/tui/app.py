"""The station's app: polls for snapshots, hands them to the panes, turns keys into requests."""

from __future__ import annotations

import asyncio
import contextlib
import math
import signal
import time
from collections.abc import Sequence
from typing import ClassVar

from rich.text import Text
from textual.app import ComposeResult
from textual.binding import BindingType
from textual.command import Provider
from textual.reactive import reactive
from textual.widget import Widget

from gcs.errors import FlightError, GcsError
from gcs.report.rollcall import RollCall
from gcs.snapshot import Snapshot
from gcs.station import Commands, Station
from gcs.trails import Trail
from gcs.tui import playback
from gcs.tui.actions import ActionProvider, actions
from gcs.tui.draw.pixels import Graphics, picture_mode, pixel_images
from gcs.tui.keys import BINDINGS, COMMAND_HINTS, LIVE_HINTS, REPLAY_HINTS
from gcs.tui.messages import AlarmsSeen, SeekTo, VehiclePicked
from gcs.tui.pane_area import PaneArea
from gcs.tui.panes.alarms import AlarmPane, token
from gcs.tui.panes.banner import Alert, Banner, alert_of, error_line
from gcs.tui.panes.event_log import EventPane
from gcs.tui.panes.find_line import FindLine
from gcs.tui.panes.fleet import FleetPane
from gcs.tui.panes.identity import IdentityPane
from gcs.tui.panes.key_hints import KeyHints
from gcs.tui.panes.map import map_pane
from gcs.tui.panes.pane import Pane
from gcs.tui.panes.status import StatusBar
from gcs.tui.panes.timeline import TimelineBar
from gcs.tui.panes.video import VideoPane
from gcs.tui.picking import beside, followed
from gcs.tui.replay_app import ReplayApp
from gcs.tui.screens.command import ask_for_order
from gcs.tui.screens.fleet_changes import ask_for_fleet, tell_newcomers
from gcs.tui.screens.held import ask_to_accept
from gcs.tui.screens.help import HelpScreen
from gcs.tui.screens.leaving import Leave, LeaveFlight
from gcs.tui.screens.marking import ask_for_mark
from gcs.tui.screens.naming import ask_for_name, withdraw_name
from gcs.tui.screens.practising import ask_for_trouble
from gcs.tui.screens.preflight import PreflightScreen
from gcs.tui.screens.prompts import Prompt, ask_for_rival_video
from gcs.tui.screens.saving import ask_to_save_screen, save_still
from gcs.tui.terminal.terminal_app import MAX_FPS
from gcs.tui.themes import ThemeName
from mavlink.geodesy import LocalFrame
from vision.errors import VisionError

POLL_S = 1 / MAX_FPS
COUNT_S = 2.0


class RollcallApp(ReplayApp):
    """Screens of one station; the station's threads never touch a widget."""

    silent_after_s = 2.0
    """Time after which the screen of a flight says that nothing new came, s; inf for a flight without a clock."""

    CSS_PATH = "app.tcss"
    TITLE = "Rollcall"
    ENABLE_COMMAND_PALETTE = True
    COMMANDS: ClassVar[set[type[Provider]]] = {ActionProvider}  # type: ignore[assignment]
    ALLOW_SELECT = False
    AUTO_FOCUS = None
    BINDINGS: ClassVar[list[BindingType]] = [*BINDINGS]

    snapshot: reactive[Snapshot | None] = reactive(None, always_update=True, repaint=False)
    selected: reactive[int] = reactive(0, repaint=False)
    picked_track: reactive[int] = reactive(0, repaint=False)

    def __init__(
        self,
        station: Station,
        *,
        graphics: Graphics = "auto",
        bell: bool = False,
        theme: ThemeName = "dark",
        fps: float = MAX_FPS,
        calls: RollCall | None = None,
    ) -> None:
        """Show a station.

        Args:
            station: A running flight or replay; it is stopped by whoever started it.
            graphics: ``auto`` and ``pixels`` show real pixels where the terminal can, else the finest blocks that it
                is known to draw; the others are these blocks, unasked.
            bell: ring the terminal's bell at every new alarm.
            theme: Colours to begin with.
            fps: most pictures a second of the video and the map.
            calls: who was named in a flight so far.
        """
        super().__init__(fps, theme)
        self._calls = calls
        self._bell = bell
        self._rung: frozenset[tuple[str, int, str]] = frozenset()
        self._station = station
        self._newest_at = time.monotonic()
        self._offered: frozenset[int] = frozenset()
        self.left = self._tiled = False
        # held, not queried: a query looks at the screen on top, which may be a question
        self._status = StatusBar(live=station.timeline is None, id="status")
        self._alert_line = Banner(id="alert")
        self._map = map_pane(station, self._trails)
        self._fleet = FleetPane(id="fleet")
        self._identity = IdentityPane(id="identity")
        self._events = EventPane(id="events", live=station.timeline is None)
        self._alarms = AlarmPane(id="alarms")
        pixels = pixel_images(graphics)
        mode = picture_mode("blocks" if pixels else graphics, self.colours)
        self._video = VideoPane(id="video", pixels=pixels, mode=mode)
        self._panes = PaneArea(
            [
                self._video,
                self._map,
                self._fleet,
                self._identity,
                self._alarms,
                self._events,
            ],
            id="panes",
        )
        self._timeline = None if station.timeline is None else TimelineBar(id="timeline")

    def compose(self) -> ComposeResult:
        """Status, alert, panes, timeline, keys."""
        live = self._timeline is None
        for pane in self._panes.panes:
            pane.data_bind(RollcallApp.snapshot, RollcallApp.selected, RollcallApp.picked_track)
        yield self._status.data_bind(RollcallApp.snapshot)
        yield self._alert_line
        yield self._panes
        if self._timeline is not None:
            yield self._timeline
        hints = REPLAY_HINTS if not live else COMMAND_HINTS if self._commands else LIVE_HINTS
        self._hints = KeyHints((*hints[:2], ("a", "alarms"), *hints[2:]) if live else hints, id="hints")
        yield self._hints

    def on_mount(self) -> None:
        """Start to poll."""
        with contextlib.suppress(RuntimeError):  # outside the main thread there are no signals
            loop = asyncio.get_running_loop()
            for number, end in ((signal.SIGTERM, self._end), (signal.SIGHUP, self.exit)):
                if signal.getsignal(number) is signal.SIG_DFL:  # else whoever shows the screens heeds it
                    loop.add_signal_handler(number, end)
        self.watch(self.screen, "focused", self._show_keys_of)
        self._poll()
        self.set_interval(POLL_S, self._poll)
        self.set_interval(COUNT_S, self._count_names)

    def _poll(self) -> None:
        if self.to_end() and not self.left:
            self._end()
        newest = self._station.latest()
        waits = self.picture_waits()
        if waits:
            self._panes.hold_pictures(True)
        if newest is not None and newest is not self.snapshot:
            self._newest_at = time.monotonic()
            self._panes.fit_to(newest)
            self._pick(*followed(newest, (self.selected, self.picked_track)))
            self.snapshot = newest
        if not waits:
            self._panes.hold_pictures(False)
        if self._tiled:
            self._show_tiles()
        self._status.title = self._station.title
        events = tuple(self._station.events())
        if events != self._events.all_events:
            self._events.all_events = events
        if self._station.timeline is not None and self._timeline is not None:
            name = self.snapshot.name_of(self.selected) if self.snapshot is not None else ""
            shown_us = self.snapshot.now_us if self.snapshot is not None else None
            self._timeline.show(self._station.timeline, events, self.selected, name, shown_us)
            self._events.now_us = 0 if self._timeline.is_behind else self._station.timeline.now_us
        self._alert_line.alert = self._alert()
        self._ring()
        self._offered = tell_newcomers(self, self._station.newcomers(), self._offered)

    def _count_names(self) -> None:
        """Count for how long each vehicle was named; not at every poll, since it changes slowly."""
        if self._timeline is not None and self._station.timeline is not None and self.snapshot is not None:
            ours = [row.system_id for row in self.snapshot.vehicles if row.role == "ugv"]
            self._identity.named_for = playback.shares_named(self._station.timeline, ours)
        elif self._calls is not None and self.snapshot is not None:
            rows = self._calls.of(self.snapshot.vehicles[0].system_id).rows()
            self._identity.named_for = {row.system_id: row.share for row in rows if math.isfinite(row.share)}

    def _show_keys_of(self, focused: Widget | None) -> None:
        self._hints.pane = focused.id or "" if isinstance(focused, Pane) else ""

    def _ring(self) -> None:
        """Once for every new alarm, if at all."""
        loud = frozenset(token(alarm) for alarm in self._alarms.alarms if alarm.level == "alarm")
        if self._bell and loud - self._rung:
            self.bell()
        self._rung = loud

    def _alert(self) -> Alert:
        silent_s = time.monotonic() - self._newest_at
        live = self._station.timeline is None and self.snapshot is not None
        return alert_of(
            self.snapshot,
            self._events.all_events,
            self._alarms.seen,
            error=self._station.error,
            silent_s=silent_s if live and silent_s > self.silent_after_s else 0.0,
            over=self._station.practice is not None and self._station.practice.over,
        )

    def action_pane(self, pane: str) -> None:
        """Show, focus or hide a pane."""
        self._panes.toggle(pane)

    def action_acknowledge(self) -> None:
        """Acknowledge every alarm that is on now."""
        self._alarms.acknowledge(self._alarms.alarms)

    @property
    def _commands(self) -> Commands | None:
        commands: Commands | None = getattr(self._station, "commands", None)
        return commands

    def action_command(self) -> None:
        """Choose, confirm and give an order."""
        ask_for_order(self, self._commands, self.selected, live=self._station.timeline is None)

    def action_state_name(self) -> None:
        """State which vehicle the picked box is."""
        ask_for_name(self, self._station, self.snapshot, (self.selected, self.picked_track), self._pick)

    def action_undo_statement(self) -> None:
        """Withdraw a statement."""
        withdraw_name(self, self._station, self.snapshot, (self.selected, self.picked_track))

    def action_preflight(self) -> None:
        """Show what the flight needs, live."""
        self.push_screen(PreflightScreen(self._station))

    def action_practise(self) -> None:
        """Begin or end a trouble of the simulated fleet."""
        ask_for_trouble(self, self._station, self.snapshot, self.selected)

    def action_fleet(self) -> None:
        """Take vehicles into the fleet, leave them out, rename them."""
        ask_for_fleet(self, self._station, self.snapshot)

    def action_accept_held(self) -> None:
        """Accept vehicles whose signed packets are held."""
        ask_to_accept(self, self._station, self.snapshot, self.selected)

    def action_take_rival_video(self) -> None:
        """Take the other video where two senders contest its port."""
        ask_for_rival_video(self, self._station, self.snapshot)

    def action_layout(self, layout: int) -> None:
        """Choose one of three layouts."""
        self._panes.choose(layout)

    def action_maximise(self) -> None:
        """The focused pane, or the layout's first view, over everything."""
        pane = self.focused.id if isinstance(self.focused, Pane) and self.focused.id else None
        self._panes.maximise(
            self._panes.state.maximised or pane or ("map" if self._panes.state.layout == 2 else "video")
        )

    def action_pick(self, steps: int) -> None:
        """Select the vehicle, or the box without a name, above or below."""
        if self.snapshot is not None:
            rows = self._fleet.in_order(self.snapshot)
            self._pick(*beside(self.snapshot, rows, (self.selected, self.picked_track), steps))

    def action_find(self) -> None:
        """Pick a vehicle by its name or id."""
        if self.snapshot is not None and not self.query(FindLine):
            self.mount(FindLine(self._fleet, self._hints, (self.selected, self.picked_track)), after=self._hints)

    def action_order(self) -> None:
        """The fleet by trouble, or as the mission has it."""
        self._fleet.by_trouble = not self._fleet.by_trouble

    def action_pick_vehicle(self, system_id: int) -> None:
        """Select one vehicle."""
        self._pick(system_id, 0)

    def action_show_event(self, t_us: int, system_id: int) -> None:
        """Pick the vehicle of an event, and in a replay go to its time."""
        if self.snapshot is not None and system_id in {row.system_id for row in self.snapshot.vehicles}:
            self._pick(system_id, 0)
        if self._station.timeline is not None:
            self._station.timeline.seek(t_us)

    def _pick(self, system_id: int, track_id: int) -> None:
        """The table answers a key at once, and pictures, which take longer, right after it."""
        picked = system_id, 0 if system_id else track_id
        if picked != (self.selected, self.picked_track):
            self._panes.hold_pictures(True)
            self.selected, self.picked_track = picked
            self.call_after_refresh(self._panes.hold_pictures, False)

    def action_release(self) -> None:
        """Leave the maximised pane, else the search, else the selection."""
        if self._panes.state.maximised:
            self._panes.maximise(self._panes.state.maximised)
        elif self._events.words:
            self._events.words = ""
        else:
            self._pick(0, 0)

    def action_next_view(self) -> None:
        """Show what the flight's next camera sees; which track is which vehicle differs from one to the other."""
        try:
            view = self._station.next_view()
        except (GcsError, VisionError) as error:
            self.notify(str(error), severity="warning", markup=False)
            return
        if view is None:
            self.notify("there is one camera", markup=False, timeout=2)
            return
        self._station = view
        self._pick(self.selected, 0)

    def action_tiles(self) -> None:
        """Show all cameras beside each other in the video, or the one on show alone."""
        self._tiled = not self._tiled
        if self._tiled:
            self._show_tiles()
        else:
            self._video.tiles = ()

    def _show_tiles(self) -> None:
        try:
            tiles = self._station.pictures()
        except (GcsError, VisionError) as error:
            self.notify(str(error), severity="warning", markup=False)
            tiles = ()
        if len(tiles) == 1:
            self.notify("there is one camera", markup=False, timeout=2)
        self._tiled = len(tiles) > 1
        self._video.tiles = tuple(tiles) if self._tiled else ()

    def _trails(self, t_us: int, span_s: float, origin: LocalFrame | None) -> Sequence[Trail]:
        """Trails of a replay."""
        timeline = self._station.timeline
        return timeline.trails(t_us, span_s, origin) if timeline is not None else ()

    def action_inset(self) -> None:
        """Enlarge the picked vehicle in a corner of the video, or no more."""
        self._video.enlarged = not self._video.enlarged

    def action_zoom(self, steps: int) -> None:
        """Zoom the map."""
        self._map.zoom_by(steps)

    def action_follow(self) -> None:
        """Change what the map follows."""
        self._map.follow_next()

    def action_evidence(self) -> None:
        """Evidence for analysts in the identity pane, or not."""
        self._identity.show_evidence()

    def action_level(self) -> None:
        """Level filter of the log."""
        self._events.next_filter()

    def action_search(self) -> None:
        """Prompt for words that the log's events are to have."""
        hint = "words, a vehicle's name, a kind (identity, text, link, mark …); nothing ends it"
        ask = Prompt("Search the event log", hint, str.strip, value=self._events.words)
        self.push_screen(ask, lambda words: None if words is None else setattr(self._events, "words", words))

    def action_help(self) -> None:
        """Show all keys, marks and colours."""
        self.push_screen(HelpScreen(actions(self._panes.panes, live=self._station.timeline is None)))

    def action_mark(self) -> None:
        """Prompt for a text about this moment."""
        ask_for_mark(self, self._station, self.snapshot, self.selected)

    async def action_still(self) -> None:
        """Save the full frame with names."""
        await save_still(self, self._station, self.snapshot, (self.selected, self.picked_track))

    def action_save(self) -> None:
        """Save the screen."""
        ask_to_save_screen(self, self.snapshot)

    def action_save_mission(self) -> None:
        """Save who flies as a mission file."""
        try:
            result = self._station.save_mission()
        except OSError as error:
            result = f"the mission cannot be saved here: {error.strerror}"
        self.notify(result, timeout=6, markup=False)

    def action_leave(self) -> None:
        """Quit a replay, or a flight that is over; ask before a flight is ended."""
        flies = self._station.timeline is None and (
            self._station.error is None or isinstance(self._station.error, FlightError)
        )
        if flies:
            self.push_screen(LeaveFlight(), self._leave)
        else:
            self._end()

    def _leave(self, answer: Leave | None) -> None:
        if answer == "end":
            self._end()
        elif answer == "screen":
            self.exit()

    def _end(self) -> None:
        """Quit; an error of the station is the exit message."""
        self.left = True
        error = self._station.error
        # rich text, since a plain string would be read as markup
        self.exit(return_code=int(error is not None), message=None if error is None else Text(error_line(error)))

    def on_alarms_seen(self, message: AlarmsSeen) -> None:
        """The station keeps what was acknowledged, and when."""
        self._station.acknowledge(message.alarms)

    def on_vehicle_picked(self, message: VehiclePicked) -> None:
        """Pick what was clicked in a pane."""
        self._pick(message.system_id, message.track_id)

    def on_seek_to(self, message: SeekTo) -> None:
        """Seek to where the timeline was clicked."""
        if self._station.timeline is not None:
            self._station.timeline.seek(message.t_us)
