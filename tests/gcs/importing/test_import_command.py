import errno
import json
import os
import tomllib
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest

from gcs.errors import ImportFileError
from gcs.mission.mission import load_mission
from gcs.report.score import score_files
from mavlink.protocol.encoder import MavlinkEncoder
from mavlink.tlog.log import Tlog
from tests.support.command_line import run_gcs
from tests.support.imports.film_writers import with_klv, with_sei, with_subtitles
from tests.support.imports.flown import FOV_DEG, UGVS, fly
from tests.support.imports.log_writers import dataflash, gpx, pose_csv, positions_csv, ulog
from tests.support.imports.srt_writers import srt

FRAMES = 90
RIGHT = 0.99
"""Least share of right names after an import; the recording itself has all of them."""


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    return fly(tmp_path_factory.mktemp("flown"), FRAMES)


@pytest.fixture(scope="module")
def longer(tmp_path_factory):
    return fly(tmp_path_factory.mktemp("longer"), 2 * FRAMES)


def import_words(flown, out, *more):
    return ("import", "-o", out, "--video", flown.video, "--tlog", flown.fleet, "--fov", FOV_DEG, *more)


def right_of(session, flown, tmp_path):
    assert run_gcs("identify", session, "-o", tmp_path / "names")[0] == 0
    return score_files(flown.session / "truth.csv", tmp_path / "names" / "identity.csv")


def test_a_dji_drone_above_rovers(flown, tmp_path):
    subtitles, session = tmp_path / "DJI_0001.SRT", tmp_path / "session"
    subtitles.write_text(srt("keyed", flown.spots()))
    code, told, _ = run_gcs(*import_words(flown, session, "--uav", subtitles, "--json"))
    assert code == 0
    report = json.loads(told)
    assert (report["uav"], report["ugv"], report["folder"]) == (1, list(UGVS), str(session))
    assert "the camera looks straight down; --pitch changes that" in report["assumed"]
    table = tomllib.loads((session / "session.toml").read_text())
    assert table["session"]["imported"]["found"] == report["found"]
    assert table["clock"]["video_offset_s"] == "auto"
    assert (session / "video.mp4").read_bytes() == flown.video.read_bytes()
    fleet = {(packet.t_us, packet.raw) for packet in Tlog.open(flown.fleet).packets()}
    log = Tlog.open(session / "telemetry.tlog")
    assert {(p.t_us, p.raw) for p in log.packets(system_ids=UGVS)} == fleet
    assert np.all(np.diff(log.index.t_us) >= 0)
    assert not log.index.damage
    # no attitude was known, so none is told
    assert not len(log.columns(30, 1)[0])


@pytest.mark.slow
def test_two_drones_above_rovers(flown, tmp_path):
    subtitles, film, session = tmp_path / "DJI_0001.SRT", tmp_path / "DJI_0002.MP4", tmp_path / "session"
    subtitles.write_text(srt("keyed", flown.spots()))
    film.write_bytes(flown.video.read_bytes())
    words = import_words(flown, session, "--uav", subtitles, "--view", f"{film}={subtitles}", "--json")
    code, told, stderr = run_gcs(*words)
    assert code == 0, stderr
    found = dict(json.loads(told)["found"])
    assert "DJI_0002.MP4" in found["video 2"] and "as system 2:" in found["uav 2"]
    mission = load_mission(session / "session.toml")
    assert [view.system_id for view in mission.view] == [2] and mission.view[0].camera == mission.camera
    first = right_of(session, flown, tmp_path)
    second = score_files(flown.session / "truth.csv", tmp_path / "names" / "view-2" / "identity.csv")
    assert min(first.right, second.right) >= RIGHT
    assert first.wrong_sure_s == 0.0


MAST = """
name = "Gate"
[mast]
latitude_deg = 48.1
longitude_deg = 11.6
height_m = 20
heading_deg = 90
[camera]
pitch_deg = -30
"""


