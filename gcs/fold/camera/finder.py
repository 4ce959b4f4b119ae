"""A camera that nothing describes, found from the film: frames are collected until the fleet's motion explains them.

Three things may be unknown: the focal length, the direction, or both. What is found is a camera as a mission has it, so
that it is used, and kept, as one that was described.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from assoc.camera_search.inputs import FilmedFleet, KnownMount, MountKind
from assoc.camera_search.search import CameraFit, CameraVerdict, find_camera, refined
from gcs.fold.camera.direction import LEVEL
from gcs.mission.mission import Camera
from gcs.snapshot import Event
from mavlink.state import FleetState, Level
from vision.detect.detections import Detections
from vision.track.tracks import Tracks

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

STEP_US, LOOKS = 400_000, 50
"""Least time between frames that are kept, as a vehicle moves by little more than its own error, and their number, 20
s."""
MIN_LOOKS = 12
"""Least number of frames that a search needs, 5 s; and half of them of a track."""
AGAIN_US, RARER, MAX_AGAIN_US = 1_500_000, 1.15, 30_000_000
"""Time after which a search is repeated, the factor by which that grows with each that finds nothing, as it costs half
a second, and its bound."""
REFINED_AGAIN_US, REFINED_FOR_US = 5_000_000, 60_000_000
"""Time after which a camera that was found is refined again, and the time in which that is done."""
MIN_HEIGHT_M = 5.0
"""Least height above the ground, m; lower down nothing is level enough."""
GUESSED_FOR_US = 30_000_000
"""Time for which a direction that nobody stated is no reason to doubt that video and telemetry belong together."""
REPORT_AFTER_US = 10_000_000
"""Duration of a search after which it is reported why the camera is not found."""
CORRECTED_FOCAL, CORRECTED_RAD, CORRECTED_STDS = 0.06, math.radians(4.0), 3.0
"""ln of a focal length, and a pitch, that a longer look must differ by to be used, and by how many σ. Names then
begin again."""
NAME = "the film"
"""Name of a camera that was found."""
_WHY_NOT = {
    CameraVerdict.STANDING: "the fleet stands still: vehicles in view have to drive by 4 m and more",
    CameraVerdict.AMBIGUOUS: "more than one camera explains what is seen: it takes vehicles that turn or brake",
    CameraVerdict.UNEXPLAINED: "no camera explains what is seen yet: it takes three vehicles that drive in view",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class _SeenFrame:
    t_us: int
    track_id: IntArray
    picture: FloatArray
    """(T, 2) from the middle of the picture, in its widths."""
    vehicle_enu: FloatArray
    """(V, 2), NaN unknown."""
    R_enu_base: FloatArray
    p_enu: FloatArray
    known: bool
    """True if the attitude is."""


class CameraFinder:
    """Searches for a camera over the first minutes of a film.

    Args:
        camera: the mission's; None: nothing is known of it but what the UAV reports.
    """

    def __init__(self, camera: Camera | None) -> None:
        self.camera: Camera | None = None
        """The camera as it is known best by now, None until it was found."""
        self._stated = camera
        self._looks: deque[_SeenFrame] = deque(maxlen=LOOKS)
        self._fit: CameraFit | None = None
        self._gimbal = False
        self._first_us = self._searched_us = self._found_us = 0
        self._again_us = float(AGAIN_US)
        self._reported_verdict: CameraVerdict | None = None
        self._least_std = math.inf
        """1σ of ln φ of ``camera``."""
        self._size, self._focal = (0, 0), math.nan

    @property
    def describes_lens(self) -> bool:
        """True if the mission has the camera's numbers, so that there is nothing to search for."""
        return self._stated is not None and self._stated.intrinsics is not None

    @property
    def guesses(self) -> bool:
        """True if the camera is taken to look straight down as nobody says, while it may still be found otherwise."""
        if self._stated is not None or self._fit is not None or self._gimbal or not self._looks:
            return False
        return self._looks[-1].t_us - self._first_us < GUESSED_FOR_US

    def look(
        self,
        state: FleetState,
        boxes: Detections,
        tracks: Tracks,
        size: tuple[int, int],
        *,
        ground_z: float,
        focal: float,
    ) -> tuple[Camera | None, list[Event]]:
        """Take in a frame, and search where it is time to.

        Args:
            state: the fleet at the frame.
            boxes: of the frame.
            tracks: after them.
            size: width and height of the frame, px.
            ground_z: height of the ground, ENU metres.
            focal: reported focal length in widths of the picture, NaN unknown.

        Returns:
            A camera to use from now on, None: as before; and what an operator should know.
        """
        gimbal = state.uav.R_enu_gimbal is not None and state.uav.attitude_valid
        # once it was found, the one in use is not the reported one
        focal = self._focal = focal if self._fit is None else self._focal
        done = self._found_us and state.t_us - self._found_us > REFINED_FOR_US
        if done or not self._lacks(focal, gimbal):
            return None, []
        if (gimbal, size) != (self._gimbal, self._size):
            self._looks.clear()
            self._gimbal, self._size = gimbal, size
        self._keep(state, boxes, tracks)
        again_us = self._again_us if self._fit is None else REFINED_AGAIN_US
        if len(self._looks) < MIN_LOOKS or 0 <= state.t_us - self._searched_us < again_us:
            return None, []
        self._searched_us = state.t_us
        film = self._film(ground_z, focal)
        if float(np.median(film.p_enu[:, 2])) - ground_z < MIN_HEIGHT_M:
            return None, []
        return self._search(state.t_us, film) if self._fit is None else self._refine(state.t_us, film, self._fit)

    def _lacks(self, focal: float, gimbal: bool) -> bool:
        """Tell whether the focal length is unknown, or the direction."""
        return math.isnan(focal) or (self._stated is None and not gimbal) or self._fit is not None

    def _keep(self, state: FleetState, boxes: Detections, tracks: Tracks) -> None:
        uav = state.uav
        if not self._looks or state.t_us < self._looks[-1].t_us:
            self._looks.clear()
        elif state.t_us - self._looks[-1].t_us < STEP_US:
            return
        if not uav.position_valid:
            return
        found = np.flatnonzero(tracks.detection >= 0)
        self._first_us = self._first_us or (state.t_us if len(found) else 0)
        width, height = self._size
        self._looks.append(
            _SeenFrame(
                t_us=state.t_us,
                track_id=tracks.track_id[found],
                picture=(boxes.centre[tracks.detection[found]] - np.array([width, height]) / 2.0) / width,
                vehicle_enu=np.where(state.valid[:, None], state.p_enu[:, :2], np.nan),
                R_enu_base=self._base(state),
                p_enu=uav.p_enu,
                known=uav.attitude_valid,
            )
        )

    def _base(self, state: FleetState) -> FloatArray:
        """Mount that the camera hangs on: the gimbal where that reports, else the body."""
        uav = state.uav
        if not self._gimbal or uav.R_enu_gimbal is None:
            return uav.R_enu_body
        roll = math.radians(-uav.camera.rotation_deg) if uav.camera is not None else 0.0
        c, s = math.cos(roll), math.sin(roll)
        return np.asarray(uav.R_enu_gimbal @ np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]]))

    def _film(self, ground_z: float, focal: float) -> FilmedFleet:
        looks = list(self._looks)
        ids = np.unique(np.concatenate([look.track_id for look in looks]))
        picture = np.full((len(looks), len(ids), 2), np.nan)
        for row, look in enumerate(looks):
            picture[row, np.searchsorted(ids, look.track_id)] = look.picture
        long = np.count_nonzero(np.isfinite(picture[..., 0]), axis=0) >= MIN_LOOKS // 2
        known = all(look.known for look in looks)
        return FilmedFleet(
            t=np.array([(look.t_us - looks[0].t_us) * 1e-6 for look in looks]),
            picture=picture[:, long],
            vehicle_enu=np.stack([look.vehicle_enu for look in looks]),
            R_enu_base=np.stack([look.R_enu_base if known else LEVEL for look in looks]),
            p_enu=np.stack([look.p_enu for look in looks]),
            ground_z=ground_z,
            heading_known=known,
            focal=focal,
            mount=self._known_mount(),
        )

    def _known_mount(self) -> KnownMount | None:
        if self._gimbal:
            return KnownMount(kind="gimbal", pitch=0.0, yaw=0.0)
        if self._stated is None:
            return None
        kind: MountKind = "fixed" if self._stated.mount == "fixed" else "stabilized"
        return KnownMount(kind=kind, pitch=math.radians(self._stated.pitch_deg), yaw=math.radians(self._stated.yaw_deg))

    def _search(self, t_us: int, film: FilmedFleet) -> tuple[Camera | None, list[Event]]:
        found = find_camera(film)
        if found.verdict is CameraVerdict.FOUND and found.best is not None:
            self._fit, self._found_us, self.camera = found.best, t_us, self._camera(found.best)
            self._least_std = found.best.focal_std
            return self.camera, [_event(t_us, "info", f"camera found from the film: {_described(found.best)}")]
        if found.verdict is not CameraVerdict.STANDING:
            self._again_us = min(RARER * self._again_us, MAX_AGAIN_US)
        if found.verdict is self._reported_verdict or t_us - self._first_us < REPORT_AFTER_US:
            return None, []
        self._reported_verdict = found.verdict
        return None, [_event(t_us, "warning", f"nothing describes the camera, and {_WHY_NOT[found.verdict]}")]

    def _refine(self, t_us: int, film: FilmedFleet, used: CameraFit) -> tuple[Camera | None, list[Event]]:
        fit = refined(film, used)
        if fit is None or fit.focal_std > self._least_std:
            return None, []
        self.camera, self._least_std = self._camera(fit), fit.focal_std
        focal = abs(math.log(fit.focal / used.focal)), math.hypot(fit.focal_std, used.focal_std)
        pitch = abs(fit.pitch - used.pitch), math.hypot(fit.pitch_std, used.pitch_std)
        limits = (CORRECTED_FOCAL, CORRECTED_RAD)
        if not any(
            off > max(least, CORRECTED_STDS * std) for (off, std), least in zip((focal, pitch), limits, strict=True)
        ):
            return None, []
        self._fit = fit
        return self.camera, [_event(t_us, "warning", f"camera corrected by the film: {_described(fit)}")]

    def _camera(self, fit: CameraFit) -> Camera:
        """A mission's camera, hung as was stated, else as was found."""
        width, height = self._size
        focal_px = round(fit.focal * width, 1)
        return replace(
            self._stated or _hung(fit),
            name=NAME,
            width=width,
            height=height,
            fx=focal_px,
            fy=focal_px,
            cx=width / 2.0,
            cy=height / 2.0,
            zoom=1.0,
            zoom_max=1.0,
        )


