"""Fleets with faults: the senders, where each one drives, and which of them report false positions.

Everything is a function of time, so that a second of traffic is made at once for all senders and costs little. Metres
east and north of the scenario's origin, seconds since the start, angles in radians.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from sim.world.earth import to_geodetic

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

LIES = ("zero", "prefix", "jump", "nan", "other", "altitude")
"""Kinds of false positions: no fix as 0/0; as ArduPilot before its first fix; 500 m away for a second of five;
impossible numbers; in the place of the next vehicle; 600 m too high."""
LIE_AFTER_S = 5.0
"""True positions are reported until then: a receiver has a position that the false ones contradict."""
ORIGIN_DEG, ALTITUDE_M, AGL_M = (47.397742, 8.545594), 488.0, 40.0
"""Latitude and longitude, metres above the ellipsoid, and the UAV's height above ground: the place is a choice
(Zurich)."""
SPACING_M = 30.0
"""Distance between centres of neighbouring circles: more than two largest radii, 12 m, so vehicles never meet."""
GO_S, REST_S = 8.0, 4.0
"""Seconds of ``stop_and_go``: drive, then stand still; a choice."""
SILENT_S = 1.3
"""A reboot takes this long."""
_INT32_MAX = 2**31 - 1
"""Greatest value of an int32 field; as degrees it is no place on the globe."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SimulatedSender:
    """One sender."""

    system_id: int
    place: int
    """Index of the circle that it drives; two senders of one id drive different ones. 0 is the UAV's."""
    lie: str = ""
    version: int = 2
    signs: Literal["right", "wrong", "never"] = "right"
    reboot_s: float = math.inf
    move_port_s: float = math.inf
    label: str = ""
    """Name under which its packets are counted."""

    def boot_ms(self, t: float, before_s: float) -> int:
        """Milliseconds since its last boot; the first was ``before_s`` before the start."""
        since = t - self.reboot_s if t >= self.reboot_s else t + before_s
        return int(since * 1000.0)

    def silent(self, t: float) -> bool:
        """Tell whether it is rebooting."""
        return self.reboot_s <= t < self.reboot_s + SILENT_S


@dataclass(frozen=True, slots=True, kw_only=True)
class SimulatedFleet:
    """All senders of vehicle telemetry, and how they drive."""

    senders: tuple[SimulatedSender, ...]
    stop_and_go: bool = False


def places(fleet: SimulatedFleet, who: IntArray, t: FloatArray) -> tuple[IntArray, FloatArray, FloatArray]:
    """Reported positions of all senders.

    Args:
        who: (k,) index of the sender.
        t: (k,) seconds.

    Returns:
        (k, 3) latitude and longitude in 1e-7 degrees and altitude in mm; (k, 2) velocity east and north, m/s; (k,)
        heading clockwise from north.
    """
    circle = np.array([sender.place for sender in fleet.senders])[who]
    lies = np.array([LIES.index(sender.lie) if sender.lie else -1 for sender in fleet.senders])[who]
    lies[t < LIE_AFTER_S] = -1
    circle = np.where(lies == LIES.index("other"), circle + 1, circle)
    east, north, v_east, v_north, heading = _driven(circle, t, fleet.stop_and_go)
    east = east + np.where((lies == LIES.index("jump")) & (t % 5.0 < 1.0), 500.0, 0.0)
    up = np.where(circle == 0, AGL_M, 0.0) + np.where(lies == LIES.index("altitude"), 600.0, 0.0)
    lat, lon, alt = to_geodetic(np.column_stack([east, north, up]), *ORIGIN_DEG, ALTITUDE_M)
    reported = np.rint(np.column_stack([lat * 1e7, lon * 1e7, alt * 1e3])).astype(np.int64)
    reported[lies == LIES.index("zero"), :2] = 0
    reported[lies == LIES.index("prefix"), :2] = (353, -129)
    reported[lies == LIES.index("nan")] = _INT32_MAX
    return reported, np.column_stack([v_east, v_north]), np.where(lies == LIES.index("nan"), np.nan, heading)


def _driven(circle: IntArray, t: FloatArray, stop_and_go: bool) -> tuple[FloatArray, ...]:
    """Circles on a grid, each with a speed of its own; the UAV's is wide and slow, and it looks north."""
    aloft = circle == 0
    side = 16
    centre_e = SPACING_M * (circle % side - side // 2) * ~aloft
    centre_n = SPACING_M * (circle // side - 3) * ~aloft
    radius = np.where(aloft, 6.0, 8.0 + circle * 7 % 5)
    speed = np.where(aloft, 1.0, 1.5 + circle * 13 % 9 * 0.5)
    driving = aloft | (t % (GO_S + REST_S) < GO_S) | np.array(not stop_and_go)
    # time spent driving: whole cycles, and what has passed of this one
    spent = t // (GO_S + REST_S) * GO_S + np.minimum(t % (GO_S + REST_S), GO_S) if stop_and_go else t
    phase = circle * 0.7 + speed * np.where(aloft, t, spent) / radius
    v = speed * driving
    east, north = centre_e + radius * np.cos(phase), centre_n + radius * np.sin(phase)
    v_east, v_north = -v * np.sin(phase), v * np.cos(phase)
    heading = np.where(aloft, 0.0, -phase % (2.0 * np.pi))
    return east, north, v_east, v_north, heading
