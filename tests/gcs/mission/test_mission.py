import tomllib

import pytest

from gcs.errors import ConfigError, GcsError
from gcs.flight.plan import FlightPlan
from gcs.fold.camera.frame_camera import identifier_params
from gcs.mission.mission import BUNDLED, load_mast, load_mission, parse_mission, user_keys
from gcs.session.metadata import mission_table

GOOD = """
[uav]
system_id = 1
[[ugv]]
system_id = 11
name = "Alpha"
[[ugv]]
system_id = 12
[camera]
width = 1920
height = 1080
fx = 1200
fy = 1200.0
cx = 960.0
cy = 540.0
distortion = [0, 0, 0, 0, 0]
mount = "fixed"
pitch_deg = -45.0
[clock]
video_offset_s = "auto"
"""


def test_reads_every_part():
    mission = parse_mission(tomllib.loads(GOOD), "m.toml")
    assert mission.uav.system_id == 1
    assert mission.ugv_ids == (11, 12)
    assert [mission.name_of(i) for i in (1, 11, 12, 99)] == ["UAV", "Alpha", "UGV-12", "UGV-99"]
    assert mission.camera is not None
    assert (mission.camera.fx, mission.camera.mount, mission.camera.pitch_deg) == (1200.0, "fixed", -45.0)
    assert mission.clock.video_offset_s == "auto"
    assert mission.identity.threshold == 0.7


def test_written_and_read_again_is_the_same():
    mission = parse_mission(tomllib.loads(GOOD), "m.toml")
    again = parse_mission(tomllib.loads(mission_table(mission, {"format": 1})), "session.toml")
    assert (again.camera, again.clock, again.ugv_ids, again.identity) == (
        mission.camera,
        mission.clock,
        mission.ugv_ids,
        mission.identity,
    )


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("[clock]", "[clok]"), "unknown key 'clok'; did you mean clock?"),
        (("video_offset_s", "vido_offset_s"), "did you mean video_offset_s?"),
        (("width = 1920", ""), "width is missing"),
        (("width = 1920", "width = 3"), "must lie between 16 and 16384"),
        (("fx = 1200", "fx = nan"), "fx is nan"),
        (("fx = 1200", 'fx = "wide"'), "is 'wide'; a number is needed"),
        (("system_id = 12", "system_id = 11"), "system id 11 is given to two vehicles"),
        (("system_id = 12", "system_id = 300"), "must lie between 1 and 255"),
        (("system_id = 12", "system_id = true"), "a whole number is needed"),
        (("system_id = 12", "system_id = 1.5"), "a whole number is needed"),
        (('mount = "fixed"', 'mount = "glued"'), "'fixed' or 'gimbal' or 'stabilized' is needed"),
        (("[0, 0, 0, 0, 0]", "[0, 0]"), "a list of 5 numbers"),
        (("[0, 0, 0, 0, 0]", "3"), "a list of 5 numbers"),
        (('video_offset_s = "auto"', 'video_offset_s = "later"'), "a number or 'auto' is needed"),
        (("[[ugv]]\nsystem_id = 12\n", "[[ugv]]\n"), "[[ugv]] number 2: system_id is missing"),
    ],
)
def test_says_what_is_wrong_and_where(change, message):
    with pytest.raises(ConfigError) as refused:
        parse_mission(tomllib.loads(GOOD.replace(*change)), "m.toml")
    assert str(refused.value).startswith("m.toml") or "two vehicles" in message
    assert message in str(refused.value)


def test_needs_vehicles():
    with pytest.raises(ConfigError, match=r"or \[mast\] instead, and at least one"):
        parse_mission({"uav": {"system_id": 1}}, "m.toml")
    with pytest.raises(ConfigError, match="two brackets"):
        parse_mission({"uav": {"system_id": 1}, "ugv": {"system_id": 2}}, "m.toml")


