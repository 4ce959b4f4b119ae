import dataclasses
import re
from pathlib import Path

import numpy as np
import pytest

from gcs.errors import ImportFileError
from gcs.importing.camera_choice import CameraOptions, choose_camera
from gcs.importing.film import ImportedFilm
from gcs.importing.timeline import check_overlap, find_timeline, is_about
from gcs.importing.vehicle_log import ImportNotes, PlaceTrack, VehicleLog, ViewTrack
from vision.errors import CameraError

T0 = 1_790_000_000_000_000
FILM = ImportedFilm(
    path=Path("film.mp4"), elapsed_us=np.arange(100) * 200_000, width=640, height=480, created_us=0, model=""
)
FLEET = (T0, T0 + 30_000_000)


def uav_log(first_s, last_s, clock):
    t_us = np.arange(round(first_s * 1e6), round(last_s * 1e6), 200_000) + (T0 if clock == "utc" else 0)
    places = PlaceTrack.of(t_us, np.full(len(t_us), 47.1), np.full(len(t_us), 8.1))
    return VehicleLog(source="uav.csv", clock=clock, places=places, notes=ImportNotes())


@pytest.mark.parametrize("clock", ["video", "utc"])
@pytest.mark.parametrize(("first_s", "last_s", "covers"), [(0, 30, True), (15, 60, True), (65000, 94500, False)])
def test_a_log_of_the_uav_has_to_cover_the_film(first_s, last_s, covers, clock):
    uav = uav_log(first_s, last_s, clock)
    times = find_timeline(FILM, uav, FLEET, 0.0)
    if clock == "utc":
        times = find_timeline(FILM, None, FLEET, 0.0)  # as a search in the film may have it
    told = uav.source, tuple(int(uav.places.t_us[k]) + times.uav_shift_us for k in (0, -1))
    if not covers:
        with pytest.raises(ImportFileError, match=r"while uav\.csv tells of .*: it does not cover the film"):
            check_overlap(FILM, times, told, FLEET)
        return
    partly = check_overlap(FILM, times, told, FLEET)
    assert partly == (() if first_s == 0 else ("uav.csv tells of 4.8 s of the film's 19.8 s",))


def test_what_was_assumed_of_the_fleet_is_told_where_it_does_not_fit():
    times = find_timeline(FILM, None, FLEET, 3600.0)
    with pytest.raises(ImportFileError, match=r"--clock \+SECONDS \(rover\.gpx: times without a zone are UTC\)$"):
        check_overlap(FILM, times, ("uav.csv", FLEET), FLEET, ["rover.gpx: times without a zone are UTC"])


@pytest.mark.parametrize(("last_s", "told"), [(20.0, False), (21.5, False), (25.0, True)])
def test_a_log_from_the_films_beginning_that_goes_on_behind_its_end_is_told(last_s, told):
    times = find_timeline(FILM, uav_log(0.0, last_s, "video"), FLEET, 0.0)
    words = "uav.csv tells of 24.8 s since the film's beginning, the film has 19.8 s: is it another film's, or was this"
    assert [text.startswith(words) for text in times.assumed] == [True] * told


def test_a_vehicle_that_reports_less_of_the_film_than_the_fleet_is_told():
    times = find_timeline(FILM, None, FLEET, 0.0)
    film_us = times.film_us, times.film_us + 19_800_000
    spans = {"a": FLEET, "b": (T0 + 10_000_000, FLEET[1]), "c": (T0 + 3_600_000_000, T0 + 3_601_000_000)}
    told = check_overlap(FILM, times, ("uav.csv", FLEET), FLEET, vehicles=spans)
    assert told[0] == "b tells of 9.8 s of the film's 19.8 s"
    assert re.fullmatch(r"c tells nothing of the film: of .*, from \+3600\.0 s of the film on", told[1])
    assert [is_about(film_us, span) for span in spans.values()] == [True, True, False]
    late = (T0 + 10_000_000, FLEET[1])
    assert len(check_overlap(FILM, times, ("uav.csv", FLEET), late, vehicles={"a": late, "b": late})) == 1


LENS = "width = {}\nheight = {}\nfx = {}\nfy = {}\ncx = {}\ncy = {}\n"


@pytest.mark.parametrize(
    "lens", [(1440, 1080, 1100.0, 1466.7, 700.0, 550.0), (1920, 1080, 1466.7, 1466.7, 933.3, 550.0)]
)
def test_a_lens_described_for_the_coded_picture_or_the_shown_one(lens, tmp_path):
    film = dataclasses.replace(FILM, width=1920, height=1080, aspect=4 / 3)
    (tmp_path / "lens.toml").write_text(LENS.format(*lens))
    chosen, _ = choose_camera(film, None, CameraOptions(lens=tmp_path / "lens.toml"))
    camera = chosen.camera
    assert (camera.width, camera.height) == (1920, 1080)
    assert (camera.fx, camera.fy, camera.cx, camera.cy) == pytest.approx((1466.7, 1466.7, 933.3, 550.0), abs=0.1)
    square = dataclasses.replace(film, aspect=1.0)
    if lens[0] == 1440:
        with pytest.raises(CameraError, match="another aspect"):
            choose_camera(square, None, CameraOptions(lens=tmp_path / "lens.toml"))


def test_upright_pictures_are_seen_across_their_longer_side():
    upright = dataclasses.replace(FILM, width=1080, height=1920)
    view = ViewTrack(t_us=np.array([0, 1_000_000]), hfov=np.radians([71.6, 40.0]), source="focal length")
    uav = dataclasses.replace(uav_log(0.0, 2.0, "video"), view=view)
    for options in (CameraOptions(model="dji-mini-3"), CameraOptions()):
        chosen, log = choose_camera(upright, uav, options)
        assert chosen.camera.fx == pytest.approx(960.0 / np.tan(np.radians(35.8)), rel=1e-3)
        assert "71.6° across the longer side" in chosen.optics
        assert np.tan(0.5 * log.view.hfov) == pytest.approx(np.tan(np.radians([35.8, 20.0])) * 1080 / 1920)
    assert choose_camera(upright, None, CameraOptions(fov_deg=90.0))[0].camera.fx == pytest.approx(540.0)
