"""The offset of a fleet's clock from recorded flights: real autopilots, the simulator, wrong and standing fleets."""

from dataclasses import replace

import numpy as np
import pytest

from gcs.errors import ImportFileError
from gcs.importing.clock_choice import FilmBoxes, FilmedFleetLogs, film_spans, find_fleet_clock
from gcs.importing.fleet_log import open_fleet
from gcs.session.frame_tables import read_detections, read_times
from gcs.session.session import open_session
from sim.session import write_session
from sim.world.presets import nominal
from sim.world.scenario import ScenarioAttitude, ScenarioGround
from tests.support.bundled import SWARM

ANY = (-90_000.0, 90_000.0)


def flight(folder, *, later_s=0.0, uav_too=False, without=()):
    """Boxes and logs of a session, the fleet's so much later; frames four a second."""
    session = open_session(folder)
    fleet, times = open_fleet(session.tlog), read_times(session.frames).times_us
    boxes = read_detections(session.detections)
    rows = range(0, len(times), 3)
    later_us = round(later_s * 1e6)
    uav_us = later_us if uav_too else 0
    camera = session.mission.camera
    film = FilmBoxes(
        t_us=times[rows], boxes=[boxes.at(row) for row in rows], size=(int(camera.width), int(camera.height))
    )
    messages = None if not without else [i for i in (0, 30, 33, 285) if i not in without]

    def uav():
        for packet in fleet.tlog.packets(system_ids=[session.mission.uav.system_id], message_ids=messages):
            yield packet.t_us + uav_us, packet.raw

    places = {i: fleet.places(i) for i in fleet.ground}
    moved = {i: replace(track, t_us=track.t_us + later_us) for i, track in places.items()}
    return film, FilmedFleetLogs(mission=session.mission, uav=uav, uav_with_fleet=uav_too, fleet=moved)


@pytest.mark.slow
@pytest.mark.parametrize("later_s", [0.0, 0.3, 3.0, -600.0, 7200.0])
def test_real_autopilots_with_a_clock_that_is_off(later_s):
    film, logs = flight(SWARM, later_s=later_s)
    found = find_fleet_clock([film], logs, ANY)
    assert abs(found.ahead_s - later_s) < 0.15
    assert found.clock_source.startswith(f"{found.ahead_s:+.2f} s, found by how the fleet fits the film")


@pytest.mark.slow
def test_a_video_with_another_clock_than_uav_and_fleet():
    film, logs = flight(SWARM, later_s=-47.0, uav_too=True)
    assert abs(find_fleet_clock([film], logs, ANY).ahead_s + 47.0) < 0.15


@pytest.mark.slow
def test_a_uav_that_tells_no_attitude(tmp_path):
    blind = replace(nominal(6), duration_s=30.0, attitude=ScenarioAttitude(missing=True))
    write_session(blind, tmp_path / "blind")
    film, logs = flight(tmp_path / "blind", later_s=12.5)
    assert abs(find_fleet_clock([film], logs, ANY).ahead_s - 12.5) < 0.2


@pytest.mark.slow
def test_a_heading_that_is_unknown_and_turns_is_not_guessed_with():
    film, logs = flight(SWARM, without=(30, 285))
    with pytest.raises(ImportFileError, match="--clock"):
        find_fleet_clock([film], logs, ANY)


@pytest.mark.slow
def test_a_part_in_which_nothing_is_seen_is_passed_over():
    film, logs = flight(SWARM, later_s=5.0)
    empty = FilmBoxes(t_us=np.empty(0, np.int64), boxes=(), size=film.size)
    assert abs(find_fleet_clock([empty, film], logs, ANY).ahead_s - 5.0) < 0.15


@pytest.mark.slow
def test_a_clock_beyond_the_bounds_is_not_found():
    film, logs = flight(SWARM, later_s=30.0)
    with pytest.raises(ImportFileError, match=r"cam\.mp4: .* between -10 and \+10 s.*--clock=\+SECONDS"):
        find_fleet_clock([film], logs, (-10.0, 10.0), "cam.mp4")


@pytest.mark.slow
def test_vehicles_that_stand_are_refused_with_two_offsets(tmp_path):
    parked = replace(nominal(4), duration_s=24.0, ground=ScenarioGround(kind="parked", vehicles=5))
    write_session(parked, tmp_path / "parked")
    film, logs = flight(tmp_path / "parked")
    with pytest.raises(
        ImportFileError, match=r"as well with its clock .* as with .*: give --clock=\S+ or --clock=\S+$"
    ):
        find_fleet_clock([film], logs, ANY)


@pytest.mark.slow
def test_a_fleet_that_was_elsewhere_is_refused(tmp_path):
    write_session(replace(nominal(5), duration_s=24.0), tmp_path / "other")
    film, logs = flight(SWARM)
    _, others = flight(tmp_path / "other")
    with pytest.raises(ImportFileError, match="--clock"):
        find_fleet_clock([film], replace(logs, fleet=others.fleet), ANY)


@pytest.mark.slow
def test_without_a_uav_or_a_fleet_nothing_is_found():
    film, logs = flight(SWARM)
    for lacking in (replace(logs, uav=lambda: ()), replace(logs, fleet={})):
        with pytest.raises(ImportFileError, match="cannot be found"):
            find_fleet_clock([film], lacking, ANY)


def test_parts_of_a_long_film_are_a_minute_long_and_in_it():
    times = np.arange(0, 1_200_000_000, 40_000)
    spans = film_spans(times)
    assert [last - first for first, last in spans] == [60_000_000] * 3
    assert all(first >= 0 and last <= times[-1] for first, last in spans)
    assert film_spans(times[:1500]) == [(0, int(times[1499]))]
