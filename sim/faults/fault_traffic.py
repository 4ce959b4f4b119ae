"""Telemetry of a fleet with faults, datagram by datagram in order of time.

The few messages that a fleet needs are packed here and not by pymavlink, which is slower: a struct, a checksum, and a
signature on request.
"""

from __future__ import annotations

import hashlib
import heapq
import math
import random
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import count
from struct import Struct
from typing import Final

import numpy as np
from fastcrc import crc16

from mavlink.protocol.dialect import DEFINITIONS
from mavlink.protocol.encoder import ARDUPILOT, COPTER, ROVER
from sim.faults.fleet_faults import AGL_M, SimulatedFleet, SimulatedSender, places

BATCH_S = 0.1
"""Datagrams are computed in spans of this length: a choice between memory and calls of numpy."""
REPLAY_AFTER_S = 10.0
"""Time after which a recorded frame is sent again; a choice, well above any delay of a link."""
COPTER_GUIDED, ROVER_AUTO, ARMED_CUSTOM, ACTIVE = 4, 10, 129, 4
"""HEARTBEAT: ArduPilot's custom modes Guided (Copter) and Auto (Rover), base mode armed with a custom mode,
MAV_STATE_ACTIVE."""
UNKNOWN_SENDER = -1
"""Outlet of datagrams that are no vehicle's; ``-2 - k`` is that of part k's replayed frames."""
HEARTBEAT, GPS, ATTITUDE, POSITION, TEXT = 0, 24, 30, 33, 253
"""Message ids."""
_BODY: Final = {
    HEARTBEAT: Struct("<IBBBBB"),
    GPS: Struct("<QiiiHHHHBB"),
    ATTITUDE: Struct("<Iffffff"),
    POSITION: Struct("<IiiiihhhH"),
    TEXT: Struct("<B50s"),
}
"""Payloads of the messages above, fields in MAVLink's wire order."""
_V1, _V2, _STAMP, _CRC = Struct("<BBBBBB"), Struct("<BBBBBBBHB"), Struct("<BIH"), Struct("<H")
"""Headers of MAVLink 1 and 2, the signature's link and time stamp, and the checksum."""
_SIGNING_EPOCH_US = 1_420_070_400_000_000
"""Unix time of 2015-01-01, from which MAVLink signatures count their time."""
HOSTILE_TEXTS: Final = (
    "[/x]",
    "[@click=app.quit]x[/]",
    "[bold red]x[/bold red] [link=http://x]y[/link]",
    "\x1b[2J\x1b]0;pwned\x07\x1b[31mred",
    "\x1b]52;c;cm0gLXJmIH4=\x07clipboard",
    "\x1bPq#0;2;0;0;0#0~~@@vv\x1b\\sixel",
    "\x9b31mC1 \x90\x9d0;t\x9c",
    "a\r\nb\tc\x00d\x08\x08\x7f",
    "\u202eesrever\u2066 \u2069\u200f",
    "zero\u200bwidth\u200d\u2060\ufeff\u00ad",
    "\U0001f916\U0001f468\u200d\U0001f469\u200d\U0001f467 \u6f22\u5b57 e\u0301\u0323\u0308",
    "\U000e0041\U000e0042 tags \ue000\U0010ffff",
    "{}%s{0}$(x)`x`\\'\"<>&;|",
    "W" * 50,
)
"""Texts that each go into a STATUSTEXT as their first 50 bytes of UTF-8."""
BOOT_WORDS: Final = (b"\n\nInit ArduRover V4.6.0\n\nFree RAM: 131072\n", b"Init Gyro", b"*", b"0 ")
"""Plain text, as autopilots send it before their first packet."""


def poison(rng: random.Random, good: bytes) -> bytes:
    """One datagram that is no frame: headers without a body, noise, text, a frame cut short or with a bit turned."""
    kind = rng.randrange(6)
    if kind == 0:
        return bytes([0xFD, 0xFF, rng.randrange(2)])
    if kind == 1:
        return rng.randbytes(rng.randrange(1, 300))
    if kind == 2:
        return rng.choice(BOOT_WORDS)
    if kind == 3:
        return good[: rng.randrange(1, len(good))]
    if kind == 4:
        return b"\xfd\xff\x00\x00" * rng.randrange(1, 300)
    bit = rng.randrange(8 * 10, 8 * len(good))
    spoilt = bytearray(good)
    spoilt[bit >> 3] ^= 1 << (bit & 7)
    return bytes(spoilt)


