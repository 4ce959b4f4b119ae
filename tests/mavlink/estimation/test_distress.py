"""What autopilots say against their own positions, as packets: when it is an alarm, how wide, and when it ends."""

import math

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from mavlink.protocol.encoder import ROVER
from tests.support.flights import FIELD, T0, World

GPS, AHRS = 1 << 5, 1 << 21
GOOD, GLITCH, UNAIDED = 0x033F, 0x833F, 0x00A7


@pytest.fixture
def world():
    world = World()
    world.now_us = world.run(5)
    return world


def ekf(world, flags=GOOD, position=0.01, velocity=0.01, compass=0.01, component=1):
    message = dialect.MAVLink_ekf_status_report_message(flags, velocity, position, 0.01, compass, 0.0)
    return speak(world, message, component)


def estimator(world, flags=0x033F, position=0.1, accuracy=0.5):
    message = dialect.MAVLink_estimator_status_message(0, flags, 0.1, position, 0.1, 0.1, 0.0, 0.0, accuracy, 1.0)
    return speak(world, message)


def sensors(world, unhealthy=0, used=GPS | AHRS):
    health = used & ~unhealthy
    return speak(world, dialect.MAVLink_sys_status_message(used, used, health, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0))


def text(world, words, severity=2):
    return world.feed(world.speakers[11].statustext(words, severity), world.now_us)


def speak(world, message, component=1):
    speaker = world.speakers[11]
    return world.feed(
        type(speaker)(11, component).pack(message) if component != 1 else speaker.pack(message), world.now_us
    )


def later(world, seconds):
    """Time goes by, with positions and heartbeats."""
    world.now_us = world.run(seconds, start_us=world.now_us)


def receiver(world, east_m, h_acc_m=0.3):
    """GPS_RAW_INT of rover 11, this far east of where it is."""
    east, north, _ = world.rover_truth(11, world.now_us)
    lat, lon, alt = (float(a) for a in FIELD.to_geodetic([east + east_m, north, 0.0]))
    boot_us = world.boot_ms(11, world.now_us) * 1000
    frame = world.speakers[11].gps_raw_int(boot_us, lat, lon, alt, fix_type=3, satellites=12, h_acc_m=h_acc_m)
    world.feed(frame, world.now_us)


def said(world):
    """Reason and 1σ of rover 11 now."""
    state = world.fleet.at(world.now_us)
    return state.vehicles[1].doubted_for, float(state.std_m[0])


def report_std_m(world):
    world.fleet.take_reports()
    world.now_us += 200_000
    world.rover(11, world.now_us)
    return float(world.fleet.take_reports().std_m[-1])


@pytest.mark.parametrize(
    ("begin", "end", "reason", "least_m"),
    [
        (lambda w: ekf(w, GLITCH), ekf, "GPS glitch", 10.0),
        (lambda w: ekf(w, position=27.7), ekf, "its filter refuses its receiver", 111.0),
        (lambda w: ekf(w, velocity=1.2), ekf, "its filter refuses its receiver", 10.0),
        (lambda w: ekf(w, UNAIDED), ekf, "nothing corrects its estimate", 30.0),
        (lambda w: estimator(w, 0x073F), estimator, "GPS glitch", 10.0),
        (lambda w: estimator(w, position=1.5, accuracy=44.0), estimator, "its filter refuses its receiver", 44.0),
        (lambda w: sensors(w, GPS), sensors, "GPS unhealthy", 10.0),
        (lambda w: sensors(w, AHRS), sensors, "estimate unhealthy", 10.0),
        (lambda w: text(w, "EKF variance"), lambda w: text(w, "EKF failsafe cleared"), 'it says "EKF variance"', 10.0),
        (lambda w: text(w, "GPS Glitch or Compass error"), lambda w: text(w, "Glitch cleared"), 'it says "GPS', 10.0),
    ],
)
def test_distress_is_told_widens_and_ends(world, begin, end, reason, least_m):
    end(world)
    assert said(world) == ("", pytest.approx(2.0, abs=0.5))
    begin(world)
    told, std_m = said(world)
    assert told.startswith(reason) and least_m <= std_m < 1.6 * least_m
    assert report_std_m(world) == pytest.approx(std_m, rel=0.1)
    end(world)
    assert said(world)[0] == "" and report_std_m(world) < 3.0