def test_a_film_from_a_mast(flown, tmp_path):
    subtitles, mast, session = tmp_path / "DJI_0001.SRT", tmp_path / "mast.toml", tmp_path / "session"
    subtitles.write_text(srt("keyed", flown.spots()))
    mast.write_text(MAST + "[clock]\nvideo_offset_s = -0.5\n")
    words = import_words(flown, session, "--uav", subtitles, "--clock=+0", "--view", f"{flown.video}={mast}", "--json")
    code, told, stderr = run_gcs(*words)
    assert code == 0, stderr
    found = dict(json.loads(told)["found"])
    assert "on a mast at 48.10000, 11.60000" in found["uav 2"] and "+0.5 s as given" in found["clock 2"]
    (view,) = load_mission(session / "session.toml").view
    assert (view.name, view.system_id, view.mast.height_m, view.camera.pitch_deg) == ("Gate", 257, 20.0, -30.0)
    assert view.camera.intrinsics is not None and (session / "view-2" / "video.mp4").is_file()
    senders = {packet.system_id for packet in Tlog.open(session / "telemetry.tlog").packets()}
    assert senders == {1, *UGVS}, "it sends nothing"
    mast.write_text(MAST.replace("[mast]", "[masts]"))
    code, _, stderr = run_gcs(*words[:2], tmp_path / "other", *words[3:])
    assert code == 2 and "mast.toml: needs [mast]" in stderr


def test_a_further_film_whose_clock_is_not_found_is_to_be_imported_by_itself(flown, tmp_path, monkeypatch):
    monkeypatch.setattr("gcs.importing.importer.searched_times", Mock(side_effect=ImportFileError("give --clock=+1")))
    subtitles = tmp_path / "DJI_0001.SRT"
    subtitles.write_text(srt("keyed", flown.spots()))
    words = import_words(flown, tmp_path / "s", "--uav", subtitles, "--clock=+0")
    code, _, stderr = run_gcs(*words, "--view", f"{flown.video}={subtitles}")
    assert code == 2 and "give --clock=+1, which is for the first film: import this one by itself" in stderr


@pytest.mark.slow
def test_a_logged_uav_above_logged_rovers(flown, tmp_path):
    (tmp_path / "uav.bin").write_bytes(dataflash(flown, 1))
    ugv = []
    for k, system_id in enumerate(UGVS):
        path = tmp_path / f"rover{system_id}.{'ulg' if k % 2 else 'bin'}"
        path.write_bytes((ulog if k % 2 else dataflash)(flown, system_id))
        ugv += ["--ugv", f"{system_id}={path}" if k % 3 else path]
    late_s = (flown.frames_us[0] - flown.columns(33, 1)[0][0]) * 1e-6
    words = (
        "import",
        "-o",
        tmp_path / "session",
        "--video",
        flown.video,
        "--fov",
        FOV_DEG,
        "--uav",
        tmp_path / "uav.bin",
    )
    code, told, _ = run_gcs(*words, *ugv, f"--clock={late_s:+.2f}", "--json")
    assert code == 0
    report = json.loads(told)
    assert report["ugv"] == list(UGVS)
    assert "the film begins with the UAV's log" in report["assumed"]
    assert right_of(tmp_path / "session", flown, tmp_path).right >= RIGHT


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["positions.csv", "positions.gpx"])
def test_tables_of_poses_and_positions(kind, flown, tmp_path):
    (tmp_path / "pose.csv").write_text(pose_csv(flown))
    write = positions_csv if kind.endswith("csv") else gpx
    (tmp_path / kind).write_text(write(flown, UGVS))
    late_s = (flown.frames_us[0] - min(flown.columns(33, i)[0][0] for i in UGVS)) * 1e-6
    words = ("import", "-o", tmp_path / "session", "--video", flown.video, "--fov", FOV_DEG, f"--clock={late_s:+.2f}")
    code, _, _ = run_gcs(*words, "--uav", tmp_path / "pose.csv", "--ugv", tmp_path / kind)
    assert code == 0
    assert right_of(tmp_path / "session", flown, tmp_path).right >= RIGHT


