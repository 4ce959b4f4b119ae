"""A flight: links and camera in, recording and snapshots out.

Telemetry and video each come in through a process of their own, which records them untouched. Here, one thread takes
packets, one looks after links, disk and video, one folds. The fold takes only the newest frame; what it skips is still
recorded and counted. What fails in a turn of a thread costs that turn: the flight and its recording go on.
"""

from __future__ import annotations

import itertools
import logging
import os
import platform
import shutil
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gcs.errors import FlightError
from gcs.flight.listening import Listening
from gcs.flight.monitor import FlightMonitor, with_video
from gcs.flight.newcomers import Newcomers
from gcs.flight.plan import FlightPlan, open_detector, open_links
from gcs.flight.practice import PractisedFleet
from gcs.flight.view import FlightView
from gcs.flight.views import FlightViews
from gcs.fold.detector_factory import fingerprints
from gcs.health.faults import Faults
from gcs.mission.fleet_changes import changed
from gcs.mission.mission import Mission
from gcs.mission.written import save_mission
from gcs.session.metadata import PROGRAM, key_notes
from gcs.session.recorder import Recorder, ViewRecorder
from gcs.snapshot import Alarm, Event, FleetChange, Health, Snapshot, Statement
from gcs.station import CameraPicture, Commands, Newcomer
from infra.wall_clock import now_us
from mavlink.errors import LinkError
from mavlink.signing.keys import KeyRing, read_ring
from mavlink.transmit.message_rates import MessageRates, Rate, uav_rates
from vision.detect.detector import Detector

if TYPE_CHECKING:
    from gcs.command import CommandService

_log = logging.getLogger(__name__)

READ_S = 0.2
CARE_S = 0.5
FAULT_PAUSE_S = 0.1