def test_files_that_are_not_missions(tmp_path):
    with pytest.raises(ConfigError, match="no such file"):
        load_mission(tmp_path / "absent.toml")
    (tmp_path / "bad.toml").write_text("[uav\n")
    with pytest.raises(ConfigError, match="not valid TOML"):
        load_mission(tmp_path / "bad.toml")
    (tmp_path / "binary.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ConfigError, match="cannot be read as text"):
        load_mission(tmp_path / "binary.toml")


def test_paths_of_models_are_where_the_mission_file_is(tmp_path):
    path = tmp_path / "m.toml"
    path.write_text(
        GOOD + '[detector]\nmodel = "yolo.onnx"\nfront = "/models/front.onnx"\nfront_sure = 0.9\ntiled = false\n'
    )
    mission = load_mission(path)
    assert mission.detector.model == str(tmp_path / "yolo.onnx")
    assert (mission.detector.front, mission.detector.front_sure) == ("/models/front.onnx", 0.9)
    assert not mission.detector.tiled
    # written into a session elsewhere it still is the same file
    copy = tmp_path / "sessions" / "session.toml"
    copy.parent.mkdir()
    copy.write_text(mission_table(mission, {"format": 1}))
    assert load_mission(copy).detector == mission.detector


def test_bundled_models_have_no_path(tmp_path):
    path = tmp_path / "m.toml"
    path.write_text(GOOD)
    assert (load_mission(path).detector.model, load_mission(path).detector.front) == ("", "")
    path.write_text(GOOD + '[detector]\nfront = "bundled"\n')
    assert load_mission(path).detector.front == BUNDLED


def test_keys_are_where_the_mission_says(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    path = tmp_path / "m.toml"
    path.write_text(GOOD)
    assert load_mission(path).signing.folder is None
    assert load_mission(path).signing.unsigned == (109,)
    path.write_text(GOOD + '[signing]\nkeys = "keys"\nunsigned = [109, 166]\nkeyless = "open"\n')
    signing = load_mission(path).signing
    assert (signing.folder, signing.unsigned, signing.keyless) == (tmp_path / "keys", (109, 166), "open")
    # the user's own, where there is one, unless the mission says otherwise
    (tmp_path / "config" / "rollcall" / "keys").mkdir(parents=True)
    assert load_mission(path).signing.folder == tmp_path / "keys"
    path.write_text(GOOD)
    assert load_mission(path).signing.folder == tmp_path / "config" / "rollcall" / "keys"
    path.write_text(GOOD + '[signing]\nkeys = "none"\n')
    assert load_mission(path).signing.folder is None


def test_keys_in_the_home_folder(tmp_path, monkeypatch):
    monkeypatch.delenv("XDG_CONFIG_HOME", raising=False)
    monkeypatch.setenv("HOME", str(tmp_path))
    assert user_keys() == tmp_path / ".config" / "rollcall" / "keys"
    path = tmp_path / "m.toml"
    path.write_text(GOOD + '[signing]\nkeys = "~/mine"\n')
    assert load_mission(path).signing.folder == tmp_path / "mine"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[signing]\nkey = 'x'\n", "did you mean keys?"),
        ("[signing]\nunsigned = 109\n", "a list of whole numbers is needed"),
        ("[signing]\nunsigned = [109.5]\n", "a list of whole numbers is needed"),
        ("[signing]\nunsigned = [true]\n", "a list of whole numbers is needed"),
        ("[signing]\nunsigned = [-1]\n", "must lie between 0 and"),
        ("[signing]\nkeyless = 'maybe'\n", "'open' or 'refused' is needed"),
        ("[links]\nforward = 'udpout:127.0.0.1:14551'\n", "a list of texts is needed"),
    ],
)
def test_signing_and_forwarding_that_cannot_be(text, message):
    with pytest.raises(ConfigError) as refused:
        parse_mission(tomllib.loads(GOOD + text), "m.toml")
    assert message in str(refused.value)


def test_links_to_forward_to():
    links = parse_mission(tomllib.loads(GOOD + '[links]\nforward = ["udpout:127.0.0.1:14551"]\n'), "m.toml").links
    assert links.forward == ("udpout:127.0.0.1:14551",)


