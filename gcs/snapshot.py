"""One frozen record per frame: all that screens, overlays and logs may read.

Units and frames: ENU metres, radians, Unix microseconds; image quantities in pixels. NaN is an unknown number,
0 an unknown system id, ``inf`` an age of something never received.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from gcs.camera_aim import CameraAim
from gcs.limits import Limits
from mavlink.geodesy import LocalFrame
from mavlink.state import Level, VehicleStatus

NAN, NEVER = float("nan"), float("inf")
HELD_SHOWN_S = 0.5
"""Names older than this are shown with their age: streams of two frames a second and faster pass in this time."""
Standing = Literal[
    "confirmed",
    "tentative",
    "coasting",
    "unidentified",
    "out of view",
    "no position",
    "misplaced",
    "no new frame",
]
NAMED: Final[frozenset[Standing]] = frozenset({"confirmed", "tentative", "coasting"})
"""Standings of a vehicle that has a box in the picture."""
Reported = Literal["", "then", "now"]
"""Origin of something in a replay: only the flight reported it (``then``), or only the replay does (``now``); empty:
both, or no replay."""
OF_A_CAMERA: Final = frozenset({"camera", "identity", "video"})
"""Kinds of alarms and events that are about one camera, and not about the fleet that all of them see."""


def _nowhere() -> NDArray[np.float64]:
    return np.full(3, np.nan)


@dataclass(frozen=True, slots=True, kw_only=True)
class Statement:
    """Statement of the operator about a box."""

    track_id: int
    system_id: int
    """System id of the vehicle, 0 none of ours."""
    frame: int = -1
    """Frame from which on the statement counts, -1 not yet."""
    cx: float = NAN
    cy: float = NAN
    """Place of the box in that frame, px, NaN unknown: a replay that tracks otherwise finds it there."""
    undone: bool = False
    """True if the statement is withdrawn with this frame."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FleetChange:
    """Change by the operator of who is named: a vehicle taken in, left out, or called otherwise."""

    what: Literal["added", "left out", "renamed"]
    system_id: int
    name: str = ""
    """Name from then on; empty: as a vehicle without a name of its own."""
    t_us: int = 0
    """Time of the turn of the fold from which on it counts, Unix µs, 0 not yet."""
    frame: int = -1
    """The newest frame then, -1 none."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Event:
    """Event that an operator or an analyst may want to know of."""

    t_us: int
    level: Level
    kind: str
    """Kind in one word, for filters: ``link``, ``vehicle``, ``camera``, ``text``, ``identity``, ``video``,
    ``recording``, ``operator``, ``mark``, ``program``."""
    text: str
    """Plain text, possibly from the air: never markup; a vehicle's own words begin with its name and ``says:``."""
    system_id: int = 0
    alarm: str = ""
    """Key of the alarm that comes or is over with it, or that the operator acknowledges; empty: of none."""
    alarm_level: Level | Literal[""] = ""
    """The level of the alarm that comes or is over, empty where none does."""
    over: bool = False
    """True if that alarm is over."""
    reported: Reported = ""
    statement: Statement | None = None
    """Statement that the operator made or withdrew with it; a replay does so at the same frame."""
    change: FleetChange | None = None
    """Change that the operator made to the fleet with it; a replay does so at the same time."""

    @property
    def acknowledges(self) -> str:
        """Key of the alarm that the operator acknowledges with it, empty for none."""
        return "" if self.alarm_level else self.alarm

    @property
    def is_about_a_box(self) -> bool:
        """True of what the operator stated of a box, and of what became of that."""
        return self.kind == "operator" and not self.alarm and self.change is None

    def is_of(self, uav_id: int) -> bool:
        """Tell whether it is about the camera on an aircraft, or about that aircraft, and not about the whole fleet."""
        return self.kind in OF_A_CAMERA or self.is_about_a_box or (self.system_id == uav_id and self.change is None)


