"""Two senders of one system id, and single ones that must not be taken for two."""

from __future__ import annotations

import heapq
import itertools
import json
import random
import subprocess
import sys
from dataclasses import dataclass, replace

from bench.attacks.actors import DATED, Body, rover, uav, vehicle_schedules
from bench.attacks.records import first_warning, frames, read_events, sender_of
from bench.attacks.report import AttackRow
from bench.attacks.run import PROMISE_S, SLACK_S, Flown, Options, false_position_s, fly
from bench.attacks.stage import FALSE, PacketSchedule, Send, SenderFactory, StageCounts
from bench.attacks.takeover import CONTEST
from bench.attacks.wire import ComponentEncoder
from bench.ports import free_port
from bench.station import FlyingStation, mission_text

BEGIN_S = 5.0
"""When second senders begin: the true ones are known by then."""
FROM_BOOT = -BEGIN_S
"""As a boot clock: it is switched on when it begins."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Twin:
    """A second vehicle with the id of another."""

    clock_s: float
    """Its boot clock minus the true one's; NaN: it is switched on as it begins."""
    apart_m: float
    rate_hz: float = 5.0
    """Of its positions."""

    @property
    def name(self) -> str:
        clock = "clock from zero" if self.clock_s != self.clock_s else f"clock {self.clock_s:+g} s"
        return f"{clock}, {self.apart_m:g} m, {self.rate_hz:g} Hz"


NAN = float("nan")
TWO_SENDERS = r"two senders|several senders|contest"
TWINS = (
    Twin(clock_s=0.0, apart_m=245.0),
    Twin(clock_s=-58.0, apart_m=245.0),
    Twin(clock_s=58.0, apart_m=245.0),
    Twin(clock_s=NAN, apart_m=245.0),
    Twin(clock_s=-0.5, apart_m=30.0),
    Twin(clock_s=0.5, apart_m=1000.0, rate_hz=10.0),
    Twin(clock_s=-3.0, apart_m=100.0, rate_hz=2.0),
    Twin(clock_s=-10.0, apart_m=10_000.0),
    Twin(clock_s=10.0, apart_m=50.0, rate_hz=10.0),
    Twin(clock_s=-120.0, apart_m=50.0),
    Twin(clock_s=120.0, apart_m=1000.0, rate_hz=2.0),
    Twin(clock_s=-30.0, apart_m=30.0, rate_hz=10.0),
)


def duplicates(options: Options) -> list[AttackRow]:
    """A second vehicle with the same id: a grid of boot clocks, distances and rates."""
    ids = {11 + k: twin for k, twin in enumerate(TWINS)}

    def lines(new_sender: SenderFactory) -> list[PacketSchedule]:
        found = vehicle_schedules(uav(), ComponentEncoder(1), new_sender())
        for system_id, twin in ids.items():
            body = rover(system_id, boot_s=300.0)
            found += vehicle_schedules(body, ComponentEncoder(system_id), new_sender())
            boot_s = FROM_BOOT if twin.clock_s != twin.clock_s else body.boot_s + twin.clock_s
            other = replace(body.moved(twin.apart_m), boot_s=boot_s, phase=body.phase + 1.0)
            found += vehicle_schedules(
                other,
                ComponentEncoder(system_id),
                new_sender(),
                FALSE,
                rates_hz={"position": twin.rate_hz},
                start_s=BEGIN_S,
            )
        return found

    flown = fly(options, "duplicates", list(ids), lines, 15.0 if options.quick else 25.0)
    return [*(_judge_twin(flown, system_id, twin) for system_id, twin in ids.items()), _documented(options)]


