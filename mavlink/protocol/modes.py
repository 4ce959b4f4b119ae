"""Vehicle kinds and flight modes in words. The same mode number means different things on different vehicles."""

from __future__ import annotations

from functools import cache

from pymavlink.dialects.v20 import ardupilotmega

_ARDUPILOT, _NO_AUTOPILOT, _PX4 = 3, 8, 12
_COPTER_TYPES = frozenset({2, 3, 4, 13, 14, 15, 29, 35, 43})
_PLANE_TYPES = frozenset({1, 7, 16, 17, 28})
_VTOL_TYPES = frozenset({19, 20, 21, 22, 23, 24, 25, 47})
_KINDS = (
    dict.fromkeys(_COPTER_TYPES, "copter")
    | dict.fromkeys(_PLANE_TYPES, "plane")
    | dict.fromkeys(_VTOL_TYPES, "vtol")
    | {4: "helicopter", 5: "tracker", 8: "balloon", 9: "rocket", 10: "rover", 11: "boat", 12: "sub", 46: "quadruped"}
)
_FLYING = frozenset({"copter", "helicopter", "plane", "vtol"})
_DRIVING = frozenset({"rover", "boat", "quadruped"})
_EQUIPMENT = frozenset({6, 18, 26, 27, 30, 31, 32, 33, 34, 36, 37, 38, 39, 40, 41, 42, 44, 48})
"""Types that send heartbeats without being a vehicle: stations, companions, gimbals, cameras, batteries, and others."""
_MODE_ENUMS = {
    "copter": "COPTER_MODE",
    "helicopter": "COPTER_MODE",
    "rover": "ROVER_MODE",
    "boat": "ROVER_MODE",
    "plane": "PLANE_MODE",
    "vtol": "PLANE_MODE",
    "sub": "SUB_MODE",
}
_PX4_MAIN = {
    1: "MANUAL",
    2: "ALTCTL",
    3: "POSCTL",
    4: "AUTO",
    5: "ACRO",
    6: "OFFBOARD",
    7: "STABILIZED",
    8: "RATTITUDE",
}
_PX4_AUTO = {1: "READY", 2: "TAKEOFF", 3: "LOITER", 4: "MISSION", 5: "RTL", 6: "LAND", 8: "FOLLOW", 9: "PRECLAND"}
_FIXES = {0: "none", 1: "none", 2: "2D", 3: "3D", 4: "DGPS", 5: "RTK float", 6: "RTK", 7: "static", 8: "PPP"}


def is_vehicle(mav_type: int, autopilot: int) -> bool:
    """Tell whether a heartbeat is a vehicle's; stations, gimbals and cameras send them too, and relayed copies."""
    return autopilot != _NO_AUTOPILOT and mav_type not in _EQUIPMENT


def kind_name(mav_type: int) -> str:
    """Vehicle type in a word, ``vehicle`` for types without one."""
    return _KINDS.get(mav_type, "vehicle")


def is_aircraft(mav_type: int) -> bool:
    """Tell whether a MAV_TYPE flies and can carry the camera."""
    return kind_name(mav_type) in _FLYING


def is_ground_vehicle(mav_type: int) -> bool:
    """Tell whether a MAV_TYPE stays on the ground or on the water's surface."""
    return kind_name(mav_type) in _DRIVING


def fix_name(fix_type: int) -> str:
    """GPS_FIX_TYPE in a word, ``none`` without a fix."""
    return _FIXES.get(fix_type, "none")


def mode_name(mav_type: int, autopilot: int, base_mode: int, custom_mode: int) -> str:
    """Flight mode in words, ``MODE <number>`` when the number has no name for this vehicle."""
    if autopilot == _PX4:
        return _px4_mode(custom_mode)
    if autopilot == _ARDUPILOT:
        return _ardupilot_modes(_MODE_ENUMS.get(kind_name(mav_type), "")).get(custom_mode, f"MODE {custom_mode}")
    return f"MODE {custom_mode}" if base_mode & 1 else "MANUAL" if base_mode & 64 else ""


def _px4_mode(custom_mode: int) -> str:
    main, sub = custom_mode >> 16 & 0xFF, custom_mode >> 24 & 0xFF
    if main == 4 and sub in _PX4_AUTO:
        return _PX4_AUTO[sub]
    return _PX4_MAIN.get(main, f"MODE {main}.{sub}")


@cache
def _ardupilot_modes(enum: str) -> dict[int, str]:
    entries = ardupilotmega.enums.get(enum, {})
    prefix = f"{enum}_"
    names = {int(value): str(entry.name).removeprefix(prefix) for value, entry in entries.items()}
    return {value: name for value, name in names.items() if name != "ENUM_END"}
