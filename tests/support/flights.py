"""Fleets that listen, and who speaks into them: a plain flight (``World``), senders step by step with impostors among
them (``Air``), and senders of one system id with clocks and links of their own (``Listener``)."""

import math
from dataclasses import dataclass
from functools import cache

import numpy as np

from mavlink.fleet.fleet import Fleet
from mavlink.geodesy import LocalFrame
from mavlink.protocol.encoder import ARDUPILOT, COPTER, ROVER, MavlinkEncoder
from mavlink.protocol.packet import Auth, Packet
from tests.support.frames import MessageEncoder

T0 = 1_790_000_000_000_000
S = 1_000_000
FIELD = LocalFrame(-35.363, 149.165, 584.0)
SPEED = 4.0


class World:
    """A hovering copter 1 and rovers 11 .. on straight lines north, speaking into a fleet."""

    def __init__(self, rovers=2, **options):
        self.ids = list(range(11, 11 + rovers))
        self.fleet = Fleet(1, self.ids, **options)
        self.speakers = {i: MessageEncoder(i) for i in [1, *self.ids]}
        self.booted_us = {i: T0 - (50 + i) * S for i in self.speakers}
        self.notices = []

    def boot_ms(self, system_id, t_us):
        return (t_us - self.booted_us[system_id]) // 1000

    def feed(self, frame, t_us):
        notices = self.fleet.add_packet(Packet(t_us, frame))
        self.notices += notices
        return notices

    def rover_truth(self, system_id, t_us):
        return np.array([10.0 * (system_id - 11), SPEED * (t_us - T0) * 1e-6, 0.0])

    def rover(self, system_id, t_us, *, alt=None, heading=0.0, delay_us=0, v=SPEED, shift=0.0):
        east, north, _ = self.rover_truth(system_id, t_us)
        lat, lon, up = (float(a) for a in FIELD.to_geodetic([east + shift, north, 0.0]))
        frame = self.speakers[system_id].global_position_int(
            self.boot_ms(system_id, t_us), lat, lon, up if alt is None else alt, 0.0, (v, 0, 0), heading
        )
        return self.feed(frame, t_us + delay_us)

    def copter(self, t_us, *, up=40.0):
        lat, lon, alt = (float(a) for a in FIELD.to_geodetic([0.0, 0.0, up]))
        frame = self.speakers[1].global_position_int(self.boot_ms(1, t_us), lat, lon, alt, up, (0, 0, 0), 0.5)
        return self.feed(frame, t_us)

    def attitude(self, t_us, yaw=0.5, system_id=1, rate=0.0, pitch=0.0):
        boot_ms = self.boot_ms(system_id, t_us)
        return self.feed(self.speakers[system_id].attitude(boot_ms, 0.0, pitch, yaw, (0, 0, rate)), t_us)

    def run(self, seconds, start_us=T0, ids=None):
        """Positions at 5 Hz, attitude of the copter at 20 Hz, heartbeats at 1 Hz."""
        ids = [1, *self.ids] if ids is None else ids
        for tick in range(int(seconds * 20)):
            t_us = start_us + tick * 50_000
            if 1 in ids:
                self.attitude(t_us)
            if tick % 4 == 0:
                if 1 in ids:
                    self.copter(t_us)
                for i in set(ids) - {1}:
                    self.rover(i, t_us)
            if tick % 20 == 0:
                for i in ids:
                    kind, mode = (COPTER, 4) if i == 1 else (ROVER, 10)
                    self.feed(self.speakers[i].heartbeat(kind, custom_mode=mode), t_us)
        return start_us + int(seconds * S)


UAV, UGV = 1, 11
STEP_US = 50_000


