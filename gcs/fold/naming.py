"""Second stage of the fold: who the tracks are, and which of the names are given."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from assoc.geometry.ground import YAW
from assoc.identification.identifier import Identifier
from assoc.records import CameraState, Identities
from assoc.whole_flight.evidence import FlightEvidence
from gcs.fold.camera.frame_camera import FrameCamera, expected_pixels, identifier_params
from gcs.fold.contradictions import Contradictions
from gcs.fold.evidence import camera_of, observation_of, reports_of
from gcs.fold.name_changes import NameChanges
from gcs.fold.quarantine import limit_doubted, withhold_names
from gcs.fold.statements import Statements
from gcs.fold.turn import Look, Turn
from gcs.fold.view_exchange import ExchangeMember
from gcs.mission.mission import Mission
from gcs.snapshot import Event
from mavlink.geodesy import LocalFrame
from mavlink.state import FleetState, Reports
from vision.track.tracks import Stitch

IntArray = NDArray[np.int64]
FloatArray = NDArray[np.float64]


class NamingStage:
    """Keeps the evidence of who is who, and decides which names are given.

    Args:
        mission: who can be named.

    Attributes:
        exchange: with the folds of the flight's other cameras; None: it is by itself.
        evidence: keeps what names rest on, for those who look at the whole flight later; None: nobody does.
    """

    exchange: ExchangeMember | None = None
    evidence: FlightEvidence | None = None

    def __init__(self, mission: Mission) -> None:
        self._mission = mission
        self._params = identifier_params(mission)
        if mission.clock.video_offset_s == "auto":
            self._params = replace(self._params, time_offset_std_s=self._params.unknown_offset_std_s)
        self.identifier = Identifier(mission.ugv_ids, self._params)
        self.contradictions = Contradictions()
        self.statements = Statements(mission)
        self._changes = NameChanges(mission)
        self._state_of: tuple[FrameCamera, CameraState] | None = None
        """The camera that was last asked about, as the identifier has it."""

    @property
    def yaw_error(self) -> float:
        """Error of the camera's heading as far as known, radians clockwise."""
        return float(self.identifier.pose_correction[YAW])

    def expected_px(self, state: FleetState, view: FrameCamera | None) -> dict[int, tuple[float, float]] | None:
        """Places where the vehicles' reports put them, by system id; None while the camera's pose is unknown."""
        return expected_pixels(state, view, lambda p, by: self.identifier.expected_rays(p, self._camera(by)))

    def stitch(self, t_us: int, view: FrameCamera | None) -> Stitch | None:
        """Continue lost tracks where their vehicles report to be (Algorithm 1, lines 15-22).

        Args:
            t_us: time of the frame on telemetry's clock, Unix µs.
            view: the camera, None unknown.
        """
        if view is None:
            return None
        camera = self._camera(view)

        def stitch(track_id: IntArray, centres: FloatArray) -> IntArray:
            return self.identifier.stitch(t_us, track_id, view.intrinsics.rays(centres), camera)

        return stitch

    def followed(self, state: FleetState) -> list[int]:
        """Tracks that carry a name whose vehicle reports a position."""
        positioned = set(state.system_id[state.valid].tolist())
        return [track for track, vehicle in self._changes.by_track.items() if vehicle in positioned]

    def number_of(self, track_id: int) -> int:
        """Number of what a track is: no two cameras of the flight give the same one to two objects; of one camera 0."""
        own, others = self._mission.uav.system_id, [view.system_id for view in self._mission.view]
        if not others:
            return 0
        films = sorted((own, *others))
        camera, track = self.exchange.first_seen(track_id) if self.exchange else (own, track_id)
        return (track - 1) * len(films) + films.index(camera) + 1

    def add_reports(self, reports: Reports, state: FleetState, view: FrameCamera | None) -> None:
        """Take in the positions that came since the last frame."""
        seen = reports_of(reports, self._mission.ugv_ids, view, state)
        self.identifier.add_reports(seen)
        if self.evidence is not None:
            self.evidence.add_reports(seen)

    def raise_ground(self, step_m: float) -> None:
        """Move what was seen onto ground that is higher, metres, than was thought."""
        self.identifier.raise_ground(step_m)
        self._begin_evidence()

    def change_fleet(self, mission: Mission) -> None:
        """Name another fleet; who stays is named on by the same frames and reports."""
        before, self._mission = self._mission, mission
        self._changes.mission = self.statements.mission = mission
        if mission.ugv_ids != before.ugv_ids:
            self.identifier.change_fleet(mission.ugv_ids)
            self._count_again()

    def begin_anew(self) -> None:
        """Forget all evidence."""
        self.identifier = Identifier(self._mission.ugv_ids, self._params)
        self._count_again()

    def _count_again(self) -> None:
        """Let what was stated count for an identifier whose evidence begins anew."""
        self._begin_evidence()
        self.statements.count_again(self.identifier)
        self._changes.evidence_forgotten = True

    def _begin_evidence(self) -> None:
        if self.evidence is not None:
            self.evidence.begin_anew(self._mission.ugv_ids)

    def state_names(self, turn: Turn, look: Look) -> list[Event]:
        """Let what the operator stated count from this frame on."""
        return self.statements.apply(turn.t_us, turn.index, look.tracks, self.identifier)

    def name(self, turn: Turn, look: Look, origin: LocalFrame | None) -> tuple[Look, list[Event]]:
        """Find out who the tracks of a frame are.

        Args:
            turn: The frame.
            look: What was seen in it.
            origin: Of the local frame, None unknown.

        Returns:
            The look with names, and an event for each name that came, changed or went.
        """
        look = replace(look, found=self._identify(turn, look, origin))
        seen = set(look.tracks.track_id[look.tracks.detection >= 0].tolist())
        stated = set(self.statements.by_track.values())
        self.contradictions.update(turn.t_us, look.found, turn.state, seen, stated)
        given, suspected = self.given(look, turn.state), self.contradictions.suspected
        events = self._changes.update(turn.t_us, given, turn.state, look.tracks, look.size, suspected)
        return look, events + self.statements.review(turn.t_us, given, turn.state, self.identifier, look.living)

    def given(self, look: Look | None, state: FleetState) -> Identities | None:
        """Names of the last look, without those that the fleet's state forbids now."""
        known = limit_doubted(look.found if look else None, state, self._mission.identity.threshold)
        return withhold_names(known, state, self.contradictions.withheld, self.contradictions.left)

    def _identify(self, turn: Turn, look: Look, origin: LocalFrame | None) -> Identities | None:
        view, t_us = look.view, turn.state.t_us
        if view is None:
            return None
        observation = observation_of(t_us, look.joined.boxes, look.tracks, view.intrinsics, view)
        heard: Callable[..., FloatArray] | None = None
        if self.exchange and origin:
            heard = partial(self.exchange.answers, turn.index, origin, tuple(self._mission.ugv_ids))
        camera = self._camera(view)
        found = self.identifier.update(observation, camera, heard=heard, unlooked_s=look.unlooked_s)
        if self.evidence is not None and self.identifier.by_course:
            self.evidence.add_frame(turn.t_us, observation, camera, self.identifier.pose_correction)
        return found

    def _camera(self, view: FrameCamera) -> CameraState:
        if self._state_of is None or self._state_of[0] is not view:
            self._state_of = view, camera_of(view)
        return self._state_of[1]
