"""Alarms of the station itself: its receiving, video, clock, recording and program."""

from __future__ import annotations

import math
from collections.abc import Sequence

from gcs.health.alarm_rule import AlarmRule
from gcs.health.heard import is_heard, refused_because
from gcs.snapshot import Health, Snapshot, VehicleRow
from vision.stream.pace import STALL_S

UNHEARD_S = 15.0
"""Vehicles are switched on one after the other."""
BEHIND_S = 2.0
"""Telemetry is processed five times a second and more; a moment's hold-up changes nothing that is shown."""
STAYS_AWAY_S = 1.0
"""Time within which what is back asks for nothing: under load frames and telemetry are a second late now and then."""
LATE_S = 1.0
"""A vehicle at 5 m/s is five metres from where an older frame shows it."""
LATE_FOR_S = 3.0
"""A hold-up of the video that is over by then needs no action."""
FIRST_FRAME_S = 15.0
"""A camera that was just switched on shows its first picture in this time."""
CONTEST_S = 1.0
"""A camera that moves to another port sends from both for a moment."""
CLOCK_OFFSET_S = 0.1
"""A vehicle at 5 m/s is half a metre elsewhere after a tenth of a second; also the 1σ up to which it is known."""
CLOCK_OFFSET_FOR_S = 5.0
"""The estimate is not settled before."""
TURNED_DEG, TILTED_DEG = 45.0, 8.0
"""Errors of heading and pitch that no compass or gimbal makes: the mission says something else of the camera."""
TURNED_STD_DEG, TURNED_FOR_S = 4.0, 5.0
"""1σ up to which such an error is known, and how long it must be found: an estimate may leap while little is seen."""
FIT, NO_FIT, NO_FIT_FOR_S = 0.9, 0.0025, 2.0
"""Probability above which video and telemetry belong together, and the one below which they do not; the time covers a
camera hidden for a moment. With no evidence it is 0.05."""
NOT_KNOWN, NOT_KNOWN_FOR_S = 0.5, 10.0
"""Probability below which nothing is named, and the time for which that need not be said: who drives is known within 5
s."""
DIFFER_FOR_S = 2.0
"""A name that one of two cameras corrects is no contradiction."""
FEW_FPS = 1.0
"""Vehicles cannot be followed from one frame to the next where fewer are looked at in a second."""
CLOCK_STEP = "clock step"
"""The alarm that this computer's clock was set."""
STEP_S = 0.5
"""A time service slews what is less."""
STALLED_S = 1.0
"""A disk that has not answered for this long hangs: a busy one answers within some tenths."""
LOW_BYTES, LOW_S = 2_000_000_000, 600.0
"""Half an hour of video at 8 Mbit/s; ten minutes are enough to make room, or to land."""
FULL_BYTES, FULL_S = 200_000_000, 120.0
"""A tenth of it; two minutes are enough to end what is being done."""
MAX_NAMES = 4
"""Most names in one line of text."""


def first_of(names: Sequence[str]) -> str:
    """``a, b, c, d and 16 more``."""
    more = f" and {len(names) - MAX_NAMES} more" if len(names) > MAX_NAMES else ""
    return ", ".join(names[:MAX_NAMES]) + more


def _never_received(now: Snapshot) -> list[VehicleRow]:
    """Vehicles never received; one that is received and rejected has an alarm for that."""
    return [row for row in now.vehicles if not (is_heard(row) or refused_because(row))]


def _some_never_received(health: Health, now: Snapshot) -> bool:
    # at the start of a flight it is all of them
    return 0 < len(_never_received(now)) < len(now.vehicles)


def _video_clock_off(health: Health, now: Snapshot) -> bool:
    std_s = health.time_offset_std_s
    return std_s < CLOCK_OFFSET_S and abs(health.time_offset_s) > CLOCK_OFFSET_S + std_s


def _video_clock(health: Health, now: Snapshot) -> str:
    return f"it is {abs(health.time_offset_s):.1f} s {'late' if health.time_offset_s > 0.0 else 'early'}"


def _camera_off(health: Health, error: float, std: float, limit_deg: float) -> bool:
    return health.fit > FIT and math.degrees(std) < TURNED_STD_DEG and abs(math.degrees(error)) > limit_deg


def _unsure(health: Health, std: float) -> bool:
    """Tell whether it is not known whether the camera still has that error."""
    return not (health.fit > FIT and math.degrees(std) < TURNED_STD_DEG)