def _hung(fit: CameraFit) -> Camera:
    """A camera without numbers that hangs as was found; until a gimbal reports it is taken to hold the horizon."""
    roll_deg = round(math.degrees(fit.roll), 2)
    if fit.kind == "gimbal":
        return Camera(mount="gimbal", roll_deg=roll_deg)
    return Camera(
        mount="fixed" if fit.kind == "fixed" else "gimbal",
        roll_deg=roll_deg,
        pitch_deg=round(math.degrees(fit.pitch), 2),
        yaw_deg=round(math.degrees(fit.yaw), 2),
    )


def _event(t_us: int, level: Level, text: str) -> Event:
    return Event(t_us=t_us, level=level, kind="camera", text=text)


def _described(fit: CameraFit) -> str:
    """A camera in words."""
    across = math.degrees(2.0 * math.atan(0.5 / fit.focal))
    text = f"{across:.0f}° across (± {100.0 * fit.focal_std:.0f} %)"
    if fit.kind == "gimbal":
        return text
    turned = math.degrees((fit.yaw + math.pi) % (2.0 * math.pi) - math.pi)
    side = f"{abs(turned):.0f}° to the {'right' if turned > 0.0 else 'left'} of the nose"
    return f"{text}, looks {-math.degrees(fit.pitch):.0f}° down, {side}, {fit.kind}"