MAST = """
[[ugv]]
system_id = 11
[mast]
name = "Bridge"
latitude_deg = 48.1
longitude_deg = 11.6
height_m = 20
heading_deg = 352
[camera]
pitch_deg = -4
[[view]]
system_id = 2
[[view]]
[view.mast]
latitude_deg = 48.2
longitude_deg = 11.6
altitude_m = 570
heading_deg = 90
heading_std_deg = 15
[view.camera]
pitch_deg = -20
"""


def test_cameras_on_masts():
    mission = parse_mission(tomllib.loads(MAST), "m.toml")
    assert [each.name_of(each.uav.system_id) for each in mission.views] == ["Bridge", "UAV-2", "Mast-3"]
    assert [each.uav.system_id for each in mission.views] == [256, 2, 258]
    assert mission.system_ids == (2, 11), "masts send nothing"
    assert mission.views[2].mast.stand.heading == pytest.approx(1.5708, abs=1e-3)
    assert identifier_params(mission.views[2]).yaw_std_deg == 15.0
    assert [identifier_params(each).yaw_std_deg for each in mission.views[:2]] == [7.0, 7.0]


@pytest.mark.parametrize(("clock", "offset_s"), [("", "auto"), ("[clock]\nvideo_offset_s = 0.0", 0.0)])
def test_the_clock_of_a_mast_of_its_own_file_is_unknown_unless_told(clock, offset_s, tmp_path):
    path = tmp_path / "mast.toml"
    path.write_text(
        f"[mast]\nlatitude_deg = 48\nlongitude_deg = 11\nheight_m = 9\nheading_deg = 0\n"
        f"{clock}\n[camera]\npitch_deg = -9\n"
    )
    assert load_mast(path).clock.video_offset_s == offset_s


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("pitch_deg = -4", "", "[camera]: pitch_deg is missing"),
        ("[camera]\npitch_deg = -4", "", "[camera]: pitch_deg is missing"),
        ("pitch_deg = -20", "", "[view.camera]: pitch_deg is missing"),
        ("height_m = 20", "", "height_m is missing"),
        ("height_m = 20", "height_m = 1", "must lie between 3"),
        ("[view.mast]", "system_id = 3\n[view.mast]", "a camera on a mast has none"),
        ("system_id = 2\n", "", "system_id is missing"),
        ("[mast]", "[uav]\nsystem_id = 1\n[mast]", "needs [uav], or [mast] instead"),
        ("pitch_deg = -4", "pitch_deg = -4\nmount = 'gimbal'", "nothing reports one on a mast"),
    ],
)
def test_masts_that_cannot_be(old, new, message):
    with pytest.raises(ConfigError) as refused:
        parse_mission(tomllib.loads(MAST.replace(old, new, 1)), "m.toml")
    assert message in str(refused.value)


@pytest.mark.parametrize("further", ['system_id = 2\nname = "North"', "system_id = 3\n[[view]]\nsystem_id = 2"])
def test_two_cameras_of_one_name_are_refused(further):
    text = f"[uav]\nsystem_id = 1\nname = '{'North' if 'North' in further else 'UAV-2'}'\n[[ugv]]\nsystem_id = 11\n"
    with pytest.raises(ConfigError, match=r"two cameras are called (North|UAV-2); give each"):
        parse_mission(tomllib.loads(f"{text}[[view]]\n{further}"), "m.toml")
    assert parse_mission(tomllib.loads(f"{text}[[view]]\nsystem_id = 9"), "m.toml").views[1].uav.name == "UAV-9"


@pytest.mark.parametrize(
    ("video", "further", "command", "message"),
    [
        ("", "auto", False, "Mast-3: its video is"),
        ("auto", "", False, "Bridge: its"),
        ("", "", True, "--command is for"),
    ],
)
def test_nothing_is_asked_of_a_mast(video, further, command, message, tmp_path):
    mission = parse_mission(tomllib.loads(MAST.replace("[view.mast]", f"video = '{further}'\n[view.mast]")), "m.toml")
    with pytest.raises(GcsError, match=message):
        FlightPlan(mission=mission, links=("14550",), video=video, sessions=tmp_path, command=command)
