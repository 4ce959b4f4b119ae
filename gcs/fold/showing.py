"""Third stage of the fold: the snapshot of a turn, with what is wrong and what has happened."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from assoc.records import Identities
from gcs.fold.camera.frame_camera import camera_aim
from gcs.fold.camera.frame_cameras import FrameCameras
from gcs.fold.candidates import CandidateWords
from gcs.fold.fences import Fences
from gcs.fold.naming import NamingStage
from gcs.fold.notice_events import NoticeEvents
from gcs.fold.since import Since
from gcs.fold.snapshot_rows import boxes_of, vehicle_rows, with_camera_errors, with_standings
from gcs.fold.turn import Look, Turn
from gcs.health.alarms import Alarms
from gcs.health.event_throttle import EventThrottle
from gcs.health.link_rates import LinkRates
from gcs.mission.mission import Mission
from gcs.session.fold_order import NO_FRAME
from gcs.snapshot import Box, Event, Health, Snapshot, Standing, doubted_by
from mavlink.geodesy import LocalFrame
from mavlink.protocol.packet import Packet
from mavlink.state import FleetState, Notice
from vision.camera.camera import footprint

HELD_US = 2_000_000
"""Time for which names are shown after their frame: at 5 m/s a vehicle is 10 m on, perhaps where its neighbour was."""
CLOCK_SET_US = 10_000_000
"""Greatest delay of a frame; one that is earlier still was dated by a clock that had been set back."""


class ShowingStage:
    """Makes snapshots: boxes with names, rows of the fleet, alarms, events.

    Args:
        mission: who flies.
        naming: the second stage.
        cameras: of the first stage.

    Attributes:
        frame: the newest frame, or ``NO_FRAME``.
        clock_us: the latest time of all turns, Unix µs.
    """

    def __init__(self, mission: Mission, naming: NamingStage, cameras: FrameCameras) -> None:
        self._mission, self._naming, self._cameras = mission, naming, cameras
        self.frame, self.clock_us, self._frame_us = NO_FRAME, 0, 0
        self._candidates = CandidateWords(mission.identity.threshold)
        self._named_since: Since[int, int] = Since()
        self._standing_since: Since[int, Standing] = Since()
        self._fences = Fences(mission)
        self._notices, self._throttle = NoticeEvents(mission), EventThrottle()
        self._events: list[Event] = []
        self._link_rates, self._alarms = LinkRates(), Alarms()

    def change_fleet(self, mission: Mission) -> None:
        """Show another fleet."""
        self._mission = self._notices.mission = mission
        self._fences = Fences(mission)

    def add_notices(self, notices: Iterable[Notice], packet: Packet) -> None:
        """Take in what a packet led to; of many alike the next snapshots have some."""
        events = [self._notices.event(notice, packet) for notice in notices]
        for event in events:
            self._alarms.texts.add(event)
        self._events += self._throttle.admit(events)

    def add_events(self, events: Iterable[Event]) -> None:
        """Take in events for the next snapshot."""
        for event in events:
            self._alarms.texts.acknowledge(event.acknowledges)
            self._events.append(event)

    def follow(self, state: FleetState) -> None:
        """Take note of whose senders are in doubt."""
        self._notices.follow(state)

    def show(
        self,
        turn: Turn,
        look: Look | None,
        origin: LocalFrame | None,
        *,
        image: NDArray[np.uint8] | None,
        health: Health | None,
    ) -> Snapshot:
        """Make the snapshot of a turn.

        Args:
            turn: The frame or moment, with the camera as it is known by now.
            look: The last one of the detector, None before the first.
            origin: Of the local frame, None unknown.
            image: (H, W, 3) BGR, only passed on.
            health: How the program is doing, passed on.
        """
        t_us, state, view, naming = turn.t_us, turn.state, turn.view, self._naming
        if turn.index != NO_FRAME:
            self.frame, self._frame_us = turn.index, t_us
        self.clock_us = max(t_us, self.clock_us) if t_us > self.clock_us - CLOCK_SET_US else t_us
        boxes = self._boxes(turn, look, naming.given(look, state), origin)
        expected_px = naming.expected_px(state, view)
        width, height = self._cameras.size or ((view.intrinsics.width, view.intrinsics.height) if view else (0, 0))
        looked_share = look.detections.looked_share((width, height)) if look and width else 1.0
        self._fences.set_origin(origin)
        suspected = naming.contradictions.suspected
        rows = vehicle_rows(self._mission, state, boxes, expected_px, (width, height), suspected=suspected)
        snapshot = Snapshot(
            t_us=t_us,
            frame=self.frame,
            frame_us=self._frame_us,
            seen_us=look.t_us if look else 0,
            clock_us=self.clock_us,
            width=width,
            height=height,
            image=image,
            vehicles=self._fences.compare(rows),
            boxes=boxes,
            footprint_enu=footprint(view.intrinsics, view.pose, view.ground_z) if view else None,
            uav_enu=state.uav.p_enu,
            uav_heading=state.uav.yaw,
            health=with_camera_errors(
                self._link_rates.with_rates(t_us, health or Health()),
                naming.identifier,
                self._mission.clock.declared_offset_s,
                looked_share=looked_share,
                guessed=self._cameras.guessed,
                differ=naming.exchange.contradictions(self._mission) if naming.exchange else "",
            ),
            camera=camera_aim(view, state.uav) if view else None,
            pose="unknown" if view is None else "known" if view.attitude_known else "no attitude",
            conflicts=naming.contradictions.standing,
            origin=origin,
            limits=self._mission.limits,
            fence_enu=self._fences.outlines,
        )
        return self._with_alarms(snapshot)

    def _boxes(
        self, turn: Turn, look: Look | None, names: Identities | None, origin: LocalFrame | None
    ) -> tuple[Box, ...]:
        """Boxes of the last look, while they are held."""
        if look is None or turn.t_us - look.t_us > HELD_US:
            return ()
        return boxes_of(
            look,
            names,
            origin,
            candidates=self._candidates.of(names, turn.state, self._naming.contradictions.standing),
            named_since=partial(self._named_since.update, turn.t_us),
            stated=self._naming.statements.by_track,
            number_of=self._naming.number_of,
            score=self._mission.detector.score,
        )

    def _with_alarms(self, snapshot: Snapshot) -> Snapshot:
        """The snapshot with its alarms and events, and the standings of its vehicles."""
        alarms, changes = self._alarms.update(snapshot)
        events = (*self._events, *self._throttle.overdue(snapshot.t_us), *changes)
        self._events = []
        since = partial(self._standing_since.update, snapshot.t_us)
        lapsed = bool(self._frame_us) and snapshot.t_us - self._frame_us > HELD_US
        rows = with_standings(snapshot, doubted_by(alarms), since, lapsed=lapsed)
        return replace(snapshot, alarms=alarms, events=events, vehicles=rows)
