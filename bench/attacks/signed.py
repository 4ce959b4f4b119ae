"""Signed fleets whose stamps are those of real autopilots, and recordings of them that are played again."""

from __future__ import annotations

import csv
import threading
from collections.abc import Callable, Set
from contextlib import ExitStack, closing
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from bench.attacks.actors import DATED, FULL, UAV_ID, Body, rover, uav, vehicle_schedules
from bench.attacks.records import (
    LoggedEvent,
    estimates_of,
    first_warning,
    fold_recording,
    frames,
    read_events,
    sender_of,
)
from bench.attacks.report import AttackRow
from bench.attacks.run import PROMISE_S, SLACK_S, Options
from bench.attacks.stage import FALSE, TRUE, PacketSchedule, Party, SenderFactory, Stage, StageCounts
from bench.attacks.wire import ComponentEncoder, ticks_now
from bench.ports import free_port
from bench.station import FlyingStation, StationError, key_of, mission_text, write_keys

DAY_S = 86_400.0
LATE_S = 20.0
FLY_S = 8.0
CYCLE_S, OFF_S = 11.0, 2.0
"""When a vehicle is switched off, and for how long."""
PAUSE_S = 4.0
"""Between the end of a flight and the next start."""
MOST_REPLAYED = 400
RETRY_S = 10.0
"""A flight that was killed may hold its port for a moment."""
BOOT_AHEAD_S = 60.0
"""ArduPilot adds a minute to the stamp that it had kept, at each start."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StampClock:
    """How one vehicle stamps."""

    name: str
    system_id: int
    ahead_s: float
    """Of the time, when the station starts."""
    runs: bool
    """With the time; else it takes one unit for each packet, as ArduPilot's does while armed and alone."""
    recorded: bool = False
    """It is no vehicle, but a recording of one that is switched off."""
    dated: bool = True
    """It sends SYSTEM_TIME."""
    cycled: bool = False
    """It is switched off and on in flight, and boots with its stamp a minute on."""

    def encoder(self) -> ComponentEncoder:
        return ComponentEncoder(self.system_id, key=key_of(self.system_id), stamp=ticks_now(self.ahead_s))

    def tick(self, encoder: ComponentEncoder) -> Callable[[float], None]:
        """Sets the stamp ahead of each packet."""

        def set_stamp(t_s: float) -> None:
            if self.runs:
                encoder.stamp = max(encoder.stamp + 1, ticks_now(self.ahead_s))

        return set_stamp


LATE = (
    StampClock(name="ArduPilot armed, 110 s behind", system_id=11, ahead_s=-110.0, runs=False),
    StampClock(name="ArduPilot armed, 150 s behind", system_id=12, ahead_s=-150.0, runs=False),
    StampClock(name="ArduPilot armed, 195 s behind", system_id=13, ahead_s=-195.0, runs=False),
    StampClock(
        name="ArduPilot armed, 150 s behind, without SYSTEM_TIME", system_id=20, ahead_s=-150.0, runs=False, dated=False
    ),
    StampClock(name="PX4, the time itself", system_id=14, ahead_s=0.0, runs=True),
    StampClock(name="ArduPilot disarmed, a minute ahead", system_id=15, ahead_s=BOOT_AHEAD_S - 0.5, runs=True),
    StampClock(name="ArduPilot, switched off and on", system_id=18, ahead_s=-30.0, runs=False, cycled=True),
    StampClock(
        name="ArduPilot armed, 150 s behind, switched off and on", system_id=19, ahead_s=-150.0, runs=False, cycled=True
    ),
    StampClock(name="hostile: a recording of yesterday", system_id=16, ahead_s=-DAY_S, runs=True, recorded=True),
    StampClock(name="hostile: a recording of an hour ago", system_id=17, ahead_s=-3600.0, runs=True, recorded=True),
    StampClock(
        name="hostile: a recording of three minutes ago", system_id=21, ahead_s=-180.0, runs=True, recorded=True
    ),
)
STEADY = (
    StampClock(name="ArduPilot armed", system_id=11, ahead_s=0.0, runs=False),
    *(clock for clock in LATE if clock.system_id in (14, 15)),
)


