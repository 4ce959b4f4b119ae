"""Message rates: measured, compared with what is wanted, and requested where that is allowed.

Requests go to the UAV alone; a ground vehicle's rates are measured, and a hint names the parameter to set on it. Each
message is requested by SET_MESSAGE_INTERVAL, one at a time because the answer does not name the message, and again
until the rate is reached; what the autopilot rejects is requested as a stream by the older REQUEST_DATA_STREAM.
"""

from __future__ import annotations

import math
import threading
from collections import deque
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Literal

from infra.reporting import Hysteresis
from mavlink.protocol.dialect import message_name
from mavlink.protocol.encoder import MavlinkEncoder
from mavlink.protocol.packet import Auth, Packet
from mavlink.reception.packet_loss import PacketLoss
from mavlink.state import SILENT_S
from mavlink.transmit.rate_requests import (
    ATTITUDE,
    COMMAND_ACK,
    DISTANCE_SENSOR,
    GIMBAL_ATTITUDE,
    GLOBAL_POSITION_INT,
    GPS_RAW_INT,
    PARAMETERS,
    STREAMS,
    SYSTEM_TIME,
    TERRAIN_REPORT,
    interval_answer,
    interval_request,
    stream_request,
)
from mavlink.transmit.transmitter import SYSTEM_ID

UAV_RATES: Mapping[int, float] = {
    ATTITUDE: 30.0,
    GLOBAL_POSITION_INT: 10.0,
    GIMBAL_ATTITUDE: 10.0,
    GPS_RAW_INT: 1.0,
    SYSTEM_TIME: 1.0,
    DISTANCE_SENSOR: 2.0,
    TERRAIN_REPORT: 1.0,
}
"""message id → Hz that the UAV has to send for vehicles to be identified in the video."""
UGV_RATES: Mapping[int, float] = {GLOBAL_POSITION_INT: 5.0}
"""Equivalent of ``UAV_RATES`` for a ground vehicle."""

_DENIED, _UNSUPPORTED, _FAILED = 2, 3, 4
"""MAV_RESULT of a request that was rejected."""
ENOUGH = 0.7
"""Share of the wanted rate that is good enough: vehicles round to what their loop can do, and radios lose some."""
TRIES = 5
"""Requests for one message before it is given up."""
WINDOW_S = 3.0
"""Rates are measured over this: at 1 Hz there are three messages in it."""
ANSWER_S = 1.0
"""An answer that has not come within this is lost."""
LASTS_S = 5.0
"""A rate is low for this long before it is reported: a pause of the link is in what is measured for three seconds."""
CALM_S = 30.0
"""Time that it must be better before the next report, or one near the limit would be a line every ten seconds."""
AGAIN_S = 4.0
"""Seconds between two requests for one message: its rate has to be measured meanwhile."""
BEHIND_S = 10.0
"""Time after a packet that was rejected as replayed in which a link's rates are not judged."""
PAUSE_S = 1.5
"""A link that brings nothing at all for this long is interrupted: that is no sign of a low rate."""
LOSS_MEMORY = 50.0
"""Packets over which the loss of a link is measured: a few seconds."""
LOSSY = 0.1
"""Share of packets lost from which on the link is named as the cause of a low rate."""
_WHERE_THERE_IS_ONE = frozenset({GIMBAL_ATTITUDE, SYSTEM_TIME, DISTANCE_SENSOR, TERRAIN_REPORT})
"""Messages of equipment that a vehicle need not have: one that never came is not reported."""
_REBOOT_MS, _YOUNG_MS = 2000, 60_000
"""A boot time that is this much less than before, and less than a minute, is one after a reboot."""
State = Literal["ok", "measuring", "asked", "refused", "not reached", "too slow"]


def uav_rates(*, gimbal: bool) -> Mapping[int, float]:
    """Rates wanted of a UAV, with those of its gimbal where it reports the camera's direction."""
    return UAV_RATES if gimbal else {message: hz for message, hz in UAV_RATES.items() if message != GIMBAL_ATTITUDE}


@dataclass(frozen=True, slots=True, kw_only=True)
class Rate:
    """One message of one vehicle on one link."""

    system_id: int
    link: int
    message: str
    wanted_hz: float
    measured_hz: float
    state: State
    hint: str = ""
    """Advice for the operator, empty for nothing."""

    @property
    def words(self) -> str:
        """``GLOBAL_POSITION_INT comes at 1.0 of 5 Hz: ...``."""
        comes = f"comes at {self.measured_hz:.1f} of {self.wanted_hz:g} Hz" if self.measured_hz else "does not come"
        return f"{self.message} {comes}: {self.hint}"