def _unmatched(health: Health) -> bool:
    return health.fit < NO_FIT and not 0.0 < health.fps < FEW_FPS


def _off(error: float, more: str, less: str) -> str:
    return f"{abs(math.degrees(error)):.0f}° {more if error > 0.0 else less}"


def _turned(health: Health, now: Snapshot) -> bool:
    # without a reported attitude every heading is the mission's
    return now.pose == "known" and _camera_off(health, health.yaw_offset, health.yaw_offset_std, TURNED_DEG)


def _tilted(health: Health, now: Snapshot) -> bool:
    return now.pose == "known" and _camera_off(health, health.pitch_offset, health.pitch_offset_std, TILTED_DEG)


def _records(health: Health) -> bool:
    """False: a replay, which records nothing."""
    return health.keys is not None or bool(health.links)


def _almost_full(health: Health, now: Snapshot) -> bool:
    return _records(health) and (health.free_bytes < FULL_BYTES or health.full_in_s < FULL_S)


def _low(health: Health, now: Snapshot) -> bool:
    low = health.free_bytes < LOW_BYTES or health.full_in_s < LOW_S
    return _records(health) and low and not _almost_full(health, now)


def _space(health: Health, now: Snapshot) -> str:
    left = f", {health.full_in_s / 60:.1f} min at this rate" if math.isfinite(health.full_in_s) else ""
    return f"{health.free_bytes / 1e6:,.0f} MB free{left}"