def _lines(new_sender: SenderFactory, clocks: tuple[StampClock, ...]) -> list[PacketSchedule]:
    found = []
    for clock in (StampClock(name="UAV", system_id=UAV_ID, ahead_s=0.0, runs=True), *clocks):
        encoder, send = clock.encoder(), new_sender()
        body: Body = uav() if clock.system_id == UAV_ID else rover(clock.system_id)
        if clock.recorded:
            body = replace(body, date_s=clock.ahead_s)
        role = FALSE if clock.recorded else TRUE
        messages = DATED if clock.dated else FULL
        stop_s = CYCLE_S if clock.cycled else float("inf")
        found += vehicle_schedules(
            body, encoder, send, role, messages=messages, before=clock.tick(encoder), stop_s=stop_s
        )
        if clock.cycled:
            again = replace(clock, ahead_s=clock.ahead_s + BOOT_AHEAD_S)
            booted = replace(body, boot_s=-CYCLE_S - OFF_S)
            found += vehicle_schedules(
                booted, again.encoder(), new_sender(), role, messages=messages, start_s=CYCLE_S + OFF_S
            )
    return found


@dataclass(frozen=True, slots=True, kw_only=True)
class Judged:
    """One vehicle in one session."""

    sent: int
    refused: int
    believed_after_s: float
    """From its first record; inf never."""
    sure_s: float


@dataclass(frozen=True, kw_only=True)
class SessionVerdicts:
    """One session of a signed fleet."""

    python: str
    """Interpreter of the station that recorded it."""
    folder: Path
    sent: StageCounts

    @cached_property
    def refused(self) -> set[int]:
        """Numbers of the records that were not accepted."""
        return refused_records(self.folder)

    @cached_property
    def _folded(self) -> list[dict[str, Any]]:
        return fold_recording(self.python, self.folder, self.sent)

    def judge(self, system_id: int, since_s: float = 0.0, again: Set[bytes] = frozenset()) -> Judged:
        """What became of a vehicle's packets since a time of the stage, without those that were sent again."""
        since_us = self.sent.start_us + since_s * 1e6
        its = [
            (number, t_us)
            for number, (t_us, raw) in enumerate(frames(self.folder))
            if sender_of(raw) == system_id and raw not in again and t_us >= since_us
        ]
        refused = sum(number in self.refused for number, _ in its)
        first_s = (its[0][1] - self.sent.start_us) * 1e-6 if its else float("inf")
        sure = [b for b in estimates_of(self._folded, system_id) if b.used and b.t_s >= first_s]
        # five times a second is looked: what was so at the first look is so at once
        after_s = max(sure[0].t_s - first_s - 0.2, 0.0) if sure else float("inf")
        return Judged(sent=len(its), refused=refused, believed_after_s=after_s, sure_s=len(sure) / 5.0)


def refused_records(session: Path) -> set[int]:
    """Numbers of the records that were not accepted."""
    found: set[int] = set()
    for path in session.glob("refused*.csv"):
        with path.open(newline="") as file:
            found |= {int(row["record"]) for row in csv.DictReader(file)}
    return found


def _row(attack: str, case: str, judged: Judged, hostile: bool) -> AttackRow:
    if hostile:
        return AttackRow(
            attack=attack,
            case=case,
            false_sent=judged.sent,
            false_recorded=judged.sent,
            believed_s=judged.sure_s,
            held=judged.refused == judged.sent > 0 and not judged.sure_s,
            note=f"{judged.sent - judged.refused} not refused",
        )
    after_s = judged.believed_after_s
    note = f"believed after {after_s:.1f} s" if judged.sure_s else "never believed"
    return AttackRow(
        attack=attack,
        case=case,
        sent=judged.sent,
        lost=judged.refused,
        held=after_s <= PROMISE_S + SLACK_S,
        note=f"{note}, {judged.refused:,} refused",
    )


