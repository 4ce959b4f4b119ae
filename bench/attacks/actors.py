"""Vehicles that drive in circles and report it, true ones and impostors."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from bench.attacks.stage import TRUE, PacketSchedule, Party, Send
from bench.attacks.wire import AUTOPILOT, COPTER, ROVER, ComponentEncoder

HOME = (47.0, 8.0)
"""Latitude and longitude, degrees, of the hovering UAV: the origin of all positions here."""
ALTITUDE_M, UAV_HEIGHT_M = 500.0, 40.0
METRES_PER_DEGREE = 111_194.9
"""Of latitude on a sphere of 6,371 km: within half a per cent of WGS 84, which is enough as all share the error."""
UAV_ID = 1
FULL = ("beat", "position", "attitude", "gps", "status")
DATED = (*FULL, "time")
"""With SYSTEM_TIME, as real autopilots send it; it reveals two senders of one id, so attackers leave it out."""
RATES_HZ = {"beat": 1.0, "position": 5.0, "attitude": 5.0, "gps": 2.0, "status": 1.0, "time": 1.0}
UAV_RATES_HZ = RATES_HZ | {"position": 10.0, "attitude": 30.0}
"""The UAV's rates, as docs/operations.md recommends."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Body:
    """A vehicle on a circle, with the boot clock that stamps its messages."""

    system_id: int
    east_m: float = 0.0
    north_m: float = 0.0
    """Centre of its circle, relative to :data:`HOME`."""
    radius_m: float = 12.0
    speed_m_s: float = 2.0
    phase: float = 0.0
    """Bearing from the circle's centre at time 0, radians."""
    boot_s: float = 100.0
    """Time since boot when the stage begins; negative for a vehicle that boots later."""
    clock_rate: float = 1.0
    """Seconds that boot clock and date pass in one second: less than 1 of a simulator on a busy computer."""
    height_m: float = 0.0
    home: tuple[float, float] = HOME
    date_s: float = 0.0
    """By how much its SYSTEM_TIME is ahead."""

    def moved(self, east_m: float, north_m: float = 0.0) -> Body:
        """The same vehicle on a shifted circle."""
        return replace(self, east_m=self.east_m + east_m, north_m=self.north_m + north_m)

    def at(self, t_s: float) -> tuple[float, float]:
        """East and north, metres from :data:`HOME`."""
        angle = self._angle(t_s)
        return self.east_m + self.radius_m * math.sin(angle), self.north_m + self.radius_m * math.cos(angle)

    def heading(self, t_s: float) -> float:
        """Radians clockwise from north."""
        return (self._angle(t_s) + math.pi / 2) % (2 * math.pi)

    def boot_ms(self, t_s: float) -> int:
        return max(round((t_s * self.clock_rate + self.boot_s) * 1e3), 0)

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


def geodetic_position(body: Body, t_s: float) -> tuple[float, float, float, float]:
    """Latitude and longitude, degrees, altitude and height above home, metres."""
    east, north = body.at(t_s)
    lat = body.home[0] + north / METRES_PER_DEGREE
    lon = body.home[1] + east / (METRES_PER_DEGREE * math.cos(math.radians(body.home[0])))
    return lat, lon, ALTITUDE_M + body.height_m, body.height_m


def vehicle_schedules(
    body: Body,
    encoder: ComponentEncoder,
    send: Send,
    role: str = TRUE,
    *,
    messages: Sequence[str] = FULL,
    kind: int | None = None,
    autopilot: int = AUTOPILOT,
    rates_hz: dict[str, float] | None = None,
    start_s: float = 0.0,
    stop_s: float = math.inf,
    silent_s: tuple[float, float] = (math.inf, math.inf),
    delay_s: float = 0.0,
    before: Callable[[float], None] = lambda t_s: None,
) -> list[PacketSchedule]:
    """Schedules of the messages that a vehicle sends.

    Args:
        body: how it moves.
        encoder: packs its messages.
        send: its socket.
        role: ``TRUE`` or ``FALSE``: how its packets are counted.
        messages: which ones.
        kind: MAV_TYPE of its heartbeats.
        autopilot: MAV_AUTOPILOT of its heartbeats.
        rates_hz: rates by message that differ from the usual ones.
        start_s: when it begins to send.
        stop_s: when it ends.
        silent_s: from when to when it sends nothing.
        delay_s: by how much packets leave later than they were made.
        before: called before every packet, for example to set a signing clock.
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
        "beat": lambda t: encoder.heartbeat(kind, autopilot, marked=role != TRUE),
        "position": lambda t: encoder.position(body.boot_ms(t), geodetic_position(body, t), speed(t), heading(t)),
        "attitude": lambda t: encoder.attitude(body.boot_ms(t), yaw(t)),
        "gps": lambda t: encoder.gps(body.boot_ms(t), geodetic_position(body, t)),
        "status": lambda t: encoder.status(),
        "time": lambda t: encoder.time(
            round((time.time() + body.date_s - delay_s + (body.clock_rate - 1.0) * t) * 1e3) * 1000, body.boot_ms(t)
        ),
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

    return [line(k, name) for k, name in enumerate(messages)]
