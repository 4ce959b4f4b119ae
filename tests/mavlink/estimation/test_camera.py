"""What a UAV says about its camera: which message counts, which camera, and numbers that no camera has."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega

from mavlink.estimation.camera_models import CAMERAS, camera_model
from mavlink.estimation.camera_report import NARROWEST, WIDEST
from mavlink.protocol.decode import decode
from mavlink.protocol.messages import CameraSettings
from mavlink.protocol.packet import Packet
from tests.support.flights import FIELD, T0, World
from tests.support.frames import MessageEncoder

NOBODY = [math.nan] * 4


@pytest.fixture
def world():
    return World(origin=FIELD)


def fov(hfov_deg, vfov_deg=math.nan, component=1, device=0, q=NOBODY):
    message = ardupilotmega.MAVLink_camera_fov_status_message(
        1, *[2**31 - 1] * 6, list(q), hfov_deg, vfov_deg, camera_device_id=device
    )
    return MessageEncoder(1, component).pack(message)


def stream(hfov_deg, size=(1280, 720), rotation=0, component=1, stream_id=1):
    message = ardupilotmega.MAVLink_video_stream_information_message(
        stream_id, 1, 0, 1, 30, *size, 0, rotation, hfov_deg, b"a", b"rtsp://x"
    )
    return MessageEncoder(1, component).pack(message)


def information(focal_mm=8.0, sensor_mm=(6.4, 4.8), size=(1920, 1080), component=1):
    return MessageEncoder(1, component).camera_information(1, "Nadir", focal_mm, sensor_mm, size)


def named(vendor, model, size=(0, 0)):
    """As ArduPilot has it of a SIYI camera: who made it, and a focal length without a sensor."""
    names = [list(name.encode().ljust(32, b"\0")) for name in (vendor, model)]
    message = ardupilotmega.MAVLink_camera_information_message(
        1, *names, 0, 21.0, math.nan, math.nan, *size, 0, 0, 0, b"", 1
    )
    return MessageEncoder(1).pack(message)


def settings_of(zoom):
    return MessageEncoder(1).pack(ardupilotmega.MAVLink_camera_settings_message(1, 1, zoom, math.nan))


def report(world):
    return world.fleet.at(T0).uav.camera


def texts(world):
    return [n.text for n in world.notices if n.kind == "camera"]


def test_lens_and_sensor_make_the_field_of_view(world):
    world.feed(information(), T0)
    camera = report(world)
    assert (camera.width, camera.height, camera.source, camera.model) == (1920, 1080, "CAMERA_INFORMATION", "Nadir")
    # 8 mm behind a sensor of 6.4 mm: 2400 px focal length in an image of 1920
    assert 960.0 / math.tan(camera.hfov / 2) == pytest.approx(2400.0)
    assert 4.8 / 2 / math.tan(camera.vfov / 2) == pytest.approx(8.0, abs=1e-5)


def test_stream_counts_before_lens_and_field_of_view_now_before_both(world):
    for frame in (information(), stream(90), fov(60.0, 35.0)):
        world.feed(frame, T0)
    assert report(world).source == "CAMERA_FOV_STATUS"
    assert (report(world).width, report(world).uri) == (1280, "rtsp://x")
    assert report(world).hfov == pytest.approx(math.radians(60.0))
    again = World(origin=FIELD)
    for frame in (fov(math.nan), stream(90), information()):
        again.feed(frame, T0)
    assert (report(again).source, report(again).hfov) == ("VIDEO_STREAM_INFORMATION", pytest.approx(math.pi / 2))


def test_field_of_view_alone_is_a_camera_of_unknown_size(world):
    """As ArduPilot has it, whose CAMERA_INFORMATION is full of zeros and NaN."""
    world.feed(information(math.nan, (math.nan, 0.0), (0, 0)), T0)
    assert report(world) is None
    world.feed(fov(70.0), T0)
    assert (report(world).width, report(world).height) == (0, 0)
    assert report(world).hfov == pytest.approx(math.radians(70.0))
    assert texts(world) == []


@pytest.mark.parametrize(
    ("frame", "text"),
    [
        (fov(179.0), "CAMERA_FOV_STATUS not used: a field of view of 179°"),
        (fov(-20.0), "CAMERA_FOV_STATUS not used: a field of view of -20°"),
        (fov(math.inf), "CAMERA_FOV_STATUS not used: a field of view of inf°"),
        (fov(0.1), "CAMERA_FOV_STATUS not used: a field of view of 0.1°"),
        (stream(400), "VIDEO_STREAM_INFORMATION not used: a field of view of 400°"),
        (information(-8.0), "CAMERA_INFORMATION not used: a field of view of 316.4°"),
        (information(1e9), "CAMERA_INFORMATION not used: a field of view of 3.667e-07°"),
        (settings_of(250.0), "CAMERA_SETTINGS not used: a zoom of 250 % of the range"),
    ],
    ids=["wide", "negative", "infinite", "narrow", "stream", "negative lens", "endless lens", "zoom"],
)
def test_numbers_of_no_camera_are_refused_and_told_once(world, frame, text):
    for _ in range(3):
        world.feed(frame, T0)
    assert texts(world).count(text) == 1
    assert report(world) is None
    assert all(n.level == "warning" for n in world.notices)


def test_what_is_refused_leaves_standing_what_was_said_before(world):
    for frame in (information(), stream(90, rotation=180), fov(60.0), settings_of(30.0)):
        world.feed(frame, T0)
    before = report(world)
    for frame in (fov(179.0), fov(math.nan), stream(0, size=(8, 8), rotation=5), settings_of(-1.0)):
        world.feed(frame, T0)
    assert report(world) == before


@settings(max_examples=60, deadline=None)
@given(st.floats(width=32), st.floats(width=32), st.integers(0, 65535), st.integers(0, 65535), st.floats(width=32))
def test_whatever_comes_a_report_is_possible_and_the_log_stays_short(hfov, vfov, width, turn, zoom):
    world = World(origin=FIELD)
    for k in range(40):
        for frame in (fov(hfov, vfov), stream(k * 9, (width, 720), turn), settings_of(zoom), information(hfov)):
            world.feed(frame, T0)
    camera = report(world)
    if camera is not None:
        angles = [a for a in (camera.hfov, camera.vfov) if not math.isnan(a)]
        assert angles and all(NARROWEST < a < WIDEST for a in angles)
        assert camera.rotation_deg in (0, 90, 180, 270)
        assert camera.width == 0 or 16 <= camera.width <= 16384
        assert math.isnan(camera.zoom_percent) or 0 <= camera.zoom_percent <= 100
    assert len(texts(world)) <= 30


def test_stream_turned_by_something_else_than_quarters(world):
    world.feed(stream(90, rotation=180), T0)
    assert report(world).rotation_deg == 180
    world.feed(stream(90, rotation=45), T0)
    assert report(world).rotation_deg == 180
    assert texts(world) == ["VIDEO_STREAM_INFORMATION not used: a rotation of 45°"]


def test_first_camera_that_tells_its_field_of_view_is_the_one(world):
    world.feed(stream(0, component=100), T0)  # says nothing of how wide it sees
    world.feed(fov(60.0, component=101), T0)
    world.feed(fov(20.0, component=100), T0)
    assert report(world).hfov == pytest.approx(math.radians(60.0))
    assert texts(world) == ["camera 100 reports too and is not used: [camera] device chooses"]


def test_chosen_camera_is_the_one_by_component_or_device_id():
    by_component = World(origin=FIELD, camera_id=101)
    by_device = World(origin=FIELD, camera_id=2)
    for world in (by_component, by_device):
        for frame in (fov(60.0, component=100), fov(50.0, device=1), fov(40.0, device=2), fov(30.0, component=101)):
            world.feed(frame, T0)
    assert report(by_component).hfov == pytest.approx(math.radians(30.0))
    assert report(by_device).hfov == pytest.approx(math.radians(40.0))


def test_camera_of_another_vehicle_is_none_of_ours(world):
    world.feed(MessageEncoder(11).camera_information(1, "Rover", 8.0, (6.4, 4.8), (640, 480)), T0)
    assert report(world) is None


def test_zoom_keeps_its_last_known_value(world):
    for frame in (fov(60.0), settings_of(50.0), settings_of(math.nan)):
        world.feed(frame, T0)
    assert report(world).zoom_percent == 50.0
    sample = decode(Packet(T0, settings_of(50.0)))
    assert sample == CameraSettings(T0, 1, 1, 50.0, 0)


@pytest.mark.parametrize(
    ("vendor", "model", "size", "name"),
    [
        ("Siyi", "A8", (0, 0), "siyi-a8-mini"),
        ("SIYI", "SIYI A8 mini", (1920, 1080), "siyi-a8-mini"),
        ("Siyi", "ZR10", (0, 0), "siyi-zr10"),
        ("DJI", "Mini3Pro", (0, 0), "dji-mini-3-pro"),
        ("Raspberry Pi", "Camera Module v2", (1640, 1232), "raspberry-pi-camera-module-2"),
        ("Raspberry Pi", "Camera Module 3 Wide", (1920, 1080), "raspberry-pi-camera-module-3-wide"),
        # one whose picture may be of the sensor's middle; a radio link; a bare sensor; no name at all
        ("Raspberry Pi", "Camera Module v2", (1920, 1080), ""),
        ("Raspberry Pi", "Camera Module v2", (0, 0), ""),
        ("Herelink", "Air Unit", (1920, 1080), ""),
        ("", "imx219", (1640, 1232), ""),
        ("", "A8", (0, 0), ""),
        ("", "", (0, 0), ""),
    ],
)
def test_a_camera_that_tells_its_name_alone_is_looked_up(world, vendor, model, size, name):
    world.feed(named(vendor, model, size), T0)
    if not name:
        assert report(world) is None
        return
    known = CAMERAS[name]
    assert math.degrees(report(world).hfov) == pytest.approx(known.hfov_deg)
    assert (report(world).source, report(world).zoom_max) == (f"{name} by {known.source}", known.zoom_max)
    world.feed(fov(50.0), T0)
    assert (report(world).source, report(world).zoom_max) == ("CAMERA_FOV_STATUS", 1.0), "what is measured counts more"


def test_every_known_camera_has_a_source_and_is_found_by_each_of_its_names():
    for name, known in CAMERAS.items():
        assert known.source and 10.0 < known.hfov_deg < 110.0
        assert all(camera_model(each) is known for each in (name, name.upper().replace("-", " "), *known.also))
