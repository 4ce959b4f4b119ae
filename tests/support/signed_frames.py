"""Signed frames as pymavlink makes them, the oracle of signing, and the time they are made at."""

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
