"""The camera a flight uses: mission, lens file or what the UAV reports; other sizes; zoom."""

import math

import numpy as np
import pytest

from gcs.errors import ConfigError
from gcs.fold.camera.optics import Optics
from gcs.fold.pipeline import Pipeline
from gcs.mission.mission import Camera, load_mission, parse_mission
from gcs.session.metadata import mission_table
from mavlink.geodesy import LocalFrame
from mavlink.protocol.encoder import COPTER, ROVER, MavlinkEncoder
from mavlink.protocol.packet import Packet
from mavlink.state import CameraReport
from vision.camera.intrinsics import Intrinsics
from vision.camera.lens_file import lens_text

LENS = Intrinsics(
    width=1920, height=1080, fx=1300, fy=1302, cx=950, cy=545, distortion=np.array([-0.1, 0.02, 0.001, 0, 0])
)
NUMBERS = {"width": 1920, "height": 1080, "fx": 1300.0, "fy": 1302.0, "cx": 950.0, "cy": 545.0}
WHO = {"uav": {"system_id": 1}, "ugv": [{"system_id": 11}]}


def report(hfov_deg=60.0, vfov_deg=math.nan, source="CAMERA_FOV_STATUS", **more):
    known = {"width": 0, "height": 0, "hfov": math.radians(hfov_deg), "vfov": math.radians(vfov_deg)}
    return CameraReport(**{**known, "source": source, **more})


def texts(optics):
    return [event.text for event in optics.take_events()]


def test_mission_counts_before_what_is_reported():
    optics = Optics(Camera(**NUMBERS, name="nadir.toml"))
    assert optics.intrinsics(0, report(), (1920, 1080)).fx == 1300.0
    assert texts(optics) == ["camera as nadir.toml has it: 72.9° across 1920 px"]
    optics.intrinsics(1, report(), None)
    assert texts(optics) == []


def test_reported_camera_takes_the_size_of_the_image():
    optics = Optics(None)
    assert optics.intrinsics(0, None, (1280, 720)) is None
    camera = optics.intrinsics(1, report(width=4000, height=3000, vfov_deg=47.0, model="Cam"), None)
    assert (camera.width, camera.height, camera.cx, camera.cy) == (1280, 720, 640, 360)
    assert camera.fx == camera.fy == pytest.approx(640 / math.tan(math.radians(30)))
    (told,) = texts(optics)
    assert told == (
        "camera as CAMERA_FOV_STATUS (Cam) without its height of 47.0°, which is another aspect's has it: "
        "60.0° across 1280 px"
    )


def test_reported_size_serves_without_images():
    optics = Optics(None)
    assert optics.intrinsics(0, report(), None) is None
    assert optics.intrinsics(0, report(width=640, height=480), None).width == 640


def test_image_of_another_aspect_is_an_alarm_and_no_camera():
    optics = Optics(Camera(**NUMBERS))
    for t_us in range(3):
        assert optics.intrinsics(t_us, None, (1440, 1080)) is None
    (alarm,) = optics.take_events()
    assert alarm.level == "alarm" and "described for images of 1920×1080, these are 1440×1080" in alarm.text
    assert optics.intrinsics(4, None, (960, 540)).fx == 650.0


def test_fixed_digital_zoom():
    camera = Optics(Camera(**NUMBERS, zoom=2.0)).intrinsics(0, None, (1920, 1080))
    assert (camera.fx, camera.fy, camera.cx, camera.cy) == (2600.0, 2604.0, 940.0, 550.0)


def test_zoom_by_percent_of_the_range():
    optics = Optics(Camera(**NUMBERS, zoom_max=5.0))
    factors = [
        optics.intrinsics(0, report(zoom_percent=percent, hfov_deg=fov), (1920, 1080)).fx / 1300.0
        for percent, fov in ((0.0, 60), (25.0, 60), (100.0, 20), (math.nan, 60))
    ]
    assert factors == [1.0, 2.0, 5.0, 1.0]
    assert [text[:24] for text in texts(optics)][1:3] == ["camera zoomed 2.00 times", "camera zoomed 2.50 times"]


def test_zoom_reports_are_not_followed_unless_the_range_is_known():
    camera = Optics(Camera(**NUMBERS)).intrinsics(0, report(zoom_percent=80.0), (1920, 1080))
    assert camera.fx == 1300.0