@dataclass(frozen=True, slots=True, kw_only=True)
class Alarm:
    """Trouble that lasts until it is over; it is reported once when it comes and once when it goes."""

    key: str
    """Key of what it is about: the same trouble of the same thing always has the same one."""
    level: Level
    kind: str
    """Kind, as an event's."""
    text: str
    """Text of what is wrong, and with what: plain text, possibly with names and reasons from the air."""
    advice: str
    """Advice on what to do."""
    since_us: int
    system_id: int = 0
    vehicles: tuple[int, ...] = ()
    """System ids of all that it is about, where it is not one vehicle's."""
    doubts_name: bool = False
    """True if nobody is to act on that vehicle's name meanwhile."""
    reported: Reported = ""
    acknowledged: bool = False
    """True if the operator had acknowledged it in flight, in a replay."""


@dataclass(frozen=True, slots=True, kw_only=True)
class VehicleRow(VehicleStatus):
    """One line of the fleet table: what a vehicle reports, and where it was found."""

    name: str
    role: Literal["uav", "ugv"]
    p_enu: NDArray[np.float64] = field(default_factory=_nowhere)
    """(3,) metres, NaN unknown."""
    heading: float = NAN
    """Clockwise from north, NaN unknown."""
    std_m: float = NAN
    in_view: bool | None = None
    """True if the reported position is in view; None when the camera's pose is unknown."""
    standing: Standing = "no position"
    standing_since_us: int = 0
    """Time since which it has this standing, Unix µs, 0 unknown."""
    expected_px: tuple[float, float] | None = None
    """Reported position in the image plane, px, also outside of the frame; None unknown or behind."""
    track_id: int = 0
    """Track that carries this identity, 0 none."""
    confidence: float = NAN
    """Probability of that identity, NaN without one."""
    elsewhere: tuple[str, ...] = ()
    """Aircraft in whose pictures it is named too, where a flight has several cameras."""
    stated: bool = False
    """The identity is what the operator stated."""
    fence: str = ""
    """The fence nearest to be broken of those that hold for it, or broken most; empty without one."""
    fence_m: float = NAN
    """Distance to that fence on its right side, negative beyond, NaN unknown."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Candidate:
    """A vehicle that a box may be."""

    system_id: int
    confidence: float
    """Probability that the box is this vehicle, 0..1."""
    distance_m: float = NAN
    """Distance from the box to where the vehicle reports to be, m; NaN where it has not lately."""
    against: str = ""
    """Reason against it, in words; empty: nothing."""
    missing: str = ""
    """Reason why its reports do not tell where it is, in words; empty: they do."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Box:
    """One tracked vehicle in the frame."""

    track_id: int
    """0 for a detection that no track took; with a name it is another part of the vehicle that has this name."""
    number: int = 0
    """Number of what it is in all pictures of a flight with several cameras; 0 of one camera, or without a track."""
    cx: float
    cy: float
    w: float
    h: float
    angle: float
    heading: float
    score: float
    coasting: bool = False
    """Predicted, not seen in this frame."""
    in_turn: bool = False
    """Predicted since its turn to be looked at has not come, and not because it was missed."""
    system_id: int = 0
    """System id, 0 unknown."""
    confidence: float = NAN
    """Probability of the name; of "none of ours" when unnamed; NaN before any evidence."""
    runner_up: int = 0
    runner_up_confidence: float = NAN
    candidates: tuple[Candidate, ...] = ()
    """The most likely vehicles, the best first, at most three."""
    since_us: int = 0
    """Time since which it has had this name, or none, Unix µs; 0 unknown."""
    stated: bool = False
    """The name, or that it is none of ours, is what the operator stated."""
    none_of_ours: float = NAN
    """Probability that it is no vehicle of the mission, NaN before any evidence."""
    doubt: str = ""
    """Reason why the answer is less sure than its evidence, in words; empty: it is not."""
    residual_m: float = NAN
    residual_px: float = NAN
    position_age_s: float = NAN
    projection: float = NAN
    topology: float = NAN
    fused: float = NAN
    p_enu: NDArray[np.float64] = field(default_factory=_nowhere)
    """(3,) where the box is on the ground, NaN when the camera's pose is unknown."""
    place_std_m: float = NAN
    """1σ per level axis of that place by the camera's reported pose alone, NaN unknown."""
    lat_deg: float = NAN
    lon_deg: float = NAN

    @property
    def known_as(self) -> int:
        """Number of what has no name: the same in all pictures, of one camera its track's."""
        return self.number or self.track_id

    @property
    def margin(self) -> float:
        """Confidence ahead of the runner-up."""
        return self.confidence - self.runner_up_confidence


