"""Everything that can be chosen of a simulation, as frozen dataclasses. SI units; angles in degrees where so named.

Vehicles are numbered 0..n−1: first those the UAV films, then those that only report. System ids are 1 for the UAV and
``FIRST_UGV_ID + index`` for the rest.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Annotated, Literal

from msgspec import Meta

from infra.toml_tables import check_limits
from sim.errors import ScenarioError

UAV_ID = 1
"""MAVLink system id of the UAV."""
FIRST_UGV_ID = 11
"""MAVLink system id of the first ground vehicle; the others count on from it."""
MAX_VIEWS = FIRST_UGV_ID - UAV_ID
"""Cameras, each with an aircraft that has a system id."""
_SEED_STEP = 1_000_003
"""Difference of the seeds of two cameras: none that somebody chooses for another flight."""
MAX_REPORTING = 240
"""Ground vehicles, filmed and outside; system ids end at 255."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ScenarioGround:
    """The fleet and the ground it drives on."""

    kind: Literal["straight", "curved", "open", "formation", "parked", "bays"] = "curved"
    """Kind of ground; in bays all vehicles of our make stand side by side in two rows, with empty bays among them."""
    formation: Literal["line", "column", "wedge", "grid", "triangle"] = "line"
    """Formation, only for ``kind = "formation"``: line is abreast, column one behind the other, triangle has equal
    sides."""
    station_keeping_m: Annotated[float, Meta(ge=0.0, le=2.0)] = 0.15
    """Distance that vehicles wander about their places in a formation; 0 makes it rigid."""
    vehicles: Annotated[int, Meta(ge=1, le=200)] = 6
    """Vehicles that the UAV films."""
    outside: Annotated[int, Meta(ge=0, le=200)] = 0
    """Further vehicles that report but drive beyond the image."""
    speed_mps: Annotated[float, Meta(ge=0.1, le=30.0)] = 3.5
    spacing_m: Annotated[float, Meta(ge=1.0, le=200.0)] = 9.0
    """Distance between neighbours: along the lane, in the formation, from bay to bay, at least between parked ones."""
    lanes: Annotated[int, Meta(ge=1, le=8)] = 2
    lane_width_m: float = 3.5
    road_deg: float = 90.0
    """Mean direction of the road, clockwise from north: 90 runs along the image's width while the UAV looks north."""
    bend_deg: Annotated[float, Meta(ge=0.0, le=80.0)] = 50.0
    """Angle that a curved road turns to either side of its mean direction."""
    bend_length_m: float = 120.0
    lane_changes_per_min: float = 2.0
    """Rate of each vehicle, where there is room."""
    stops_per_min: float = 0.3
    """Rate of each vehicle."""
    area_m: tuple[float, float] = (44.0, 24.0)
    """Open ground and parked vehicles: extent of the filmed vehicles' area across and along the image; wider than the
    image makes them leave and re-enter."""
    slope_deg: Annotated[float, Meta(ge=0.0, le=20.0)] = 0.0
    """Rise of the ground towards ``uphill_deg``; telemetry's heights follow it, the UAV's do not."""
    uphill_deg: float = 0.0
    waves_m: Annotated[float, Meta(ge=0.0, le=30.0)] = 0.0
    """Amplitude of waves of the ground on top of the slope; telemetry's heights follow them, video cannot show them."""
    wavelength_m: Annotated[float, Meta(ge=20.0, le=2000.0)] = 90.0
    length_m: float = 2.2
    width_m: float = 1.4
    height_m: float = 0.9

    @property
    def is_open(self) -> bool:
        """True on open ground, where bodies stand or drive anywhere and follow no path."""
        return self.kind in ("open", "parked", "bays")