class SenderEncoder:
    """One sender's frames, numbered and signed as its autopilot would.

    Args:
        system_id: 1..255.
        version: MAVLink 1 or 2; 1 cannot be signed.
        key: 32 bytes to sign with.
    """

    def __init__(self, system_id: int, *, version: int = 2, key: bytes | None = None, link_id: int = 0) -> None:
        self._system_id, self._version, self._link_id = system_id, version, link_id
        self._key = key if version == 2 else None
        self._seq = 0
        self._stamp = 0

    def frame(self, t_us: int, message_id: int, *values: float | bytes) -> bytes:
        """The next frame, made at Unix time ``t_us``; values in the order on the wire, without extensions."""
        body = _BODY[message_id].pack(*values)
        seq, self._seq = self._seq, (self._seq + 1) & 0xFF
        if self._version == 1:
            raw = _V1.pack(0xFE, len(body), seq, self._system_id, 1, message_id) + body
        else:
            # trailing zeros are cut off by every autopilot, the first byte never
            body = body[:1] + body[1:].rstrip(b"\0")
            flags = 1 if self._key else 0
            raw = _V2.pack(0xFD, len(body), flags, 0, seq, self._system_id, 1, message_id, 0) + body
        raw += _CRC.pack(crc16.mcrf4xx(raw[1:] + bytes([DEFINITIONS[message_id][1]])))
        return raw + self._signature(raw, t_us) if self._key else raw

    def _signature(self, raw: bytes, t_us: int) -> bytes:
        assert self._key is not None
        # ticks of 10 µs since 2015, one more than the last at least
        self._stamp = max(self._stamp + 1, (t_us - _SIGNING_EPOCH_US) // 10)
        stamp = _STAMP.pack(self._link_id, self._stamp & 0xFFFFFFFF, self._stamp >> 32)
        return stamp + hashlib.sha256(self._key + raw + stamp).digest()[:6]


@dataclass(frozen=True, slots=True, order=True)
class ScheduledDatagram:
    """Datagram to send; no bytes: the outlet gets a new source port."""

    t_s: float
    order: int
    outlet: int
    label: str
    raw: bytes


@dataclass(frozen=True, slots=True, kw_only=True)
class FaultTraffic:
    """Traffic that is to be sent: of which fleet, and how much of each kind."""

    fleet: SimulatedFleet
    rate_hz: float
    """Vehicles' packets a second, all together."""
    keys: Mapping[int, bytes]
    """32 bytes by system id; without one no sender signs."""
    flood_hz: float = 0.0
    """Hostile texts a second, from the second sender."""
    garbage_hz: float = 0.0
    replayed: frozenset[int] = frozenset()
    """System ids whose frames come again, ten seconds late, from another address."""
    banner: bool = False
    seed: int = 1


def traffic(plan: FaultTraffic, start_us: int) -> Iterator[ScheduledDatagram]:
    """Yield all datagrams in order of time since the start, without end.

    Args:
        start_us: Unix time of the start.
    """
    stage = _SenderCounters(plan, start_us)
    for batch in count():
        yield from stage.batch(batch * BATCH_S, (batch + 1) * BATCH_S)


class _SenderCounters:
    """Encoders, boot times and next packets of all senders, from which each span's datagrams are made."""

    def __init__(self, plan: FaultTraffic, start_us: int) -> None:
        self._plan, self._start_us = plan, start_us
        self._rng = random.Random(plan.seed)
        self._encoders = [self._encoder_of(sender) for sender in plan.fleet.senders]
        self._booted_s = [self._rng.uniform(40.0, 400.0) for _ in plan.fleet.senders]
        self._each_hz = plan.rate_hz / len(plan.fleet.senders)
        self._slots = np.zeros(len(plan.fleet.senders), dtype=np.int64)
        self._phase = np.arange(len(plan.fleet.senders)) / len(plan.fleet.senders)
        self._later: list[ScheduledDatagram] = []
        self._order = count()
        self._texts = count()
        self._good = b"\xfd\x09"

    def batch(self, from_s: float, until_s: float) -> list[ScheduledDatagram]:
        """Return the datagrams of a span of time in their order."""
        due = self._vehicles(until_s) + self._extras(from_s, until_s)
        while self._later and self._later[0].t_s < until_s:
            due.append(heapq.heappop(self._later))
        due.sort()
        return due

    def _encoder_of(self, sender: SimulatedSender) -> SenderEncoder:
        key = self._plan.keys.get(sender.system_id)
        if key and sender.signs == "wrong":
            key = self._rng.randbytes(32)
        return SenderEncoder(sender.system_id, version=sender.version, key=None if sender.signs == "never" else key)

    def _vehicles(self, until_s: float) -> list[ScheduledDatagram]:
        # slot n of sender k is due at (n + φ_k) / rate
        stop = np.ceil(until_s * self._each_hz - self._phase).astype(np.int64)
        who = np.repeat(np.arange(len(stop)), stop - self._slots)
        first = np.concatenate([np.arange(a, b) for a, b in zip(self._slots, stop, strict=True)])
        self._slots = stop
        t = (first + self._phase[who]) / self._each_hz
        reported, v, heading = places(self._plan.fleet, who, t)
        beats = max(4, round(self._each_hz))
        columns = who, first % beats, t, reported, v, heading
        rows = zip(*(column.tolist() for column in columns), strict=True)
        senders = self._plan.fleet.senders
        return [self._packet_of(k, slot, at, *row) for k, slot, at, *row in rows if not senders[k].silent(at)]

    def _packet_of(
        self, k: int, slot: int, t: float, reported: list[int], v: list[float], heading: float
    ) -> ScheduledDatagram:
        sender, encoder = self._plan.fleet.senders[k], self._encoders[k]
        boot_ms, unix_us = sender.boot_ms(t, self._booted_s[k]), self._start_us + int(t * 1e6)
        wrong = math.isnan(heading)
        if slot == 0:
            kind, mode = (COPTER, COPTER_GUIDED) if sender.place == 0 else (ROVER, ROVER_AUTO)
            raw = encoder.frame(unix_us, HEARTBEAT, mode, kind, ARDUPILOT, ARMED_CUSTOM, ACTIVE, 3)
        elif slot == 2:
            raw = encoder.frame(unix_us, GPS, boot_ms * 1000, *reported, 80, 120, 0, 65535, 3, 14)
        elif slot % 2:
            speed = (round(v[1] * 100), round(v[0] * 100), 0) if not wrong else (32767, -32768, 32767)
            hdg = 65535 if wrong else round(math.degrees(heading) * 100) % 36000
            relative_mm = round(AGL_M * 1000) if sender.place == 0 else 0
            raw = encoder.frame(unix_us, POSITION, boot_ms, *reported, relative_mm, *speed, hdg)
        else:
            yaw = heading if wrong else (heading + math.pi) % (2 * math.pi) - math.pi
            raw = encoder.frame(unix_us, ATTITUDE, boot_ms, *((math.nan,) * 2 if wrong else (0.0, 0.0)), yaw, 0, 0, 0)
        self._good = raw
        if sender.system_id in self._plan.replayed:
            label = f"replayed {sender.system_id}"
            heapq.heappush(self._later, ScheduledDatagram(t + REPLAY_AFTER_S, next(self._order), -2 - k, label, raw))
        return ScheduledDatagram(t, next(self._order), k, sender.label or str(sender.system_id), raw)

    def _extras(self, from_s: float, until_s: float) -> list[ScheduledDatagram]:
        """Reboots, new ports, boot banners, floods and garbage."""
        due: list[ScheduledDatagram] = []
        for k, sender in enumerate(self._plan.fleet.senders):
            moves = (sender.reboot_s, sender.move_port_s)
            due += [ScheduledDatagram(moment, -1, k, "", b"") for moment in moves if from_s <= moment < until_s]
            if from_s <= sender.reboot_s < until_s or (self._plan.banner and from_s == 0.0):
                moment = sender.reboot_s if from_s <= sender.reboot_s < until_s else 0.0
                due += [
                    ScheduledDatagram(moment + 1e-3, next(self._order), k, "boot words", word) for word in BOOT_WORDS
                ]
        plan = self._plan
        due += [self._text(t) for t in _moments(plan.flood_hz, from_s, until_s)]
        due += [
            ScheduledDatagram(t, next(self._order), UNKNOWN_SENDER, "garbage", poison(self._rng, self._good))
            for t in _moments(plan.garbage_hz, from_s, until_s)
        ]
        return due

    def _text(self, t: float) -> ScheduledDatagram:
        number = next(self._texts)
        at = min(1, len(self._encoders) - 1)
        words = HOSTILE_TEXTS[number % len(HOSTILE_TEXTS)].encode("utf-8", "replace")[:50]
        raw = self._encoders[at].frame(self._start_us + int(t * 1e6), TEXT, number % 8, words)
        return ScheduledDatagram(t, next(self._order), at, "texts", raw)


def _moments(rate_hz: float, from_s: float, until_s: float) -> list[float]:
    if rate_hz <= 0:
        return []
    return [n / rate_hz for n in range(math.ceil(from_s * rate_hz), math.ceil(until_s * rate_hz))]
