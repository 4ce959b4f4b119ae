"""Vehicles that drive in circles and report it, true ones and impostors."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from bench.attacks.stage import TRUE, PacketSchedule, Party, Send
from bench.attacks.wire import AUTOPILOT, COPTER, ROVER, ComponentEncoder

__all__ = ["DATED", "FULL", "HOME", "UAV_ID", "Body", "lines_of", "place_of", "rover", "uav"]

HOME = (47.0, 8.0)
"""Latitude and longitude of the UAV, which hovers: all places are told relative to it."""
ALTITUDE_M, UAV_HEIGHT_M = 500.0, 40.0
METRES_A_DEGREE = 111_194.9
"""Of a sphere of 6,371 km: within half a per cent of WGS 84, and the same for all."""
UAV_ID = 1
FULL = ("beat", "position", "attitude", "gps", "status")
DATED = (*FULL, "time")
"""With the date, as real autopilots send it: two of them give two senders away, so attackers do without."""
RATES_HZ = {"beat": 1.0, "position": 5.0, "attitude": 5.0, "gps": 2.0, "status": 1.0, "time": 1.0}
UAV_RATES_HZ = RATES_HZ | {"position": 10.0, "attitude": 30.0}
"""As docs/operations.md asks for."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Body:
    """Something that moves, with the clock that it stamps with."""

    system_id: int
    east_m: float = 0.0
    north_m: float = 0.0
    """Centre of its circle, relative to :data:`HOME`."""
    radius_m: float = 12.0
    speed_m_s: float = 2.0
    phase: float = 0.0
    boot_s: float = 100.0
    """Its clock when the stage begins; as a number that stands for a clock set anew it may be negative."""
    height_m: float = 0.0
    home: tuple[float, float] = HOME
    date_s: float = 0.0
    """By how much its date is ahead of the time."""

    def moved(self, east_m: float, north_m: float = 0.0) -> Body:
        """The same elsewhere."""
        return replace(self, east_m=self.east_m + east_m, north_m=self.north_m + north_m)

    def at(self, t_s: float) -> tuple[float, float]:
        """East and north, metres from :data:`HOME`."""
        angle = self._angle(t_s)
        return self.east_m + self.radius_m * math.sin(angle), self.north_m + self.radius_m * math.cos(angle)

    def heading(self, t_s: float) -> float:
        """Radians clockwise from north."""
        return (self._angle(t_s) + math.pi / 2) % (2 * math.pi)

    def boot_ms(self, t_s: float) -> int:
        return max(round((t_s + self.boot_s) * 1e3), 0)

    def _angle(self, t_s: float) -> float:
        return self.phase + (self.speed_m_s / self.radius_m * t_s if self.radius_m else 0.0)


def uav() -> Body:
    """The UAV, which hovers over :data:`HOME`."""
    return Body(system_id=UAV_ID, radius_m=0.0, speed_m_s=0.0, height_m=UAV_HEIGHT_M)


def rover(system_id: int, boot_s: float | None = None) -> Body:
    """A vehicle, each on a circle of its own, 60 m from the next."""
    k = system_id - 11
    return Body(
        system_id=system_id, east_m=-90.0 + 60.0 * (k % 4), north_m=-60.0 + 60.0 * (k // 4), phase=0.7 * k,
        boot_s=100.0 + 3.7 * k if boot_s is None else boot_s,
    )  # fmt: skip


def place_of(body: Body, t_s: float) -> tuple[float, float, float, float]:
    """Latitude, longitude, altitude and height above home."""
    east, north = body.at(t_s)
    lat = body.home[0] + north / METRES_A_DEGREE
    lon = body.home[1] + east / (METRES_A_DEGREE * math.cos(math.radians(body.home[0])))
    return lat, lon, ALTITUDE_M + body.height_m, body.height_m


def lines_of(
    body: Body,
    voice: ComponentEncoder,
    send: Send,
    role: str = TRUE,
    *,
    says: Sequence[str] = FULL,
    kind: int | None = None,
    autopilot: int = AUTOPILOT,
    rates_hz: dict[str, float] | None = None,
    start_s: float = 0.0,
    stop_s: float = math.inf,
    silent_s: tuple[float, float] = (math.inf, math.inf),
    delay_s: float = 0.0,
    before: Callable[[float], None] = lambda t_s: None,
) -> list[PacketSchedule]:
    """What a vehicle sends.

    Args:
        body: how it moves.
        voice: writes its packets.
        send: its socket.
        role: whose packets they are counted as.
        says: which messages.
        kind: MAV_TYPE of its heartbeats.
        autopilot: MAV_AUTOPILOT of its heartbeats.
        rates_hz: by message.
        start_s, stop_s, silent_s: when.
        delay_s: by which it leaves later than it was made.
        before: called ahead of every packet, as for a signing clock.
    """
    kind = kind if kind is not None else COPTER if body.system_id == UAV_ID else ROVER
    rates = (UAV_RATES_HZ if body.system_id == UAV_ID else RATES_HZ) | (rates_hz or {})
    party: Party = (role, body.system_id)

    def heading(t_s: float) -> float:
        return math.degrees(body.heading(t_s))

    def speed(t_s: float) -> tuple[float, float]:
        return body.speed_m_s * math.cos(body.heading(t_s)), body.speed_m_s * math.sin(body.heading(t_s))

    def yaw(t_s: float) -> float:
        return (body.heading(t_s) + math.pi) % (2 * math.pi) - math.pi

    make: dict[str, Callable[[float], bytes]] = {
        "beat": lambda t: voice.heartbeat(kind, autopilot, marked=role != TRUE),
        "position": lambda t: voice.position(body.boot_ms(t), place_of(body, t), speed(t), heading(t)),
        "attitude": lambda t: voice.attitude(body.boot_ms(t), yaw(t)),
        "gps": lambda t: voice.gps(body.boot_ms(t), place_of(body, t)),
        "status": lambda t: voice.status(),
        "time": lambda t: voice.time(round((time.time() + body.date_s - delay_s) * 1e3) * 1000, body.boot_ms(t)),
    }

    def line(k: int, name: str) -> PacketSchedule:
        def packets(t_s: float) -> list[bytes]:
            before(t_s)
            return [make[name](t_s - delay_s)]

        phase_s = (0.013 * body.system_id + 0.031 * k) % 0.19
        return PacketSchedule(
            party=party,
            make=packets,
            send=send,
            rate_hz=rates[name],
            start_s=start_s + phase_s,
            stop_s=stop_s,
            silent_s=silent_s,
        )

    return [line(k, name) for k, name in enumerate(says)]