def late_start(options: Options) -> list[AttackRow]:
    """A signed fleet that was armed long before the station starts: stamps that do not advance, minutes behind."""
    port, ids = free_port(), [clock.system_id for clock in LATE]
    keys = write_keys(options.folder / "keys-late", (UAV_ID, *ids))
    with ExitStack() as stack:
        new_sender = stack.enter_context(closing(SenderFactory(port)))
        station = FlyingStation(
            options.gcs, options.folder / "late", mission_text(ids, str(keys)), [f"udpin:127.0.0.1:{port}"]
        )
        stack.callback(station.kill)
        stage = Stage(_lines(new_sender, LATE))
        stage.start()
        stack.callback(stage.stop)
        stage.wait(LATE_S)
        station.end()
        events = read_events(station.session, stage.sent)
        verdicts = SessionVerdicts(python=options.python, folder=station.session, sent=stage.sent)
        return [_late_row(verdicts, clock, events) for clock in LATE]


def _late_row(verdicts: SessionVerdicts, clock: StampClock, events: list[LoggedEvent]) -> AttackRow:
    """Who proves nothing, not even with a date, is as good as a recording: that has to be reported."""
    judged = verdicts.judge(clock.system_id, CYCLE_S + OFF_S if clock.cycled else 0.0)
    row = _row("signed, late start", clock.name, judged, clock.recorded)
    alarm = first_warning(events, "sign|recording", clock.system_id)
    if judged.refused < judged.sent / 2:
        return replace(row, held=False, note=f"{row.note}; false alarm: {alarm.text}") if alarm else row
    row = replace(row, note=f"{row.note}; told: {alarm.text if alarm else 'nothing'}")
    return row if clock.dated else replace(row, held=alarm is not None)


def restarts(options: Options) -> list[AttackRow]:
    """A signed fleet whose station is killed and started again, then ended and started again; with replays."""
    port, ids = free_port(), [clock.system_id for clock in STEADY]
    keys = write_keys(options.folder / "keys-restart", (UAV_ID, *ids))
    earlier: list[bytes] = []
    flying = threading.Event()

    def keep(t_s: float, party: Party, raw: bytes) -> None:
        if party[0] == TRUE and flying.is_set() and len(earlier) < MOST_REPLAYED:
            earlier.append(raw)

    rows = []
    with ExitStack() as stack:
        new_sender = stack.enter_context(closing(SenderFactory(port)))
        stage = Stage(_lines(new_sender, STEADY), keep)
        stage.start()
        stack.callback(stage.stop)
        for after in ("", "a crash", "a clean end"):
            station = _started(options, stage, mission_text(ids, str(keys)), port)
            stack.callback(station.kill)
            begun_s = stage.now_s
            flying.set()
            if after:
                send = new_sender()
                for raw in earlier:
                    send(raw)
            stage.wait(begun_s + FLY_S)
            if not after:
                station.kill()
                stage.wait(stage.now_s + PAUSE_S)
                continue
            station.end()
            stage.wait(stage.now_s + PAUSE_S)
            again = set(earlier)
            verdicts = SessionVerdicts(python=options.python, folder=station.session, sent=stage.sent)
            for clock in STEADY:
                judged = verdicts.judge(clock.system_id, again=again)
                rows.append(_row("signed, restart", f"{clock.name}, after {after}", judged, hostile=False))
            rows.append(_replayed_row(station.session, again, f"hostile: frames of the first flight, after {after}"))
    return rows


