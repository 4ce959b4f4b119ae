"""Telemetry of a fleet with faults, datagram by datagram in order of time."""

from __future__ import annotations

import heapq
import math
import random
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import count

import numpy as np

from mavlink.protocol.encoder import ARDUPILOT, COPTER, ROVER
from sim.faults.fault_frames import ATTITUDE, GPS, HEARTBEAT, POSITION, TEXT, SenderEncoder
from sim.faults.fault_texts import BOOT_WORDS, HOSTILE_TEXTS, poison
from sim.faults.fleet_faults import AGL_M, SimulatedFleet, SimulatedSender, places

__all__ = ["UNKNOWN_SENDER", "FaultTraffic", "ScheduledDatagram", "traffic"]

BATCH_S = 0.1
"""Datagrams are computed in spans of this length: a choice between memory and calls of numpy."""
REPLAY_AFTER_S = 10.0
"""A recorded frame is sent again after so long; a choice, well above any delay of a link."""
COPTER_GUIDED, ROVER_AUTO, ARMED_CUSTOM, ACTIVE = 4, 10, 129, 4
"""HEARTBEAT: ArduPilot's custom modes Guided (Copter) and Auto (Rover), base mode armed with a custom mode,
MAV_STATE_ACTIVE."""
UNKNOWN_SENDER = -1
"""Outlet of datagrams that are no vehicle's; ``-2 - k`` is that of part k's replayed frames."""


@dataclass(frozen=True, slots=True, order=True)
class ScheduledDatagram:
    """One thing to send; no bytes: the outlet gets a new source port."""

    t_s: float
    order: int
    outlet: int
    label: str
    raw: bytes


@dataclass(frozen=True, slots=True, kw_only=True)
class FaultTraffic:
    """How much of what."""

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
    """Everything, without end, by time since the start.

    Args:
        plan: what.
        start_us: Unix time of the start.
    """
    stage = _SenderCounters(plan, start_us)
    for batch in count():
        yield from stage.batch(batch * BATCH_S, (batch + 1) * BATCH_S)


class _SenderCounters:
    """The senders' counters."""

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
        """Everything of a tenth of a second."""
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