@pytest.mark.slow_but_first
@pytest.mark.parametrize(
    ("ugv", "words"),
    [
        (["11=positions.csv"], "without the id"),
        (["positions.csv", "positions.csv"], "given twice"),
        (["0=rover.bin"], "1 to 255"),
        (["undated.bin"], "does not know the date"),
        (["nameless.gpx"], "no system id"),
        (["11=nameless.gpx", "12=nameless.gpx"], "is one log given for two vehicles?"),
        (["absent.bin"], "no such file"),
    ],
)
def test_ground_vehicles_that_cannot_be_told_apart(ugv, words, flown, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "positions.csv").write_text(positions_csv(flown, UGVS))
    (tmp_path / "undated.bin").write_bytes(dataflash(flown, 11, gps=False))
    (tmp_path / "nameless.gpx").write_text(gpx(flown, (11,)).replace("UGV-11", "rover"))
    told = run_gcs(
        *("import", "-o", "out", "--video", flown.video), *(word for each in ugv for word in ("--ugv", each))
    )
    assert told[0] == 2
    assert words in told[2]
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["klv", "sei", "siyi", "dji"])
def test_telemetry_inside_the_film(kind, flown, tmp_path):
    write = {
        "klv": lambda: with_klv(flown, tmp_path / "cam.ts"),
        "sei": lambda: with_sei(flown, tmp_path / "cam.mp4"),
        "siyi": lambda: with_subtitles(flown, tmp_path / "cam.mp4", "siyi"),
        "dji": lambda: with_subtitles(flown, tmp_path / "cam.mp4", "keyed"),
    }[kind]
    video = write()
    fov = ("--fov", FOV_DEG) if kind in ("siyi", "dji") else ()
    # nine seconds are too short for its clock to be searched
    given = ("--clock=+0", *fov, "--json")
    words = ("import", "-o", tmp_path / "session", "--video", video, "--tlog", flown.fleet, *given)
    code, told, _ = run_gcs(*words)
    assert code == 0
    assert ("attitude" in json.loads(told)["found"]) == (kind in ("siyi", "dji"))
    if kind == "siyi":
        rows, wire = Tlog.open(tmp_path / "session" / "telemetry.tlog").columns(24, 1)
        assert len(rows) > 5
        assert (wire["h_acc"] == 3000).all()
    assert right_of(tmp_path / "session", flown, tmp_path).right >= RIGHT


@pytest.mark.slow
def test_the_gimbal_of_an_enterprise_drone_gives_the_heading(flown, tmp_path):
    subtitles, session = tmp_path / "DJI_0001.SRT", tmp_path / "session"
    subtitles.write_text(srt("enterprise", flown.spots()))
    code, told, _ = run_gcs(*import_words(flown, session, "--uav", subtitles, "--clock=+0"))
    assert code == 0
    assert "only the gimbal's angles count" in told
    log = Tlog.open(session / "telemetry.tlog")
    assert len(log.columns(30, 1)[0]) == len(log.columns(285, 1)[0]) == FRAMES
    assert right_of(session, flown, tmp_path).right >= RIGHT


def test_what_is_there_is_not_overwritten(flown, tmp_path):
    code, _, told = run_gcs(*import_words(flown, tmp_path))
    assert code == 2
    assert "exists already" in told


def test_a_container_that_no_session_has_is_refused_before_the_clock_is_searched(flown, tmp_path):
    film = tmp_path / "film.wmv"
    film.hardlink_to(flown.video)
    code, _, told = run_gcs("import", "-o", tmp_path / "S", "--video", film, "--tlog", flown.fleet, "--uav", "no.srt")
    assert code == 2
    assert "film.wmv: a session's video is one of .mkv, .mp4" in told and "remux it" in told


