"""Inputs as public bug reports describe them, as they were handed in: ``tests/data/reported``, by the commands."""

import json
from pathlib import Path

import numpy as np
import pytest

from gcs.importing.film import open_film
from gcs.importing.sources import read_vehicle_logs
from gcs.mission.mission import load_mission
from mavlink.protocol.modes import mode_name
from mavlink.tlog.log import Tlog
from tests.support.command_line import run_gcs
from vision.video.video import VideoFile

FOLDER = Path("tests/data/reported")
GREY = ("grey_film.mp4", "--fov", "70", "--uav", "tables_uav.csv")
POSED = ("--uav", "films_pose.csv", "--ugv", "films_fleet.csv", "--fov", "77.3")
SUBTITLED = ("films_whole.mp4", "--ugv", "subtitles_fleet.csv", "--uav")
FLEET_ALONE = ("--ugv", "films_fleet.csv")


def imported(words, session):
    """Exit code, report and messages of ``gcs import``, with the clocks as they stand in the files."""
    video, *others = words
    paths = [FOLDER / word if (FOLDER / word).exists() else word for word in others]
    paths = [f"11={FOLDER / word[3:]}" if str(word).startswith("11=") else word for word in paths]
    code, told, refused = run_gcs("import", "-o", session, "--video", FOLDER / video, "--clock=+0", "--json", *paths)
    return code, json.loads(told) if code == 0 else {}, refused


@pytest.mark.slow_but_first
@pytest.mark.parametrize(
    ("words", "why"),
    [
        ((*GREY, "--ugv", "11=two_boots_two_boots.bin"), "the vehicle was started again at byte 27652; cut it there"),
        ((*GREY, "--ugv", "11=ulog2csv_rover.csv"), "column timestamp: cannot be s, since rows are 202360 apart"),
        ((*GREY[:4], "boot_ms_uav_uav.csv", "--ugv", "11=excel_sep_line_rover.csv"), "since rows are 500 apart"),
        ((*GREY, "--ugv", "11=same_time_gpx_rover.gpx"), "all 60 positions have the same time, 2020-06-12 05:50:25"),
        ((*GREY, "--ugv", "11=local_dates_rover_de.csv"), "the time '09.10.2025 08:53:20.000000' is not understood"),
        ((*GREY, "--ugv", "11=local_dates_rover_us.csv"), "the time '10/09/2025 08:53:20 AM' is not understood"),
        ((*GREY, "--ugv", "date_in_track_name_rover.gpx"), "has no system id; give it as --ugv ID="),
        ((*GREY, "--ugv", "11=local_time_gpx_rover.gpx"), "times without a zone are UTC"),
        (
            (*GREY[:4], "excel_sep_line_rover.csv", "--ugv", "11=excel_sep_line_rover.csv"),
            "same times as in excel_sep_line_rover.csv of system 11; is one log given for two vehicles?",
        ),
        (
            (*GREY[:4], "row_id_rover.csv", "--ugv", "11=qgc_csv_rover.csv", "--clock=auto"),
            "(row_id_rover.csv: it never is 3 m above its take-off or the fleet: is it a ground vehicle's log?)",
        ),
        (("klv_hae_film.ts", *FLEET_ALONE), "above the ellipsoid alone (tag 75 or 104), not above sea level (tag 15)"),
        (("djmd_error_film.mp4", *FLEET_ALONE, "--fov", "70"), "DJI meta 01:00:00:0': DJI does not publish its layout"),
    ],
)
def test_what_cannot_be_used_says_why(words, why, tmp_path):
    code, _, refused = imported(words, tmp_path / "s")
    assert code == 2 and why in refused and refused.count("\n") == 1
    assert not (tmp_path / "s").exists()


@pytest.mark.slow_but_first
@pytest.mark.parametrize(
    ("words", "count", "said"),
    [
        ((*GREY, "--ugv", "11=row_id_rover.csv"), 60, "the column id counts rows: it is no system id"),
        ((*GREY, "--ugv", "11=excel_sep_line_rover.csv"), 60, ""),
        ((*GREY, "--ugv", "11=time_units_message_rover_ms.csv"), 60, ""),
        ((*GREY, "--ugv", "11=time_units_message_rover_us.csv"), 60, ""),
        ((*GREY, "--ugv", "11=time_units_message_rover_ns.csv"), 60, ""),
        ((*GREY, "--ugv", "11=qgc_csv_rover.csv"), 60, "times without a zone are UTC"),
        (
            (*GREY[:4], "companion_position_uav.csv", "--tlog", "companion_position_fleet.tlog"),
            400,
            "by the fleet's median altitude of 430.0 m",
        ),
        (
            (*GREY[:3], "--tlog", "clock_set_back_fleet.tlog"),
            400,
            "the recorder's clock was set by -3600.00 s at byte 35402: all times are on the clock that it has from",
        ),
    ],
)
def test_a_vehicles_log_is_that_of_one_vehicle_on_the_films_time(words, count, said, tmp_path):
    session = tmp_path / "s"
    code, report, refused = imported(words, session)
    assert code == 0, refused
    assert any(said in text for text in report["assumed"])
    log = Tlog.open(session / "telemetry.tlog")
    rows, wire = log.columns(33, 11)
    assert len(rows[log.index.component_id[rows] == 1]) == count
    assert np.ptp(wire["alt"][log.index.component_id[rows] == 1]) < 5_000
    first_us = int((session / "frames.csv").read_text().splitlines()[1].split(",")[1])
    for system_id in (report["uav"], *report["ugv"]):
        times = log.index.t_us[log.columns(33, system_id)[0]]
        assert times.min() - 2_000_000 < first_us < times.max(), system_id