def _documented(options: Options) -> AttackRow:
    """The fleet with an impostor that docs/operations.md shows: both send from the start."""
    port, system_id = free_port(), 13
    words = [sys.executable, "-m", "sim.fleet_process", "--vehicles", "8", "--duplicate", str(system_id)]
    ids = range(11, 18)
    station = FlyingStation(options.gcs, options.folder / "documented", mission_text(ids), [f"udpin:127.0.0.1:{port}"])
    try:
        done = subprocess.run(
            [*words, "--to", f"127.0.0.1:{port}", "--duration", "10"],
            capture_output=True,
            text=True,
            check=True,
            timeout=60.0,
        )
    finally:
        station.end()
    packets: dict[str, int] = json.loads(done.stdout)["packets"]
    sent, false = packets[str(system_id)], packets[f"impostor {system_id}"]
    times_us = [t_us for t_us, raw in frames(station.session) if sender_of(raw) == system_id]
    alarm = first_warning(read_events(station.session, StageCounts(start_us=times_us[0])), TWO_SENDERS, system_id)
    return AttackRow(
        attack="duplicates",
        case="the fleet of docs/operations.md",
        sent=sent,
        lost=sent + false - len(times_us),
        false_sent=false,
        false_recorded=min(false, len(times_us)),
        alarm_s=alarm.t_s if alarm else NAN,
        held=alarm is not None and alarm.t_s <= PROMISE_S + SLACK_S,
        note="" if alarm else "no alarm",
    )


def _judge_twin(flown: Flown, system_id: int, twin: Twin) -> AttackRow:
    begin_s = flown.sent.first_s[FALSE, system_id]
    alarm = first_warning(flown.events, TWO_SENDERS, system_id)
    after_s = alarm.t_s - begin_s if alarm else NAN
    true = rover(system_id, boot_s=300.0)
    since_s = begin_s + PROMISE_S + SLACK_S
    wrong_s = false_position_s(flown.estimates(system_id), true, twin.apart_m, since_s, flown.flown_s)
    held = 0.0 <= after_s <= PROMISE_S + SLACK_S and wrong_s == 0.0
    return AttackRow(
        attack="duplicates",
        case=twin.name,
        **flown.counts(system_id),
        believed_s=wrong_s,
        alarm_s=after_s,
        held=held,
        note="" if alarm else "no alarm",
    )


class Echo:
    """A second link that brings the same packets again: late, with losses, out of order.

    Args:
        send: of the first link.
        delay_s: by which the second is later.
        loss: share of packets that it loses.
        jitter_s: by which packets are further late, each by another time: they overtake one another.
    """

    def __init__(self, send: Send, delay_s: float, loss: float, jitter_s: float) -> None:
        self._send, self._delay_s, self._loss, self._jitter_s = send, delay_s, loss, jitter_s
        self._now_s = 0.0
        self._order = itertools.count()
        self._waiting: list[tuple[float, int, bytes]] = []
        self._rng = random.Random(1)

    def send(self, raw: bytes) -> None:
        """As the first link."""
        self._send(raw)
        if self._rng.random() >= self._loss:
            late_s = self._delay_s + self._rng.random() * self._jitter_s
            heapq.heappush(self._waiting, (self._now_s + late_s, next(self._order), raw))

    def due(self, t_s: float) -> list[bytes]:
        """What the second link brings now."""
        self._now_s = t_s
        found = []
        while self._waiting and self._waiting[0][0] <= t_s:
            found.append(heapq.heappop(self._waiting)[2])
        return found


@dataclass(frozen=True, slots=True, kw_only=True)
class SecondLink:
    """How a vehicle's second link differs from the first."""

    delay_s: float
    copied: bool
    """The same bytes again, as a router sends them; else a radio of the autopilot's own, with counters of its own."""

    @property
    def name(self) -> str:
        return f"{'copies' if self.copied else 'own counters'}, {self.delay_s:g} s late"


DELAYS_S = (0.0, 0.05, 0.3, 1.0, 3.0, 10.0)
LINKS = tuple(SecondLink(delay_s=delay_s, copied=copied) for copied in (True, False) for delay_s in DELAYS_S)
LOSS = 0.1


