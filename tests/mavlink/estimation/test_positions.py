import math

import pytest

from mavlink.estimation.interpolation import Fix
from mavlink.estimation.positions import (
    Positions,
    VehicleLimits,
    Verdict,
    altitude_known,
    course_gap,
    place_error,
    position_stds,
    too_far,
)
from mavlink.protocol.messages import GlobalPosition, GpsRaw

NAN = math.nan
LIMITS = VehicleLimits()
MS = 1000


def report(lat=-35.36, lon=149.16, *, v=(0.0, 0.0), heading=0.0):
    return GlobalPosition(0, 11, 1, 0, lat, lon, 584.0, 0.0, v[1], v[0], 0.0, heading)


def receiver(fix_type=3, *, h_acc=NAN, hdop=NAN):
    return GpsRaw(0, 11, 1, fix_type, 0.0, 0.0, 0.0, hdop, 12, h_acc, NAN, 0, NAN, NAN)


@pytest.mark.parametrize(
    ("lat", "lon", "reason"),
    [
        (-35.36, 149.16, ""),
        (0.0, 0.0, "no fix"),
        (353e-7, -129e-7, "no fix"),  # what one autopilot sends before its first fix
        (9e-4, -9e-4, "no fix"),
        (0.0, 10.0, ""),  # the equator is a place
        (51.5, 0.0, ""),  # so is the prime meridian
        (214.7483647, 214.7483647, "out of range"),  # INT32_MAX, the sentinel of newer messages
        (-214.7483648, 0.0, "out of range"),
        (10.0, 200.0, "out of range"),
        (91.0, 10.0, "out of range"),
        (NAN, 10.0, "not a number"),
        (10.0, math.inf, "not a number"),
    ],
)
def test_places_that_are_none(lat, lon, reason):
    assert place_error(report(lat, lon), None).startswith(reason)
    assert bool(place_error(report(lat, lon), None)) == bool(reason)


@pytest.mark.parametrize(("fix_type", "used"), [(0, True), (1, False), (2, True), (3, True), (6, True)])
def test_no_fix_is_not_used_but_no_receiver_may_be(fix_type, used):
    assert (place_error(report(), receiver(fix_type)) == "") == used


@pytest.mark.parametrize(
    ("alt", "known"), [(584, True), (-30, True), (2147483.647, False), (-2147483.648, False), (NAN, False)]
)
def test_altitude_sentinels(alt, known):
    assert altitude_known(alt) == known


@pytest.mark.parametrize(
    ("gps", "std"),
    [
        (None, 2.0),
        (receiver(0), 2.0),
        (receiver(3), 2.0),
        (receiver(3, h_acc=0.8), 0.8),
        (receiver(6, h_acc=0.001), 0.02),
        (receiver(3, hdop=1.2), 1.8),
        (receiver(4), 1.0),
        (receiver(5), 0.3),
        (receiver(6), 0.05),
    ],
)
def test_how_good_a_position_is(gps, std):
    assert position_stds(gps, LIMITS)[0] == pytest.approx(std)


def test_too_far():
    assert too_far(50.0, 0.2, 0.3, LIMITS)
    assert not too_far(6.0, 0.2, 0.3, LIMITS)
    assert not too_far(500.0, 20.0, 0.3, LIMITS)


@pytest.mark.parametrize(
    ("course_deg", "heading_deg", "gap_deg"), [(90, 90, 0), (90, 270, 0), (90, 0, 90), (350, 10, 20), (350, 190, 20)]
)
def test_course_fits_forward_and_in_reverse(course_deg, heading_deg, gap_deg):
    course = math.radians(course_deg)
    gap = course_gap(math.sin(course), math.cos(course), math.radians(heading_deg))
    assert math.degrees(gap) == pytest.approx(gap_deg, abs=1e-9)


def fix_at(east, north=0.0, *, v=(0.0, 0.0), heading=0.0, std=0.3):
    return Fix(east, north, 0.0, v[0], v[1], 0.0, heading, std, 0.0, 3.0)


def drive(positions, ticks, *, speed=5.0, start=0, east=0.0):
    """Five reports a second on a straight line eastward; returns the verdicts."""
    verdicts = []
    for i in range(ticks):
        x = east + speed * 0.2 * i
        verdicts.append(positions.add((start + i * 200) * MS, fix_at(x, v=(speed, 0.0), heading=1.5), (x, 0.0)))
    return verdicts


