"""What stands on the screens from turn to turn: each vehicle's row, and the alarms."""

from __future__ import annotations

import math
from collections.abc import Iterator

from bench.screens.flights import Moment
from bench.statements.flights import TrueFlight
from bench.statements.sentences import ADRIFT_S, HOLD_S, LOST_S, SILENT_S, SLACK_S, Said, check_sentence
from gcs.snapshot import VehicleRow

S = 1_000_000
EDGE_PX = 60.0
"""Three metres of a position's error, near the border of the frame."""
FOUND_OUT_S = 3.0
TURN_S = 0.3
CONTRADICTIONS = ("conflict", "doubted", "refused")
LATE_S = 4.0
"""An alarm is there so long after what raises it, where its rule asks for no longer."""


def check_rows(flown: TrueFlight, moment: Moment) -> Iterator[tuple[Said, str]]:
    """Standing, ages and whether it is in view, of each ground vehicle."""
    snapshot = moment.snapshot
    for row in snapshot.vehicles:
        if row.role == "ugv":
            for what, why in check_row(flown, moment, row):
                yield Said(where="fleet", t_us=snapshot.t_us, text=f"{row.name}: {what}", system_id=row.system_id), why


def check_row(flown: TrueFlight, moment: Moment, row: VehicleRow) -> Iterator[tuple[str, str]]:
    """What is false of one vehicle; ages that are not told are NaN."""
    snapshot, i = moment.snapshot, row.system_id
    for what, told_s in (("heartbeat", row.heartbeat_age_s), ("position", row.position_age_s)):
        # what has come since the frame was taken may be in it
        true_s, least_s = (flown.silent_s(i, t_us, what) for t_us in (snapshot.t_us, moment.now_us))
        # what has just come is in the next one
        turn_s = TURN_S + flown.silent_s(i, snapshot.t_us - round(TURN_S * S), what)
        younger = told_s < min(true_s, least_s) - SLACK_S
        # a position that was refused is none, whenever it came
        faulty = what == "position" and flown.fault_of(i, snapshot.t_us, within_s=5)
        older = told_s > max(true_s, turn_s) + SLACK_S and not faulty
        if younger or older:
            yield f"{what} {told_s:.1f} s ago", f"it came {true_s:.1f} s before"
    frame = flown.frames.get(snapshot.seen_us)
    if frame is None:
        return
    if row.standing == "confirmed" and not row.stated and not snapshot.held:
        box = next(box for box in snapshot.boxes if box.track_id == row.track_id)
        whose = frame.whose(box.cx, box.cy)
        if whose not in (None, i):
            yield f"confirmed {row.confidence:.2f}", f"its box is {flown.name(whose or 0)}'s"
    outside_px = frame.outside_px(i)
    # a lie that is found out is told: its place is then not where it reports to be; none is found out at once
    fault = flown.fault_of(i, snapshot.t_us)
    fresh = fault is not None and flown.at_s(snapshot.t_us) < fault.start_s + FOUND_OUT_S
    told = fresh or any(alarm.system_id == i and alarm.key.startswith(CONTRADICTIONS) for alarm in snapshot.alarms)
    if row.standing == "out of view" and outside_px < -EDGE_PX and not told:
        yield "out of view", f"it is {-outside_px:.0f} px inside of the picture"
    if row.in_view and outside_px > EDGE_PX and not told:
        yield "in view", f"it is {outside_px:.0f} px outside of the picture"
    yield from _without_place(flown, snapshot.t_us, row)


def _without_place(flown: TrueFlight, t_us: int, row: VehicleRow) -> Iterator[tuple[str, str]]:
    """Of vehicles of which it is said that nobody knows where they are."""
    i = row.system_id
    if row.standing == "misplaced" and not flown.fault_of(i, t_us, within_s=HOLD_S + ADRIFT_S):
        yield "misplaced", "its positions are right"
    if row.standing == "no position":
        age_s = flown.silent_s(i, t_us, "position")
        if age_s < LOST_S - SLACK_S and not flown.fault_of(i, t_us, within_s=5):
            yield "no position", f"one came {age_s:.1f} s before"


def check_alarms(flown: TrueFlight, moment: Moment) -> Iterator[tuple[Said, str]]:
    """Every alarm that stands has its cause, or had it a moment ago."""
    for alarm in moment.snapshot.alarms:
        said = Said(
            where="alarms", t_us=moment.snapshot.t_us, text=alarm.text, system_id=alarm.system_id, standing=True
        )
        yield from ((said, why) for why in check_sentence(flown, said))


def check_missing_alarms(flown: TrueFlight, moment: Moment) -> Iterator[tuple[Said, str]]:
    """What is wrong for long is told: a vehicle is silent, or the video has stopped."""
    t_us = moment.snapshot.t_us
    texts = {alarm.text for alarm in moment.snapshot.alarms}
    for i in flown.scenario.ugv_ids:
        silent_s = flown.silent_s(i, t_us)
        if SILENT_S + LATE_S < silent_s < math.inf and f"{flown.name(i)}: no heartbeat" not in texts:
            yield _nothing(t_us, i), f"{flown.name(i)} has been silent for {silent_s:.1f} s"
    frames = [frame_us for now_us, frame_us in flown.turns if frame_us and now_us <= t_us]
    told = any("the video has stopped" in text or "the video comes and goes" in text for text in texts)
    if frames and t_us - frames[-1] > LATE_S * S and not told:
        yield _nothing(t_us, 0), f"the last frame is of {(t_us - frames[-1]) / S:.1f} s before"


def _nothing(t_us: int, system_id: int) -> Said:
    return Said(where="alarms", t_us=t_us, text="no alarm", system_id=system_id, standing=True)