STATION_RULES: tuple[AlarmRule[Health], ...] = (
    AlarmRule(
        key="unheard",
        level="warning",
        kind="vehicle",
        text="never heard",
        meaning=f"in the mission, and not on the air {UNHEARD_S:g} s after others are",
        advice="switch them on, check their system ids and keys against the mission, or take them out of it",
        condition=_some_never_received,
        detail=lambda _, now: first_of([row.name for row in _never_received(now)]),
        vehicles=lambda _, now: [row.system_id for row in _never_received(now)],
        lasts_s=UNHEARD_S,
    ),
    AlarmRule(
        key="no keys",
        level="warning",
        kind="link",
        text="nothing is authenticated: anybody can pose as a vehicle",
        meaning="no key is set",
        advice="make keys with gcs keys and give them to the autopilots, or fly where no one else can transmit",
        condition=lambda health, _: health.keys == 0,
    ),
    AlarmRule(
        key="ingest",
        level="alarm",
        kind="link",
        text="the receiving process had to be started again",
        meaning="it died or hung, and another took over in its place",
        advice="packets of that moment may be missing; note the time and keep the session for a report",
        counter=lambda health, _: health.ingest_restarts,
    ),
    AlarmRule(
        key="ring",
        level="warning",
        kind="link",
        text="packets are recorded but not shown: the program is too slow",
        meaning="packets waited too long to be processed; the recording is whole",
        advice="free the processor: close other programs, or use a smaller detector",
        counter=lambda health, _: health.ring_dropped,
    ),
    AlarmRule(
        key="overload",
        level="alarm",
        kind="program",
        text="this computer cannot keep up: telemetry is processed late",
        on_and_off="this computer cannot keep up now and then",
        meaning=f"what was received and recorded is processed {BEHIND_S:g} s late or more, for {STAYS_AWAY_S:g} s; "
        "ages are given for then, so that no vehicle counts as silent for it",
        advice="what is shown is as old; free the processor: close other programs, or use a smaller detector",
        condition=lambda health, _: health.behind_s > BEHIND_S,
        lasts_s=STAYS_AWAY_S,
    ),
    AlarmRule(
        key="fault",
        level="warning",
        kind="program",
        text="an error in this program was passed over",
        meaning="one packet or frame could not be processed: the error is given",
        advice="fly on: names may be missing for that moment, the recording is whole; send in the session's faults.txt",
        counter=lambda health, _: health.faults,
        detail=lambda health, _: health.fault,
    ),
    AlarmRule(
        key="no video",
        level="alarm",
        kind="video",
        text="no video comes",
        meaning=f"no picture came in the first {FIRST_FRAME_S:g} s: what is wrong an event says where it is known",
        advice="check the camera, its link and its address; nothing is named before",
        condition=lambda health, _: health.video == "waiting",
        lasts_s=FIRST_FRAME_S,
    ),
    AlarmRule(
        key="video",
        level="alarm",
        kind="video",
        text="the video has stopped",
        meaning=f"no frame for {STALL_S + STAYS_AWAY_S:g} s, or {STAYS_AWAY_S:g} s longer than 2.5 intervals of a slow "
        "stream: names are taken off then; it is opened again automatically",
        on_and_off="the video comes and goes",
        advice="check the camera and its link; no name is renewed while no frame comes",
        condition=lambda health, _: health.video == "stalled",
        lasts_s=STAYS_AWAY_S,
    ),
    AlarmRule(
        key="video contest",
        level="alarm",
        kind="video",
        text="two senders contest the video's port",
        meaning=f"for {CONTEST_S:g} s another sender's video has come there too: whose is shown and recorded is given, "
        "and whose is not. The first to show a picture is listened to, and has its place back after a pause",
        advice="compare the picture with what the camera sees; V takes the other one. Write the camera's own address "
        "into the mission, as udp://192.168.1.10:5600: no other is listened to then",
        condition=lambda health, _: bool(health.video_rival),
        detail=lambda health, _: f"{health.video_sender} is shown, {health.video_rival} is not",
        lasts_s=CONTEST_S,
    ),
    AlarmRule(
        key="undecoded",
        level="warning",
        kind="video",
        text="video frames cannot be decoded",
        meaning="the video link loses data",
        advice="lower its bit rate, or come closer",
        counter=lambda health, _: health.undecoded,
    ),
    AlarmRule(
        key="lag",
        level="warning",
        kind="video",
        text=f"the video is more than {LATE_S:g} s late",
        meaning=f"the detector cannot keep up, for {LATE_FOR_S:g} s",
        advice="free the processor, or use a smaller detector or a smaller stream",
        condition=lambda health, _: health.video == "ok" and health.lag_s > LATE_S,
        lasts_s=LATE_FOR_S,
    ),
    AlarmRule(
        key="video clock",
        level="warning",
        kind="video",
        text="the video's clock differs from the telemetry's",
        meaning=f"frames are dated {CLOCK_OFFSET_S:g} s or more after they were taken, or before, for "
        f"{CLOCK_OFFSET_FOR_S:g} s: the estimate is given",
        advice="it is corrected in flight; measure it and put it into the mission as video_offset_s",
        condition=_video_clock_off,
        detail=_video_clock,
        kept_while=lambda health, _: not health.time_offset_std_s < CLOCK_OFFSET_S,
        lasts_s=CLOCK_OFFSET_FOR_S,
    ),
    AlarmRule(
        key="camera heading",
        level="warning",
        kind="video",
        text="the camera's heading is not the mission's",
        meaning=f"the vehicles are where they report to be if the camera is turned by {TURNED_DEG:g}° or more, for "
        f"{TURNED_FOR_S:g} s: by how much is given",
        advice="it is corrected in flight; add it to the mission's yaw_deg if clockwise, else subtract it; with a "
        "gimbal roll_deg",
        condition=_turned,
        kept_while=lambda health, _: _unsure(health, health.yaw_offset_std),
        detail=lambda health, _: _off(health.yaw_offset, "clockwise", "counterclockwise"),
        lasts_s=TURNED_FOR_S,
    ),
    AlarmRule(
        key="camera pitch",
        level="warning",
        kind="video",
        text="the camera's pitch is not the mission's",
        meaning=f"the vehicles are where they report to be if the camera is tilted by {TILTED_DEG:g}° or more, for "
        f"{TURNED_FOR_S:g} s: by how much is given",
        advice="it is corrected in flight; add it to the mission's pitch_deg if above, else subtract it",
        condition=_tilted,
        kept_while=lambda health, _: _unsure(health, health.pitch_offset_std),
        detail=lambda health, _: _off(health.pitch_offset, "above it", "below it"),
        lasts_s=TURNED_FOR_S,
    ),
    AlarmRule(
        key="camera mirrored",
        level="warning",
        kind="video",
        text="the picture is mirrored: left and right are exchanged",
        meaning="the vehicles are where they report to be in the mirror image alone",
        advice="it is corrected for the names; switch off mirroring or flipping in the camera or its link: the mission "
        "cannot state it",
        condition=lambda health, _: health.mirrored,
        kept_while=lambda health, _: math.isnan(health.fit),
    ),
    AlarmRule(
        key="no match",
        level="alarm",
        kind="video",
        text="video and telemetry do not match: clock, camera, place or recording",
        on_and_off="video and telemetry match now and then only",
        meaning=f"for {NO_FIT_FOR_S:g} s no more boxes are where vehicles report to be than chance would put there; "
        f"until they are, nothing is named; not told below {FEW_FPS:g} frame/s looked at, which follow nobody",
        advice="check that the recording is of this flight, then the mission's video_offset_s, mount, pitch_deg, "
        "yaw_deg and focal length, and the UAV's heading and height",
        condition=lambda health, _: _unmatched(health),
        kept_while=lambda health, _: math.isnan(health.fit),
        lasts_s=NO_FIT_FOR_S,
    ),
    AlarmRule(
        key="match not known",
        level="warning",
        kind="video",
        text="it is not known yet whether video and telemetry match: nothing is named",
        meaning=f"for {NOT_KNOWN_FOR_S:g} s boxes are not clearly more often where vehicles report to be than chance "
        "would put them there",
        advice="wait until vehicles turn or brake, or more of them are in view; if it stays, check what is to be "
        "checked when video and telemetry do not match",
        condition=lambda health, _: NO_FIT <= health.fit < NOT_KNOWN,
        kept_while=lambda health, _: math.isnan(health.fit),
        lasts_s=NOT_KNOWN_FOR_S,
    ),
    AlarmRule(
        key="views differ",
        level="alarm",
        kind="camera",
        text="another camera names a vehicle differently",
        meaning=f"for {DIFFER_FOR_S:g} s one box of two cameras has another sure name in each; neither is shown as "
        "sure meanwhile. A clock, a camera's place, a turn or a scale that would explain it is said where the data "
        "tell",
        advice="act on neither name; look at clock, heading and mount of the camera that is likelier wrong, and at the "
        "vehicle's position",
        condition=lambda health, _: bool(health.views_differ),
        detail=lambda health, _: health.views_differ,
        lasts_s=DIFFER_FOR_S,
    ),
    AlarmRule(
        key=CLOCK_STEP,
        level="warning",
        kind="recording",
        text="this computer's clock was set during the flight",
        meaning=f"by hand or by a time service, by {STEP_S:g} s or more",
        advice="times in the session come from its own record of the clock; leave the clock alone in flight",
        condition=lambda health, _: abs(health.clock_step_s) > STEP_S,
    ),
    AlarmRule(
        key="disk",
        level="alarm",
        kind="recording",
        text="the recording cannot be written",
        meaning="the disk is full, failing or gone: the reason is given",
        advice="packets wait in memory for a minute at least: free space or bring the disk back, it goes on by itself",
        condition=lambda health, _: _records(health) and health.write_failing_s > 0,
        detail=lambda health, _: health.write_reason,
        logged_by="gcs.session.recorder",
    ),
    AlarmRule(
        key="disk hangs",
        level="alarm",
        kind="recording",
        text="the disk does not answer: what comes is kept in memory",
        on_and_off="the disk answers now and then only",
        meaning=f"no answer for {STALLED_S:g} s (network disk, failing drive, frozen file system); what waits in "
        "memory is there also when a process dies meanwhile",
        advice="packets wait in memory for a minute at least, video is not recorded: bring the disk back",
        condition=lambda health, _: _records(health) and health.write_stalled_s > STALLED_S,
    ),
    AlarmRule(
        key="lost",
        level="alarm",
        kind="recording",
        text="telemetry could not be recorded and is lost",
        meaning="it waited longer than memory lasts",
        advice="land; what was flown since is in no file",
        counter=lambda health, _: health.write_lost,
        logged_by="gcs.session.recorder",
    ),
    AlarmRule(
        key="disk space",
        level="warning",
        kind="recording",
        text="the disk will be full soon",
        meaning=f"less than {LOW_BYTES / 1e9:g} GB free, or {LOW_S / 60:g} min at this rate",
        advice="free space; nothing that was recorded is ever deleted by this program",
        condition=_low,
        detail=_space,
    ),
    AlarmRule(
        key="disk space",
        level="alarm",
        kind="recording",
        text="the disk is almost full",
        meaning=f"less than {FULL_BYTES / 1e6:g} MB free, or {FULL_S / 60:g} min at this rate",
        advice="free space; nothing that was recorded is ever deleted by this program",
        condition=_almost_full,
        detail=_space,
    ),
)
