"""Which of two senders of one system is accepted: another component, and a false first position of the UAV."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from bench.attacks.actors import FULL, HOME, Body, rover, uav, vehicle_schedules
from bench.attacks.records import VehicleEstimate, first_warning
from bench.attacks.report import AttackRow
from bench.attacks.run import PROMISE_S, SLACK_S, Flown, Options, false_position_s, fly
from bench.attacks.stage import FALSE, TRUE, PacketSchedule, SenderFactory
from bench.attacks.wire import AUTOPILOT, NO_AUTOPILOT, ROVER, ComponentEncoder

CONTEST = r"senders? |two addresses|contest|another component|also (sent|reported)|imposs?tor"
"""Words in alarms about a second sender."""
COMPANION_TYPE = 18  # MAV_TYPE_ONBOARD_CONTROLLER
GIMBAL_TYPE = 26
START_S = 3.0
"""When the true vehicles begin, or fall silent."""
GAP_AT_S, GAP_S = 5.0, 4.0
APART_M = 1000.0


@dataclass(frozen=True, slots=True, kw_only=True)
class TakeoverCase:
    """A second source of one vehicle's reports."""

    name: str
    system_id: int
    component_id: int
    messages: tuple[str, ...] = ("beat", "position")
    kind: int = ROVER
    autopilot: int = AUTOPILOT
    apart_m: float = APART_M
    gap: bool = False
    """It begins when the true vehicle falls silent for four seconds; else three seconds ahead of it."""

    @property
    def hostile(self) -> bool:
        return self.apart_m > 0.0


CASES = (
    TakeoverCase(name="component 200, 3 s ahead", system_id=11, component_id=200),
    TakeoverCase(name="component 200, in a gap of 4 s", system_id=12, component_id=200, gap=True),
    TakeoverCase(name="component 2, all messages, 3 s ahead", system_id=13, component_id=2, messages=FULL),
    TakeoverCase(
        name="companion 191 that says no autopilot, 3 s ahead",
        system_id=14,
        component_id=191,
        kind=COMPANION_TYPE,
        autopilot=NO_AUTOPILOT,
    ),
    TakeoverCase(
        name="component 200, positions only, 3 s ahead", system_id=15, component_id=200, messages=("position",)
    ),
    TakeoverCase(name="component 1, in a gap of 4 s", system_id=16, component_id=1, gap=True),
    TakeoverCase(
        name="component 220, all messages, in a gap of 4 s", system_id=17, component_id=220, messages=FULL, gap=True
    ),
    TakeoverCase(
        name="innocent: companion 191 that repeats its positions",
        system_id=18,
        component_id=191,
        kind=COMPANION_TYPE,
        autopilot=NO_AUTOPILOT,
        apart_m=0.0,
    ),
    TakeoverCase(
        name="innocent: gimbal 154 with attitudes of its own",
        system_id=19,
        component_id=154,
        kind=GIMBAL_TYPE,
        autopilot=NO_AUTOPILOT,
        messages=("beat", "attitude"),
        apart_m=0.0,
    ),
    TakeoverCase(
        name="innocent: second GPS, component 221",
        system_id=20,
        component_id=221,
        kind=27,
        autopilot=NO_AUTOPILOT,
        messages=("beat", "gps"),
        apart_m=0.0,
    ),
)


def components(options: Options) -> list[AttackRow]:
    """Components of a system 1 km away from it, begun before it or while it is silent."""
    duration_s = 16.0 if options.quick else 30.0
    flown = fly(options, "components", [case.system_id for case in CASES], _lines, duration_s)
    return [judge(flown, case) for case in CASES]


def _lines(new_sender: SenderFactory) -> list[PacketSchedule]:
    lines = vehicle_schedules(uav(), ComponentEncoder(1), new_sender())
    for case in CASES:
        body = rover(case.system_id)
        ahead = case.hostile and not case.gap
        silent = (GAP_AT_S, GAP_AT_S + GAP_S) if case.gap else (1e9, 1e9)
        send = new_sender()
        lines += vehicle_schedules(
            body, ComponentEncoder(case.system_id), send, start_s=START_S if ahead else 0.0, silent_s=silent
        )
        begin_s = silent[0] if case.gap else 0.0
        elsewhere = replace(body.moved(case.apart_m), speed_m_s=3.0 if case.hostile else body.speed_m_s)
        lines += vehicle_schedules(
            elsewhere,
            ComponentEncoder(case.system_id, case.component_id),
            new_sender() if case.hostile else send,
            FALSE,
            messages=case.messages,
            kind=case.kind,
            autopilot=case.autopilot,
            start_s=begin_s,
        )
    return lines


