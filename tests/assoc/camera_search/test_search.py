"""A camera that nothing describes is found by what drives under it, and never where two explanations are as good."""

import numpy as np
import pytest

from assoc.camera_search.inputs import FilmedFleet
from assoc.camera_search.search import CameraVerdict, find_camera, refined
from assoc.errors import ShapeError
from tests.support.films.unknown_camera import CameraFilm


def check(scene, film, truth, found, focal_off=0.08):
    assert found.verdict is CameraVerdict.FOUND
    best = found.best
    assert abs(np.log(best.focal / scene.focal)) < focal_off
    named = best.vehicle >= 0
    assert np.array_equal(best.vehicle[named], truth[named])
    assert np.count_nonzero(named) >= 0.6 * np.count_nonzero(truth >= 0)


@pytest.mark.slow_but_first
@pytest.mark.parametrize(
    "scene",
    [
        CameraFilm(seed=1),
        CameraFilm(seed=2, across_deg=110.0, pitch_deg=-35.0, yaw_deg=270.0, strangers=2, outside=1),
        CameraFilm(seed=3, across_deg=35.0, pitch_deg=-88.0, height_m=90.0, speed_mps=2.0),
        CameraFilm(seed=4, kind="fixed", yaw_deg=180.0, sway_deg=3.0),
        CameraFilm(seed=5, heading_known=False, length_s=12.0),
        CameraFilm(seed=6, bias_m=1.8, white_m=0.6, box_px=4.0, missed=0.3, height_error_m=2.0, length_s=12.0),
        CameraFilm(seed=7, vehicles=3, length_s=14.0),
    ],
    ids=["plain", "wide", "long lens", "fixed", "no heading", "poor receivers", "three"],
)
def test_camera_and_names_are_found(scene):
    film, truth = scene.film()
    check(scene, film, truth, find_camera(film))


def test_mount_is_found_to_some_degrees():
    scene = CameraFilm(seed=8, pitch_deg=-50.0, yaw_deg=90.0, length_s=12.0)
    best = find_camera(scene.film()[0]).best
    assert abs(np.rad2deg(best.pitch) + 50.0) < 3.0
    assert abs(np.rad2deg(best.yaw) - 90.0) < 3.0


@pytest.mark.slow_but_first
@pytest.mark.parametrize(
    ("scene", "known"),
    [
        (CameraFilm(seed=11, pitch_deg=-45.0, yaw_deg=180.0), {"focal_known": True}),
        (CameraFilm(seed=12, pitch_deg=-45.0, yaw_deg=20.0), {"mount_known": True}),
        (CameraFilm(seed=13, pitch_deg=-45.0, yaw_deg=20.0, kind="gimbal"), {}),
    ],
    ids=["focal length", "mount", "gimbal reports"],
)
def test_what_is_known_is_kept(scene, known):
    film, truth = scene.film(**known)
    found = find_camera(film)
    check(scene, film, truth, found, focal_off=0.051 if "focal_known" in known else 0.08)


@pytest.mark.slow
def test_longer_look_at_the_same_camera_is_closer():
    scene = CameraFilm(seed=14, across_deg=50.0, pitch_deg=-40.0, bias_m=0.5)
    first = find_camera(scene.film()[0]).best
    longer = CameraFilm(seed=14, across_deg=50.0, pitch_deg=-40.0, bias_m=0.5, length_s=20.0)
    again = refined(longer.film()[0], first)
    assert again is not None
    assert again.focal_std < first.focal_std
    assert abs(np.log(again.focal / scene.focal)) < 0.03


def test_fleet_that_stands_tells_nothing():
    film, _ = CameraFilm(seed=15, speed_mps=0.0).film()
    assert find_camera(film).verdict is CameraVerdict.STANDING


def test_film_of_another_fleet_is_not_explained():
    film, _ = CameraFilm(seed=16, length_s=12.0).film()
    other, _ = CameraFilm(seed=17, length_s=12.0).film()
    mixed = FilmedFleet(
        t=film.t,
        picture=film.picture,
        vehicle_enu=other.vehicle_enu,
        R_enu_base=film.R_enu_base,
        p_enu=film.p_enu,
        ground_z=0.0,
        heading_known=True,
    )
    assert find_camera(mixed).verdict in (CameraVerdict.UNEXPLAINED, CameraVerdict.AMBIGUOUS)


def test_shapes_are_checked():
    film, _ = CameraFilm(seed=18).film()
    with pytest.raises(ShapeError, match="picture"):
        FilmedFleet(
            t=film.t,
            picture=film.picture[:-1],
            vehicle_enu=film.vehicle_enu,
            R_enu_base=film.R_enu_base,
            p_enu=film.p_enu,
            ground_z=0.0,
            heading_known=True,
        )
