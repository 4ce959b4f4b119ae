"""What became of a vehicle has one word in every place, and only frames that were looked at are counted."""

from dataclasses import replace

import pytest

from gcs.report.rollcall import RollCall
from gcs.snapshot import Alarm, Event
from tests.support.snapshots import TWO_UGVS, box, snapshot

POSITIONED = {"heartbeat_age_s": 0.2, "position_age_s": 0.1, "position_state": "ok"}
HEARD = {"heartbeat_age_s": 0.2}
OUTCOMES = [
    ({}, "never heard", ""),
    ({"bad_signature": 7}, "all refused", "packets with a wrong signature"),
    ({"unsigned": 7}, "all refused", "unsigned packets"),
    ({"held": 7}, "all refused", "nothing proves that its packets are new"),
    ({"contested": True, "position_state": "contested"}, "all refused", "several senders use its system id"),
    (HEARD | {"position_state": "refused", "refused_for": "a jump"}, "all refused", "a jump"),
    (HEARD, "no position", ""),
    (HEARD | {"refused_for": "no GPS fix", "refusals": {"no GPS fix": 3}}, "no position", "no GPS fix"),
    (POSITIONED | {"in_view": False}, "never where the camera looked", ""),
    (POSITIONED | {"in_view": None}, "where the camera looked is not known", ""),
    (POSITIONED | {"in_view": True}, "in view, never named", "5 of 5 frames"),
]


def flown(frames=5, seconds=0.0, **state):
    """Snapshots in which the second vehicle is as given; the first one is named."""
    for frame in range(frames):
        now = snapshot(frame, boxes=[box(1, 2)])
        uav, first, second = now.vehicles
        second = replace(second, **{"in_view": None} | state)
        later = round(seconds * 1e6)
        vehicles = uav, replace(first, **POSITIONED), second
        yield replace(now, t_us=now.t_us + later, seen_us=now.seen_us + later, vehicles=vehicles)


def called(snapshots):
    calls = RollCall(TWO_UGVS)
    for each in snapshots:
        calls.add(each)
    return calls


@pytest.mark.parametrize(("state", "outcome", "why"), OUTCOMES)
def test_a_vehicle_without_a_name_is_told_why(state, outcome, why):
    first, second = called(flown(**state)).rows()
    assert (first.outcome, first.remark) == ("named", "")
    assert (second.outcome, second.why) == (outcome, why)


def test_without_a_frame_nobody_was_out_of_view():
    unseen = (replace(each, seen_us=0, boxes=()) for each in flown(**POSITIONED))
    calls = called(unseen)
    assert {row.outcome for row in calls.rows()} == {"no frame was looked at"}
    assert (calls.frames, calls.skipped_frames, calls.span_s) == (0, 0, 0.0)


def test_one_that_had_its_position_for_some_frames_was_not_out_of_view_in_the_others():
    before = flown(frames=2, **POSITIONED | {"in_view": False})
    after = (replace(each, frame=each.frame + 2) for each in flown(frames=3, seconds=0.2, **HEARD))
    _, row = called([*before, *after]).rows()
    assert row.outcome == "never where the camera looked"
    assert row.why.endswith("not known in 3 of 5 frames")


def test_frames_that_nobody_looked_at_are_told_and_count_for_nothing():
    looked = list(flown(**POSITIONED | {"in_view": True}))
    held = [replace(each, frame=each.frame + 5, t_us=each.t_us + 500_000) for each in looked]
    calls = called([*looked, *held])
    calls.set_frame_count(12)
    assert (calls.frames, calls.skipped_frames, calls.boxes) == (5, 7, 5)
    assert [row.frames_in_view for row in calls.rows()] == [5, 5]
    assert calls.skipped == "7 more frames came and were not looked at"
    calls.set_frame_count(12, as_flown=False)
    assert calls.skipped == "7 more frames have no boxes: nothing was found in them, or nobody looked"
    calls.set_frame_count(5, as_flown=False)
    assert calls.skipped == ""


