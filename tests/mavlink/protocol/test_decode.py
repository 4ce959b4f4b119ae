import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega

from mavlink.protocol.decode import clean_text, decode
from mavlink.protocol.encoder import GCS, NO_AUTOPILOT, ROVER
from mavlink.protocol.framing import split
from mavlink.protocol.messages import (
    Attitude,
    CameraFov,
    CameraInformation,
    GimbalAttitude,
    GlobalPosition,
    GpsRaw,
    Heartbeat,
    MountOrientation,
    RadioStatus,
    StatusText,
    SystemTime,
    TimeSync,
    VideoStreamInformation,
)
from mavlink.protocol.packet import Packet
from tests.support.frames import MessageEncoder

UAV = MessageEncoder(1)


def decoded(frame, t_us=77):
    assert split(frame)[1].good == 1
    return decode(Packet(t_us, frame))


def test_heartbeat():
    assert decoded(UAV.heartbeat(ROVER, custom_mode=4, armed=False)) == Heartbeat(77, 1, 1, 10, 3, 1, 4, 4)
    assert decoded(UAV.heartbeat(armed=True)).armed
    assert decoded(MessageEncoder(255, 190, version=1).heartbeat(GCS, autopilot=NO_AUTOPILOT)).system_id == 255


def test_times():
    assert decoded(UAV.system_time(1234, 0)) == SystemTime(77, 1, 1, 0, 1234)
    assert decoded(UAV.timesync(0, 10_011_827_002)) == TimeSync(77, 1, 1, 0, 10_011_827_002)


@given(
    lat=st.integers(-(2**31), 2**31 - 1),
    lon=st.integers(-(2**31), 2**31 - 1),
    alt=st.integers(-(2**31), 2**31 - 1),
    v=st.tuples(*[st.integers(-32768, 32767)] * 3),
    hdg=st.integers(0, 65535),
    boot=st.integers(0, 2**32 - 1),
)
@settings(max_examples=100, deadline=None)
def test_global_position_in_si(lat, lon, alt, v, hdg, boot):
    frame = UAV.pack(ardupilotmega.MAVLink_global_position_int_message(boot, lat, lon, alt, -alt - 1, *v, hdg))
    sample = decoded(frame)
    assert isinstance(sample, GlobalPosition)
    assert sample.boot_ms == boot
    assert sample.lat_deg == pytest.approx(lat / 1e7, abs=1e-12)
    assert sample.lon_deg == pytest.approx(lon / 1e7, abs=1e-12)
    assert sample.alt_m == pytest.approx(alt / 1e3, abs=1e-6)
    assert sample.relative_alt_m == pytest.approx((-alt - 1) / 1e3, abs=1e-6)
    for speed, raw in zip((sample.v_north, sample.v_east, sample.v_down), v, strict=True):
        assert math.isnan(speed) if raw in (32767, -32768) else speed == pytest.approx(raw / 100.0)
    assert math.isnan(sample.heading) if hdg > 36000 else sample.heading == pytest.approx(math.radians(hdg / 100.0))