def test_what_nobody_repeats_is_over_after_a_while(world):
    ekf(world, GLITCH)
    later(world, 4.5)
    assert said(world)[0]
    later(world, 1.0)
    assert not said(world)[0]


def test_the_largest_size_stays_while_the_distress_does(world):
    ekf(world, position=20.0)
    ekf(world, GLITCH)
    assert said(world)[1] > 99.0
    ekf(world)
    ekf(world, GLITCH)
    assert said(world)[1] < 12.0


@pytest.mark.parametrize("east_m", [15.0, -40.0, 2000.0])
def test_a_receiver_elsewhere_than_the_estimate(world, east_m):
    receiver(world, east_m)
    assert not said(world)[0], "once may be a delay"
    receiver(world, east_m)
    assert said(world)[0] == "receiver and estimate are apart" and said(world)[1] >= abs(east_m)
    receiver(world, 1.0)
    assert not said(world)[0]


def test_a_receiver_that_is_noisy_by_its_own_word_is_not_apart(world):
    for _ in range(5):
        receiver(world, 15.0, h_acc_m=4.0)
    assert not said(world)[0]


def test_a_vehicle_that_was_just_switched_on_is_in_no_distress():
    world = World()
    for tick in range(40):
        world.now_us = T0 + tick * 200_000
        world.copter(world.now_us)
        world.rover(11, world.now_us)
        if tick % 5 == 0:
            world.feed(world.speakers[11].heartbeat(ROVER, armed=False), world.now_us)
            ekf(world, UNAIDED)
            sensors(world, GPS | AHRS)
    assert not said(world)[0]
    ekf(world)
    ekf(world, UNAIDED)
    assert said(world)[0], "it had settled"


def test_only_the_vehicle_itself_speaks_of_its_distress(world):
    ekf(world, GLITCH, component=191)
    world.feed(type(world.speakers[11])(11, 191).statustext("EKF variance", 2), world.now_us)
    world.feed(world.speakers[12].statustext("UGV 11: EKF variance", 2), world.now_us)
    text(world, "EKF variance", severity=6)
    text(world, "PreArm: Battery below minimum")
    assert not said(world)[0]


def test_an_end_that_the_radio_lost_is_seen_in_the_heartbeats(world):
    text(world, "EKF failsafe")
    for status in (5, 5, 4):
        assert said(world)[0]
        world.feed(world.speakers[11].heartbeat(ROVER, status=status, custom_mode=10), world.now_us)
    assert not said(world)[0]


def test_a_compass_that_contradicts_costs_the_heading_and_no_position(world):
    ekf(world, compass=1.5)
    state = world.fleet.at(world.now_us).vehicles[1]
    assert state.compass_doubted and not state.doubted_for
    world.fleet.take_reports()
    world.rover(11, world.now_us + 200_000)
    assert math.isnan(world.fleet.take_reports().heading[-1])
    ekf(world)
    assert not world.fleet.at(world.now_us).vehicles[1].compass_doubted


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, 3e38, -1.0])
def test_impossible_figures_are_bounded(world, value):
    ekf(world, position=value, velocity=value, compass=value)
    estimator(world, position=value, accuracy=value)
    state = world.fleet.at(world.now_us)
    assert math.isfinite(state.std_m[0]) and state.std_m[0] < 2e5


def test_a_jump_that_is_accepted_is_told_at_alarm_level_with_its_distance(world):
    told = []
    for tick in range(8):
        told += world.rover(11, world.now_us + tick * 200_000, shift=111.0)
    jump = [notice for notice in told if "jumped" in notice.text]
    assert [notice.level for notice in jump] == ["alarm"] and "position jumped by 111 m" in jump[0].text
