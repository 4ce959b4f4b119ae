import csv
import dataclasses
import tomllib

import av
import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from mavlink.geodesy import LocalFrame
from sim.errors import ScenarioError, SessionWriteError
from sim.session import frame_times, write_session
from sim.world.presets import curved_road
from sim.world.scenario import Blackout, ScenarioCamera, ScenarioDeclared, ScenarioGround, ScenarioTiming
from sim.world.scenario_file import load_scenario

SHORT = dataclasses.replace(
    curved_road(), duration_s=4.0, occlusions=(), blackouts=(Blackout(start_s=0.95, stop_s=1.95),)
)
SMALL = dataclasses.replace(
    SHORT, duration_s=0.6, camera=ScenarioCamera(width=480, height=270, fx=300.0, fy=300.0, cx=240.0, cy=135.0)
)


def rows(path):
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("sessions") / "a"
    write_session(SHORT, path)
    return path


def test_a_session_has_its_files_and_their_columns(folder):
    assert sorted(p.name for p in folder.iterdir()) == [
        "detections.csv",
        "frames.csv",
        "scenario.toml",
        "session.toml",
        "telemetry.tlog",
        "truth.csv",
    ]
    heads = {p.name: p.read_text().split("\n")[0] for p in folder.glob("*.csv")}
    assert heads == {
        "frames.csv": "frame,time_us",
        "detections.csv": "frame,cx,cy,w,h,angle,score,heading",
        "truth.csv": "frame,cx,cy,w,h,angle,system_id",
    }
    assert load_scenario(folder / "scenario.toml") == SHORT


def test_two_cameras_over_one_fleet(folder, tmp_path):
    scenario = SHORT.filmed_by(2)
    write_session(scenario, tmp_path / "two")
    second = tmp_path / "two" / "view-2"
    assert load_scenario(tmp_path / "two" / "scenario.toml") == scenario
    for name in ("frames.csv", "detections.csv", "truth.csv"):
        assert (tmp_path / "two" / name).read_bytes() == (folder / name).read_bytes()
        assert (second / name).read_bytes() != (folder / name).read_bytes()
    assert {row["system_id"] for row in rows(second / "truth.csv")} == {
        row["system_id"] for row in rows(folder / "truth.csv")
    }
    first_us, second_us = (int(rows(path / "frames.csv")[0]["time_us"]) for path in (folder, second))
    assert second_us - first_us == pytest.approx(200_000, abs=20_000)
    (view,) = tomllib.loads((tmp_path / "two" / "session.toml").read_text())["view"]
    assert (view["system_id"], view["clock"]) == (2, {"video_offset_s": 0.2})
    one, two = (senders(path / "telemetry.tlog") for path in (folder, tmp_path / "two"))
    assert two.keys() - one.keys() == {2}
    assert {system_id: two[system_id] for system_id in one} == one


def test_a_camera_on_a_mast_sends_nothing_and_is_where_the_mission_has_it(tmp_path):
    scenario = SHORT.filmed_by(3, masts=1)
    world = write_session(scenario, tmp_path / "three")
    table = tomllib.loads((tmp_path / "three" / "session.toml").read_text())
    assert senders(tmp_path / "three" / "telemetry.tlog").keys() & {1, 2, 3} == {1, 2}
    flies, stands = table["view"]
    assert "mast" not in flies and "system_id" not in stands
    truth = world.views[1]
    assert np.allclose(truth.at(0.0).uav.p_enu, truth.at(3.0).uav.p_enu)
    frame = LocalFrame(scenario.latitude_deg, scenario.longitude_deg, scenario.altitude_m)
    place = frame.to_enu_point(stands["mast"]["latitude_deg"], stands["mast"]["longitude_deg"], scenario.altitude_m)
    assert place[:2] == pytest.approx(truth.at(0.0).uav.p_enu[:2], abs=0.1)
    assert (stands["mast"]["height_m"], stands["camera"]["yaw_deg"], stands["camera"]["pitch_deg"]) == (
        25.0,
        4.0,
        -21.5,
    )


def senders(path):
    """Packets of each system in a log, by its id."""
    data, sent, at = path.read_bytes(), {}, 0
    while at < len(data):
        end = at + 8 + 12 + data[at + 9]
        sent.setdefault(data[at + 8 + 5], []).append(data[at:end])
        at = end
    return sent


def test_session_toml_declares_what_flew(folder):
    session = tomllib.loads((folder / "session.toml").read_text())
    assert session["uav"] == {"system_id": 1}
    assert [u["system_id"] for u in session["ugv"]] == list(range(11, 18))
    assert session["ugv"][0]["name"] == "UGV-11"
    assert session["camera"]["fx"] == 1200.0
    assert session["camera"]["mount"] == "stabilized"
    assert session["camera"]["distortion"] == [0.0] * 5
    assert session["clock"] == {"video_offset_s": 0.0}


def test_frames_detections_and_truth_belong_together(folder):
    frames, detections, truth = (rows(folder / f"{n}.csv") for n in ("frames", "detections", "truth"))
    times = np.array([int(r["time_us"]) for r in frames])
    assert [int(r["frame"]) for r in frames] == list(range(40))
    assert abs(np.diff(times) - 100_000).max() < 20_000
    for box, name in zip(detections, truth, strict=True):
        assert all(box[key] == name[key] for key in ("frame", "cx", "cy", "w", "h", "angle"))
    seen = {int(r["frame"]) for r in detections}
    assert seen == set(range(10)) | set(range(20, 40))
    # the seventh is outside; the look-alike may be in view
    assert {int(r["system_id"]) for r in truth} - {0} == set(range(11, 17))