def test_straight_drive_is_interpolated_and_extrapolated():
    positions = Positions(LIMITS, drives=True)
    assert set(drive(positions, 10)) == {Verdict.NEW}
    assert positions.period_s == pytest.approx(0.2)
    between = positions.at(900 * MS)
    assert between.fix.east == pytest.approx(4.5)
    assert (between.bracketed, between.age_s) == (True, pytest.approx(0.1))
    after = positions.at(2300 * MS)
    assert after.fix.east == pytest.approx(9.0 + 0.5 * 5.0)
    assert not after.bracketed and after.fix.std_m > 0.3
    assert positions.at(9_800 * MS).fix.east == pytest.approx(9.0 + 2.0 * 5.0)  # no farther than two seconds
    assert positions.at(-1) is None


def test_turn_between_slow_reports_follows_the_arc():
    positions = Positions(LIMITS, drives=True)
    radius, rate = 10.0, 0.5
    for t in range(4):
        a = rate * t
        fix = fix_at(
            radius * math.sin(a),
            radius * (1 - math.cos(a)),
            heading=math.pi / 2 - a,
            v=(radius * rate * math.cos(a), radius * rate * math.sin(a)),
        )
        positions.add(t * 1000 * MS, fix, (fix.east, fix.north))
    for t in (0.5, 1.25, 2.7):
        fix = positions.at(int(t * 1e6)).fix
        assert fix.east == pytest.approx(radius * math.sin(rate * t), abs=0.02)
        assert fix.north == pytest.approx(radius * (1 - math.cos(rate * t)), abs=0.02)


def test_heading_goes_the_short_way_round():
    positions = Positions(LIMITS, drives=True)
    positions.add(0, fix_at(0, heading=math.radians(350)), (0, 0))
    positions.add(200 * MS, fix_at(0.1, heading=math.radians(10)), (0.1, 0))
    heading = positions.at(100 * MS).fix.heading
    assert math.cos(heading) == pytest.approx(1.0)


def test_half_known_heading_is_the_nearer_one():
    positions = Positions(LIMITS, drives=True)
    positions.add(0, fix_at(0, heading=1.0), (0, 0))
    positions.add(200 * MS, fix_at(0.1, heading=NAN), (0.1, 0))
    assert positions.at(50 * MS).fix.heading == 1.0
    assert math.isnan(positions.at(150 * MS).fix.heading)


def test_single_jump_is_rejected():
    positions = Positions(LIMITS, drives=True)
    drive(positions, 5)
    assert positions.add(1000 * MS, fix_at(500.0), (500.0, 0)) is Verdict.JUMP
    assert set(drive(positions, 5, start=1200, east=6.0)) == {Verdict.NEW}
    assert positions.at(1100 * MS).fix.east == pytest.approx(5.5, abs=0.1)


def test_new_place_is_accepted_after_a_second():
    positions = Positions(LIMITS, drives=True)
    drive(positions, 5)
    verdicts = drive(positions, 10, start=1000, east=800.0)
    assert verdicts == [Verdict.JUMP] * 5 + [Verdict.MOVED] + [Verdict.NEW] * 4
    assert positions.at(900 * MS) is None  # nothing is interpolated across the jump
    assert positions.at(2800 * MS).fix.east == pytest.approx(809.0)


def test_wild_jumps_are_never_accepted():
    positions = Positions(LIMITS, drives=True)
    drive(positions, 5)
    for i in range(30):
        place = 1000.0 * (1 + i % 3)
        assert positions.add((1000 + i * 200) * MS, fix_at(place), (place, 0)) is Verdict.JUMP


def test_long_silence_allows_a_long_way():
    positions = Positions(LIMITS, drives=True)
    drive(positions, 5)
    assert drive(positions, 1, start=30_000, east=600.0) == [Verdict.NEW]


def test_two_senders_at_two_places_do_not_mix():
    positions = Positions(LIMITS, drives=True)
    for i in range(20):
        t_us = i * 200 * MS
        positions.add(t_us, fix_at(i * 0.5), (i * 0.5, 0))
        far = positions.add(t_us + 100 * MS, fix_at(300.0 + i * 0.5), (300.0 + i * 0.5, 0))
        assert far is Verdict.JUMP
    assert positions.at(t_us).fix.east < 20.0


