"""Vehicles and impostors on the air, and the fleet that listens."""

from dataclasses import dataclass

import numpy as np

from mavlink.fleet.fleet import Fleet
from mavlink.protocol.encoder import ARDUPILOT, COPTER, ROVER, MavlinkEncoder
from mavlink.protocol.packet import Auth, Packet
from tests.support.mavlink_flight import FIELD, T0, S

UAV, UGV = 1, 11
STEP_US = 50_000


@dataclass
class Sender:
    """Somebody who speaks under a system id: the real one, or another."""

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
    """Everybody on the air, and the fleet that listens."""

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
