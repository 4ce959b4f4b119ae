"""Senders of one system id with clocks, components and links of their own, and what a fleet makes of them, quickly."""

import math
from dataclasses import dataclass
from functools import cache

import numpy as np

from mavlink.fleet.fleet import Fleet
from mavlink.protocol.encoder import ARDUPILOT, ROVER, MavlinkEncoder
from mavlink.protocol.packet import Packet
from tests.support.mavlink_flight import FIELD, T0, S

UAV, UGV = 1, 11
RADIUS_M, SPEED = 30.0, 4.0
UP_S = 200.0
"""The vehicle was switched on so long before."""
LINKS = ("udp", "radio")


@dataclass(frozen=True)
class Voice:
    """Somebody who says that he is vehicle 11; times in seconds of the flight."""

    component: int = 1
    link: int = 0
    peer: int = 1
    shift: tuple = (0.0, 0.0)
    """Metres from the true place."""
    ahead_s: float = 0.0
    """By which its boot clock is ahead of the true vehicle's."""
    clock: str = "own"
    """``zero``, ``half``, ``fast`` (tenfold) or ``random``; ``own`` runs as it should."""
    rate_hz: float = 5.0
    delay_s: float = 0.0
    jitter_s: float = 0.0
    loss: float = 0.0
    begins_s: float = 0.0
    ends_s: float = 1e9
    holes: tuple = ()
    """When nothing of it is heard: pairs of seconds."""
    seq: int = 0
    says: str = "pbah"
    """Positions, heartbeats (b: an autopilot's, c: a companion's), attitudes, GPS (g: fix, n: none), its time (t)."""
    parked: bool = False
    jumps: tuple = ()
    """When its place is somewhere else by how much: (from, until, metres east)."""
    boots_s: float = -UP_S
    noise_m: float = 0.0
    """1σ of each coordinate."""

    def place(self, t):
        """East, north and velocity there."""
        angle = 0.0 if self.parked else SPEED * t / RADIUS_M
        east = RADIUS_M * math.sin(angle) + self.shift[0] + sum(m for a, b, m in self.jumps if a <= t < b)
        north = RADIUS_M * (1.0 - math.cos(angle)) + self.shift[1]
        speed = 0.0 if self.parked else SPEED
        return (east, north), (speed * math.cos(angle), speed * math.sin(angle))

    def boot_ms(self, t, rng):
        since = t - self.boots_s
        own = {
            "own": since,
            "zero": 0.0,
            "half": 0.5 * since,
            "fast": 10.0 * since,
            "random": rng.uniform(0.0, 4e6),
        }[self.clock]
        return max(0, round(1000 * (own + (self.ahead_s if self.clock == "own" else 0.0))))


@cache
def frames(voice, until_s):
    """What it sends: (seconds of arrival, frame), lost and held up as its link does."""
    speaker, rng = MavlinkEncoder(UGV, voice.component), np.random.default_rng(voice.seq + 1)
    speaker._mav.seq = voice.seq
    sent, heard = [], []
    period = 1.0 / voice.rate_hz
    for kind, every, phase in (
        ("p", period, 0.0),
        ("a", period, 0.4),
        ("b", 1.0, 0.2),
        ("g", 0.5, 0.3),
        ("t", 0.5, 0.6),
    ):
        wanted = {"b": "bc", "g": "gn"}.get(kind, kind)
        said = next((c for c in wanted if c in voice.says), None)
        if said:
            stop = min(until_s, voice.ends_s)
            count = max(0, math.ceil((stop - voice.begins_s) / every - phase))
            sent += [(voice.begins_s + (k + phase) * every, said) for k in range(count)]
    for t, said in sorted(sent):
        raw = _frame(voice, speaker, rng, t, said)
        lost = rng.random() < voice.loss or any(a <= t < b for a, b in voice.holes)
        if not lost:
            heard.append((t + voice.delay_s + rng.uniform(0.0, voice.jitter_s), raw))
    return heard


def _frame(voice, speaker, rng, t, said):
    (east, north), (v_east, v_north) = voice.place(t)
    east, north = east + rng.normal(0.0, voice.noise_m), north + rng.normal(0.0, voice.noise_m)
    boot_ms = voice.boot_ms(t, rng)
    heading = math.atan2(v_east, v_north) % (2 * math.pi) if not voice.parked else 0.0
    if said == "p":
        lat, lon, alt = (float(x) for x in FIELD.to_geodetic([east, north, 0.0]))
        return speaker.global_position_int(boot_ms, lat, lon, alt, 0.0, (v_north, v_east, 0.0), heading)
    if said == "a":
        return speaker.attitude(boot_ms, 0.0, 0.0, heading)
    if said == "t":
        return speaker.system_time(boot_ms, T0 + round(t * S))
    if said in "gn":
        lat, lon, alt = (float(x) for x in FIELD.to_geodetic([east, north, 0.0]))
        fix = 3 if said == "g" else 1
        return speaker.gps_raw_int(boot_ms * 1000, lat, lon, alt, fix_type=fix)
    if said == "c":
        return speaker.heartbeat(18, autopilot=8)
    return speaker.heartbeat(ROVER, autopilot=ARDUPILOT, custom_mode=10)


class Hearing:
    """A fleet that hears them."""

    def __init__(self):
        self.fleet = Fleet(UAV, [UGV], origin=FIELD, links=LINKS)
        self.notices = []
        self.seen = []
        """(seconds, status, east and north) at each look."""

    def hear(self, *voices, until_s, look_s=0.0):
        packets = sorted(
            ((t, raw, voice) for voice in voices for t, raw in frames(voice, until_s) if t < until_s),
            key=lambda row: row[0],
        )
        due = look_s
        for t, raw, voice in packets:
            while look_s and t > due:
                self.look(due)
                due += look_s
            self.notices += self.fleet.add_packet(Packet(T0 + round(t * S), raw, voice.link, voice.peer))
        return self

    def look(self, t):
        state = self.fleet.at(T0 + round(t * S))
        self.seen.append((t, state.vehicles[1], state.p_enu[0, :2], bool(state.valid[0])))
        return self.seen[-1]

    @property
    def contested_s(self):
        """When two senders were told first, infinite where they were not."""
        return min(((n.t_us - T0) * 1e-6 for n in self.notices if "two senders" in n.text), default=math.inf)

    def texts(self):
        return [n.text for n in self.notices]
