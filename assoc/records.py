"""Records that go into the identifier and come out: plain arrays, one record per frame.

Frames: camera = OpenCV (x right, y down, z forward); world = ENU metres. Times are int Unix µs. m tracks, k reports.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from assoc.errors import ShapeError

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


def _need(name: str, array: NDArray[np.generic], shape: tuple[int, ...]) -> None:
    """Raise ShapeError unless the array has the shape."""
    if array.shape != shape:
        raise ShapeError(f"{name}: expected shape {shape}, got {array.shape}")


@dataclass(frozen=True, slots=True, kw_only=True)
class Observation:
    """The tracks of one video frame."""

    t_us: int
    """Time at which the frame was taken, Unix µs."""
    track_id: IntArray
    """(m,) identity of the track in the image, unique in a frame."""
    ray_cam: FloatArray
    """(m, 3) ray through the box centre, camera frame; length does not matter."""
    front_cam: FloatArray
    """(m, 3) ray through a point ahead of the centre on the box's axis; NaN rows: front unknown."""
    gap_s: FloatArray
    """(m,) seconds since the track's last detection, 0 = seen in this frame."""
    score: FloatArray
    """(m,) detector score."""
    length_m: FloatArray | None = None
    """(m,) long side of a seen track's box on the ground, metres, NaN unseen or unknown; None: all unknown."""
    extent_rad: FloatArray | None = None
    """(m, 2) how wide and high the box of a track is in the picture, radians; None: unknown."""

    def __post_init__(self) -> None:
        m = len(self.track_id)
        if self.length_m is not None:
            _need("length_m", self.length_m, (m,))
        if self.extent_rad is not None:
            _need("extent_rad", self.extent_rad, (m, 2))
        _need("ray_cam", self.ray_cam, (m, 3))
        _need("front_cam", self.front_cam, (m, 3))
        _need("gap_s", self.gap_s, (m,))
        _need("score", self.score, (m,))


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraState:
    """Position and attitude of the camera, as telemetry has them at the time of the frame."""

    R_enu_cam: FloatArray
    """(3, 3) rotation camera → ENU."""
    p_enu: FloatArray
    """(3,) camera position, metres."""
    ground_z: float
    """Height of the ground plane in the same ENU frame, metres."""
    px_rad: float
    """Radians per pixel near the image centre."""
    attitude_known: bool = True
    """False: the heading of the image is not known at all; tilt is taken from ``R_enu_cam`` nevertheless."""
    position_known: bool = True
    """False: ``p_enu`` is a guess."""
    stabilized: bool = False
    """True: a gimbal keeps the horizon; False: the camera tilts with the body, so tilt is known less well."""
    half_view: tuple[float, float] = (np.nan, np.nan)
    """Tangents of half the angle of view, across and along the image; NaN unknown."""
    of_image_time: bool = False
    """True: ``R_enu_cam`` is the rotation at the moment of the frame, whatever telemetry's clock is off by."""
    R_reported: FloatArray | None = None
    """(3, 3) the rotation as telemetry has it for the frame's time, where ``R_enu_cam`` is another; None: the same."""
    height_std_m: float = np.nan
    """1σ of the camera's height above the ground, metres; NaN: as the identifier assumes."""
    other_heights_m: tuple[float, ...] = ()
    """Amounts by which the camera is higher above the ground if other sources of its height are right, metres."""
    position_std_m: float = np.nan
    """1σ per axis of the camera's level position, metres; NaN: as the identifier assumes."""

    def __post_init__(self) -> None:
        _need("R_enu_cam", self.R_enu_cam, (3, 3))
        _need("p_enu", self.p_enu, (3,))