def test_field_of_view_that_changes_is_zoom():
    optics = Optics(Camera(**NUMBERS))
    first = optics.intrinsics(0, report(60.0), (1920, 1080))
    later = optics.intrinsics(1, report(20.0), (1920, 1080))
    # half the width of what is seen, in focal lengths, shrinks as the tangent
    assert first.fx == 1300.0
    assert later.fx / first.fx == pytest.approx(math.tan(math.radians(30)) / math.tan(math.radians(10)))
    assert later.cx - 960 == pytest.approx((950 - 960) * later.fx / first.fx)
    assert "camera zoomed 3.27 times: 25.4° across 1920 px" in texts(optics)


def test_field_of_view_of_a_reported_camera_is_followed_itself():
    optics = Optics(None)
    for t_us, hfov in enumerate((60.0, 60.5, 30.0)):
        assert optics.intrinsics(t_us, report(hfov), (1920, 1080)).hfov == pytest.approx(math.radians(hfov))
    told = texts(optics)
    assert len(told) == 2 and told[1].startswith("camera zoomed 2.15 times: 30.0°")


def mission_file(folder, camera):
    path = folder / "m.toml"
    path.write_text(f"[uav]\nsystem_id = 1\n[[ugv]]\nsystem_id = 11\n[camera]\n{camera}\n")
    return path


def test_lens_file_lies_beside_the_mission_and_goes_into_the_session(tmp_path):
    (tmp_path / "nadir.toml").write_text(lens_text(LENS, {}))
    mission = load_mission(mission_file(tmp_path, 'lens = "nadir.toml"\nmount = "fixed"\nzoom = 2.0'))
    camera = mission.camera
    assert (camera.fx, camera.cy, camera.name, camera.mount, camera.zoom) == (1300.0, 545.0, "nadir.toml", "fixed", 2.0)
    elsewhere = tmp_path / "flown" / "session.toml"
    elsewhere.parent.mkdir()
    elsewhere.write_text(mission_table(mission, {"format": 1}))
    assert load_mission(elsewhere).camera == camera


def test_mount_without_numbers_is_a_camera_that_the_uav_describes(tmp_path):
    mission = load_mission(mission_file(tmp_path, 'mount = "fixed"\npitch_deg = -60\ndevice = 2\ngimbal = 154'))
    assert mission.camera.intrinsics is None
    assert (mission.camera.device, mission.camera.gimbal) == (2, 154)
    again = tmp_path / "session.toml"
    again.write_text(mission_table(mission, {"format": 1}))
    assert load_mission(again).camera == mission.camera


@pytest.mark.parametrize(
    ("camera", "message"),
    [
        ('lens = "absent.toml"', r"m.toml: \[camera\]: lens .*absent.toml: no such file; gcs calibrate makes one"),
        ('lens = "m.toml"', "unknown key 'uav'"),
        ('lens = "a.toml"\nfx = 1000', "lens replaces width, height"),
        ('lens = "a.toml"\ndistortion = [0.1, 0, 0, 0, 0]', "leave those out"),
        ("width = 1920\nheight = 1080", "fx is missing; give width, height, fx, fy, cx, cy, or a lens file, or none"),
        ("zoom = 0", "must lie between 0.1 and 200"),
        ("zoom_max = 0.5", "must lie between 1 and 200"),
        ("device = 300", "must lie between 0 and 255"),
    ],
)
def test_cameras_of_missions_that_cannot_be(tmp_path, camera, message):
    with pytest.raises(ConfigError, match=message):
        load_mission(mission_file(tmp_path, camera))


FIELD = LocalFrame(-35.363, 149.165, 584.0)


def flown(camera, *frames):
    """A pipeline that has heard a level copter 40 m up, looking north, and these frames."""
    pipeline = Pipeline(parse_mission({**WHO, **camera}, "m.toml"))
    uav, t_us = MavlinkEncoder(1), 1_790_000_000_000_000
    lat, lon, alt = (float(v) for v in FIELD.to_geodetic([0.0, 0.0, 40.0]))
    for k in range(10):
        boot_ms = 1000 + 100 * k
        for frame in (
            uav.heartbeat(COPTER),
            uav.attitude(boot_ms, 0.0, 0.0, 0.0),
            uav.global_position_int(boot_ms, lat, lon, alt, 40.0),
            *frames,
        ):
            pipeline.add_packet(Packet(t_us + 100_000 * k, frame))
    return pipeline, t_us + 900_000