class _MessageStream:
    """Arrivals of one message, and how it was requested."""

    def __init__(self) -> None:
        self.arrivals: deque[float] = deque(maxlen=256)
        self.ever = False
        self.restart()

    def restart(self) -> None:
        """Begin again, as if it was never requested."""
        self.tries = 0
        self.due_s = 0.0
        self.rejected = False

    def hz(self, now_s: float) -> float:
        """Rate over the last seconds, Hz: by the intervals, but no more than by the count, which falls when a stream
        ends."""
        while self.arrivals and self.arrivals[0] < now_s - WINDOW_S:
            self.arrivals.popleft()
        count = len(self.arrivals)
        if count < 2:
            return count / WINDOW_S
        by_count = count / max(now_s - self.arrivals[0], 1.0)
        span_s = self.arrivals[-1] - self.arrivals[0]
        return min((count - 1) / span_s, by_count) if span_s > 0.0 else by_count


class _VehicleLink:
    """One vehicle on one link."""

    def __init__(self, wanted: Mapping[int, float], now_s: float) -> None:
        self.since_s = self.newest_s = now_s
        self.behind_s = -math.inf  # when a packet was rejected because another link had brought newer ones
        self.boot_ms = 0
        self.loss = PacketLoss(half_life=LOSS_MEMORY)
        self.streams = {message_id: _MessageStream() for message_id in wanted}
        self.requested: int | None = None
        self.requested_s = -math.inf

    def restart(self, now_s: float) -> None:
        """Forget the answers: after a reboot or a silence everything may have to be requested again."""
        self.since_s, self.requested = now_s, None
        for stream in self.streams.values():
            stream.restart()