def test_the_tlog_is_stamped_in_order_and_parses(folder):
    data = (folder / "telemetry.tlog").read_bytes()
    parser, at, stamps, ids = dialect.MAVLink(None), 0, [], set()
    while at < len(data):
        stamps.append(int.from_bytes(data[at : at + 8], "big"))
        length = 12 + data[at + 9]
        ids.add(parser.parse_buffer(data[at + 8 : at + 8 + length])[0].get_srcSystem())
        at += 8 + length
    assert ids == {1, *range(11, 18)}
    assert stamps == sorted(stamps)
    assert stamps[0] < SHORT.start_us < SHORT.start_us + 4_000_000 < stamps[-1]


def test_equal_scenarios_give_equal_bytes(folder, tmp_path):
    write_session(SHORT, tmp_path / "b")
    for path in folder.iterdir():
        assert path.read_bytes() == (tmp_path / "b" / path.name).read_bytes(), path.name


def test_a_folder_is_never_overwritten(folder):
    before = {p.name: p.read_bytes() for p in folder.iterdir()}
    with pytest.raises(SessionWriteError, match="exists already"):
        write_session(SHORT, folder)
    assert {p.name: p.read_bytes() for p in folder.iterdir()} == before


def test_a_folder_that_cannot_be_made_is_named(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(SessionWriteError, match=r"file/session: cannot be made"):
        write_session(SHORT, tmp_path / "file" / "session")


@pytest.mark.slow_but_first
@pytest.mark.parametrize(("declared", "said"), [("exact", 0.35), ("zero", 0.0), ("auto", "auto")])
def test_the_video_offset_is_in_the_stamps_and_declared_as_asked(declared, said, tmp_path):
    scenario = dataclasses.replace(SHORT, timing=ScenarioTiming(video_offset_s=0.35, declared_offset=declared))
    t, stamps = frame_times(scenario)
    np.testing.assert_allclose((stamps - scenario.start_us) / 1e6 - t, 0.35, atol=1e-6)
    write_session(scenario, tmp_path / "s")
    assert tomllib.loads((tmp_path / "s" / "session.toml").read_text())["clock"]["video_offset_s"] == said


@pytest.mark.slow
def test_a_film_is_rendered_twice_alike(tmp_path):
    for name in ("a", "b"):
        write_session(SMALL, tmp_path / name, video=True)
    assert (tmp_path / "a" / "video.mp4").read_bytes() == (tmp_path / "b" / "video.mp4").read_bytes()


def test_a_rendered_session_has_a_video_with_the_frames_times(tmp_path):
    write_session(SMALL, tmp_path / "a", video=True)
    assert not (tmp_path / "a" / "detections.csv").exists()
    with av.open(str(tmp_path / "a" / "video.mp4")) as video:
        frames = list(video.decode(video=0))
    stamps = np.array([int(r["time_us"]) for r in rows(tmp_path / "a" / "frames.csv")])
    assert [(f.width, f.height) for f in frames] == [(480, 270)] * 6
    seconds = np.array([float(f.pts * f.time_base) for f in frames])
    np.testing.assert_allclose(seconds, (stamps - stamps[0]) / 1e6, atol=2e-5)
    truth = rows(tmp_path / "a" / "truth.csv")
    assert {r["system_id"] for r in truth} >= {str(i) for i in range(11, 17)}
    assert "17" not in {r["system_id"] for r in truth}


def test_a_film_of_another_flight_shows_nobody_of_ours(folder, tmp_path):
    even = dataclasses.replace(SHORT, timing=ScenarioTiming(frame_jitter_s=0.0))
    other = dataclasses.replace(even, seed=9)
    write_session(even, tmp_path / "s", film=other)
    write_session(other, tmp_path / "other")
    assert (tmp_path / "s" / "telemetry.tlog").read_bytes() == (folder / "telemetry.tlog").read_bytes()
    assert (tmp_path / "s" / "session.toml").read_bytes() == (folder / "session.toml").read_bytes()
    assert (tmp_path / "s" / "detections.csv").read_bytes() == (tmp_path / "other" / "detections.csv").read_bytes()
    assert {r["system_id"] for r in rows(tmp_path / "s" / "truth.csv")} == {"0"}


def test_a_mission_can_be_wrong_about_the_camera(folder, tmp_path):
    wrong = ScenarioDeclared(focal_share=0.7, yaw_deg=90.0, pitch_deg=15.0, offset_s=2.0)
    write_session(dataclasses.replace(SHORT, declared=wrong), tmp_path / "s")
    said = tomllib.loads((tmp_path / "s" / "session.toml").read_text())
    assert said["camera"]["fx"] == pytest.approx(0.7 * 1200.0)
    assert (said["camera"]["yaw_deg"], said["camera"]["pitch_deg"]) == (90.0, -75.0)
    assert said["clock"]["video_offset_s"] == 2.0
    for name in ("telemetry.tlog", "frames.csv", "detections.csv"):
        assert (tmp_path / "s" / name).read_bytes() == (folder / name).read_bytes()


def test_a_mission_can_leave_the_camera_out(tmp_path):
    write_session(dataclasses.replace(SHORT, declared=ScenarioDeclared(camera=False)), tmp_path / "s")
    assert "camera" not in tomllib.loads((tmp_path / "s" / "session.toml").read_text())


def test_frames_can_be_lost():
    t, stamps = frame_times(dataclasses.replace(SHORT, duration_s=60.0, timing=ScenarioTiming(frame_loss=0.25)))
    assert len(t) == len(stamps) == pytest.approx(450, abs=40)
    assert np.diff(t).max() > 0.25


def test_waves_are_not_drawn(tmp_path):
    wavy = dataclasses.replace(SMALL, ground=ScenarioGround(waves_m=2.0))
    with pytest.raises(ScenarioError, match="waves_m cannot be drawn"):
        write_session(wavy, tmp_path / "s", video=True)