def late_links(options: Options) -> list[AttackRow]:
    """Innocent: two links of one vehicle, the second 0 to 10 s late, with losses and reordering."""
    ids = {11 + k: link for k, link in enumerate(LINKS)}

    def lines(new_sender: SenderFactory, other: SenderFactory) -> list[PacketSchedule]:
        found = vehicle_schedules(uav(), ComponentEncoder(1), new_sender())
        for system_id, link in ids.items():
            body, second = rover(system_id), other()
            if link.copied:
                echo = Echo(new_sender(), link.delay_s, LOSS, jitter_s=0.3 * min(link.delay_s, 1.0))
                found += vehicle_schedules(body, ComponentEncoder(system_id), echo.send, messages=DATED)
                found.append(PacketSchedule(party=(FALSE, system_id), make=echo.due, send=second, rate_hz=100.0))
            else:
                found += vehicle_schedules(body, ComponentEncoder(system_id), new_sender(), messages=DATED)
                found += vehicle_schedules(
                    body,
                    ComponentEncoder(system_id),
                    second,
                    FALSE,
                    messages=DATED,
                    start_s=link.delay_s,
                    delay_s=link.delay_s,
                )
        return found

    flown = fly(options, "late-links", list(ids), lines, 18.0 if options.quick else 60.0, ports=2)
    return [_judge_quiet(flown, "late links", system_id, link.name) for system_id, link in ids.items()]


def _judge_quiet(flown: Flown, attack: str, system_id: int, case: str) -> AttackRow:
    """Of a vehicle that is all right: no alarm, accepted throughout."""
    alarms = [event for event in flown.events if event.loud and event.system_id == system_id and event.kind != "text"]
    seen = [estimate for estimate in flown.estimates(system_id) if estimate.t_s > 2.0]
    unsure_s = sum(not estimate.used for estimate in seen) / 5.0
    wrong_s = false_position_s(seen, rover(system_id), 10.0, 2.0, flown.flown_s)
    counts = flown.counts(system_id)
    note = f"told: {alarms[0].text}" if alarms else f"not believed for {unsure_s:.1f} s" if unsure_s >= 1.0 else ""
    held = not alarms and unsure_s < 1.0 and wrong_s == 0.0 and not counts["lost"]
    return AttackRow(attack=attack, case=case, **counts, believed_s=wrong_s, held=held, note=note)


class Jumping(Body):
    """A vehicle whose receiver is jammed: its estimate jumps between two places."""

    __slots__ = ()

    def at(self, t_s: float) -> tuple[float, float]:
        east, north = Body.at(self, t_s)
        return (east + JUMP_M, north) if t_s > BEGIN_S and t_s % 1.0 < 0.5 else (east, north)


JUMP_M = 111.0


def jammed(options: Options) -> list[AttackRow]:
    """Innocent: one receiver that jumps by 111 m twice a second is no second sender, but has an alarm."""
    steady = rover(11)
    jumping = Jumping(**{name: getattr(steady, name) for name in Body.__slots__})

    def lines(new_sender: SenderFactory) -> list[PacketSchedule]:
        found = vehicle_schedules(uav(), ComponentEncoder(1), new_sender())
        found += vehicle_schedules(jumping, ComponentEncoder(11), new_sender())
        return found + vehicle_schedules(rover(12), ComponentEncoder(12), new_sender())

    flown = fly(options, "jammed", [11, 12], lines, 15.0)
    wrong = first_warning(flown.events, CONTEST, 11)
    alarm = first_warning(flown.events, "position|jam|GPS", 11, BEGIN_S)
    after_s = alarm.t_s - BEGIN_S if alarm else NAN
    note = f"told as: {wrong.text}" if wrong else "" if alarm else "no alarm"
    held = wrong is None and after_s <= PROMISE_S + SLACK_S
    jumps = AttackRow(
        attack="jammed",
        case="jumps of 111 m from one address",
        **flown.counts(11),
        alarm_s=after_s,
        held=held,
        note=note,
    )
    return [jumps, _judge_quiet(flown, "jammed", 12, "the vehicle beside it")]
