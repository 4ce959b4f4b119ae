import dataclasses

import numpy as np
import pytest

from sim.annotated.camera_guess import guess_camera
from sim.annotated.film_world import film_world
from sim.annotated.layouts import read_tracks
from sim.errors import AnnotationError
from sim.world.camera import view_from
from sim.world.error_draws import standard_errors
from sim.world.scenario import ScenarioFlight
from sim.world.view import project
from tests.support.films.annotated import FOV_DEG, film_of, ground_errors, labels_of, tilted, true_motions

SIZE = (640, 360)


def tracks_of(world, tmp_path, layout="csv"):
    path = tmp_path / f"{layout}.txt"
    path.write_text(labels_of(world, layout))
    return read_tracks(path, layout)


def made_of(tracks, times, motions, *, team=4, chosen=(), **camera):
    errors = standard_errors(np.random.default_rng(1))
    return film_world(
        tracks, times, guess_camera(tracks, SIZE, **camera), SIZE, motions, errors, team=team, chosen=chosen
    )


@pytest.mark.slow_but_first
@pytest.mark.parametrize("layout", ["csv", "mot"])
@pytest.mark.parametrize("pitch", [-90.0, -50.0])
def test_perfect_boxes_and_a_known_camera_give_the_ground_positions(pitch, layout, tmp_path):
    world, times = film_of(tilted(pitch))
    tracks = tracks_of(world, tmp_path, layout)
    made = made_of(
        tracks,
        times,
        true_motions(world, times),
        height_m=float(world.at_uav(times[:1]).p_enu[0, 2]),
        fov_deg=FOV_DEG,
        pitch_deg=pitch,
    )
    errors = ground_errors(world, made, times)
    assert np.quantile(errors, 0.95) < 0.5
    assert len(errors) > 100


def test_vehicles_appear_where_they_are_labelled(tmp_path):
    world, times = film_of(tilted(-50.0))
    tracks = tracks_of(world, tmp_path)
    made = made_of(tracks, times, true_motions(world, times))
    for k, track in enumerate(made.team):
        for frame in track.frames[::10].tolist():
            view = view_from(made.world.scenario, made.world.at_uav(times[frame]))
            uv, _ = project(view, [*made.world.at(times[frame]).xy[k], 0.75])
            label = tracks.centre[(tracks.frame == frame) & (tracks.track == track.track)][0]
            assert np.linalg.norm(uv - label) < 3.0


@pytest.mark.slow
def test_the_team_moves_and_the_parked_report_no_heading(tmp_path):
    world, times = film_of(tilted(-90.0))
    tracks, motions = tracks_of(world, tmp_path), true_motions(world, times)
    assert [track.track for track in made_of(tracks, times, motions, team=3).team] == [0, 1, 2]
    made = made_of(tracks, times, motions, chosen=(4, 0))
    assert [(track.track, track.moved) for track in made.team] == [(4, False), (0, True)]
    heading = made.world.at(5.0).heading
    assert np.isfinite(heading).tolist() == [False, True]
    with pytest.raises(AnnotationError, match="vehicle 99 has no label"):
        made_of(tracks, times, motions, chosen=(99,))


@pytest.mark.slow_but_first
@pytest.mark.parametrize("pitch", [-90.0, -50.0, -30.0])
def test_a_camera_is_guessed_from_sizes(pitch, tmp_path):
    world, _ = film_of(tilted(pitch))
    tracks = tracks_of(world, tmp_path)
    camera = guess_camera(tracks, SIZE, fov_deg=FOV_DEG)
    assert camera.pitch_deg == pytest.approx(pitch, abs=8.0)
    assert camera.height_m == pytest.approx(45.0, rel=0.2)


@pytest.mark.slow
def test_a_camera_that_climbs_has_the_height_of_the_first_image(tmp_path):
    scenario = tilted(-90.0)
    climbing = dataclasses.replace(scenario, duration_s=20.0, flight=ScenarioFlight(height_m=45.0, climb_mps=3.0))
    world, times = film_of(climbing)
    tracks = tracks_of(world, tmp_path)
    made = made_of(tracks, times, true_motions(world, times), fov_deg=FOV_DEG)
    heights = made.world.at_uav(times[[0, -1]]).p_enu[:, 2]
    assert heights[0] == pytest.approx(45.0, rel=0.25)
    assert heights[1] / heights[0] == pytest.approx(105.0 / 45.0, rel=0.05)


@pytest.mark.slow
def test_absurd_motion_is_taken_for_none(tmp_path):
    world, times = film_of(tilted(-50.0))
    motions = true_motions(world, times)
    absurd = [np.zeros((3, 3)), np.diag([9.0, 9.0, 1.0]), np.array([[1.0, 0, 0], [0, 1.0, 0], [0.1, 0.1, -1.0]])]
    motions[10:13] = absurd
    made = made_of(tracks_of(world, tmp_path), times, motions)
    p = made.world.at_uav(times).p_enu
    assert np.isfinite(p).all()
    np.testing.assert_array_equal(p[10:13], p[9:12])


def test_cars_of_an_absurd_size_are_refused(tmp_path):
    path = tmp_path / "gt.txt"
    path.write_text("1,1,5,5,0.5,0.5,1\n")
    with pytest.raises(AnnotationError, match="no camera drone"):
        guess_camera(read_tracks(path), SIZE)