@dataclass(frozen=True, slots=True, kw_only=True)
class LinkHealth:
    """Counters of one telemetry link."""

    name: str
    packets: int
    bad: int
    """Damaged frames."""
    dropped: int
    """Datagrams the kernel dropped before we could read them."""
    silent_s: float
    junk_bytes: int = 0
    """Stray bytes that are no MAVLink."""
    packets_per_s: float = NAN
    """Lately, NaN unknown."""
    junk_per_s: float = NAN
    """Stray bytes a second lately, NaN unknown."""
    index: int = -1
    """Index of the link in the flight, −1 unknown."""
    flooded: bool = False
    """True if a sender is rate-limited."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Health:
    """State of the program itself."""

    fps: float = 0.0
    lag_s: float = 0.0
    """Delay of the frame on screen behind the newest one."""
    behind_s: float = 0.0
    """Delay of the telemetry that was taken in: a computer that cannot keep up. Ages are given without it."""
    frames: int = 0
    looked_share: float = 1.0
    """Share of the last frame in which it was looked for vehicles, less than 1 where it is gone through in turns."""
    skipped_frames: int = 0
    video: str = "none"
    """``waiting`` for the first frame, ``ok``, ``stalled``, ``ended``, ``none``."""
    video_sender: str = ""
    """Address that the video's datagrams come from, empty where it is not datagrams."""
    video_rival: str = ""
    """Address of another that sends video to the same port, empty without one."""
    links: tuple[LinkHealth, ...] = ()
    recording_since_us: int = 0
    """Start of the flight's recording, Unix µs; 0 without one."""
    free_bytes: int = 0
    time_offset_s: float = 0.0
    """Video time minus telemetry time, declared and estimated."""
    time_offset_std_s: float = NAN
    yaw_offset: float = NAN
    """Estimated error of the camera's reported heading, radians clockwise, and its 1σ; NaN unknown."""
    yaw_offset_std: float = NAN
    pitch_offset: float = NAN
    """Estimated error of its pitch, radians upward, and its 1σ, NaN unknown."""
    pitch_offset_std: float = NAN
    mirrored: bool = False
    """True if left and right of the picture were found to be exchanged."""
    fit: float = NAN
    """Probability that video and telemetry belong together, NaN while nothing was compared."""
    views_differ: str = ""
    """Vehicle that another camera names differently, and which is likelier wrong; empty: nothing."""
    undecoded: int = 0
    """Frames that came and could not be decoded."""
    keys: int | None = None
    """Signing keys in use, 0 when nothing received can be authenticated; None without a receiver."""
    full_in_s: float = NEVER
    """Time until the disk is full if recording goes on as lately, s; inf unknown."""
    write_failing_s: float = 0.0
    """Time for which the recording could not be written, s; 0 while it can."""
    write_reason: str = ""
    """Why, in the system's words."""
    write_stalled_s: float = 0.0
    """Time for which the disk has not answered, s; 0 while it does."""
    write_lost: int = 0
    """Packets that were given up because too many waited."""
    ingest_restarts: int = 0
    """Times that the process which receives packets had to be started again."""
    ring_dropped: int = 0
    """Packets recorded but not shown because the fold did not take them in time."""
    faults: int = 0
    """Turns of this program's own jobs that failed."""
    fault: str = ""
    """The last of them in words."""
    clock_step_s: float = 0.0
    """Sum of the steps by which the wall clock was set since the flight began."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Snapshot:
    """The fleet, the boxes, the identities and the health at one frame."""

    t_us: int
    frame: int
    """Index in the video, -1 before the first frame."""
    frame_us: int = 0
    """Time of its exposure, 0 before the first; earlier than ``t_us`` while no new one comes."""
    seen_us: int = 0
    """Time of the frame that the boxes were found in, 0 before the first."""
    clock_us: int = 0
    """Time on clocks: the latest ``t_us`` so far, since the next frame may have been taken earlier; 0: ``t_us``."""
    analysed: bool = True
    """False: a place of a recording that the analysis has not reached, or before the flight; there are no vehicles and
    no boxes."""
    begins_us: int = 0
    """Time at which the flight begins, at a place of its recording before that; 0 elsewhere."""
    provisional: bool = False
    """Worked out from the last seconds of a recording alone, until the analysis from the start reaches this place."""
    width: int
    height: int
    image: NDArray[np.uint8] | None
    """(height, width, 3) BGR, None when there is no image."""
    vehicles: tuple[VehicleRow, ...]
    """UAV first; where a flight shows several cameras the aircraft of the others next."""
    names: Mapping[int, str] = field(default_factory=dict)
    """Names of the mission's vehicles by system id, where there are no rows of them."""
    boxes: tuple[Box, ...]
    footprint_enu: NDArray[np.float64] | None
    """(4, 2) corners of the image on the ground, image order from top left clockwise."""
    footprints_elsewhere: tuple[NDArray[np.float64], ...] = ()
    """Footprints of the flight's other cameras."""
    uav_enu: NDArray[np.float64]
    """(3,), NaN unknown."""
    uav_heading: float
    health: Health
    camera: CameraAim | None = None
    """None while neither the UAV's place nor its attitude tells where it looked."""
    pose: Literal["known", "no attitude", "unknown"] = "unknown"
    """Knowledge of where the camera was and how it looked."""
    events: tuple[Event, ...] = field(default=())
    """Events that are new since the snapshot before."""
    origin: LocalFrame | None = None
    """Origin of the ENU metres here, None while no place is known; it moves when the UAV turns out to be elsewhere."""
    conflicts: frozenset[int] = frozenset()
    """System ids whose reports contradict the video."""
    alarms: tuple[Alarm, ...] = ()
    """Alarms that are on now, the worst and newest first."""
    limits: Limits = field(default_factory=Limits)
    """Limits of the mission's alarms."""
    fence_enu: tuple[NDArray[np.float64], ...] = ()
    """Outline (n, 2) of each fence of the mission; the last corner is joined to the first."""

    @property
    def doubted(self) -> frozenset[int]:
        """System ids of vehicles on whose names nobody is to act."""
        return doubted_by(self.alarms)

    @property
    def boxes_age_s(self) -> float:
        """Age of the frame of the boxes, inf before the first."""
        return max(0, self.t_us - self.seen_us) * 1e-6 if self.seen_us else NEVER

    @property
    def frame_age_s(self) -> float:
        """Age of the frame, 0 before the first."""
        return max(0, self.t_us - self.frame_us) * 1e-6 if self.frame_us else 0.0

    @property
    def held(self) -> bool:
        """True if the boxes are those of an earlier frame, for want of a new one."""
        return self.seen_us not in (0, self.t_us)

    @property
    def new_boxes(self) -> tuple[Box, ...]:
        """Boxes that were found at this very moment: what a log or a count takes, each once."""
        return () if self.held else self.boxes

    @property
    def held_s(self) -> float:
        """Age of boxes and names, s; 0 while that is no more than ``HELD_SHOWN_S``, or there are none."""
        return self.boxes_age_s if self.held and self.boxes and self.boxes_age_s > HELD_SHOWN_S else 0.0

    @property
    def now_us(self) -> int:
        """The time to show; it does not go back from one snapshot to the next, unless the clock was set."""
        return self.clock_us or self.t_us

    def name_of(self, system_id: int) -> str:
        """The vehicle's name; ``UGV-<id>`` for an id that is not in the table, ``unknown`` for 0."""
        for row in self.vehicles:
            if row.system_id == system_id:
                return row.name
        return self.names.get(system_id) or (f"UGV-{system_id}" if system_id else "unknown")


def doubted_by(alarms: Iterable[Alarm]) -> frozenset[int]:
    """System ids of vehicles on whose names nobody is to act by these alarms."""
    return frozenset(alarm.system_id for alarm in alarms if alarm.doubts_name)