def judge(flown: Flown, case: TakeoverCase) -> AttackRow:
    """What became of one of :data:`CASES`."""
    body: Body = rover(case.system_id)
    both_s = GAP_AT_S + GAP_S if case.gap else START_S
    alarm = first_warning(flown.events, CONTEST, case.system_id)
    counts = flown.counts(case.system_id)
    seen = flown.estimates(case.system_id)
    if not case.hostile:
        # a vehicle with several components causes no alarm and is accepted throughout
        unsure = sum(not estimate.used for estimate in seen if estimate.t_s > START_S) / 5.0
        held = alarm is None and unsure < 1.0 and not counts["lost"]
        note = f"not believed for {unsure:.1f} s" if unsure >= 1.0 else ""
        note = f"false alarm: {alarm.text}" if alarm else note
        return AttackRow(attack="components", case=case.name, **counts, held=held, note=note)
    since_s = both_s + PROMISE_S + SLACK_S
    wrong_s = false_position_s(seen, body, case.apart_m, since_s, flown.flown_s)
    after_s = alarm.t_s - both_s if alarm else float("nan")
    held = wrong_s == 0.0 and after_s <= PROMISE_S + SLACK_S and not counts["lost"]
    true_s = sum(estimate.used for estimate in seen if estimate.t_s >= since_s) / 5.0 - wrong_s
    note = "" if alarm or held else "no alarm"
    if case.messages == ("position",) or case.autopilot == NO_AUTOPILOT:
        # only an autopilot may speak for the vehicle: to go on using the true positions is as good as an alarm
        held = wrong_s == 0.0 and not counts["lost"] and (bool(alarm) or true_s > 1.0)
        note = "" if alarm else "the true one is believed, without an alarm" if held else "no alarm"
    return AttackRow(
        attack="components",
        case=case.name,
        **counts,
        believed_s=wrong_s,
        alarm_s=max(after_s, 0.0) if alarm else after_s,
        held=held,
        note=note,
    )


ELSEWHERE = {
    "45° of longitude away": (HOME[0], HOME[1] + 45.0),
    "85° of longitude away": (HOME[0], HOME[1] + 85.0),
    "the other hemisphere": (-33.0, 151.0),
    "20 km away": (HOME[0] + 0.18, HOME[1]),
}
HARMLESS = ("20 km away",)
"""So near that all places stay right by the false origin: it need not be reported."""
SPEAKS_S = 2.0
"""When the UAV itself begins."""
RIGHT_BY_S = 10.0
"""After so long the UAV has reported its position often enough."""
NEAR_M = 3.0
"""Within this a place relative to the UAV's is right: our degrees are those of a sphere, half a per cent off."""


def first_position(options: Options) -> list[AttackRow]:
    """One false position in the UAV's name before it sends itself."""
    names = list(ELSEWHERE)[:1] if options.quick else list(ELSEWHERE)
    return [_one(options, name) for name in names]


def _one(options: Options, name: str) -> AttackRow:
    vehicles = (11, 12, 13)

    def lines(new_sender: SenderFactory) -> list[PacketSchedule]:
        false = replace(uav(), home=ELSEWHERE[name])
        found = vehicle_schedules(
            false, ComponentEncoder(1), new_sender(), FALSE, messages=("beat", "position"), stop_s=0.2
        )
        found += vehicle_schedules(uav(), ComponentEncoder(1), new_sender(), start_s=SPEAKS_S)
        for system_id in vehicles:
            found += vehicle_schedules(rover(system_id), ComponentEncoder(system_id), new_sender())
        return found

    flown = fly(options, f"origin-{name.split()[0]}", vehicles, lines, 20.0)
    wrong = right = 0
    for system_id in vehicles:
        seen = [each for each in flown.estimates(system_id) if each.t_s > SPEAKS_S + RIGHT_BY_S]
        off = [_off_m(each, system_id) for each in seen if each.used]
        wrong += sum(each > NEAR_M for each in off)
        right += sum(each <= NEAR_M for each in off)
    alarms = [event for event in flown.events if "origin" in event.text.lower() or "elsewhere" in event.text.lower()]
    note = "" if alarms else "nothing told"
    note = note if right else (note + "; no place is right").strip("; ")
    sent, found = flown.sent.count, flown.recorded
    true = [party for party in sent if party[0] == TRUE]
    return AttackRow(
        attack="first position",
        case=name,
        sent=sum(sent[party] for party in true),
        lost=sum(sent[party] - found[party] for party in true),
        false_sent=sent[FALSE, 1],
        false_recorded=found[FALSE, 1],
        believed_s=wrong / 5.0 / len(vehicles),
        alarm_s=max(alarms[0].t_s - SPEAKS_S, 0.0) if alarms else math.nan,
        held=not wrong and right > 0 and (bool(alarms) or name in HARMLESS),
        note=note,
    )


def _off_m(estimate: VehicleEstimate, system_id: int) -> float:
    return math.dist(estimate.place, rover(system_id).at(estimate.t_s)) if estimate.place else math.inf
