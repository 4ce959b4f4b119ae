"""MAVLink commands as values: what each order is on the wire. Pure.

Definitions: https://mavlink.io/en/messages/common.html#mav_commands. Places travel as COMMAND_INT, the rest as
COMMAND_LONG. Heights are above sea level (MAV_FRAME_GLOBAL), which ArduPilot and PX4 understand alike.
"""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from typing import NamedTuple

from pymavlink.dialects.v20 import ardupilotmega

NAN = math.nan
AUTOPILOT = 1
"""Component id of an autopilot, which cameras and gimbals without one of their own use."""
_FRAME_GLOBAL = 0
_ROI_LOCATION, _ROI_NONE, _ROI_SYSTEM = 195, 197, 198
_PITCHYAW, _CONFIGURE, _MOUNT_CONTROL = 1000, 1001, 205
_REPOSITION, _ORBIT, _RETURN, _SET_MODE = 192, 34, 20, 176
_PHOTO, _RECORD, _RECORD_STOP = 2000, 2500, 2501
_CHANGE_MODE = 1
_FLAG_NEUTRAL, _MOUNT_NEUTRAL = 2, 1
_FLAGS_FROM_NORTH, _MOUNT_TARGETING = 4 | 8 | 16, 2  # roll, pitch and yaw lock
_GIVE_UP, _UNCHANGED = -3, -1
_ARMED_CUSTOM = 1
_ARDUPILOT, _PX4 = 3, 12
_ARDUPILOT_HOLD = {"copter": 17, "helicopter": 17, "plane": 12, "vtol": 12}  # BRAKE, LOITER


class GeoPoint(NamedTuple):
    """A place on the ground."""

    lat_deg: float
    lon_deg: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Command:
    """One COMMAND_LONG, or COMMAND_INT when it has a place; NaN is a parameter left to the vehicle."""

    number: int
    """MAV_CMD."""
    params: tuple[float, ...] = ()
    """Parameters from the first on; those left out are 0."""
    place: GeoPoint | None = None
    alt_m: float = NAN
    component: int = AUTOPILOT

    @property
    def name(self) -> str:
        """Name in MAVLink, without the prefix."""
        entry = ardupilotmega.enums["MAV_CMD"].get(self.number)
        return str(entry.name).removeprefix("MAV_CMD_") if entry is not None else str(self.number)

    @property
    def message(self) -> str:
        """Name of the message that carries it."""
        return "COMMAND_LONG" if self.place is None else "COMMAND_INT"

    def fields(self, system_id: int) -> str:
        """The message's fields as JSON, where null is NaN."""
        values: dict[str, float | int] = {
            "target_system": system_id,
            "target_component": self.component,
            "command": self.number,
        }
        count = 7 if self.place is None else 4
        params = (*self.params, *[0.0] * count)[:count]
        values |= {f"param{i + 1}": value for i, value in enumerate(params)}
        if self.place is None:
            values["confirmation"] = 0
        else:
            lat, lon = round(self.place.lat_deg * 1e7), round(self.place.lon_deg * 1e7)
            values |= {"frame": _FRAME_GLOBAL, "current": 0, "autocontinue": 0, "x": lat, "y": lon, "z": self.alt_m}
        return json.dumps({key: None if math.isnan(value) else value for key, value in values.items()})


def point_at_system(system_id: int) -> Command:
    """Let the autopilot point its gimbal at another vehicle, by the positions that it receives itself."""
    return Command(number=_ROI_SYSTEM, params=(system_id,))


def point_at_place(place: GeoPoint, ground_m: float) -> Command:
    """Point the gimbal at a place on the ground."""
    return Command(number=_ROI_LOCATION, place=place, alt_m=ground_m)


def point_nowhere() -> Command:
    """Let the gimbal go back to what it did."""
    return Command(number=_ROI_NONE)


def gimbal_angles(pitch_rad: float, yaw_rad: float, component: int = AUTOPILOT) -> Command:
    """Let the gimbal look in a direction, by gimbal protocol 2."""
    angles = (math.degrees(pitch_rad), math.degrees(yaw_rad))
    return Command(number=_PITCHYAW, params=(*angles, NAN, NAN, _FLAGS_FROM_NORTH), component=component)


def mount_angles(pitch_rad: float, yaw_rad: float) -> Command:
    """Let the gimbal look in a direction, by the older MAV_CMD_DO_MOUNT_CONTROL; yaw counts from the nose."""
    angles = (math.degrees(pitch_rad), 0.0, math.degrees(yaw_rad))
    return Command(number=_MOUNT_CONTROL, params=(*angles, 0, 0, 0, _MOUNT_TARGETING))


def gimbal_neutral(component: int = AUTOPILOT) -> Command:
    """Return the gimbal to its neutral position, by gimbal protocol 2."""
    return Command(number=_PITCHYAW, params=(NAN, NAN, NAN, NAN, _FLAG_NEUTRAL), component=component)


def mount_neutral() -> Command:
    """Turn the mount to its neutral position, the older way."""
    return Command(number=_MOUNT_CONTROL, params=(0, 0, 0, 0, 0, 0, _MOUNT_NEUTRAL))


def gimbal_control(system_id: int, component_id: int, *, take: bool, component: int = AUTOPILOT) -> Command:
    """Take or give up primary control of the gimbal for a station."""
    who = (system_id, component_id) if take else (_GIVE_UP, _GIVE_UP)
    other = (_UNCHANGED, _UNCHANGED) if take else (_GIVE_UP, _GIVE_UP)
    return Command(number=_CONFIGURE, params=(*who, *other), component=component)


def hold(kind: str, autopilot: int) -> Command | None:
    """Stop and hold the position; None for an autopilot whose mode for that is not known here.

    Args:
        kind: vehicle type in a word, see :func:`mavlink.protocol.modes.kind_name`.
    """
    if autopilot == _PX4:
        return Command(number=_SET_MODE, params=(_ARMED_CUSTOM, 4, 3))  # AUTO, LOITER
    mode = _ARDUPILOT_HOLD.get(kind) if autopilot == _ARDUPILOT else None
    return None if mode is None else Command(number=_SET_MODE, params=(_ARMED_CUSTOM, mode))


def return_to_launch() -> Command:
    """Fly home and land, as the vehicle is set up."""
    return Command(number=_RETURN)


def reposition(place: GeoPoint, alt_m: float, *, change_mode: bool) -> Command:
    """Fly to a place.

    Args:
        alt_m: above sea level.
        change_mode: whether the vehicle may change its mode for this. Only an operator's own word may: what follows in
            a stream must never take the vehicle back from a pilot who has taken it over.
    """
    return Command(
        number=_REPOSITION, params=(-1, _CHANGE_MODE if change_mode else 0, 0, NAN), place=place, alt_m=alt_m
    )


def orbit(place: GeoPoint, alt_m: float, radius_m: float, speed_mps: float) -> Command:
    """Circle clockwise around a place, nose to the middle."""
    return Command(number=_ORBIT, params=(radius_m, speed_mps, 0, 0), place=place, alt_m=alt_m)


def photo(number: int, component: int = AUTOPILOT) -> Command:
    """Take one photo.

    Args:
        number: counts up from 1, so that a repeated command takes no second photo.
    """
    return Command(number=_PHOTO, params=(0, 0, 1, number), component=component)


def record_start(component: int = AUTOPILOT) -> Command:
    """Start the camera's recording on board."""
    return Command(number=_RECORD, component=component)


def record_stop(component: int = AUTOPILOT) -> Command:
    """Stop the camera's recording."""
    return Command(number=_RECORD_STOP, component=component)
