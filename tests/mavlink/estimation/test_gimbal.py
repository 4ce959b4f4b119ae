"""Gimbal attitudes by four messages, in two frames, from several gimbals."""

import math

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega

from mavlink.estimation.gimbal import yaw_frame
from mavlink.geodesy import quaternion_from_euler, rotation_from_euler
from mavlink.protocol.encoder import MavlinkEncoder
from tests.support.flights import FIELD, T0, S, World

NOSE = 0.5  # yaw of the copter in World.run
DOWN = -math.pi / 2


@pytest.fixture
def world():
    flown = World(origin=FIELD)
    flown.run(1)
    return flown


def device(q, flags=44, component=1, device_id=1, boot_ms=1):
    message = ardupilotmega.MAVLink_gimbal_device_attitude_status_message(
        0, 0, boot_ms, flags, list(q), math.nan, math.nan, math.nan, 0, gimbal_device_id=device_id
    )
    return MavlinkEncoder(1, component).pack(message)


def mount_status(pitch, roll, yaw):
    cdeg = (round(math.degrees(a) * 100) for a in (pitch, roll, yaw))
    return MavlinkEncoder(1).pack(ardupilotmega.MAVLink_mount_status_message(0, 0, *cdeg))


def fov(q, middle_enu=None):
    unknown = 2**31 - 1
    here, there = [unknown] * 3, [unknown] * 3
    if middle_enu is not None:
        here, there = (
            [round(lat * 1e7), round(lon * 1e7), round(alt * 1e3)]
            for lat, lon, alt in (FIELD.to_geodetic(p) for p in ([0.0, 0.0, 40.0], middle_enu))
        )
    return MavlinkEncoder(1).pack(
        ardupilotmega.MAVLink_camera_fov_status_message(1, *here, *there, list(q), 60.0, 40.0)
    )


def information(gimbal_id):
    message = ardupilotmega.MAVLink_camera_information_message(
        1, [0] * 32, [0] * 32, 0, 8, 6.4, 4.8, 1920, 1080, 0, 0, 0, b"", gimbal_device_id=gimbal_id
    )
    return MavlinkEncoder(1).pack(message)


def attitude(world, t_us=T0 + S):
    """Roll, pitch, yaw from north of the gimbal, by numpy from its axes."""
    R = world.fleet.at(t_us).uav.R_enu_gimbal
    if R is None:
        return None
    ahead, right = R[:, 0], R[:, 1]
    level = np.array([ahead[1], -ahead[0], 0.0]) / np.hypot(ahead[0], ahead[1])
    pitch = math.asin(ahead[2])
    return math.atan2(-right[2] / math.cos(pitch), right @ level), pitch, math.atan2(ahead[0], ahead[1])


def texts(world):
    return [n.text for n in world.notices if n.kind == "camera"]


@pytest.mark.parametrize(
    ("flags", "frame"),
    [
        (0, "vehicle"),
        (4 + 8, "vehicle"),
        (16, "earth"),  # neither frame flag: the yaw lock decides
        (12 + 16, "earth"),
        (32, "vehicle"),
        (16 + 32, "vehicle"),  # locked, but told from the nose
        (64, "earth"),
        (16 + 64, "earth"),
        (12 + 64 + 256, "earth"),
        (32 + 64, None),
        (16 + 32 + 64, None),
    ],
)
def test_what_a_gimbals_yaw_counts_from(flags, frame):
    assert yaw_frame(flags) == frame


@pytest.mark.parametrize("locks", [0, 4, 8, 12], ids=["free", "roll", "pitch", "both"])
@pytest.mark.parametrize(("frame", "north"), [(32, NOSE + 0.3), (64, 0.3)], ids=["vehicle", "earth"])
def test_roll_and_pitch_count_from_the_horizon_whatever_is_locked(world, locks, frame, north):
    world.feed(device(quaternion_from_euler(0.1, -0.6, 0.3), locks + frame), T0 + S)
    assert attitude(world) == pytest.approx((0.1, -0.6, north), abs=1e-4)


@pytest.mark.parametrize("flags", [44, 12 + 64])
def test_gimbal_straight_down_with_its_top_to_the_nose(world, flags):
    q = quaternion_from_euler(0.0, DOWN, NOSE if flags & 64 else 0.0)
    world.feed(device(q, flags), T0 + S)
    R = world.fleet.at(T0 + S + 10_000).uav.R_enu_gimbal
    assert pytest.approx([0, 0, -1], abs=1e-4) == R @ [1, 0, 0]
    assert pytest.approx([math.sin(NOSE), math.cos(NOSE), 0], abs=1e-4) == R @ [0, 0, -1]
    assert world.fleet.at(T0 + S + 1_100_000).uav.R_enu_gimbal is None


def test_attitudes_between_reports_are_between(world):
    for k, pitch in enumerate((-1.0, -0.6)):
        world.feed(device(quaternion_from_euler(0, pitch, 0)), T0 + S + k * 400_000)
    assert attitude(world, T0 + S + 200_000)[1] == pytest.approx(-0.8, abs=1e-3)


