"""Flights in which nothing is wrong: whatever alarm comes is a false one."""

from __future__ import annotations

import math
import re
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from bench.attacks.actors import DATED, rover, uav, vehicle_schedules
from bench.attacks.records import LoggedEvent, frames, read_events, sender_of
from bench.attacks.report import AttackRow
from bench.attacks.run import SLACK_S, Flown, Options, fly
from bench.attacks.stage import TRUE, PacketSchedule, Send, SenderFactory, Stage
from bench.attacks.wire import ComponentEncoder, redated
from bench.ports import free_port
from bench.station import FlyingStation

FLEET = tuple(range(11, 23))
EXPECTED = r"nothing is authenticated"
"""True of every flight without keys."""
RATES = {11: 0.3, 12: 0.5, 13: 0.9, 14: 0.97, 15: 1.0, 16: 2.0}
NOTICED_S, RATES_S = 20.0, 60.0
"""Time within which a clock at another rate is to be told of, and length of the flight."""
OF_THE_RECORDING = rf"{EXPECTED}|comes at .* Hz|the gimbal reports another direction"
"""True of it as well: its messages were thinned out, and its gimbal's reports differ from its mission file."""


def _false_alarms(events: Sequence[LoggedEvent], until_s: float, expected: str = EXPECTED) -> list[LoggedEvent]:
    loud = [event for event in events if event.loud and event.t_s < until_s and event.kind != "text"]
    return [event for event in loud if not re.search(expected, event.text)]


def healthy_fleet(options: Options) -> list[AttackRow]:
    """Innocent: a UAV and twelve vehicles that do nothing wrong, for --minutes."""

    def lines(new_sender: SenderFactory) -> list[PacketSchedule]:
        found = vehicle_schedules(uav(), ComponentEncoder(1), new_sender(), messages=DATED)
        for system_id in FLEET:
            found += vehicle_schedules(rover(system_id), ComponentEncoder(system_id), new_sender(), messages=DATED)
        return found

    flown: Flown = fly(options, "quiet", FLEET, lines, 60.0 * (0.25 if options.quick else options.minutes))
    false = _false_alarms(flown.events, flown.flown_s)
    sent = sum(count for party, count in flown.sent.count.items() if party[0] == TRUE)
    lost = sent - sum(count for party, count in flown.recorded.items() if party[0] == TRUE)
    unsure_s = sum(not b.used for i in FLEET for b in flown.estimates(i) if b.t_s > 2.0) / 5.0
    note = f"{flown.flown_s / 60:.1f} min, {len(false)} false alarms" + (f": {false[0].text}" if false else "")
    note += f"; not believed for {unsure_s:.1f} s" if unsure_s > 0.5 else ""
    note += f"; sender {flown.sent.late_s:.1f} s late" if flown.sent.late_s > 0.5 else ""
    return [
        AttackRow(attack="quiet", case="a healthy fleet", sent=sent, lost=lost, held=not false and not lost, note=note)
    ]


def slow_clocks(options: Options) -> list[AttackRow]:
    """Vehicles of simulators at 30 to 200 % of real time: told once and soon, and no position is lost from then on."""

    def lines(new_sender: SenderFactory) -> list[PacketSchedule]:
        found = vehicle_schedules(uav(), ComponentEncoder(1), new_sender(), messages=DATED)
        for system_id, rate in RATES.items():
            body = replace(rover(system_id), clock_rate=rate)
            found += vehicle_schedules(body, ComponentEncoder(system_id), new_sender(), messages=DATED)
        return found

    flown = fly(options, "clocks", tuple(RATES), lines, RATES_S)
    return [_slow_clock(flown, system_id, rate) for system_id, rate in RATES.items()]


def _slow_clock(flown: Flown, system_id: int, rate: float) -> AttackRow:
    loud = [event for event in flown.events if event.loud and event.system_id == system_id and event.kind != "text"]
    told = [event.t_s for event in loud if "clock is wrong" in event.text]
    since_s = told[0] if told else 0.0
    later = [event for event in loud if since_s + SLACK_S < event.t_s < flown.flown_s]
    soon = 0.0 < since_s <= NOTICED_S + SLACK_S if rate != 1.0 else not told
    return AttackRow(
        attack="slow clocks",
        case=f"{100 * rate:.0f} % of real time",
        **flown.counts(system_id),
        alarm_s=since_s if told else math.nan,
        held=soon and len(told) <= 1 and not later,
        note=later[0].text if later else "",
    )


def played_recording(options: Options) -> list[AttackRow]:
    """Innocent: a recording played live with its own timing, a port for each vehicle."""
    records = list(frames(options.recording))
    start_us = records[0][0]
    length_s = (records[-1][0] - start_us) * 1e-6
    length_s = min(length_s, 15.0 if options.quick else 60.0 * options.minutes)
    port = free_port()
    new_sender = SenderFactory(port)
    outlets: dict[int, Send] = {}
    place = shift_us = 0

    def due(t_s: float) -> list[bytes]:
        nonlocal place
        first = place
        while place < len(records) and records[place][0] - start_us <= t_s * 1e6:
            place += 1
        return [redated(raw, shift_us) for _, raw in records[first:place]]

    def send(raw: bytes) -> None:
        sender = sender_of(raw)
        (outlets.get(sender) or outlets.setdefault(sender, new_sender()))(raw)

    mission = (options.recording / "session.toml").read_text()
    station = FlyingStation(options.gcs, options.folder / "played", mission, [f"udpin:127.0.0.1:{port}"], ["-v", ""])
    stage = Stage([PacketSchedule(party=(TRUE, 0), make=due, send=send, rate_hz=200.0)])
    shift_us = time.time_ns() // 1000 - start_us
    stage.start()
    try:
        stage.wait(length_s)
        count = sum(stage.sent.count.values())
    finally:
        station.end()  # before the silence at its end
        sent = stage.stop()
        new_sender.close()
    false = _false_alarms(read_events(station.session, sent), length_s, OF_THE_RECORDING)
    found = sum(1 for _ in frames(Path(station.session)))
    shown = f"{options.recording.name}, {length_s:.0f} s"
    note = f"{len(false)} false alarms" + (f": {false[0].text}" if false else "")
    note += f"; sender {sent.late_s:.1f} s late" if sent.late_s > 0.5 else ""
    return [AttackRow(attack="quiet", case=shown, sent=count, lost=max(count - found, 0), held=not false, note=note)]