@dataclass(frozen=True, slots=True, kw_only=True)
class ScenarioFlight:
    """The true flight of the UAV."""

    height_m: Annotated[float, Meta(ge=3.0, le=500.0)] = 40.0
    follow: bool = True
    """Keep the filmed vehicles' middle in view; otherwise hover over where they began."""
    sway_m: float = 1.0
    """Amplitude of the wind's sway."""
    takeoff_above_m: Annotated[float, Meta(ge=-400.0, le=400.0)] = 0.0
    """Height of the place of take-off, from which the UAV's relative altitude counts, above the vehicles' ground."""
    tilt_sway_deg: float = 1.5
    wobble_deg: Annotated[float, Meta(ge=0.0, le=20.0)] = 0.0
    """Standard deviation of the body's smooth random wobble in roll and in pitch on top of the sway; a third in yaw."""
    wobble_tau_s: Annotated[float, Meta(ge=0.05, le=10.0)] = 0.25
    """Time constant of each of the three poles that smooth the wobble."""
    yaw_deg: float = 0.0
    yaw_sway_deg: float = 2.0
    yaw_rate_dps: float = 0.0
    """Turning round the filmed point: with an oblique camera this is an orbit."""
    drift_mps: float = 0.0
    roam_m: float = 0.0
    """Amplitude of a slow wandering of the filmed point, across and along the image's mean direction."""
    roam_s: Annotated[float, Meta(ge=1.0, le=1e6)] = 24.0
    """Period of the roaming, s."""
    climb_mps: float = 0.0