def test_flags_of_both_frames_and_no_rotation_are_refused(world):
    for _ in range(3):
        world.feed(device((1, 0, 0, 0), 32 + 64), T0 + S)
        world.feed(device((0, 0, 0, 0)), T0 + S)
        world.feed(device((math.nan, 0, 0, 0)), T0 + S)
    assert attitude(world) is None
    assert texts(world) == [
        "GIMBAL_DEVICE_ATTITUDE_STATUS not used: by its flags yaw counts from the nose and from north",
        "GIMBAL_DEVICE_ATTITUDE_STATUS not used: its quaternion is no rotation",
    ]


def test_mount_orientation_serves_while_no_gimbal_speaks(world):
    def mount(t_us):
        world.feed(world.speakers[1].mount_orientation(1, 0.05, -1.0, 0.2, math.nan), t_us)

    mount(T0 + S)
    assert attitude(world) == pytest.approx((0.05, -1.0, NOSE + 0.2), abs=1e-4)
    world.feed(device(quaternion_from_euler(0, -0.5, 0)), T0 + S + 1000)
    mount(T0 + S + 2000)
    assert attitude(world, T0 + S + 3000)[1] == pytest.approx(-0.5, abs=1e-4)
    mount(T0 + 5 * S)  # the gimbal has been silent for long
    assert attitude(world, T0 + 5 * S)[1] == pytest.approx(-1.0, abs=1e-4)
    assert texts(world) == [
        "gimbal attitude from MOUNT_ORIENTATION",
        "gimbal attitude from GIMBAL_DEVICE_ATTITUDE_STATUS",
    ]


def test_mount_orientation_from_north_where_the_yaw_from_the_nose_is_unknown(world):
    world.feed(world.speakers[1].mount_orientation(1, 0.0, -1.0, math.nan, 1.2), T0 + S)
    assert attitude(world) == pytest.approx((0.0, -1.0, 1.2), abs=1e-4)


def test_mount_status_is_hundredths_of_degrees_pitch_first(world):
    world.feed(mount_status(pitch=-1.1, roll=0.07, yaw=-0.4), T0 + S)
    assert attitude(world) == pytest.approx((0.07, -1.1, NOSE - 0.4), abs=2e-4)
    world.feed(world.speakers[1].mount_orientation(1, 0.0, -0.3, 0.0, math.nan), T0 + S + 1000)
    world.feed(mount_status(pitch=-1.1, roll=0.0, yaw=0.0), T0 + S + 2000)
    assert attitude(world, T0 + S + 3000)[1] == pytest.approx(-0.3, abs=1e-4)


def test_mount_status_beyond_the_circle_is_refused(world):
    world.feed(mount_status(pitch=-9.0, roll=0.0, yaw=0.0), T0 + S)
    assert attitude(world) is None
    assert texts(world) == ["MOUNT_STATUS not used: an angle beyond 360°"]


def middle(pitch, north_yaw):
    """Where an axis from 40 m above the origin meets the ground, ENU."""
    ahead = rotation_from_euler(0.0, pitch, north_yaw)[:, 0]
    return [ahead[1] * 40 / ahead[2], ahead[0] * 40 / ahead[2], 0.0]


@pytest.mark.parametrize("told", ["earth", "vehicle"])
def test_place_of_the_middle_tells_the_frame_of_a_cameras_attitude(world, told):
    q = quaternion_from_euler(0.0, -0.8, 2.0 if told == "earth" else 2.0 - NOSE)
    world.feed(fov(q, middle(-0.8, 2.0)), T0 + S)
    assert attitude(world) == pytest.approx((0.0, -0.8, 2.0), abs=1e-3)
    # and it still holds when the camera looks straight down, where the place tells nothing
    level = quaternion_from_euler(0.0, DOWN, 0.0)
    world.feed(fov(level, [0.0, 0.0, 0.0]), T0 + S + 100_000)
    top = world.fleet.at(T0 + S + 100_000).uav.R_enu_gimbal @ [0, 0, -1]
    yaw = 0.0 if told == "earth" else NOSE
    assert top == pytest.approx([math.sin(yaw), math.cos(yaw), 0], abs=1e-3)


def test_cameras_attitude_that_contradicts_its_own_image_is_refused(world):
    world.feed(fov(quaternion_from_euler(0.0, -0.8, 2.0), middle(-0.8, -1.0)), T0 + S)
    assert attitude(world) is None
    assert "CAMERA_FOV_STATUS not used: its attitude does not look at the place" in texts(world)[0]


def test_cameras_attitude_counts_from_north_where_nothing_tells(world):
    world.feed(fov(quaternion_from_euler(0.0, -0.8, 2.0)), T0 + S)
    assert attitude(world) == pytest.approx((0.0, -0.8, 2.0), abs=1e-4)