@pytest.mark.slow
def test_an_import_that_breaks_off_leaves_nothing(flown, tmp_path, monkeypatch):
    """Where the disk is full, which is told of the disk that is written to, not of the film that is read."""
    out, subtitles = tmp_path / "out" / "session", tmp_path / "DJI_0001.SRT"
    subtitles.write_text(srt("keyed", flown.spots()))
    words = import_words(flown, out, "--uav", subtitles)

    def full(source, target):
        Path(target).write_bytes(b"half")
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(source), None, str(target))

    with monkeypatch.context() as patched:
        patched.setattr("os.link", full)
        patched.setattr("shutil.copyfile", full)
        code, _, told = run_gcs(*words)
    assert code == 3
    assert str(out.parent) in told and "No space left" in told and str(flown.video) not in told
    assert list(out.parent.iterdir()) == []
    assert run_gcs(*words)[0] == 0 and list(out.parent.iterdir()) == [out]


def unknown_camera_words(flown, folder, *more):
    (folder / "DJI_0001.SRT").write_text(srt("positional", flown.spots()))
    files = ("--video", flown.video, "--tlog", flown.fleet, "--uav", folder / "DJI_0001.SRT")
    return ("import", "-o", folder / "session", *files, *more)


def test_nothing_is_guessed_of_the_camera(flown, tmp_path):
    code, told, _ = run_gcs(*unknown_camera_words(flown, tmp_path, "--clock=+0"))
    assert code == 0 and "nothing tells its field of view" in told and "straight down" not in told
    assert load_mission(tmp_path / "session" / "session.toml").camera is None
    code, _, told = run_gcs(*unknown_camera_words(flown, tmp_path, "--camera", "kodak"))
    assert code == 2
    (tmp_path / "pitched").mkdir()
    assert run_gcs(*unknown_camera_words(flown, tmp_path / "pitched", "--pitch", -60, "--clock=+0"))[0] == 0
    stated = load_mission(tmp_path / "pitched" / "session" / "session.toml").camera
    assert (stated.pitch_deg, stated.intrinsics) == (-60.0, None)


@pytest.mark.slow
def test_a_camera_that_nothing_describes_is_found_in_the_film_and_so_is_the_clock(longer, tmp_path):
    (tmp_path / "pose.csv").write_text(pose_csv(longer))
    files = ("--video", longer.video, "--tlog", longer.fleet, "--uav", tmp_path / "pose.csv")
    code, told, _ = run_gcs("import", "-o", tmp_path / "session", *files)
    assert code == 0 and "found by how the fleet fits the film" in told, told
    result = right_of(tmp_path / "session", longer, tmp_path)
    assert result.precision > 0.99 and result.coverage > 0.9


@pytest.mark.slow_but_first
@pytest.mark.parametrize(("clock", "code"), [("+7200", 2), ("-7200", 0), ("later", 2), ("nan", 2)])
def test_a_clock_in_another_time_zone(clock, code, flown, tmp_path):
    subtitles, session = shifted_subtitles(flown, tmp_path, 7200.0), tmp_path / "session"
    got, _, told = run_gcs(*import_words(flown, session, "--uav", subtitles, f"--clock={clock}"))
    assert got == code
    assert code == 0 or "--clock" in told
    assert session.exists() == (code == 0)


def shifted_subtitles(flown, folder, later_s):
    """DJI's subtitles by a clock that is ahead."""
    subtitles = folder / "DJI_0001.SRT"
    spots = [(t, type(s)(**{**vars(s), "unix_us": s.unix_us + round(later_s * 1e6)})) for t, s in flown.spots()]
    subtitles.write_text(srt("keyed", spots))
    return subtitles