def test_a_log_of_another_hour_is_told_and_left_out(tmp_path):
    late = tmp_path / "late.csv"
    late.write_text((FOLDER / "row_id_rover.csv").read_text().replace("T08:", "T09:"))
    code, report, _ = imported((*GREY, "--ugv", "11=row_id_rover.csv", "--ugv", f"12={late}"), tmp_path / "s")
    assert code == 0 and report["ugv"] == [11, 12]
    said = (
        "late.csv, system 12, tells nothing of the film: of 2025-10-09 09:53:20 to 2025-10-09 09:53:49, from +3600.0 s"
    )
    assert any(text.startswith(said) for text in report["assumed"])
    log = Tlog.open(tmp_path / "s" / "telemetry.tlog")
    assert np.ptp(log.index.t_us) < 60_000_000 and 12 not in log.index.system_id


def test_modes_that_no_file_tells_are_not_told(tmp_path):
    assert imported((*GREY, "--ugv", "11=row_id_rover.csv"), tmp_path / "s")[0] == 0
    _, beats = Tlog.open(tmp_path / "s" / "telemetry.tlog").columns(0)
    names = ("type", "autopilot", "base_mode", "custom_mode")
    assert {mode_name(*(int(beat[name]) for name in names)) for beat in beats} == {""}
    assert set(beats["type"]) == {2, 10}


def test_places_are_those_of_the_receiver_that_has_fixes():
    (log,) = read_vehicle_logs(FOLDER / "first_receiver_dead_rover.bin")
    assert len(log.places) == 49 and np.ptp(log.places.alt_m) < 5.0


def test_the_velocity_is_that_of_the_core_that_flies():
    (log,) = read_vehicle_logs(FOLDER / "lane_switch_uav.bin")
    # the other core drifts by 6 m/s
    assert len(log.places) == 49 and np.abs(log.places.v_ned).max() < 1.0


def test_bursts_tell_no_speed_of_a_clock():
    code, told, _ = run_gcs("tlog", "check", FOLDER / "short_bursts_fleet.tlog")
    assert code == 0 and "clocks run" not in told


@pytest.mark.slow_but_first
@pytest.mark.parametrize(
    ("words", "video", "frames"),
    [
        (("trimmed_film_cut.mp4", *POSED), "66 frames of 320×180 px, 6.5 s", 66),
        (("trimmed_one_gop_cut.mp4", *POSED), "47 frames of 320×180 px, 4.6 s", 47),
        (("rotation_90_film.mp4", *POSED), "320×180 px (coded 180×320 px, turned by 90° to the right)", 80),
        (("pixel_aspect_film.mp4", *POSED), "(coded 240×180 px, pixels 1.33 times as wide as high)", 80),
        (("cover_first_film.mkv", *POSED), "80 frames of 320×180 px, 7.9 s", 80),
        (("films_whole.mp4", *POSED[:4], "--lens", "lens_indentless_lens.yaml"), "80 frames of 320×180 px", 80),
        (("klv_date_jump_film.ts", *FLEET_ALONE), "80 frames of 320×180 px", 80),
        ((*SUBTITLED, "drone_yaw_srt_film.srt"), "80 frames", 80),
        ((*SUBTITLED, "zoom_srt_tele.srt"), "80 frames", 80),
        ((*SUBTITLED, "zoom_srt_enterprise_advanced.srt"), "80 frames", 80),
    ],
)
def test_a_film_is_that_which_players_show(words, video, frames, tmp_path):
    code, report, refused = imported(words, tmp_path / "s")
    assert code == 0, refused
    found = dict(report["found"])
    assert video in found["video"] and len((tmp_path / "s" / "frames.csv").read_text().splitlines()) == frames + 1
    camera = load_mission(tmp_path / "s" / "session.toml").camera
    if "pixels" in video or "turned" in video:
        assert (camera.width, camera.height) == (320, 180) and camera.fx == pytest.approx(camera.fy)
    log = Tlog.open(tmp_path / "s" / "telemetry.tlog")
    if "drone_yaw" in words[-1]:
        assert "with the angles of the body" in found["uav"] and len(log.columns(30, 1)[0]) > 30
    if "zoom" in words[-1]:
        zoom = "4.00" if "tele" in words[-1] else "1.07"
        assert f"a digital zoom of {zoom} in the subtitles" in found["camera"]
    if "lens" in words[-1]:
        assert camera.fx == pytest.approx(1484.12 * camera.width / 1920, abs=0.01)
    if "jump" in words[0]:
        said = "klv_date_jump_film.ts: the date in its KLV steps by +18.00 s at 4.0 s: what holds longest counts"
        assert said in report["assumed"]
        assert np.ptp(log.index.t_us[log.columns(33, 1)[0]]) < 8_000_000


def test_the_first_frame_of_a_trimmed_film_is_the_one_that_players_show():
    images = []
    for name in ("films_whole.mp4", "trimmed_film_cut.mp4"):
        film = open_film(FOLDER / name)
        with VideoFile.open(film.path, film.elapsed_us) as video:
            images.append([frame.image for frame in video.frames()])
    whole, cut = images
    assert len(cut) == 66
    # that of 1.4 s, of ten a second
    assert min(range(len(whole)), key=lambda k: np.abs(whole[k].astype(int) - cut[0]).mean()) == 14


@pytest.mark.slow_but_first
@pytest.mark.parametrize(
    ("folder", "objects"), [("coco_zero", 1), ("coco_backslash", 1), ("visdrone_zero", 2), ("names_comma", 2)]
)
def test_labels_as_tools_write_them(folder, objects, tmp_path):
    code, _, refused = run_gcs("eval-detector", FOLDER / folder, "-o", tmp_path / "out")
    assert code == 0, refused
    assert json.loads((tmp_path / "out" / "eval.json").read_text())["objects"] == objects