def test_cameras_attitude_that_is_not_given_is_none(world):
    world.feed(fov([math.nan] * 4), T0 + S)
    world.feed(fov([0.0] * 4), T0 + S)
    assert attitude(world) is None and texts(world) == []


def test_first_gimbal_is_the_one_and_another_is_told(world):
    world.feed(device(quaternion_from_euler(0, -0.5, 0), device_id=1), T0 + S)
    world.feed(device(quaternion_from_euler(0, -1.2, 0), device_id=2), T0 + S + 1000)
    assert attitude(world, T0 + S + 2000)[1] == pytest.approx(-0.5, abs=1e-4)
    assert texts(world)[1] == "gimbal 2 reports too and is not used: [camera] gimbal chooses"


def test_gimbal_that_carries_the_camera_is_the_one(world):
    world.feed(device(quaternion_from_euler(0, -0.5, 0), component=154, device_id=0), T0 + S)
    world.feed(information(gimbal_id=171), T0 + S)
    world.feed(device(quaternion_from_euler(0, -1.2, 0), component=171, device_id=0), T0 + S + 1000)
    world.feed(device(quaternion_from_euler(0, -0.5, 0), component=154, device_id=0), T0 + S + 2000)
    assert attitude(world, T0 + S + 3000)[1] == pytest.approx(-1.2, abs=1e-4)


@pytest.mark.parametrize("chosen", [2, 154])
def test_chosen_gimbal_is_the_one_by_device_or_component_id(chosen):
    world = World(origin=FIELD, gimbal_id=chosen)
    world.run(1)
    world.feed(device(quaternion_from_euler(0, -0.1, 0), device_id=1), T0 + S)
    world.feed(device(quaternion_from_euler(0, -0.2, 0), device_id=2), T0 + S + 1000)
    world.feed(device(quaternion_from_euler(0, -0.3, 0), component=154, device_id=0), T0 + S + 2000)
    world.feed(world.speakers[1].mount_orientation(1, 0.0, -1.4, 0.0, math.nan), T0 + S + 3000)
    assert attitude(world, T0 + S + 4000)[1] == pytest.approx({2: -0.2, 154: -0.3}[chosen], abs=1e-4)


def turning(t_s):
    """Yaw of a gimbal that turns, at a time in seconds."""
    return 0.3 * t_s


def flown_with(*, late_s, component=1, boot_ms=None, before=False, seconds=4.0):
    """A copter whose gimbal turns; each report comes late, dated by a boot clock, and the first before all else."""
    world = World(origin=FIELD)
    if before:
        world.feed(device(quaternion_from_euler(0.0, DOWN, 0.0), boot_ms=60_000, component=component), T0)
    for k in range(round(seconds * 20)):
        t_us = T0 + k * 50_000
        world.run(0.05, t_us, [1])
        made_us = t_us - round(late_s * 1e6)
        if made_us >= T0 and k % 2 == 0:
            since_ms = (made_us - T0) // 1000
            q = quaternion_from_euler(0.0, -0.8, turning(since_ms * 1e-3))
            sent_ms = boot_ms(since_ms) if boot_ms else world.boot_ms(1, made_us)
            world.feed(device(q, boot_ms=sent_ms, component=component), t_us)
    return world


def yaw_error_s(world, at_s):
    """By how many seconds the gimbal's attitude is off at a time; its yaw counts from the nose."""
    return (attitude(world, T0 + round(at_s * S))[2] - NOSE - turning(at_s)) / 0.3


@pytest.mark.parametrize("late_s", [0.0, 0.1, 0.25, 0.4])
@pytest.mark.parametrize("component", [1, 154])
def test_a_report_that_comes_late_is_of_the_time_that_it_states(late_s, component):
    assert yaw_error_s(flown_with(late_s=late_s, component=component), 3.0) == pytest.approx(0.0, abs=0.01)


def test_a_report_from_before_the_vehicles_clock_is_known_hides_no_later_one():
    world = flown_with(late_s=0.0, before=True)
    assert yaw_error_s(world, 3.0) == pytest.approx(0.0, abs=0.01)


@pytest.mark.parametrize("ahead_ms", [-40_000, 5_000, 3_600_000])
def test_a_gimbal_with_a_clock_of_its_own_is_dated_by_that_one(ahead_ms):
    world = flown_with(late_s=0.0, component=154, boot_ms=lambda ms: ms + 60_000 + ahead_ms)
    assert yaw_error_s(world, 3.0) == pytest.approx(0.0, abs=0.01)


@pytest.mark.parametrize("component", [1, 154])
@pytest.mark.parametrize("boot_ms", [0, 7])
def test_a_gimbal_whose_clock_stands_still_is_dated_by_arrival(component, boot_ms):
    world = flown_with(late_s=0.0, component=component, boot_ms=lambda ms: boot_ms)
    assert yaw_error_s(world, 3.0) == pytest.approx(0.0, abs=0.06)