def _started(options: Options, stage: Stage, mission: str, port: int) -> FlyingStation:
    """A flight on a port that the one before may still hold for a moment."""
    until_s = stage.now_s + RETRY_S
    while True:
        try:
            return FlyingStation(options.gcs, options.folder / "restart", mission, [f"udpin:127.0.0.1:{port}"])
        except StationError:
            if stage.now_s > until_s:
                raise
            stage.wait(stage.now_s + 0.5)


def _replayed_row(session: Path, packets: Set[bytes], case: str) -> AttackRow:
    numbers = refused_records(session)
    found = [number for number, (_, raw) in enumerate(frames(session)) if raw in packets]
    believed = sum(number not in numbers for number in found)
    return AttackRow(
        attack="signed, restart",
        case=case,
        false_sent=len(packets),
        false_recorded=len(found),
        held=bool(found) and not believed,
        note=f"{believed} of them believed",
    )


DELAYS_S = {11: 5.0, 14: 20.0}
"""By system id, how long its packets are kept before they are played again."""
SLOW_S = 12.0
"""A slow link may be late by as much: until then it is no alarm, but refused all the same."""


def replayed(options: Options) -> list[AttackRow]:
    """Signed packets that come again from another address, 5 or 20 s later: refused, and reported as replays."""
    port, ids = free_port(), [clock.system_id for clock in STEADY]
    keys = write_keys(options.folder / "keys-replay", (UAV_ID, *ids))
    waiting: dict[int, list[tuple[float, bytes]]] = {system_id: [] for system_id in DELAYS_S}

    def keep(t_s: float, party: Party, raw: bytes) -> None:
        if party[0] == TRUE and party[1] in DELAYS_S:
            waiting[party[1]].append((t_s, raw))

    def again(system_id: int) -> Callable[[float], list[bytes]]:
        def due(t_s: float) -> list[bytes]:
            found = []
            while waiting[system_id] and waiting[system_id][0][0] <= t_s - DELAYS_S[system_id]:
                found.append(waiting[system_id].pop(0)[1])
            return found

        return due

    with ExitStack() as stack:
        new_sender = stack.enter_context(closing(SenderFactory(port)))
        lines = [PacketSchedule(party=(FALSE, i), make=again(i), send=new_sender(), rate_hz=50.0) for i in DELAYS_S]
        stage = Stage([*_lines(new_sender, STEADY), *lines], keep)
        station = FlyingStation(
            options.gcs, options.folder / "replay", mission_text(ids, str(keys)), [f"udpin:127.0.0.1:{port}"]
        )
        stack.callback(station.kill)
        stage.start()
        stack.callback(stage.stop)
        stage.wait(30.0)
        sent = stage.stop()
        station.end()
        events = read_events(station.session, sent)
        return [_again_row(station.session, sent, system_id, events) for system_id in DELAYS_S]


def _again_row(session: Path, sent: StageCounts, system_id: int, events: list[LoggedEvent]) -> AttackRow:
    """Of each packet the first record is the vehicle's and the next one is the copy."""
    numbers, seen = refused_records(session), set[bytes]()
    lost = copies = believed = 0
    for number, (_, raw) in enumerate(frames(session)):
        if sender_of(raw) == system_id:
            lost += raw not in seen and number in numbers
            copies += raw in seen
            believed += raw in seen and number not in numbers
            seen.add(raw)
    alarm = first_warning(events, "recording|replay|played again", system_id)
    late_s = DELAYS_S[system_id]
    after_s = alarm.t_s - sent.first_s[FALSE, system_id] if alarm else float("nan")
    note = f"{believed} believed" + (f"; told: {alarm.text}" if alarm else "; nothing told")
    return AttackRow(
        attack="signed, replayed",
        case=f"{late_s:g} s later, from another address",
        sent=sent.count[TRUE, system_id],
        lost=lost,
        false_sent=sent.count[FALSE, system_id],
        false_recorded=copies,
        alarm_s=after_s,
        held=copies > 0 and not believed and not lost and (alarm is not None or late_s <= SLOW_S),
        note=note,
    )
