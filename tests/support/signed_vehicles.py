"""What autopilots sign with, written from their sources and sharing nothing with what is tested.

ArduPilot (``GCS_Signing.cpp``, ``AP_RTC.cpp``): one counter for all links, which goes on by one with each frame. It is
raised to the whole second of GPS time, while disarmed only and only when GPS time minus boot time has grown; and to the
timestamp of every signed frame that is accepted. It is stored every 30 s and at every raise, and begins a minute after
what was stored.

PX4 (``mavlink_sign_control.cpp``): one counter for each link. In later versions it is raised to the time of day at the
start and whenever it is stored; in the first ones never, and what is stored is the time at which the key was set."""

import hashlib

from pymavlink.dialects.v20 import ardupilotmega

from mavlink.protocol.packet import Packet
from mavlink.signing.keys import Key, KeyRing
from mavlink.signing.streams import ticks_of
from mavlink.signing.verifier import Verifier

T0 = 1_790_000_000_000_000
NOW = ticks_of(T0)


def secret_of(number):
    return hashlib.sha256(f"vehicle {number}".encode()).digest()


def ring_of(*system_ids, default=None):
    return KeyRing(keys={i: Key(secret_of(i)) for i in system_ids}, default=Key(default) if default else None)


def shown_anywhere(text, secret):
    """Whether a text holds a secret in any of the ways that Python or people write bytes."""
    ways = [secret.hex(), secret.hex().upper(), repr(secret)[2:-1], repr(bytearray(secret)), str(list(secret))]
    parts = [way[k : k + 16] for way in ways for k in range(0, max(len(way) - 16, 1), 8)]
    return any(part in text for part in parts)


class Sender:
    """One vehicle that speaks through pymavlink, signed unless told otherwise."""

    def __init__(self, system_id=7, component_id=1, *, secret=None, link_id=0, timestamp=NOW, version=2, signs=True):
        self.mav = ardupilotmega.MAVLink(None, srcSystem=system_id, srcComponent=component_id)
        self.version = version
        if signs and version == 2:
            self.mav.signing.secret_key = secret or secret_of(system_id)
            self.mav.signing.sign_outgoing = True
            self.mav.signing.link_id = link_id
            self.mav.signing.timestamp = timestamp

    def frame(self, message=None, timestamp=None):
        if timestamp is not None:
            self.mav.signing.timestamp = timestamp
        message = message or ardupilotmega.MAVLink_attitude_message(5, 0.1, 0.2, 0.3, 0.0, 0.0, 0.4)
        raw = bytes(message.pack(self.mav, force_mavlink1=self.version == 1))
        self.mav.seq = (self.mav.seq + 1) % 256
        return raw

    def packet(self, message=None, *, timestamp=None, t_us=T0, link=0):
        return Packet(t_us, self.frame(message, timestamp), link)


class Still:
    """A steady clock that the test moves."""

    def __init__(self):
        self.ns = 0

    def __call__(self):
        return self.ns


def verifier(*system_ids, default=None, **options):
    return Verifier(ring_of(*system_ids, default=default), steady_ns=Still(), **options)


S = 1_000_000
TICKS = 100_000
EPOCH_S = 1_420_070_400


def wall(t_us):
    """Ticks of the time of day."""
    return (t_us - EPOCH_S * S) // 10