class MessageRates:
    """Rates of a fleet. One thread may add packets while another polls.

    Args:
        encoder: this station; None measures only.
        own: its system id, to which answers are addressed.
        uav: system id of the UAV, the only one that gets requests.
        ground: system ids of the ground vehicles.
        uav_rates: message id → Hz wanted of the UAV.
    """

    def __init__(
        self,
        encoder: MavlinkEncoder | None,
        uav: int,
        ground: Collection[int] = (),
        *,
        own: int = SYSTEM_ID,
        uav_rates: Mapping[int, float] = UAV_RATES,
        ugv_rates: Mapping[int, float] = UGV_RATES,
    ) -> None:
        self._encoder = encoder
        self._own = own
        self._uav = uav
        self._ugv_rates = ugv_rates
        self._wanted = {**dict.fromkeys(ground, ugv_rates), uav: uav_rates}
        self._lock = threading.Lock()
        self._peers: dict[tuple[int, int], _VehicleLink] = {}
        self._low_rates: dict[tuple[int, int, str], Hysteresis] = {}

    def add_wanted(self, message_id: int, hz: float) -> None:
        """Add a message that is wanted of the UAV from now on."""
        with self._lock:
            self._wanted[self._uav] = {**self._wanted[self._uav], message_id: hz}
            for (system_id, _), peer in self._peers.items():
                if system_id == self._uav:
                    peer.streams.setdefault(message_id, _MessageStream())

    def set_ground(self, ground: Collection[int]) -> None:
        """Measure these ground vehicles from now on, as those before."""
        with self._lock:
            uav_rates = self._wanted[self._uav]
            self._wanted = {**dict.fromkeys(ground, self._ugv_rates), self._uav: uav_rates}
            self._peers = {key: peer for key, peer in self._peers.items() if key[0] in self._wanted}

    def add_packet(self, packet: Packet, now_s: float) -> None:
        """Count a packet, and read the UAV's answers."""
        wanted = self._wanted.get(packet.system_id)
        if wanted is None:
            return
        with self._lock:
            if packet.auth <= Auth.GOOD:
                self._count(packet, wanted, now_s)
            elif packet.auth is Auth.REPLAYED and (peer := self._peers.get((packet.system_id, packet.link))):
                peer.behind_s = now_s

    def _count(self, packet: Packet, wanted: Mapping[int, float], now_s: float) -> None:
        peer = self._peers.get((packet.system_id, packet.link))
        if peer is None:
            peer = self._peers[packet.system_id, packet.link] = _VehicleLink(wanted, now_s)
        booted_ms = packet.boot_ms
        # a packet that came late over another link is no reboot, whose count starts at 0
        rebooted = 0 < booted_ms < _YOUNG_MS and booted_ms + _REBOOT_MS < peer.boot_ms
        if now_s - peer.newest_s > SILENT_S or rebooted:
            peer.restart(now_s)
            peer.boot_ms = 0
        peer.boot_ms, peer.newest_s = max(peer.boot_ms, booted_ms), now_s
        peer.loss.add(packet, packet.message_id)
        if (stream := peer.streams.get(packet.message_id)) is not None:
            stream.arrivals.append(now_s)
            stream.ever = True
        elif packet.message_id == COMMAND_ACK and packet.system_id == self._uav:
            self._add_answer(peer, packet)

    def poll(self, now_s: float) -> list[tuple[int, bytes]]:
        """Requests that are due, each with its link; only to the UAV, and for one message at a time on each link."""
        if self._encoder is None:
            return []
        due: list[tuple[int, bytes]] = []
        with self._lock:
            for (system_id, link), peer in self._peers.items():
                if system_id == self._uav and now_s - peer.newest_s <= SILENT_S:
                    due += ((link, raw) for raw in self._next_request(self._encoder, peer, now_s))
        return due

    def rates(self, now_s: float) -> tuple[Rate, ...]:
        """Every wanted message of every vehicle on every link on which it was received, the UAV's first."""
        with self._lock:
            order = sorted(self._peers, key=lambda key: (key[0] != self._uav, *key))
            return tuple(
                self._rate(system_id, link, message_id, hz, now_s)
                for system_id, link in order
                for message_id, hz in self._wanted[system_id].items()
            )

    def troubles(self, now_s: float) -> list[Rate]:
        """Rates that have been low for a while and that an operator can raise.

        Each is reported once until it is well again, and once more when the message ceases.
        """
        fresh = []
        for rate in self.rates(now_s):
            if rate.state == "ok" or rate.hint:
                low_rate = self._low_rates.setdefault(
                    (rate.system_id, rate.link, rate.message), Hysteresis(rises_after=LASTS_S, falls_after=CALM_S)
                )
                worse = 0 if rate.state == "ok" else 1 if rate.measured_hz else 2
                if low_rate.rises(worse, now_s):
                    fresh.append(rate)
        return fresh

    def _next_request(self, encoder: MavlinkEncoder, peer: _VehicleLink, now_s: float) -> list[bytes]:
        if now_s - peer.since_s < WINDOW_S or (peer.requested is not None and now_s - peer.requested_s < ANSWER_S):
            return []
        peer.requested = None
        for message_id, wanted_hz in self._wanted[self._uav].items():
            stream = peer.streams[message_id]
            if stream.hz(now_s) >= ENOUGH * wanted_hz:
                stream.tries = 0
                continue
            if stream.tries >= TRIES or now_s < stream.due_s:
                continue
            stream.tries, stream.due_s = stream.tries + 1, now_s + AGAIN_S
            peer.requested_s = now_s
            if stream.rejected:
                return [stream_request(encoder, self._uav, message_id, wanted_hz)]
            peer.requested = message_id
            return [interval_request(encoder, self._uav, message_id, wanted_hz)]
        return []

    def _add_answer(self, peer: _VehicleLink, packet: Packet) -> None:
        result = interval_answer(packet, self._own)
        if result is None or peer.requested is None:
            return
        message_id, peer.requested = peer.requested, None
        if result in (_DENIED, _UNSUPPORTED, _FAILED):
            stream = peer.streams[message_id]
            stream.rejected, stream.due_s = True, 0.0
            stream.tries = stream.tries if message_id in STREAMS else TRIES

    def _rate(self, system_id: int, link: int, message_id: int, wanted_hz: float, now_s: float) -> Rate:
        peer = self._peers[system_id, link]
        stream = peer.streams[message_id]
        measured_hz = stream.hz(now_s)
        state, hint = _judge(stream, measured_hz, wanted_hz, asks=self._encoder is not None and system_id == self._uav)
        unsettled = now_s - peer.since_s < WINDOW_S or now_s - peer.newest_s > PAUSE_S
        if state != "ok" and (unsettled or now_s - peer.behind_s < BEHIND_S):
            state, hint = "measuring", ""
        if not stream.ever and message_id in _WHERE_THERE_IS_ONE:
            hint = ""
        elif state == "too slow":
            lost = peer.loss.share
            sent_hz = measured_hz / max(1.0 - lost, 0.01)
            if lost > LOSSY and sent_hz >= ENOUGH * wanted_hz:
                hint = f"{lost:.0%} of its packets are lost on this link"
            else:
                hint = _hint(message_id, wanted_hz, ground=system_id != self._uav)
        return Rate(
            system_id=system_id,
            link=link,
            message=message_name(message_id),
            wanted_hz=wanted_hz,
            measured_hz=measured_hz,
            state=state,
            hint=hint,
        )


def _judge(stream: _MessageStream, measured_hz: float, wanted_hz: float, *, asks: bool) -> tuple[State, str]:
    if measured_hz >= ENOUGH * wanted_hz:
        return "ok", ""
    if not asks:
        return "too slow", ""
    if stream.tries < TRIES:
        return "asked", ""
    if stream.rejected:
        return "refused", "the autopilot refuses this rate: it may not have the sensor, or the link's budget is used up"
    return "not reached", f"asked {TRIES} times: the link may be too slow for it, or another station asks for less"


def _hint(message_id: int, wanted_hz: float, *, ground: bool) -> str:
    parameter = PARAMETERS.get(message_id, "")
    names = f"SRx_{parameter}, from 4.7 on MAVx_{parameter}"
    px4 = f"PX4: mavlink stream -s {message_name(message_id)} -r {wanted_hz:g} on its console"
    how = f"set its rate (ArduPilot: {names}, = {wanted_hz:g} of that serial port; {px4})" if parameter else ""
    if ground:
        return f"a ground vehicle is never asked: {how or 'ask whoever drives it for more'}"
    return f"the station listens only: --command lets it ask, or {how or 'ask for more elsewhere'}"