def test_an_aircraft_does_not_jump_up_and_a_new_height_that_stays_is_accepted():
    positions = Positions(LIMITS, drives=False)
    heights = [40.0] * 10 + [640.0] + [40.0] * 5 + [640.0] * 10
    verdicts = [positions.add(i * 200 * MS, fix_at(0.0)._replace(up=up), (0.0, i)) for i, up in enumerate(heights)]
    assert (
        verdicts
        == [Verdict.NEW] * 10
        + [Verdict.CLIMB]
        + [Verdict.NEW] * 5
        + [Verdict.CLIMB] * 5
        + [Verdict.MOVED]
        + [Verdict.NEW] * 4
    )


def test_repeated_place_while_moving_is_no_evidence():
    positions = Positions(LIMITS, drives=True)
    moving = fix_at(1.0, v=(3.0, 0.0))
    verdicts = [positions.add(i * 100 * MS, moving, (1.0, 0)) for i in range(20)]
    assert verdicts == [Verdict.NEW] + [Verdict.FROZEN] * 19
    assert positions.at(2000 * MS).age_s == pytest.approx(2.0)


def test_parked_vehicle_stays_fresh_and_reports_once_a_second():
    positions = Positions(LIMITS, drives=True)
    verdicts = [positions.add(i * 200 * MS, fix_at(1.0), (1.0, 0)) for i in range(20)]
    assert verdicts.count(Verdict.NEW) == 4
    assert set(verdicts) == {Verdict.NEW, Verdict.REPEATED}
    assert positions.at(3850 * MS).age_s == pytest.approx(0.05)


def test_duplicates_late_copies_and_reordered_reports():
    positions = Positions(LIMITS, drives=True)
    drive(positions, 30)
    assert positions.add(5800 * MS, fix_at(29.0), (29.0, 0)) is Verdict.DUPLICATE
    assert positions.add(100 * MS, fix_at(0.5), (0.5, 0)) is Verdict.OUT_OF_ORDER
    assert positions.add(5700 * MS, fix_at(28.5, v=(5, 0)), (28.5, 0)) is Verdict.NEW
    assert positions.at(5700 * MS).fix.east == pytest.approx(28.5)


def test_heading_against_the_course_is_dropped_and_trusted_again():
    positions = Positions(LIMITS, drives=True)
    sideways = report(v=(5.0, 0.0), heading=0.0)
    headings = [positions.check_heading(sideways, NAN) for _ in range(10)]
    assert headings[0] == 0.0 and math.isnan(headings[-1])
    straight = report(v=(5.0, 0.0), heading=math.pi / 2)
    headings = [positions.check_heading(straight, NAN) for _ in range(15)]
    assert math.isnan(headings[0]) and headings[-1] == pytest.approx(math.pi / 2)


def test_reverse_driving_keeps_its_heading():
    positions = Positions(LIMITS, drives=True)
    backward = report(v=(-5.0, 0.0), heading=math.pi / 2)
    assert all(positions.check_heading(backward, NAN) == math.pi / 2 for _ in range(30))


def test_aircraft_may_drift_sideways():
    positions = Positions(LIMITS, drives=False)
    assert all(positions.check_heading(report(v=(5.0, 0.0), heading=0.0), NAN) == 0.0 for _ in range(30))


def test_heading_must_agree_with_the_attitude():
    positions = Positions(LIMITS, drives=True)
    assert positions.check_heading(report(heading=1.0), 1.1) == 1.0
    assert math.isnan(positions.check_heading(report(heading=1.0), 2.0))
    assert positions.check_heading(report(heading=6.2), -0.1) == 6.2
    assert math.isnan(positions.check_heading(report(heading=NAN), 0.0))


@pytest.mark.parametrize(
    ("every_s", "age_s", "state"),
    [(0.2, 1.5, "stale"), (0.2, 4.0, "lost"), (10.0, 15.0, "ok"), (10.0, 25.0, "stale"), (10.0, 45.0, "lost")],
)
def test_a_position_is_lost_by_how_often_it_comes(every_s, age_s, state):
    positions = Positions(LIMITS, drives=True)
    seconds = [k * every_s for k in range(8)]
    # one outage does not make a slow sender
    seconds += [seconds[-1] + 40.0, seconds[-1] + 40.0 + every_s]
    for second in seconds:
        positions.add(int(second * 1e6), fix_at(second), (second, 0.0))
    newest_us = int(seconds[-1] * 1e6)
    assert positions.state(positions.at(newest_us + int(age_s * 1e6)), "") == state