@dataclass
class Sender:
    """A sender of a system id: the vehicle itself, or an impostor."""

    system_id: int = UGV
    link: int = 0
    peer: int = 1
    kind: int = ROVER
    autopilot: int = ARDUPILOT
    booted_us: int = T0 - 60 * S
    shift: tuple = (0.0, 0.0)
    up: float = 0.0
    rate_hz: float = 5.0
    phase_us: int = 0
    seq: int = 0
    auth: Auth = Auth.OPEN
    yaw: float = 0.0
    speed: float = 4.0
    loss: float = 0.0
    delay_us: int = 0
    places: bool = True
    beats: bool = True
    mode: int = 10
    changed_us: int = 0
    """From when on the mode is 4."""
    clocked: bool = False
    """Whether it sends SYSTEM_TIME."""
    starts_us: int = T0
    ends_us: int = T0 + 10_000 * S

    def __post_init__(self):
        self.speaker = MavlinkEncoder(self.system_id)
        self.speaker._mav.seq = self.seq
        self.rng = np.random.default_rng(self.peer)

    def place(self, t_us):
        east, north = self.shift
        return np.array([east, north + self.speed * (t_us - T0) * 1e-6, self.up])

    def frames(self, t_us):
        """Frames sent in the step that begins at a time."""
        if not self.starts_us <= t_us < self.ends_us:
            return
        boot_ms = (t_us - self.booted_us) // 1000 % (1 << 32)
        every_us = round(S / self.rate_hz)
        if self.beats and (t_us - self.phase_us - T0) % S == 0:
            mode = 4 if 0 < self.changed_us <= t_us else self.mode
            yield self.speaker.heartbeat(self.kind, autopilot=self.autopilot, custom_mode=mode)
        if self.clocked and (t_us - self.phase_us - T0) % (S // 2) == 0:
            yield self.speaker.system_time(boot_ms, t_us)
        if self.places and (t_us - self.phase_us - T0) % every_us == 0:
            lat, lon, alt = (float(x) for x in FIELD.to_geodetic(self.place(t_us)))
            yield self.speaker.global_position_int(boot_ms, lat, lon, alt, self.up, (self.speed, 0, 0), self.yaw)
            yield self.speaker.attitude(boot_ms, 0.0, 0.0, self.yaw)


class Air:
    """All senders on the air, and the fleet that receives them."""

    def __init__(self, *senders):
        self.fleet = Fleet(UAV, [UGV, 12], origin=FIELD, links=("udp", "radio"))
        quiet = Sender(12, peer=9, shift=(30.0, 0.0), booted_us=T0 - 90 * S)
        self.senders = [Sender(UAV, peer=8, kind=COPTER, up=40.0, speed=0.0), quiet, *senders]
        self.notices, self.reports = [], []
        self.now_us = T0
        self.contested_us = 0
        self.waiting = []

    def run(self, seconds):
        end_us = self.now_us + int(seconds * S)
        while self.now_us < end_us:
            for sender in self.senders:
                for raw in sender.frames(self.now_us):
                    if sender.rng.random() >= sender.loss:
                        self.waiting.append((self.now_us + sender.delay_us, raw, sender))
            due = sorted((w for w in self.waiting if w[0] <= self.now_us), key=lambda w: w[0])
            self.waiting = [w for w in self.waiting if w[0] > self.now_us]
            for t_us, raw, sender in due:
                self.notices += self.fleet.add_packet(Packet(t_us, raw, sender.link, sender.peer, sender.auth))
            self.now_us += STEP_US
            if not self.contested_us and self.status().contested:
                self.contested_us = self.now_us
            reports = self.fleet.take_reports()
            if self.status().contested:
                self.reports += reports.system_id[reports.system_id == UGV].tolist()
        return self

    def status(self, system_id=UGV):
        return next(v for v in self.fleet.at(self.now_us).vehicles if v.system_id == system_id)

    @property
    def alarms(self):
        return [n.text for n in self.notices if n.level == "alarm"]


RADIUS_M = 30.0
UP_S = 200.0
"""The vehicle was switched on so long before."""
LINKS = ("udp", "radio")


@dataclass(frozen=True)
class Claimant:
    """A sender that claims to be vehicle 11, rightly or not; times in seconds of the flight."""

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
def frames(sender, until_s):
    """What it sends: (seconds of arrival, frame), lost and held up as its link does."""
    speaker, rng = MavlinkEncoder(UGV, sender.component), np.random.default_rng(sender.seq + 1)
    speaker._mav.seq = sender.seq
    sent, heard = [], []
    period = 1.0 / sender.rate_hz
    for kind, every, phase in (
        ("p", period, 0.0),
        ("a", period, 0.4),
        ("b", 1.0, 0.2),
        ("g", 0.5, 0.3),
        ("t", 0.5, 0.6),
    ):
        wanted = {"b": "bc", "g": "gn"}.get(kind, kind)
        said = next((c for c in wanted if c in sender.says), None)
        if said:
            stop = min(until_s, sender.ends_s)
            count = max(0, math.ceil((stop - sender.begins_s) / every - phase))
            sent += [(sender.begins_s + (k + phase) * every, said) for k in range(count)]
    for t, said in sorted(sent):
        raw = _frame(sender, speaker, rng, t, said)
        lost = rng.random() < sender.loss or any(a <= t < b for a, b in sender.holes)
        if not lost:
            heard.append((t + sender.delay_s + rng.uniform(0.0, sender.jitter_s), raw))
    return heard


def _frame(sender, speaker, rng, t, said):
    (east, north), (v_east, v_north) = sender.place(t)
    east, north = east + rng.normal(0.0, sender.noise_m), north + rng.normal(0.0, sender.noise_m)
    boot_ms = sender.boot_ms(t, rng)
    heading = math.atan2(v_east, v_north) % (2 * math.pi) if not sender.parked else 0.0
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


class Listener:
    """A fleet that receives what senders of one system id send."""

    def __init__(self):
        self.fleet = Fleet(UAV, [UGV], origin=FIELD, links=LINKS)
        self.notices = []
        self.seen = []
        """(seconds, status, east and north) at each look."""

    def receive(self, *senders, until_s, look_s=0.0):
        packets = sorted(
            ((t, raw, sender) for sender in senders for t, raw in frames(sender, until_s) if t < until_s),
            key=lambda row: row[0],
        )
        due = look_s
        for t, raw, sender in packets:
            while look_s and t > due:
                self.look(due)
                due += look_s
            self.notices += self.fleet.add_packet(Packet(T0 + round(t * S), raw, sender.link, sender.peer))
        return self

    def look(self, t):
        state = self.fleet.at(T0 + round(t * S))
        self.seen.append((t, state.vehicles[1], state.p_enu[0, :2], bool(state.valid[0])))
        return self.seen[-1]

    @property
    def contested_s(self):
        """When two senders were first reported, seconds; infinite where they were not."""
        return min(((n.t_us - T0) * 1e-6 for n in self.notices if "two senders" in n.text), default=math.inf)

    def texts(self):
        return [n.text for n in self.notices]
