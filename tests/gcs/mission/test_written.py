"""A saved mission, loaded again, is the mission that flew."""

from dataclasses import replace

import pytest

from gcs.limits import Limits
from gcs.mission.fence import Fence
from gcs.mission.mast import Mast
from gcs.mission.mission import (
    Camera,
    Clock,
    DetectorChoice,
    Links,
    MapChoice,
    Mission,
    MissionVehicle,
    SigningChoice,
    View,
    keys_folder,
    load_mission,
)
from gcs.mission.written import save_mission

HEARD = Mission(
    uav=MissionVehicle(system_id=1, name="UAV"),
    ugv=(MissionVehicle(system_id=11, name='[b]"Tom"\\'), MissionVehicle(system_id=12, name="UGV-12")),
    links=Links(telemetry=("udpin:0.0.0.0:14550", "/dev/ttyUSB0,57600"), video="rtsp://u:p@host/main"),
)
LENS = Camera(width=1920, height=1080, fx=1200.0, fy=1200.5, cx=960.0, cy=540.0, pitch_deg=-60.0, mount="gimbal")
LOW = Camera(pitch_deg=-10.0)
MAST = Mast(name="Bridge", latitude_deg=48.1, longitude_deg=11.6, altitude_m=570.0, heading_deg=352.0)
FENCE = Fence(polygon=((48.1, 11.6), (48.2, 11.6), (48.2, 11.7)), keep="out", name="pond")


@pytest.mark.parametrize(
    "mission",
    [
        HEARD,
        replace(HEARD, camera=LENS, clock=Clock(video_offset_s="auto"), limits=Limits(satellites=4)),
        replace(HEARD, fence=(FENCE, replace(FENCE, keep="in")), links=Links()),
        replace(
            HEARD,
            detector=DetectorChoice(model="/models/own.onnx", classes=("ugv",)),
            map=MapChoice(tiles="/m.mbtiles"),
        ),
        replace(HEARD, view=(View(system_id=2), View(system_id=3, name="Mast", camera=LENS, video="udp://:5601"))),
        Mission(
            mast=MAST,
            camera=LOW,
            ugv=HEARD.ugv,
            view=(View(mast=replace(MAST, name="West"), camera=LOW), View(system_id=2)),
        ),
        replace(HEARD, signing=SigningChoice(keys="none")),
        replace(HEARD, signing=SigningChoice(keys="/keys", unsigned=(), keyless="open")),
    ],
)
@pytest.mark.parametrize("has_keys", [False, True])
def test_a_saved_mission_is_the_one_that_flew(mission, has_keys, tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    if has_keys:
        (tmp_path / "config" / "rollcall" / "keys").mkdir(parents=True)
    if not mission.signing.keys:
        mission = replace(mission, signing=SigningChoice(keys=keys_folder()))
    origins = {"": "made\nby", "1": "\x1b[31m copter", "11": "rover", "camera": "as reported", "links": "heard"}
    path, new = save_mission(mission, origins, tmp_path)
    assert new and load_mission(path) == mission
    assert "# made by\n" in (text := path.read_text()) and "\x1b" not in text
    assert save_mission(mission, origins, tmp_path) == (path, False)