class ArduPilot:
    save_us = 30 * S

    def __init__(self, t_us, *, key_set_us=None, drift_ppm=0.0):
        self.stored = wall(key_set_us if key_set_us is not None else t_us)
        self.drift_ppm = drift_ppm
        self.boot(t_us)

    def boot(self, t_us):
        self.booted_us, self.saved_us = t_us, t_us
        self.counter = self.stored + 60 * TICKS
        self.shift_us, self.timed, self.armed = 0, False, False

    def since_boot_us(self, t_us):
        return round((t_us - self.booted_us) * (1.0 + self.drift_ppm * 1e-6))

    def gps(self, t_us):
        if self.armed and self.timed:
            return
        shift_us = t_us - self.since_boot_us(t_us)
        if shift_us < self.shift_us:
            return
        self.shift_us, self.timed = shift_us, True
        self.counter = max(self.counter, wall(t_us // S * S))
        self.save(t_us)

    def hears(self, timestamp):
        self.counter = max(self.counter, timestamp)

    def unix_us(self, t_us):
        return self.since_boot_us(t_us) + self.shift_us if self.timed else 0

    def save(self, t_us):
        self.saved_us = t_us
        self.stored = max(self.stored, self.counter)

    def stamp(self, t_us):
        if t_us - self.saved_us >= self.save_us:
            self.save(t_us)
        self.counter += 1
        return self.counter - 1


class Px4:
    def __init__(self, t_us, *, key_set_us=None, first=False, store_us=10 * S):
        self.stored = wall(key_set_us if key_set_us is not None else t_us)
        self.first, self.store_us = first, store_us
        self.boot(t_us)

    def boot(self, t_us):
        self.booted_us, self.saved_us, self.armed = t_us, t_us, False
        self.counter = self.stored if self.first else max(self.stored, wall(t_us))

    def gps(self, t_us):
        pass

    def since_boot_us(self, t_us):
        return t_us - self.booted_us

    def unix_us(self, t_us):
        return t_us

    def stamp(self, t_us):
        if not self.first and t_us - self.saved_us >= self.store_us:
            self.saved_us = t_us
            self.counter = self.stored = max(self.counter, wall(t_us))
        self.counter += 1
        return self.counter - 1


class Vehicle:
    """One autopilot that sends 12 frames a second over each of its links."""

    rate_hz = 12

    def __init__(self, clock, system_id=7, *, system_time=True, links=1, boot_times=True):
        self.clock, self.links = clock, links
        self.sender = Sender(system_id)
        self.system_time, self.boot_times = system_time, boot_times
        self.heard = []

    def runs(self, start_us, seconds, *, arms_after_s=None):
        """Goes on for a while, unheard."""
        for k in range(round(seconds)):
            t_us = start_us + k * S
            if arms_after_s is not None and k >= arms_after_s:
                self.clock.armed = True
            for part in range(5):
                self.clock.gps(t_us + part * S // 5)
            for _ in range(self.rate_hz * self.links):
                self.clock.stamp(t_us)
        return start_us + round(seconds * S)

    def speaks(self, start_us, seconds):
        """Packets of a while, as they come over the links."""
        packets = []
        for k in range(round(seconds * self.rate_hz)):
            t_us = start_us + k * S // self.rate_hz
            if k % 2 == 0:
                self.clock.gps(t_us)
            packets += [Packet(t_us, self.frame(k, t_us), link) for link in range(self.links)]
        self.heard += packets
        return packets

    def frame(self, k, t_us):
        """The next one, the k-th of a second."""
        return self.sender.frame(self._message(k % self.rate_hz, t_us), self.clock.stamp(t_us))

    def _message(self, part, t_us):
        boot_ms = self.clock.since_boot_us(t_us) // 1000
        if part == 0:
            return ardupilotmega.MAVLink_heartbeat_message(10, 3, 129, 4, 4, 3)
        if part == 7 and self.system_time:
            return ardupilotmega.MAVLink_system_time_message(self.clock.unix_us(t_us), boot_ms)
        if not self.boot_times:
            return ardupilotmega.MAVLink_vfr_hud_message(1.0, 1.0, 90, 50, 0.0, part)
        if part % 2:
            return ardupilotmega.MAVLink_attitude_message(boot_ms, 0.1, 0.2, 0.3, 0.0, 0.0, 0.4)
        return ardupilotmega.MAVLink_global_position_int_message(boot_ms, 1, 2, 3, 4, 0, 0, 0, 9000)