class Flight:
    """A station (``gcs.station.Station``) in flight."""

    timeline = None

    def __init__(
        self,
        plan: FlightPlan,
        on_snapshot: Callable[[int, Snapshot], None] = lambda place, snapshot: None,
        listening: Listening | None = None,
    ) -> None:
        """Open links, camera, detector and recording, then start.

        Args:
            plan: What to listen to.
            on_snapshot: Called in the fold's thread with a camera's place in the mission, 0 the first, and each of its
                snapshots, of a frame or without one.
            listening: has the links open already, and what was heard so far; its folder is the session's.

        Raises:
            LinkError, ModelError, SessionError: something cannot be opened; nothing is left open.
        """
        self._plan = plan
        mission = self._mission = plan.mission
        self._ring = read_ring(mission.signing.folder) if mission.signing.folder else KeyRing()
        notes: dict[str, Any] = {"keys": key_notes(self._ring)}
        if detector := open_detector(plan):
            notes["models"] = fingerprints(mission.detector)
        made: dict[str, Any] = {"folder": listening.folder, "began_us": listening.began_us} if listening else {}
        views = [k + 1 for k in plan.videos if k]
        self._recorder = Recorder(plan.sessions, mission, video=bool(plan.video), views=views, notes=notes, **made)
        _log.info("%s records %s in process %d", PROGRAM, self._recorder.folder.name, os.getpid())
        _log.info("Python %s on %s", platform.python_version(), platform.platform())
        self._commands: CommandService | None = None
        try:
            self._ingest = listening.ingest if listening else open_links(plan, self._recorder.tlog_path)
        except BaseException:
            # nothing was received: what is in the folder are headings
            self._recorder.close()
            shutil.rmtree(self._recorder.folder, ignore_errors=True)
            raise
        if listening:
            listening.close_video()
        self._faults = Faults(self._recorder.folder / "faults.txt")
        self._views = FlightViews(on_snapshot)
        recorders = (self._recorder, *self._recorder.further)
        for (place, source), recorder in zip(plan.videos.items(), recorders, strict=True):
            self._add_view(place, source, recorder, detector)
        self._first = self._views.first
        # those that are measured alone; with orders to the first camera's aircraft the command service asks for its own
        self._rates = [
            MessageRates(
                None,
                view.uav_id,
                () if place else mission.ugv_ids,
                uav_rates=uav_rates(gimbal=view.pipeline.mission.follows_gimbal),
            )
            for place, view in self._views.all.items()
            if place or not plan.command
        ]
        self._newcomers = Newcomers([each.system_id for each in listening.roster.vehicles] if listening else ())
        self._first.loop.health = Health(
            free_bytes=self._recorder.free_bytes, recording_since_us=self._recorder.began_us, keys=len(self._ring)
        )
        for system_id in plan.accept_late:
            self._add_operator_event(system_id, "signed packets are accepted without a proof in this flight")
        films = [view.uav_id for view in self._views.all.values()]
        signs = plan.mission.signing.folder is not None
        self._practice = (
            PractisedFleet(plan.practise_port, self._add_practised, films, signs=signs) if plan.practise_port else None
        )
        self._stop = threading.Event()
        self._stopped = threading.Lock()
        self._closed = False
        self.lost: tuple[str, ...] = ()
        if plan.command:
            self._commands = self._open_commands(mission)
        self._monitor = FlightMonitor(
            self._ingest,
            self._recorder,
            self._first.video,
            self._rates,
            keys=len(self._ring),
            spare=plan.spare,
            on_event=self.add_event,
        )
        if listening:
            self._ingest.set_fleet(mission.system_ids, mission.uav.system_id)
            # twice: folding in a minute takes seconds, after which the flight is not to begin late
            for _ in range(2):
                self._views.add_packets(listening.hand_over(), self._ingest.heard_us, at_once=True)
        jobs = {"listening": self._receive, "naming": self._process, "looking after the flight": self._check_health}
        self._threads = [
            threading.Thread(target=self._repeat, args=job, name=job[0], daemon=True) for job in jobs.items()
        ]
        for thread in self._threads:
            thread.start()

    @property
    def without_key(self) -> tuple[int, ...]:
        """Vehicles of the mission that are refused because others have keys and they have none."""
        refused = len(self._ring) > 0 and self._mission.signing.keyless == "refused"
        return tuple(i for i in self._mission.system_ids if refused and self._ring.key_of(i) is None)

    @property
    def title(self) -> str:
        """Name of the session's folder, and of several cameras of the one on show."""
        return self.folder.name + (f" from {self._views.shown.name}" if self._views.several else "")

    @property
    def tiles(self) -> Path | None:
        """Tiles of the mission."""
        return self._mission.tiles

    @property
    def folder(self) -> Path:
        """The session folder."""
        return self._recorder.folder

    @property
    def packets(self) -> int:
        """Telemetry packets received and recorded, of all links; those that this station sent are not among them."""
        health = self._ingest.health()
        return health.packets - health.sent

    @property
    def frames(self) -> Mapping[int, int]:
        """Frames received and recorded, whether they were looked at or not, by their camera's place in the mission."""
        return {place: view.frames for place, view in self._views.all.items()}

    @property
    def error(self) -> FlightError | None:
        """Error of what does not work any more, None while all is well."""
        why = self._faults.persistent
        return FlightError(f"{why}; telemetry and video are recorded all the same") if why else None

    @property
    def faults(self) -> tuple[str, ...]:
        """A line on faults of the program that were passed over, if there were any."""
        if not self._faults.count:
            return ()
        return (f"{self._faults.count} faults of this program, in faults.txt; last: {self._faults.last}",)

    @property
    def practice(self) -> PractisedFleet | None:
        """Troubles of a simulated fleet, None of a real one."""
        return self._practice

    @property
    def commands(self) -> Commands | None:
        """The command service, None for a station that listens only."""
        return self._commands

    def latest(self) -> Snapshot | None:
        """The newest snapshot of the camera on show, with what the others tell."""
        return self._views.latest()

    def latest_of_first(self) -> Snapshot | None:
        """The newest snapshot of the first camera, whichever is on show."""
        return self._first.loop.latest

    def events(self) -> Sequence[Event]:
        """Events so far: of the fleet, and of each camera what is about that one."""
        return self._views.events()

    def add_event(self, event: Event) -> None:
        """Add an event that the operator is to know, for screen and event log."""
        self._first.loop.add_event(event)

    def mark(self, t_us: int, text: str, system_id: int = 0) -> None:
        """Keep the operator's note on a moment: an event."""
        self.add_event(Event(t_us=t_us, level="info", kind="mark", text=text, system_id=system_id))

    def acknowledge(self, alarms: Sequence[Alarm]) -> None:
        """Log which alarms the operator has seen, an event each."""
        t_us = now_us()
        for view, alarm in itertools.product(self._views.all.values(), alarms):
            if (own := view.own(alarm)) is None:
                continue
            view.loop.add_event(
                Event(
                    t_us=t_us,
                    level="info",
                    kind="operator",
                    text=f"seen: {own.text}",
                    system_id=own.system_id,
                    alarm=own.key,
                )
            )

    def state_name(self, track_id: int, system_id: int) -> None:
        """Take the operator's statement which vehicle a box is."""
        self._views.shown.pipeline.state_name(Statement(track_id=track_id, system_id=system_id))

    def undo_statement(self, track_id: int = 0) -> None:
        """Withdraw a statement of the operator."""
        self._views.shown.pipeline.state_name(Statement(track_id=track_id, system_id=0, undone=True))

    def rates(self) -> Sequence[Rate]:
        """Rates of messages."""
        measured = (*([self._commands.rates] if self._commands else []), *self._rates)
        return [rate for rates in measured for rate in rates.rates(time.monotonic())]

    def newcomers(self) -> Sequence[Newcomer]:
        """Vehicles that are heard and not in the fleet."""
        return self._newcomers.heard

    def change_fleet(self, change: FleetChange) -> None:
        """Take a vehicle into the fleet, leave it out or rename it, as the operator wants."""
        after = changed(self._first.pipeline.mission, change)
        for view in self._views.all.values():
            view.pipeline.change_fleet(change)
        if self._commands:
            self._commands.set_ground({i: after.name_of(i) for i in after.ugv_ids})
        else:
            self._rates[0].set_ground(after.ugv_ids)
        self._ingest.set_fleet(after.system_ids, self._first.uav_id)

    def save_mission(self) -> str:
        """Write the mission as a file of the working folder, never over one, to be flown again; tells where.

        A camera that the film showed is in it.
        """
        mission = self._first.pipeline.mission
        taken_in = set(mission.ugv_ids) - set(self._plan.mission.ugv_ids)
        origins = {**dict.fromkeys(map(str, taken_in), "taken in during the flight"), **self._plan.origins}
        cameras = {view.uav_id: found for view in self._views.all.values() if (found := view.pipeline.found_camera)}
        views = (replace(view, camera=cameras.get(view.system_id, view.camera)) for view in mission.view)
        mission = replace(mission, view=tuple(views))
        if found := cameras.get(self._first.uav_id):
            mission = replace(mission, camera=found)
            origins |= {"camera": f"Found from the film of {self.title}: gcs calibrate measures it better."}
        path, new = save_mission(mission, origins, Path.cwd())
        return f"the mission is {'saved' if new else 'already'} in {path.name}: gcs fly {path.name} flies it again"

    def accept_held(self, system_ids: Sequence[int]) -> None:
        """Accept vehicles whose signed packets are held, which the operator vouches for: an event each."""
        for system_id in system_ids:
            try:
                self._ingest.accept_held(system_id)
                self._add_operator_event(system_id, "signed packets that were held are accepted without a proof")
            except LinkError as error:
                self._add_operator_event(system_id, f"signed packets stay held: {error}")

    def next_view(self) -> Flight | None:
        """Show the next camera of the flight and put it in focus."""
        self._views.show_next()
        return self if self._views.several else None

    def pictures(self) -> Sequence[CameraPicture]:
        """Pictures that the cameras took last."""
        shown, views = self._views.shown, (view for _, view in sorted(self._views.all.items()))
        return [CameraPicture(name=each.name, snapshot=each.loop.latest, on_show=each is shown) for each in views]

    def take_rival_video(self) -> None:
        """Take the other video where two senders contest its port, as the operator wants: an event."""
        if taken := self._views.shown.video.take_rival():
            self._views.shown.loop.add_event(
                Event(t_us=now_us(), level="warning", kind="operator", text=f"video is to come from {taken}")
            )

    def _add_practised(self, system_id: int, text: str) -> None:
        whose = f"{self._first.pipeline.mission.name_of(system_id)}: " if system_id else ""
        self.add_event(Event(t_us=now_us(), level="info", kind="operator", text=f"{whose}{text}", system_id=system_id))

    def _add_operator_event(self, system_id: int, text: str) -> None:
        self.add_event(
            Event(
                t_us=now_us(),
                level="warning",
                kind="operator",
                text=f"{self._first.pipeline.mission.name_of(system_id)}: {text}",
                system_id=system_id,
            )
        )

    def stop(self) -> None:
        """End the threads, then seal the recording."""
        with self._stopped:
            if self._closed:
                return
            self._closed = True
        self._stop.set()
        if self._commands:
            self._commands.close()
        for view in self._views.all.values():
            view.video.close()
        for thread in self._threads:
            if thread is not threading.current_thread():
                thread.join(timeout=5)
        self._ingest.stop()
        for view in self._views.all.values():
            view.loop.close()
        health = self._ingest.health()
        _log.info("the flight ends with %d packets", self.packets)
        self.lost = self._recorder.close(health.record, refused=health.refused)

    def _open_commands(self, mission: Mission) -> CommandService:
        # MAVSDK's native library is loaded only by stations that may command
        from gcs.flight.command_setup import open_command_service, place_of

        return open_command_service(
            mission,
            self._ingest,
            self._ring,
            where=lambda system_id: place_of(system_id, self.latest_of_first()),
            on_event=self.add_event,
        )

    def _add_view(self, place: int, video: str, recorder: ViewRecorder, detector: Detector | None) -> None:
        mission = self._mission.views[place] if place else self._mission
        self._views.add(
            place, FlightView(mission, video, recorder, detector, self._ingest, self._faults, self._views.take)
        )

    def _repeat(self, job: str, turn: Callable[[], None]) -> None:
        """A thread's turns until the flight ends; one that fails is kept and reported, and the next one goes on."""
        while not self._stop.is_set():
            try:
                turn()
            except Exception as error:  # noqa: BLE001 - counted, reported on the screen, kept with its traceback
                self._faults.turn_failed(job, error)
                self._stop.wait(FAULT_PAUSE_S)
            else:
                self._faults.turn_succeeded(job)

    def _receive(self) -> None:
        packets = self._ingest.read(READ_S)
        self._views.add_packets(packets, self._ingest.heard_us)
        self._newcomers.add_packets(packets, self._fleet)
        now_s = time.monotonic()
        for packet in packets:
            if self._commands:
                self._commands.receive(packet)
            for rates in self._rates:
                rates.add_packet(packet, now_s)

    def _process(self) -> None:
        if self._commands:
            self._commands.poll()
        self._views.turn(self._stop.wait)

    @property
    def _fleet(self) -> frozenset[int]:
        """System ids of those who fly now."""
        return frozenset(self._first.pipeline.mission.system_ids)

    def _check_health(self) -> None:
        if self._practice:
            self._practice.look()
        for event in self._newcomers.look(now_us(), self._fleet, self.latest_of_first()):
            self.add_event(event)
        first, *others = self._views.all.values()
        offer = first.pipeline.fleet.video_offer
        first.loop.health = self._monitor.check(first.loop.throughput, self._faults, offer)
        for view in others:
            view.loop.health = with_video(first.loop.health, view.video, view.loop.throughput)
            for event in view.video.check(view.pipeline.fleet.video_offer):
                view.loop.add_event(event)
        self._stop.wait(CARE_S)
