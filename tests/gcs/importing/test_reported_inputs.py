"""Inputs as public bug reports describe them, as they were handed in: ``tests/data/reported``."""

import re
from pathlib import Path

import numpy as np
import pytest

from gcs.errors import ImportFileError
from gcs.importing.ground_vehicles import read_ground_vehicles
from gcs.importing.sources import read_vehicle_logs
from mavlink.tlog.check import check
from mavlink.tlog.log import Tlog
from vision.camera.lens_file import read_lens

FOLDER = Path("tests/data/reported")


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("two_boots_two_boots.bin", "the vehicle was started again at byte 27652; cut it there"),
        ("ulog2csv_rover.csv", "column timestamp: cannot be s, since rows are 202360 apart"),
        ("boot_ms_uav_uav.csv", "column timestamp: cannot be s, since rows are 500 apart"),
        ("same_time_gpx_rover.gpx", "all 60 positions have the same time, 2020-06-12 05:50:25"),
        ("local_dates_rover_de.csv", "the time '09.10.2025 08:53:20.000000' is not understood; give ISO 8601"),
        ("local_dates_rover_us.csv", "the time '10/09/2025 08:53:20 AM' is not understood; give ISO 8601"),
    ],
)
def test_what_cannot_be_used_says_why(name, words):
    with pytest.raises(ImportFileError, match=re.escape(words)):
        read_ground_vehicles(None, [f"11={FOLDER / name}"])


@pytest.mark.parametrize(
    ("name", "count", "said"),
    [
        ("row_id_rover.csv", 60, "the column id counts rows: it is no system id"),
        ("excel_sep_line_rover.csv", 60, ""),
        ("time_units_message_rover_ms.csv", 60, ""),
        ("time_units_message_rover_us.csv", 60, ""),
        ("time_units_message_rover_ns.csv", 60, ""),
        ("qgc_csv_rover.csv", 60, "times without a zone are UTC"),
        ("local_time_gpx_rover.gpx", 60, "times without a zone are UTC"),
        ("first_receiver_dead_rover.bin", 49, ""),
    ],
)
def test_what_is_read_is_that_of_one_vehicle_on_unix_time(name, count, said):
    fleet = read_ground_vehicles(None, [f"11={FOLDER / name}"])
    assert list(fleet.places) == [11] and len(fleet.places[11]) == count
    assert all(1.5e15 < t_us < 2e15 for t_us in fleet.span_us)
    assert any(said in words for words in fleet.assumed) if said else not fleet.assumed


def test_a_date_in_a_tracks_name_asks_for_the_id():
    with pytest.raises(ImportFileError, match="has no system id; give it as --ugv ID="):
        read_ground_vehicles(None, [str(FOLDER / "date_in_track_name_rover.gpx")])


def test_the_velocity_is_that_of_the_core_that_flies():
    (log,) = read_vehicle_logs(FOLDER / "lane_switch_uav.bin")
    # the other core drifts by 6 m/s
    assert np.nanmax(np.abs(log.places.v_ned)) < 1.0


def test_bursts_tell_no_speed_of_a_clock():
    found = check(Tlog.open(FOLDER / "short_bursts_fleet.tlog"))
    assert all(not 0.0 <= clock.speed < 0.9 for clock in found.clocks)


def test_subtitles_tell_the_body_and_the_zoom():
    (body,) = read_vehicle_logs(FOLDER / "drone_yaw_srt_film.srt")
    assert len(body.attitudes) == len(body.places) > 0
    (zoomed,) = read_vehicle_logs(FOLDER / "zoom_srt_tele.srt")
    assert not len(zoomed.view) and "a digital zoom of 4.00" in zoomed.view.source


def test_a_lens_in_block_style():
    lens = read_lens(FOLDER / "lens_indentless_lens.yaml")
    assert (lens.width, lens.fx) == (1920, pytest.approx(1484.12, abs=0.01))
