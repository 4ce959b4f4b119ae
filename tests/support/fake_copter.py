"""A copter with a gimbal as ArduPilot 4.7 has it, on 127.0.0.1; it hears none of the ground vehicles."""

from __future__ import annotations

import math
import time
from typing import Any

from mavlink.geodesy import LocalFrame, quaternion_from_euler, wrap_pi
from tests.support.fake_autopilot import FakeVehicle

_GIMBAL = 285
_ROI_LOCATION, _ROI_NONE, _ROI_SYSTEM = 195, 197, 198
_PITCHYAW, _MOUNT_CONTROL, _INTERVAL = 1000, 205, 511
SLEW = math.radians(240.0)
"""Per second: quicker than any, so that tests are short."""


class FakeCopter(FakeVehicle):
    """Accepts DO_SET_ROI_SYSID and does nothing, as it hears nobody; turns for a place and for angles.

    Attributes:
        hears: places of vehicles whose positions it hears itself, by system id.
        obeys: commands that turn its gimbal; all are accepted.
        has_gimbal: whether it reports one when asked.
        stays_deaf: whether requests for reports are denied.
    """

    def __init__(self, station: tuple[str, int], system_id: int, *, nose: float = 0.5, pitch: float = 0.0) -> None:
        self.hears: dict[int, tuple[float, float, float]] = {}
        self.obeys = {_ROI_LOCATION, _PITCHYAW, _MOUNT_CONTROL, _ROI_SYSTEM}
        self.has_gimbal = True
        self.nose, self.pitch, self.yaw = nose, pitch, nose
        self._goal: Any = None
        self._asked = False
        self._turned_s = time.monotonic()
        super().__init__(station, system_id)

    def _obey(self, said: Any, result: int) -> None:
        super()._obey(said, result)
        if result:
            return
        if said.command == _INTERVAL and said.param1 == _GIMBAL:
            self._asked = True
        if said.command not in self.obeys:
            return
        if said.command == _ROI_LOCATION:
            self._goal = (said.x * 1e-7, said.y * 1e-7, said.z)
        elif said.command == _ROI_SYSTEM:
            self._goal = int(said.param1)
        elif said.command == _PITCHYAW and not math.isnan(said.param1):
            assert int(said.param5) & 16, "yaw from north"
            self._goal = (math.radians(said.param1), math.radians(said.param2))
        elif said.command == _MOUNT_CONTROL and said.param7 == 2:
            self._goal = (math.radians(said.param1), wrap_pi(math.radians(said.param3) + self.nose))

    def _angles(self) -> tuple[float, float] | None:
        """Pitch and yaw that it turns to."""
        goal = self.hears.get(self._goal) if isinstance(self._goal, int) else self._goal
        if goal is None or len(goal) == 2:
            return goal
        lat, lon, alt, _ = self.place
        east, north, up = LocalFrame(lat, lon, alt).to_enu_point(*goal)
        return math.atan2(up, math.hypot(east, north)), math.atan2(east, north)

    def _report(self) -> None:
        super()._report()
        now_s = time.monotonic()
        boot_ms, turn = round((now_s - self._start_s) * 1e3), SLEW * (now_s - self._turned_s)
        self._turned_s = now_s
        if (angles := self._angles()) is not None:
            self.pitch += max(-turn, min(turn, angles[0] - self.pitch))
            self.yaw += max(-turn, min(turn, wrap_pi(angles[1] - self.yaw)))
        self._send(self._speaker.attitude(boot_ms, 0.0, 0.0, self.nose))
        if self._asked and self.has_gimbal:
            q = quaternion_from_euler(0.0, self.pitch, wrap_pi(self.yaw - self.nose))
            self._send(self._speaker.gimbal_attitude(boot_ms, q))