def test_short_payload_reads_as_zeros():
    frame = UAV.global_position_int(1, 0.0, 0.0, 0.0, 0.0, (0, 0, 0), 0.0)
    assert frame[1] == 1
    assert decoded(frame) == GlobalPosition(77, 1, 1, 1, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


@pytest.mark.parametrize("version", [1, 2])
def test_attitude(version):
    sample = decoded(MessageEncoder(3, version=version).attitude(500, 0.1, -0.2, 3.0, (0.4, 0.5, 0.6)))
    assert isinstance(sample, Attitude)
    assert (sample.boot_ms, sample.system_id) == (500, 3)
    numbers = [sample.roll, sample.pitch, sample.yaw, sample.roll_rate, sample.pitch_rate, sample.yaw_rate]
    assert numbers == pytest.approx([0.1, -0.2, 3.0, 0.4, 0.5, 0.6], abs=1e-6)


def test_attitude_quaternion_is_an_attitude():
    half = 0.25
    sample = decoded(UAV.attitude_quaternion(500, (math.cos(half), 0, 0, math.sin(half)), (0, 0, 0.1)))
    assert [sample.roll, sample.pitch, sample.yaw] == pytest.approx([0, 0, 0.5], abs=1e-6)
    assert math.isnan(decoded(UAV.attitude_quaternion(500, (0, 0, 0, 0))).yaw)


def test_gps_accuracy_and_its_absence():
    full = decoded(UAV.gps_raw_int(0, 1.5, -2.5, 30.0, fix_type=6, satellites=17, hdop=0.7, h_acc_m=0.3))
    assert full == GpsRaw(
        77, 1, 1, 6, 1.5, -2.5, 30.0, pytest.approx(0.7), 17, 0.3, full.v_acc_m, full.fix_us, full.speed, full.course
    )
    bare = decoded(MessageEncoder(1, version=1).gps_raw_int(0, 0, 0, 0, satellites=255))
    assert math.isnan(bare.hdop) and math.isnan(bare.h_acc_m) and math.isnan(bare.v_acc_m)
    assert bare.satellites == -1


def test_gimbal_and_mount():
    sample = decoded(UAV.gimbal_attitude(9, (0.5, -0.5, 0.5, 0.5), flags=44))
    assert sample == GimbalAttitude(77, 1, 1, 9, 44, (0.5, -0.5, 0.5, 0.5), 1)
    mount = decoded(UAV.mount_orientation(9, 0.0, -math.pi / 2, 0.25, math.nan))
    assert isinstance(mount, MountOrientation)
    assert mount.pitch == pytest.approx(-math.pi / 2, abs=1e-6)
    assert mount.yaw == pytest.approx(0.25, abs=1e-6)
    assert math.isnan(mount.yaw_absolute)


def test_camera_messages():
    information = decoded(UAV.camera_information(1, "Cam [x]\n", 8.0, (6.4, 4.8), (1920, 1080)))
    assert isinstance(information, CameraInformation)
    assert information.model == "Cam [x]\ufffd"
    assert (information.width_px, information.height_px) == (1920, 1080)
    assert information.focal_length_m == pytest.approx(8e-3)
    assert information.sensor_width_m == pytest.approx(6.4e-3)
    fov = decoded(
        UAV.pack(
            ardupilotmega.MAVLink_camera_fov_status_message(1, 0, 0, 0, 0, 0, 0, [1.0, 0.0, 0.0, 0.0], 60.0, math.nan)
        )
    )
    assert isinstance(fov, CameraFov)
    assert fov.hfov == pytest.approx(math.radians(60.0))
    assert math.isnan(fov.vfov)
    stream = decoded(
        UAV.pack(
            ardupilotmega.MAVLink_video_stream_information_message(
                1, 1, 0, 1, 30.0, 1280, 720, 0, 0, 60, b"nadir", b"rtsp://10.0.0.2/live"
            )
        )
    )
    assert isinstance(stream, VideoStreamInformation)
    assert (stream.name, stream.uri) == ("nadir", "rtsp://10.0.0.2/live")


def test_radio():
    assert decoded(UAV.radio_status(200, 190)) == RadioStatus(77, 1, 1, 200, 190, 40, 40, 100, 0, 0)


@pytest.mark.parametrize(
    ("raw", "text"),
    [
        (b"PreArm: \x1b[31mred\0rest", "PreArm: \ufffd[31mred"),
        (b"[@click=app.quit]x[/]", "[@click=app.quit]x[/]"),
        (b"\xff\xfe ok", "\ufffd\ufffd ok"),
        (b"a\r\nb\tc", "a\ufffd\ufffdb\ufffdc"),
        (b"", ""),
        ("höhe °".encode(), "höhe °"),
    ],
)
def test_text_from_the_air_is_harmless(raw, text):
    assert clean_text(raw) == text
    assert clean_text(raw).isprintable()


def test_statustext():
    sample = decoded(UAV.statustext("EKF3 active", severity=2, text_id=3, chunk=1))
    assert sample == StatusText(77, 1, 1, 2, "EKF3 active", 3, 1)


def test_messages_of_no_use_are_none():
    assert decoded(UAV.pack(ardupilotmega.MAVLink_vfr_hud_message(1, 1, 0, 0, 1, 0))) is None