MAST_FLIGHT = ScenarioFlight(height_m=25.0, follow=False, sway_m=0.0, tilt_sway_deg=0.0, yaw_sway_deg=0.0)
"""Flight of a mast: off what is filmed, and still."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Zoom:
    """A change of the focal length at once."""

    at_s: float
    factor: Annotated[float, Meta(ge=0.1, le=10.0)]
    """Focal length from then on, in that at the start."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ScenarioCamera:
    """Intrinsics in pixels and mount, as in ``session.toml``."""

    width: int = 1920
    height: int = 1080
    fx: float = 1200.0
    fy: float = 1200.0
    cx: float = 960.0
    cy: float = 540.0
    distortion: tuple[float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0)
    mount: Literal["stabilized", "fixed"] = "stabilized"
    roll_deg: float = 0.0
    pitch_deg: Annotated[float, Meta(ge=-90.0, le=-10.0)] = -90.0
    yaw_deg: float = 0.0
    crf: int = 23
    """H.264 quality of rendered video: lower is finer and larger."""
    zooms: tuple[Zoom, ...] = ()
    """Zooms in the order of time; nothing reports them."""
    mirrored: bool = False
    """The image is flipped left to right, which the mission does not say."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Gnss:
    """Position errors per horizontal axis: noise from report to report and a bias that lasts."""

    white_m: Annotated[float, Meta(ge=0.0, le=100.0)] = 0.3
    white_kind: Literal["normal", "laplace", "outliers"] = "normal"
    """Distribution of that noise: outliers is normal but for one report in 25, which is off five times as far."""
    bias_m: float = 0.6
    """Standard deviation of the wandering bias."""
    bias_kind: Literal["gauss-markov", "filtered", "walk", "steps", "sine"] = "gauss-markov"
    """Course of the bias: with its deviation kept up, the same smoothly as an autopilot's filter gives it, as a random
    walk from there, in steps, or in a wave."""
    tau_s: Annotated[float, Meta(ge=0.1, le=1e6)] = 60.0
    """Correlation time; in which a walk adds the deviation once more; mean time between steps; period of the wave."""
    steps_per_min: Annotated[float, Meta(ge=0.0, le=60.0)] = 0.0
    """Changes of satellites, per vehicle: each moves the reports by another offset."""
    step_m: float = 1.5
    """Standard deviation of those offsets, per axis."""
    uav_white_m: float = 0.1
    uav_bias_m: float = 0.5
    """Length of the UAV's constant horizontal error; its direction follows from the seed."""
    height_bias_m: float = 0.0
    """Reported height of the UAV minus the true one."""
    altitude_quirk_m: float = 0.0
    """Added to ``relative_alt`` of ground vehicles, as some autopilots do when home was set before the EKF."""
    altitude_bias_m: Annotated[float, Meta(ge=0.0, le=100.0)] = 0.0
    """Standard deviation over the ground vehicles of a constant error of the altitude they report."""
    altitude_white_m: Annotated[float, Meta(ge=0.0, le=100.0)] = 0.0
    """Noise of that altitude from report to report."""
    altitude_datum_m: Annotated[float, Meta(ge=-120.0, le=120.0)] = 0.0
    """Excess of the altitudes of all ground vehicles, as above the ellipsoid instead of the sea."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ScenarioAttitude:
    """Errors of the orientation that the vehicles report."""

    compass_bias_deg: float = 0.0
    """Reported yaw of the UAV minus the true one."""
    tilt_pitch_deg: float = 0.0
    """True pitch of a stabilized camera minus the nominal one; for a fixed camera, error of the reported pitch."""
    tilt_roll_deg: float = 0.0
    noise_deg: float = 0.3
    """White noise of reported yaw; roll and pitch have three tenths of it."""
    wander_deg: Annotated[float, Meta(ge=0.0, le=20.0)] = 0.0
    """Standard deviation of a slow error, over half a minute, of the UAV's reported yaw, pitch and roll."""
    rates: bool = True
    """The UAV's ATTITUDE has its turn rates; else zeros stand in their place."""
    missing: bool = False
    """The UAV reports neither attitude nor heading nor gimbal."""
    gimbal: bool = True
    """The UAV reports GIMBAL_DEVICE_ATTITUDE_STATUS (stabilized mount only)."""
    ugv_heading_noise_deg: float = 1.5
    ugv_heading_bias_deg: float = 2.0
    """Standard deviation over the vehicles."""
    ugv_heading_missing: bool = False
    """Ground vehicles report hdg 65535 and no attitude."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ScenarioTiming:
    """Clocks, rates and the radio."""

    video_offset_s: float = 0.0
    """Video time minus telemetry time, in the frame stamps."""
    declared_offset: Literal["exact", "zero", "auto"] = "exact"
    """Offset that ``session.toml`` declares."""
    frame_jitter_s: float = 0.002
    frame_loss: Annotated[float, Meta(ge=0.0, le=0.9)] = 0.0
    """Share of frames that are not in the video."""
    rate_min_hz: Annotated[float, Meta(ge=0.1, le=50.0)] = 5.0
    """Lower bound of a vehicle's position rate."""
    rate_max_hz: Annotated[float, Meta(ge=0.1, le=50.0)] = 5.0
    irregular: Annotated[float, Meta(ge=0.0, le=1.0)] = 0.0
    """Share of the interval by half of which each position's time varies about its even one, either way."""
    attitude_hz: Annotated[float, Meta(ge=1.0, le=200.0)] = 20.0
    """Rate of the UAV's ATTITUDE."""
    uav_lag_s: Annotated[float, Meta(ge=0.0, le=5.0)] = 0.0
    """The position the UAV reports is the one it had this long before."""
    latency_s: float = 0.03
    jitter_s: float = 0.01
    """Mean of the exponential delay on top."""
    loss: Annotated[float, Meta(ge=0.0, le=1.0)] = 0.0
    clock_ppm: float = 120.0
    """Bound of the drift of the vehicles' boot clocks."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ScenarioDetector:
    """Detections that an oriented detector makes of the image."""

    pixel_noise: float = 1.0
    size_noise: Annotated[float, Meta(ge=0.0, le=1.0)] = 0.0
    """Further noise in shares of the box's size, √(w h)."""
    angle_noise_deg: float = 2.0
    miss: Annotated[float, Meta(ge=0.0, le=1.0)] = 0.02
    miss_run_s: Annotated[float, Meta(ge=0.0, le=60.0)] = 0.0
    """Misses of one body come in runs of this mean length; 0: each frame for itself."""
    clutter: float = 0.0
    """Mean number of boxes on nothing per frame."""
    weak: Annotated[float, Meta(ge=0.0, le=1.0)] = 0.0
    """Share of the misses that still have a box, with a score too low to count."""
    weak_clutter: Annotated[float, Meta(ge=0.0, le=500.0)] = 0.0
    """Mean number of boxes on nothing per frame whose score is too low to count."""
    score: Annotated[float, Meta(ge=0.05, le=0.95)] = 0.75
    """Mean score of a true box."""
    flip: float = 0.01
    """Share of boxes whose front is taken for the rear."""
    heading_missing: bool = False
    merge_lengths: Annotated[float, Meta(ge=0.0, le=10.0)] = 0.0
    """Distance of two bodies' centres, in about their own lengths, within which they come as one box."""
    bursts_per_min: float = 0.0
    """Losses of one vehicle for a while, per vehicle."""
    burst_min_s: float = 1.0
    burst_max_s: float = 4.0
    parts: Annotated[float, Meta(ge=0.0, le=0.9)] = 0.0
    """Share of the time in which a vehicle of our make is found as two boxes, its front and its rear."""
    parts_run_s: Annotated[float, Meta(ge=0.1, le=60.0)] = 2.5
    """Mean time for which a vehicle is found as two boxes."""
    never_found: Annotated[int, Meta(ge=0, le=200)] = 0
    """Number of vehicles of ours that are never found."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Targets:
    """Targets that are seen and not ours."""

    still: int = 0
    moving: int = 0
    """Number of other cars under way."""
    persons: int = 0
    lookalikes: int = 0
    """Vehicles of our own make that drive among ours and report nothing."""
    parked_lookalikes: int = 0


@dataclass(frozen=True, slots=True, kw_only=True)
class Occlusion:
    """A roof or canopy that hides one vehicle for a while; others that pass below are hidden too."""

    vehicle: int
    t_s: float
    """Middle of the occlusion."""
    duration_s: float = 2.0
    height_m: float = 5.0
    width_m: float = 3.5


@dataclass(frozen=True, slots=True, kw_only=True)
class Blackout:
    """Time in which nothing at all is detected."""

    start_s: float
    stop_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class ScenarioFault:
    """Fault of one vehicle's telemetry."""

    vehicle: int
    kind: Literal["silent", "frozen", "zero", "jump", "lag", "drift", "spoof", "copy"]
    """A spoof reports the place of another vehicle with errors of its own, a copy the very reports of another one."""
    start_s: float
    stop_s: float = 1e9
    size: float = 0.0
    """Jump in metres, lag in seconds, drift in metres per second; 0 takes 15 m, 3 s, 0.5 m/s. For a spoof or a copy the
    delay in seconds."""
    other: int = 0
    """System id whose place is reported instead, for a spoof or a copy."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ScenarioDeclared:
    """Errors of the mission about the camera: what ``session.toml`` says beside the truth."""

    camera: bool = True
    """True if the mission describes the camera at all."""
    focal_share: Annotated[float, Meta(ge=0.2, le=5.0)] = 1.0
    """Declared focal length over the true one."""
    yaw_deg: float = 0.0
    """Declared mount angles minus the true ones."""
    pitch_deg: float = 0.0
    distortion: bool = True
    """True if the lens's distortion is declared."""
    offset_s: float = 0.0
    """Declared ``video_offset_s`` minus the true one, where it is declared as a number."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ScenarioView:
    """A further camera over the same fleet, on an aircraft of its own; its errors are drawn again."""

    mast: bool = False
    """True if the camera is on a mast: ``flight`` should not move, nothing is sent, and the mission has the place. What
    the mission has of direction is off by ``declared``, and this much is stated as 1σ."""
    aside_m: tuple[float, float] = (0.0, 0.0)
    """East and north of where ``flight`` alone would have it, metres."""
    flight: ScenarioFlight = field(default_factory=ScenarioFlight)
    camera: ScenarioCamera = field(default_factory=ScenarioCamera)
    attitude: ScenarioAttitude = field(default_factory=ScenarioAttitude)
    timing: ScenarioTiming = field(default_factory=ScenarioTiming)
    detector: ScenarioDetector = field(default_factory=ScenarioDetector)
    declared: ScenarioDeclared = field(default_factory=ScenarioDeclared)
    blackouts: tuple[Blackout, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class Scenario:
    """One flight. Equal scenarios give equal sessions, byte for byte."""

    name: str = "nominal"
    seed: Annotated[int, Meta(ge=0, le=2**63 - 1)] = 1
    duration_s: Annotated[float, Meta(ge=0.1, le=7200.0)] = 60.0
    fps: Annotated[float, Meta(ge=0.5, le=120.0)] = 10.0
    start_us: int = 1_795_170_000_000_000
    """Unix time of the first frame's exposure."""
    latitude_deg: float = 48.1
    longitude_deg: float = 11.6
    altitude_m: float = 550.0
    scenery: Literal["bare", "dressed"] = "bare"
    """Scenery beside the vehicles: nothing, or things and trees beside the road, another light, weathered
    ground and the camera's noise."""
    ground: ScenarioGround = field(default_factory=ScenarioGround)
    flight: ScenarioFlight = field(default_factory=ScenarioFlight)
    camera: ScenarioCamera = field(default_factory=ScenarioCamera)
    gnss: Gnss = field(default_factory=Gnss)
    attitude: ScenarioAttitude = field(default_factory=ScenarioAttitude)
    timing: ScenarioTiming = field(default_factory=ScenarioTiming)
    detector: ScenarioDetector = field(default_factory=ScenarioDetector)
    targets: Targets = field(default_factory=Targets)
    declared: ScenarioDeclared = field(default_factory=ScenarioDeclared)
    occlusions: tuple[Occlusion, ...] = ()
    blackouts: tuple[Blackout, ...] = ()
    faults: tuple[ScenarioFault, ...] = ()
    views: tuple[ScenarioView, ...] = ()
    """Further cameras; system ids of their aircraft count on from ``UAV_ID``."""

    def __post_init__(self) -> None:
        _check(self)

    def of_view(self, number: int) -> Scenario:
        """The flight as its camera of that number, from 2 on, has it."""
        view = self.views[number - 2]
        own = {name: getattr(view, name) for name in ScenarioView.__slots__ if name not in ("mast", "aside_m")}
        return replace(self, seed=(self.seed + _SEED_STEP * (number - 1)) % 2**63, views=(), **own)

    def filmed_by(self, cameras: int, masts: int = 0) -> Scenario:
        """The flight filmed by this many: each further one from another side, higher up, with a clock of its own.

        Args:
            cameras: all of them.
            masts: this many of the further ones, the last, are on masts.
        """
        further = [
            ScenarioView(
                flight=replace(
                    self.flight,
                    yaw_deg=self.flight.yaw_deg + 360.0 * k / cameras,
                    height_m=min(self.flight.height_m * (1.0 + 0.15 * k), 500.0),
                ),
                camera=self.camera,
                attitude=self.attitude,
                timing=replace(self.timing, video_offset_s=self.timing.video_offset_s + 0.2 * k),
                detector=self.detector,
                declared=self.declared,
            )
            for k in range(1, cameras)
        ]
        for k in range(len(further) - min(masts, len(further)), len(further)):
            further[k] = replace(
                further[k],
                mast=True,
                flight=replace(MAST_FLIGHT, yaw_deg=further[k].flight.yaw_deg),
                camera=replace(self.camera, mount="stabilized", roll_deg=0.0, pitch_deg=-20.0, yaw_deg=0.0),
                attitude=ScenarioAttitude(),
                declared=replace(self.declared, yaw_deg=4.0, pitch_deg=-1.5),
            )
        return replace(self, views=tuple(further))

    @property
    def fleet_size(self) -> int:
        """Number of reporting ground vehicles, filmed and outside."""
        return self.ground.vehicles + self.ground.outside

    @property
    def ugv_ids(self) -> tuple[int, ...]:
        """System ids of the ground vehicles in index order."""
        return tuple(range(FIRST_UGV_ID, FIRST_UGV_ID + self.fleet_size))

    @property
    def frame_count(self) -> int:
        """Frames of the whole flight."""
        return round(self.duration_s * self.fps)