@pytest.mark.slow
@pytest.mark.parametrize("later_s", [3.0, 7200.0])
def test_a_clock_that_is_off_is_found_in_the_film(later_s, longer, tmp_path):
    subtitles, session = shifted_subtitles(longer, tmp_path, later_s), tmp_path / "session"
    code, told, _ = run_gcs(*import_words(longer, session, "--uav", subtitles, "--json"))
    assert code == 0
    clock = json.loads(told)["found"]["clock"]
    found_s = float(clock.partition(", ")[2].partition(" s")[0])
    assert abs(found_s + later_s) < 0.2
    result = right_of(session, longer, tmp_path)
    assert result.right >= 0.98
    assert result.wrong_sure_s == 0.0


@pytest.mark.slow
def test_a_clock_is_not_searched_beyond_what_is_allowed(longer, tmp_path):
    subtitles = shifted_subtitles(longer, tmp_path, 600.0)
    words = import_words(longer, tmp_path / "session", "--uav", subtitles, "--clock-within", "60")
    code, _, told = run_gcs(*words)
    assert code == 2
    assert "between -60 and +60 s" in told


def test_a_uav_elsewhere(flown, tmp_path):
    subtitles, session = tmp_path / "DJI_0001.SRT", tmp_path / "session"
    spots = [(t, type(s)(**{**vars(s), "lat": s.lat + 20.0})) for t, s in flown.spots()]
    subtitles.write_text(srt("keyed", spots))
    code, _, told = run_gcs(*import_words(flown, session, "--uav", subtitles))
    assert code == 2
    assert "km from the fleet" in told


def test_who_is_in_the_telemetry_and_not_in_the_mission(flown, tmp_path):
    subtitles = tmp_path / "DJI_0001.SRT"
    subtitles.write_text(srt("enterprise", flown.spots()))
    silent = MavlinkEncoder(99).heartbeat()
    stamp = int(flown.frames_us[0]).to_bytes(8, "big")
    both = tmp_path / "both.tlog"
    both.write_bytes((flown.session / "telemetry.tlog").read_bytes() + stamp + silent)
    words = ("import", "-o", tmp_path / "session", "--video", flown.video, "--uav", subtitles, "--tlog", both)
    code, told, _ = run_gcs(*words, "--clock=+0", "--fov", FOV_DEG, "--json")
    assert code == 0
    report = json.loads(told)
    assert report["found"]["not in the mission"] == (
        "system 99, which reports no position (GLOBAL_POSITION_INT); system 1, another aircraft"
    )
    assert (report["uav"], report["ugv"]) == (2, list(UGVS))


@pytest.mark.slow
def test_latitude_and_longitude_the_other_way_round(flown, tmp_path):
    subtitles, session = tmp_path / "DJI_0001.SRT", tmp_path / "session"
    spots = [(t, type(s)(**{**vars(s), "lat": s.lon, "lon": s.lat})) for t, s in flown.spots()]
    subtitles.write_text(srt("keyed", spots))
    code, told, _ = run_gcs(*import_words(flown, session, "--uav", subtitles, "--json"))
    assert code == 0
    assert any("the other way round" in text for text in json.loads(told)["assumed"])


@pytest.mark.slow_but_first
@pytest.mark.parametrize("turned", ["uav", "rover"])
def test_of_two_tables_neither_is_turned_round(turned, flown, tmp_path):
    for name, alt in (("uav", 60.0), ("rover", 20.0)):
        at = ("lon", "lat") if name == turned else ("lat", "lon")
        rows = (f"{flown.frames_us[0] + 200_000 * k},{47.1 + 1e-6 * k:.7f},8.1,{alt}" for k in range(40))
        (tmp_path / f"{name}.csv").write_text("\n".join([f"time_us,{at[0]},{at[1]},alt", *rows]) + "\n")
    words = ("import", "-o", tmp_path / "session", "--video", flown.video, "--fov", FOV_DEG)
    code, _, said = run_gcs(*words, "--uav", tmp_path / "uav.csv", "--ugv", f"11={tmp_path / 'rover.csv'}")
    assert code == 2
    assert "uav.csv and rover.csv: latitude and longitude stand the other way round in one of them" in said
