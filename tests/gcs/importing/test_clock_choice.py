"""Where the UAV's own log has a date: its clock is the fleet's, or else the film's."""

from dataclasses import replace

import pytest

from gcs.errors import ImportFileError
from gcs.importing.clock_choice import searched_times
from gcs.importing.film import open_film
from gcs.importing.formats.dji_srt import log_of_cues
from gcs.importing.formats.subtitles import read_cues
from gcs.importing.ground_vehicles import read_ground_vehicles
from gcs.importing.messages import vehicle_records
from gcs.importing.timeline import find_timeline
from gcs.session.session import open_session
from tests.support.imports.flown import fly
from tests.support.imports.srt_writers import srt

FRAMES = 150


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    return fly(tmp_path_factory.mktemp("flown"), FRAMES)


def moved(track, later_us):
    return replace(track, t_us=track.t_us + later_us)


def searched(flown, folder, *, film_later_s=0.0, fleet_later_s=0.0, within_s=1e6):
    """Times of a film, dated so much later, with a dated UAV's log, beside a fleet that is so much later."""
    first_us = int(flown.frames_us[0])
    (folder / "uav.srt").write_text(srt("enterprise", flown.spots()))
    told = log_of_cues("uav.srt", read_cues(folder / "uav.srt"))
    uav = replace(
        told,
        clock="utc",
        zero_us=0,
        places=moved(told.places, first_us),
        gimbal=moved(told.gimbal, first_us),
        attitudes=replace(told.gimbal, t_us=told.gimbal.t_us + first_us, angles=told.gimbal.angles * [0.0, 0.0, 1.0]),
    )
    film = replace(open_film(flown.video), created_us=first_us + round(film_later_s * 1e6))
    fleet = read_ground_vehicles(flown.fleet, ())
    fleet = replace(fleet, places={i: moved(t, round(fleet_later_s * 1e6)) for i, t in fleet.places.items()})
    times = find_timeline(film, uav, fleet.span_us, None)
    mission = open_session(flown.session).mission
    records = vehicle_records(uav, mission.uav.system_id, times.uav_shift_us, flies=True, home_m=fleet.ground_m)
    return searched_times(film, uav, fleet, mission, records, times, within_s), first_us


@pytest.mark.slow
def test_a_film_that_is_dated_wrong_beside_uav_and_fleet(flown, tmp_path):
    times, first_us = searched(flown, tmp_path, film_later_s=-3605.0)
    assert abs(times.film_us - first_us) < 200_000
    assert times.uav_shift_us == 0


@pytest.mark.slow
def test_a_fleet_that_is_dated_wrong_beside_film_and_uav(flown, tmp_path):
    times, first_us = searched(flown, tmp_path, fleet_later_s=250.0)
    assert abs(times.film_us - first_us - 250_000_000) < 200_000
    assert abs(times.uav_shift_us - 250_000_000) < 200_000


@pytest.mark.slow
def test_what_was_tried_is_told_where_neither_fits(flown, tmp_path):
    with pytest.raises(ImportFileError, match=r"\(the UAV's clock was taken to be the fleet's, then the film's\)$"):
        searched(flown, tmp_path, fleet_later_s=250.0, within_s=20.0)
