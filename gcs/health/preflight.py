"""Checks of what a flight needs, gone through while its vehicles are heard: each is well, or what to do. Pure."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal

from gcs.health.heard import is_heard, refused_because
from gcs.snapshot import Alarm, Health, Snapshot, VehicleRow
from mavlink.transmit.message_rates import Rate

_OF_A_CAMERA = frozenset({"video", "video delay", "camera"})
"""Names of the checks that each camera has its own of."""
CAMERA_ADVICE = (
    "have the UAV report it (CAMERA_FOV_STATUS or CAMERA_INFORMATION), or describe it as [camera] of the mission; "
    "else it is found once three vehicles have driven in view for some 5 s"
)
VIDEO_ADVICE = "check the address (-v), the camera and its link; H.264, H.265 and MJPEG can be decoded"
SILENT_ADVICE = (
    "switch it on, and have it send here with this system id (ArduPilot SYSID_THISMAV, from 4.7 on MAV_SYSID; PX4 "
    "MAV_SYS_ID)"
)
POSITION_ADVICE = (
    "wait for its fix; have it send GLOBAL_POSITION_INT (ArduPilot: SRx_POSITION, from 4.7 on MAVx_POSITION, of that "
    "port; PX4: mavlink stream -s GLOBAL_POSITION_INT -r 5 on its console)"
)
DELAY_KNOWN_S = 0.1
"""1σ up to which the video's delay is known: a vehicle at 5 m/s is half a metre elsewhere after it."""


Verdict = Literal["ok", "short", "bad"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Check:
    """One thing that was looked at before a flight, what was found, and what to do about it."""

    name: str
    verdict: Verdict
    """``short``: a flight is possible and suffers; ``bad``: something will not work."""
    found: str
    advice: str = ""


def preflight(now: Snapshot, rates: Sequence[Rate]) -> tuple[Check, ...]:
    """Go through what the flight needs: every vehicle, the video, the camera, what the station has.

    An alarm is listed with its own words and advice.
    """
    health = now.health
    station = [_of_alarm("station", alarm) for alarm in now.alarms if not _is_of_a_vehicle(alarm, now)]
    return tuple(
        [
            *(check for row in now.vehicles for check in _vehicle(row, now, rates)),
            _video(now),
            *([_delay(health)] if health.video == "ok" else ()),
            *([_camera(now)] if health.video != "none" else ()),
            _disk(health),
            *station,
        ]
    )


def of_its_camera(checks: Iterable[Check], name: str) -> list[Check]:
    """The checks that are about a camera and not about the fleet, with the camera's name."""
    return [replace(check, name=f"{name}: {check.name}") for check in checks if check.name in _OF_A_CAMERA]


def _is_of_a_vehicle(alarm: Alarm, now: Snapshot) -> bool:
    # who is never heard has a check of its own
    return alarm.key == "unheard" or any(alarm.system_id == row.system_id for row in now.vehicles)


def _of_alarm(name: str, alarm: Alarm) -> Check:
    verdict: Verdict = "bad" if alarm.level == "alarm" else "short"
    return Check(name=name, verdict=verdict, found=alarm.text, advice=alarm.advice)


def _vehicle(row: VehicleRow, now: Snapshot, rates: Sequence[Rate]) -> Iterator[Check]:
    """All that is wrong with a vehicle, else one line on how well it is."""
    name = row.name
    if not is_heard(row):
        if why := refused_because(row):
            advice = "gcs keys check tells which key is missing or another one"
            yield Check(name=name, verdict="bad", found=f"refused: {why}", advice=advice)
        else:
            yield Check(name=name, verdict="bad", found=f"system id {row.system_id} is not heard", advice=SILENT_ADVICE)
        return
    wrong = [_of_alarm(name, alarm) for alarm in now.alarms if alarm.system_id == row.system_id]
    if row.position_state == "never":
        why = f"no position yet{f': {row.refused_for}' if row.refused_for else ''}"
        wrong.insert(0, Check(name=name, verdict="bad", found=why, advice=POSITION_ADVICE))
    mine = [rate for rate in rates if rate.system_id == row.system_id]
    wrong += [
        Check(name=name, verdict="short", found=rate.words.partition(":")[0], advice=rate.hint)
        for rate in mine
        if rate.hint
    ]
    if wrong:
        yield from wrong
        return
    positions = max((rate.measured_hz for rate in mine if rate.message == "GLOBAL_POSITION_INT"), default=math.nan)
    parts = [
        f"position {positions:.1f}/s" if positions > 0.0 else "stands" if row.kind == "mast" else "heard",
        f"fix {row.fix}" if row.fix else "",
        "signed" if row.signs else "unsigned" if now.health.keys == 0 else "",
    ]
    yield Check(name=name, verdict="ok", found=", ".join(filter(None, parts)))


def _video(now: Snapshot) -> Check:
    state = now.health.video
    if state == "none":
        return Check(name="video", verdict="short", found="none: nobody is named", advice="give its address with -v")
    if state != "ok":
        return Check(name="video", verdict="bad", found=f"{state}: no picture comes", advice=VIDEO_ADVICE)
    looked = f"{now.health.fps:.1f} frames/s looked at" if now.health.fps else "decoded"
    return Check(name="video", verdict="ok", found=f"{now.width}×{now.height}, {looked}, lag {now.health.lag_s:.1f} s")


def _delay(health: Health) -> Check:
    if health.time_offset_std_s < DELAY_KNOWN_S:
        found = f"{health.time_offset_s:.2f} s ± {health.time_offset_std_s:.2f}, taken out"
    else:
        found = "not known yet: it is found once vehicles drive in view"
    return Check(name="video delay", verdict="ok", found=found)


def _camera(now: Snapshot) -> Check:
    if now.vehicles[0].position_state not in ("ok", "stale"):
        found, advice = "where it is is not known: the UAV has no position", "see the UAV above"
        return Check(name="camera", verdict="bad", found=found, advice=advice)
    if now.pose == "known":
        return Check(name="camera", verdict="ok", found="field of view and direction are known")
    if now.pose == "no attitude":
        advice = "have the UAV send ATTITUDE (ArduPilot: SRx_EXTRA1, from 4.7 on MAVx_EXTRA1)"
        return Check(name="camera", verdict="short", found="the UAV's attitude does not come", advice=advice)
    return Check(name="camera", verdict="short", found="its field of view is not known", advice=CAMERA_ADVICE)


def _disk(health: Health) -> Check:
    left = f", {health.full_in_s / 3600:.1f} h at this rate" if math.isfinite(health.full_in_s) else ""
    return Check(name="disk", verdict="ok", found=f"{health.free_bytes / 1e9:.1f} GB free{left}")