def fov_status(hfov_deg):
    from pymavlink.dialects.v20 import ardupilotmega

    message = ardupilotmega.MAVLink_camera_fov_status_message(1, *[2**31 - 1] * 6, [math.nan] * 4, hfov_deg, math.nan)
    return MavlinkEncoder(1).pack(message)


def stream(rotation):
    from pymavlink.dialects.v20 import ardupilotmega

    message = ardupilotmega.MAVLink_video_stream_information_message(
        1, 1, 0, 1, 30, 640, 360, 0, rotation, 0, b"a", b"rtsp://x"
    )
    return MavlinkEncoder(1).pack(message)


def test_fold_uses_the_reported_field_of_view_at_the_size_of_the_image():
    pipeline, t_us = flown({}, fov_status(90.0))
    snapshot = pipeline.add_frame(0, t_us, image=np.zeros((360, 640, 3), np.uint8))
    # 90° from 40 m: 80 m wide, and north is up
    np.testing.assert_allclose(snapshot.footprint_enu, [[-40, 22.5], [40, 22.5], [40, -22.5], [-40, -22.5]], atol=0.01)
    assert "camera as CAMERA_FOV_STATUS has it: 90.0° across 640 px" in [e.text for e in snapshot.events]
    pipeline.add_packet(Packet(t_us, fov_status(53.1301)))
    snapshot = pipeline.add_frame(1, t_us, image=np.zeros((360, 640, 3), np.uint8))
    np.testing.assert_allclose(snapshot.footprint_enu[0], [-20, 11.25], atol=0.01)
    assert [e.text for e in snapshot.events] == ["camera zoomed 2.00 times: 53.1° across 640 px"]


def test_fold_turns_an_image_that_its_stream_says_is_turned():
    pipeline, t_us = flown({}, fov_status(90.0), stream(180))
    snapshot = pipeline.add_frame(0, t_us, image=np.zeros((360, 640, 3), np.uint8))
    np.testing.assert_allclose(snapshot.footprint_enu[0], [40, -22.5], atol=0.01)
    quarter, t_us = flown({}, fov_status(90.0), stream(90))
    snapshot = quarter.add_frame(0, t_us, image=np.zeros((360, 640, 3), np.uint8))
    # turned clockwise, north is at the right: the upper left corner is south west, seen long ways
    np.testing.assert_allclose(snapshot.footprint_enu[0], [-22.5, -40], atol=0.01)


def test_fold_names_nothing_in_an_image_of_another_aspect():
    pipeline, t_us = flown({"camera": NUMBERS})
    snapshot = pipeline.add_frame(0, t_us, image=np.zeros((480, 640, 3), np.uint8))
    assert snapshot.pose == "unknown" and snapshot.footprint_enu is None
    assert any(e.level == "alarm" and "nothing can be named" in e.text for e in snapshot.events)


def test_a_known_camera_is_zoomed_as_it_reports():
    optics = Optics(None)
    known = {"hfov_deg": 81.0, "source": "siyi-a8-mini by its maker's data sheet", "zoom_max": 6.0, "model": "A8"}
    wide = optics.intrinsics(0, report(**known), (1280, 720))
    assert math.degrees(wide.hfov) == pytest.approx(81.0)
    assert texts(optics) == ["camera as siyi-a8-mini by its maker's data sheet (A8) has it: 81.0° across 1280 px"]
    assert optics.intrinsics(1, report(**known, zoom_percent=20.0), None).fx == pytest.approx(2.0 * wide.fx)
    described = Optics(Camera(**NUMBERS)).intrinsics(0, report(**known, zoom_percent=20.0), (1920, 1080))
    assert described.fx == 1300.0, "a mission that has the numbers says itself whether reports of zoom are followed"


def test_a_vehicle_below_is_in_view_before_the_first_frame_where_the_uav_tells_how_large_frames_are():
    rover, (lat, lon, alt) = MavlinkEncoder(11), map(float, FIELD.to_geodetic([0.0, 0.0, 0.0]))
    below = rover.global_position_int(1900, lat, lon, alt, 0.0)
    pipeline, t_us = flown({}, fov_status(90.0), stream(0), rover.heartbeat(ROVER), below)
    row = pipeline.between_frames(t_us).vehicles[1]
    assert (row.in_view, row.standing) == (True, "unidentified")