def test_a_silence_lasts_from_the_begin_and_to_the_end():
    def at(seconds, age_s):
        (now,) = flown(frames=1, seconds=seconds, **POSITIONED | {"position_age_s": age_s})
        return now

    late = called([at(0.0, float("inf")), at(8.0, float("inf")), at(9.0, 0.1), at(20.0, 0.1)])
    assert late.rows()[1].longest_silence_s == pytest.approx(8.0)
    lost = called([at(0.0, 0.1), at(5.0, 0.1), at(39.0, 34.0)])
    assert lost.rows()[1].longest_silence_s == pytest.approx(34.0)
    assert "no position for 34.0 s" in lost.rows()[1].remark
    never = called([at(0.0, float("inf")), at(60.0, float("inf"))])
    assert never.rows()[1].longest_silence_s == pytest.approx(60.0)


def test_a_silence_in_which_the_position_stood_still_is_told_as_that():
    def at(seconds, age_s, *, frozen):
        state = {"position_age_s": age_s, "position_state": "lost" if age_s > 3.0 else "ok", "frozen": frozen}
        (now,) = flown(frames=1, seconds=seconds, **POSITIONED | state)
        return now

    calls = called(
        [
            at(0.0, 0.1, frozen=False),
            at(11.8, 11.8, frozen=True),
            at(12.0, 12.0, frozen=False),
            at(13.0, 0.1, frozen=False),
        ]
    )
    row = calls.rows()[1]
    assert row.silence_frozen and row.remark.endswith("its position stood still for 12.0 s")


def test_a_flight_counts_the_silence_of_its_replay_however_late_it_is_shown(monkeypatch):
    ages_s = [*(0.1 for _ in range(5)), *(k * 1.0 for k in range(1, 13)), 0.1]
    lates_s = [0.1, 0.9, 0.3, 0.6, 0.0]
    flight, replay, wall = RollCall(TWO_UGVS), RollCall(TWO_UGVS), []
    monkeypatch.setattr("time.time_ns", lambda: wall[-1] * 1000)
    monkeypatch.setattr("time.monotonic_ns", lambda: (wall[-1] + 5_000_000) * 1000)
    for second, age_s in enumerate(ages_s):
        (now,) = flown(frames=1, seconds=float(second), **POSITIONED | {"position_age_s": age_s})
        wall.append(now.t_us + round(lates_s[second % 5] * 1e6))
        flight.add_in_flight(now)
        replay.add(now)
    assert flight.rows()[1].longest_silence_s == replay.rows()[1].longest_silence_s == pytest.approx(12.0)
    wall.append(now.t_us - 3_600_000_000)
    flight.add_in_flight(now)
    assert flight.rows()[1].longest_silence_s < 13.0, "the wall clock was set back meanwhile"


def test_a_frame_that_was_taken_before_the_last_moment_makes_no_silence_shorter():
    calls = RollCall(TWO_UGVS)
    for second, age_s, late_s in ((0.0, 0.1, 0.0), (1.0, 1.1, 0.0), (0.9, 1.0, 0.4), (12.0, 12.1, 0.0)):
        (now,) = flown(frames=1, seconds=second, **POSITIONED | {"position_age_s": age_s})
        latest_us = now.t_us + round(late_s * 1e6)
        calls.add(replace(now, clock_us=latest_us), latest_us)
    assert calls.rows()[1].longest_silence_s == pytest.approx(12.0)


def test_an_alarm_counts_once_whatever_its_levels_and_comes_again():
    def stale(level, since_us):
        text = f"UGV-3: position {level}"
        return Alarm(key="position 3", level=level, kind="vehicle", text=text, advice="", since_us=since_us)

    on = [[stale("warning", 1)], [stale("alarm", 1)], [], [stale("warning", 3)], [stale("warning", 3)]]
    marked = Event(t_us=1, level="info", kind="mark", text="here")
    shown = [replace(each, alarms=tuple(now)) for each, now in zip(flown(), on, strict=True)]
    calls = called([replace(shown[0], events=(marked,)), *shown[1:]])
    assert (calls.alarms.alarms, calls.alarms.warnings, calls.marks) == (1, 1, 1)


def test_frames_in_which_another_one_had_its_turn_tell_nothing():
    seen = list(flown(frames=6, **POSITIONED | {"in_view": True}))
    turns = [
        replace(each, boxes=tuple(replace(b, coasting=True, in_turn=True) for b in each.boxes))
        if each.frame % 2
        else each
        for each in seen
    ]
    first = called(turns).rows()[0]
    assert (first.frames_in_view, first.share, first.frames_unknown) == (3, 1.0, 0)