def _check(scenario: Scenario) -> None:
    """Check relations between several numbers; limits of single ones are at their fields."""
    try:
        check_limits(scenario, "scenario")
    except ValueError as error:
        raise ScenarioError(str(error)) from None
    if scenario.fleet_size > MAX_REPORTING:
        together = f"vehicles and outside are {scenario.fleet_size} together"
        raise ScenarioError(f"scenario: [ground]: {together}; at most {MAX_REPORTING} can be")
    if len(scenario.views) >= MAX_VIEWS:
        raise ScenarioError(f"scenario: {len(scenario.views)} [[views]]; at most {MAX_VIEWS - 1} can be")
    timing = scenario.timing
    if timing.rate_min_hz > timing.rate_max_hz:
        raise ScenarioError(
            f"scenario: [timing]: rate_min_hz is {timing.rate_min_hz}; it must not be above rate_max_hz, "
            f"{timing.rate_max_hz:g}"
        )
    indexed = [("vehicle", occlusion.vehicle, "occlusion") for occlusion in scenario.occlusions]
    indexed += [("vehicle", fault.vehicle, "fault") for fault in scenario.faults]
    indexed += [("other", fault.other, "fault") for fault in scenario.faults]
    for key, vehicle, table in indexed:
        if not 0 <= vehicle < scenario.fleet_size:
            raise ScenarioError(
                f"scenario: {key} = {vehicle} of {table} does not exist; vehicles are 0 to {scenario.fleet_size - 1}"
            )