@dataclass(frozen=True, slots=True, kw_only=True)
class VehicleReports:
    """Position reports that arrived since the last frame, each at its own sample time."""

    t_us: IntArray
    """(k,) sample time on Unix time, µs."""
    vehicle: IntArray
    """(k,) index into the identifier's ``system_ids``."""
    p_enu: FloatArray
    """(k, 3) metres."""
    v_enu: FloatArray
    """(k, 3) m/s, NaN unknown."""
    heading: FloatArray
    """(k,) clockwise from north, radians, NaN unknown."""
    std_m: FloatArray
    """(k,) horizontal 1σ as the vehicle states it, metres, NaN unknown."""

    def __post_init__(self) -> None:
        k = len(self.t_us)
        _need("vehicle", self.vehicle, (k,))
        _need("p_enu", self.p_enu, (k, 3))
        _need("v_enu", self.v_enu, (k, 3))
        _need("heading", self.heading, (k,))
        _need("std_m", self.std_m, (k,))

    @staticmethod
    def empty() -> VehicleReports:
        """No reports."""
        none = np.empty(0)
        return VehicleReports(
            t_us=np.empty(0, np.int64),
            vehicle=np.empty(0, np.int64),
            p_enu=np.empty((0, 3)),
            v_enu=np.empty((0, 3)),
            heading=none,
            std_m=none,
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Candidates:
    """The likeliest vehicles of each track, the best first; k of them, at most three."""

    system_id: IntArray
    """(m, k)."""
    confidence: FloatArray
    """(m, k) probability that the track is this vehicle."""
    distance_m: FloatArray
    """(m, k) ground distance between the track and the vehicle's extrapolated report, NaN unknown."""
    deviation: FloatArray
    """(m, k) that distance less the vehicle's usual error, in standard deviations, NaN unknown."""
    report_age_s: FloatArray
    """(m, k) age of the report, inf where there is none that is used."""
    better_track: IntArray
    """(m, k) track that is this vehicle with a larger probability, 0 none."""
    better_confidence: FloatArray
    """(m, k) that probability, NaN without such a track."""
    none_of_ours: FloatArray
    """(m,) probability that the track is no vehicle of the mission."""

    @staticmethod
    def empty(m: int) -> Candidates:
        """No candidate for any of m tracks."""
        whole, number = np.empty((m, 0), np.int64), np.empty((m, 0))
        return Candidates(
            system_id=whole,
            confidence=number,
            distance_m=number,
            deviation=number,
            report_age_s=number,
            better_track=whole,
            better_confidence=number,
            none_of_ours=np.full(m, np.nan),
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Identities:
    """Names of the tracks of a frame, in the order of the observation."""

    track_id: IntArray
    """(m,)."""
    system_id: IntArray
    """(m,) 0 = none of ours or unknown."""
    confidence: FloatArray
    """(m,) probability of the answer: named, of that name; unnamed, of "none of ours"."""
    runner_up: IntArray
    """(m,) the next best name, 0 = none."""
    runner_up_confidence: FloatArray
    """(m,) its probability."""
    residual_m: FloatArray
    """(m,) ground distance between the track and the named vehicle's extrapolated report, NaN unnamed."""
    position_age_s: FloatArray
    """(m,) age of that report, NaN unnamed."""
    projection: FloatArray
    """(m,) projection mass of the named vehicle, at most 0.5 s old; NaN unnamed."""
    topology: FloatArray
    """(m,) topology mass, likewise."""
    fused: FloatArray
    """(m,) both fused by Dempster's rule, likewise."""
    conflict: tuple[int, ...]
    """System ids whose reports contradict the video or one another."""
    candidates: Candidates
    """Candidates of each track, also of those that have no name."""
    doubt: IntArray
    """(m,) ``assoc.identification.doubts.AnswerDoubt``: what took most from the answer, 0 nothing."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Sighting:
    """Tracks of a view in one frame by itself, as it tells them to views of other cameras."""

    t_us: int
    """Unix µs on telemetry's clock, what the video's clock was found to be off taken out."""
    track_id: IntArray
    """(m,) tracks that are seen."""
    place: FloatArray
    """(m, 2) where they are on the ground, by the pose that the view found, ENU metres; NaN unknown."""
    cov_m2: FloatArray
    """(m, 2, 2) covariance of that, m², beyond what all of the frame share."""
    common_std_m: float
    """1σ per axis of what they share: the pose is off."""
    p: FloatArray
    """(m, n + 1) probability of each vehicle by this view alone, the last column "none of ours"."""
    fit: float
    """Probability that the view's film and telemetry belong together, 0 unknown."""

    def __post_init__(self) -> None:
        m = len(self.track_id)
        _need("place", self.place, (m, 2))
        _need("cov_m2", self.cov_m2, (m, 2, 2))
        _need("p", self.p[:, :0], (m, 0))
