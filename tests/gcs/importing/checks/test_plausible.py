"""Damage and contradictions within a log, whatever its format, and receivers that are all there is."""

import dataclasses

import numpy as np
import pytest

from gcs.errors import ImportFileError
from gcs.importing.checks.plausible import plausible
from gcs.importing.formats import px4_log
from gcs.importing.sources import read_vehicle_logs
from gcs.importing.vehicle_log import AngleTrack, ImportNotes, PlaceTrack, VehicleLog
from tests.support.imports.flown import fly
from tests.support.imports.log_writers import gpx, positions_csv, ulog, wire_places

N = 200
T_US = 1_790_000_000_000_000 + np.arange(N) * 100_000
LAT, LON = 47.1 + 1e-6 * np.arange(N), 179.9999 + 1e-6 * np.arange(N)


def log_of(**change):
    columns = {"lat_deg": LAT, "lon_deg": np.where(LON > 180.0, LON - 360.0, LON), **change}
    places = PlaceTrack.of(T_US, columns.pop("lat_deg"), columns.pop("lon_deg"), **columns)
    return VehicleLog(source="a.bin", clock="utc", places=places, notes=ImportNotes())


def test_a_whole_log_stays_as_it_is_also_across_the_date_line():
    log = plausible(log_of())
    assert len(log.places) == N
    assert not log.notes.skipped


@pytest.mark.parametrize(
    ("first_us", "said"),
    [
        (100_000_000, "it is of 1970-01-01 by its date: a clock that was never set?"),
        (
            1_175_853_600_000_000,
            "it is of 2007-04-06 by its date: a receiver whose weeks have begun again? that would ",
        ),
        (1_795_169_997_000_000, ""),
    ],
)
def test_old_dates_are_those_of_a_clock_or_of_a_receivers_weeks(first_us, said):
    log = log_of()
    log = plausible(dataclasses.replace(log, places=dataclasses.replace(log.places, t_us=T_US - T_US[0] + first_us)))
    assert "".join(log.notes.assumed).startswith(said) and bool(log.notes.assumed) == bool(said)


@pytest.mark.parametrize("rows", [[0], [N // 2], [N - 1], [40, 41, 42, 43], [3, 90, 150]])
def test_places_that_cannot_be_reached_are_left_out_and_counted(rows):
    lat = LAT.copy()
    lat[rows] += 22.5  # 2,500 km
    log = plausible(log_of(lat_deg=lat))
    assert log.notes.skipped == {"positions too far from those around them": len(rows)}
    assert log.places.lat_deg == pytest.approx(np.delete(LAT, rows))


def test_a_receiver_that_corrects_itself_is_followed():
    lat = LAT.copy()
    lat[50:] += 1e-3  # 110 m
    assert len(plausible(log_of(lat_deg=lat)).places) == N


def test_places_of_four_decimals_stay_until_the_next_cell():
    t_us = T_US[0] + 100_000 * np.arange(600)
    lat, north = 48.0 + 1.5 * 0.1 * np.arange(600) / 111_320.0, np.zeros((600, 3))
    north[:, 0] = 1.5
    places = PlaceTrack.of(t_us, np.round(lat, 4), np.full(600, 11.0), v_ned=north)
    log = VehicleLog(source="a.csv", clock="utc", places=places, notes=ImportNotes())
    assert len(plausible(log).places) == 600


def test_heights_before_home_is_set_are_none():
    height = np.full(N, 30.0)
    height[:20] = 0.0
    log = plausible(log_of(alt_m=np.full(N, 480.0), height_m=height))
    assert np.isnan(log.places.height_m[:20]).all()
    assert (log.places.height_m[20:] == 30.0).all()
    # on the ground 0 is a height
    log = plausible(log_of(alt_m=450.0 + height, height_m=height))
    assert (log.places.height_m == height).all()


def test_angles_that_are_all_0_are_none():
    still, level = AngleTrack(t_us=T_US, angles=np.zeros((N, 3))), AngleTrack(t_us=T_US, angles=np.zeros((N, 3)))
    level.angles[:, 1] = -0.5 * np.pi
    log = plausible(dataclasses.replace(log_of(), attitudes=still, gimbal=level))
    assert not len(log.attitudes) and len(log.gimbal) == N
    assert log.notes.assumed == ("its attitudes are all 0, which stands for unknown ones",)
    assert not len(plausible(dataclasses.replace(log_of(), gimbal=still)).gimbal)


def test_altitudes_that_are_all_0_are_none():
    height = 30.0 + 0.1 * np.arange(N)
    log = plausible(log_of(alt_m=np.zeros(N), height_m=height))
    assert np.isnan(log.places.alt_m).all() and (log.places.height_m == height).all()
    assert log.notes.assumed == ("its altitudes are all 0, which stands for unknown ones",)
    # a boat goes up and down
    waves = 0.1 * np.sin(np.arange(N))
    log = plausible(log_of(alt_m=waves))
    assert (log.places.alt_m == waves).all() and not log.notes.assumed


@pytest.mark.parametrize(
    ("factor", "turned", "kept"),
    [
        (1.0, 0.0, True),
        (1.1, 0.1, True),
        (100.0, 0.0, False),
        (3.6, 0.0, False),
        (1 / 3.6, 0.0, False),
        (1.0, 1.5, False),
    ],
)
def test_velocities_in_another_unit_or_frame_than_the_path_are_left_out(factor, turned, kept):
    speed_mps, t_s = 8.0, np.arange(N) * 0.1
    rng = np.random.default_rng(1)
    lat = 47.1 + (speed_mps * t_s + rng.normal(0.0, 0.5, N)) / 111_320.0
    v_ned = speed_mps * factor * np.column_stack([np.full(N, np.cos(turned)), np.full(N, np.sin(turned)), np.zeros(N)])
    log = plausible(log_of(lat_deg=lat, lon_deg=np.full(N, 8.1), v_ned=v_ned))
    assert np.isfinite(log.places.v_ned).all() == kept
    assert log.notes.skipped == ({} if kept else {"velocities that are not those of the path": N})


def test_a_drift_that_the_filter_tells_of_a_vehicle_that_stands_is_none():
    log = plausible(log_of(lat_deg=np.full(N, 47.1), lon_deg=np.full(N, 8.1), v_ned=np.full((N, 3), 6.0)))
    assert np.isnan(log.places.v_ned).all()


def test_a_camera_that_looks_straight_down_keeps_its_angles():
    # yaw and roll leap together there, and the camera does not
    turned = 0.01 * np.arange(N)
    yaw = turned + 2.0 * (np.arange(N) // 2 == 25)
    angles = np.column_stack([turned - yaw, np.full(N, -np.pi / 2), yaw])
    log = plausible(dataclasses.replace(log_of(), gimbal=AngleTrack(t_us=T_US, angles=angles)))
    assert len(log.gimbal) == N and not log.notes.skipped


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    return fly(tmp_path_factory.mktemp("flown"), 60)


@pytest.mark.parametrize("name", ["rover.csv", "rover.gpx"])
def test_a_damaged_row_is_found_in_every_format(name, flown, tmp_path):
    path = tmp_path / name
    text = positions_csv(flown, (11,)) if name.endswith("csv") else gpx(flown, (11,))
    path.write_text(text)
    (whole,) = read_vehicle_logs(path)
    lat = f"{wire_places(flown, 11)['lat'][9]:.7f}"
    path.write_text(text.replace(lat, f"{float(lat) + 20.0:.7f}"))
    (log,) = read_vehicle_logs(path)
    assert sum(log.notes.skipped.values()) == len(whole.places) - len(log.places) == 1


def receiver(fixes, *, older, utc=True):
    n = len(T_US)
    lat, lon, alt = (LAT, np.full(n, 8.1), np.full(n, 430.0)) if fixes else (np.zeros(n),) * 3
    names = ("lat", "lon", "alt") if older else ("latitude_deg", "longitude_deg", "altitude_msl_m")
    scales = (1e7, 1e7, 1e3) if older else (1.0, 1.0, 1.0)
    kind = np.int32 if older else np.float64
    columns = {
        name: np.round(v * s).astype(kind) if older else v
        for name, v, s in zip(names, (lat, lon, alt), scales, strict=True)
    }
    return {
        **columns,
        "timestamp": (T_US - T_US[0] + 5_000_000).astype(np.uint64),
        "time_utc_usec": T_US.astype(np.uint64) if fixes and utc else np.zeros(n, np.uint64),
        "fix_type": np.full(n, 3 if fixes else 0, np.uint8),
        "vel_n_m_s": np.full(n, 1.0, np.float32),
        "vel_e_m_s": np.zeros(n, np.float32),
        "vel_d_m_s": np.zeros(n, np.float32),
        "eph": np.full(n, 0.9, np.float32),
    }


@pytest.mark.parametrize(("name", "older"), [("vehicle_gps_position", True), ("sensor_gps", False)])
def test_px4_by_its_receivers_where_nothing_was_estimated(name, older, tmp_path, monkeypatch):
    topics = {name: [receiver(False, older=older), receiver(True, older=older)]}
    monkeypatch.setattr(px4_log, "_topics", lambda path: (topics, 12, False))
    log = px4_log.read_px4(tmp_path / "rover.ulg")
    assert log.clock == "utc"
    assert log.places.t_us == pytest.approx(T_US)
    assert log.places.lat_deg == pytest.approx(LAT, abs=1e-7)
    assert log.places.alt_m == pytest.approx(430.0)
    assert log.places.v_ned[3] == pytest.approx((1.0, 0.0, 0.0))
    assert log.notes.found[0] == "ULog, 200 positions of the receiver"


def test_a_px4_log_whose_times_begin_again_is_refused(tmp_path, monkeypatch):
    fixes = receiver(True, older=False)
    fixes["timestamp"][N // 2 :] -= fixes["timestamp"][N // 2] - fixes["timestamp"][0]
    monkeypatch.setattr(px4_log, "_topics", lambda path: ({"sensor_gps": [fixes]}, 12, False))
    with pytest.raises(ImportFileError, match=r"rover\.ulg: its times begin again: 5\.0 s of the log's clock"):
        px4_log.read_px4(tmp_path / "rover.ulg")


def test_a_date_of_px4_that_steps_is_that_which_holds_longest(tmp_path, monkeypatch):
    fixes = receiver(True, older=False)
    fixes["time_utc_usec"][: N // 3] -= 18_000_000
    monkeypatch.setattr(px4_log, "_topics", lambda path: ({"sensor_gps": [fixes]}, 12, False))
    log = px4_log.read_px4(tmp_path / "rover.ulg")
    assert log.places.t_us == pytest.approx(T_US)
    assert log.notes.assumed == ("GPS time steps by +18.00 s at 11.6 s: what holds longest counts",)


def test_the_date_is_that_of_a_receiver_that_knows_it(flown, tmp_path, monkeypatch):
    read = px4_log._topics

    def with_dead(path):
        topics, system_id, damaged = read(path)
        dead = {name: np.zeros_like(values) for name, values in topics["vehicle_gps_position"][0].items()}
        return {**topics, "vehicle_gps_position": [dead, *topics["vehicle_gps_position"]]}, system_id, damaged

    (tmp_path / "rover.ulg").write_bytes(ulog(flown, 12))
    (whole,) = read_vehicle_logs(tmp_path / "rover.ulg")
    monkeypatch.setattr(px4_log, "_topics", with_dead)
    (log,) = read_vehicle_logs(tmp_path / "rover.ulg")
    assert log.clock == "utc"
    assert log.places.t_us == pytest.approx(whole.places.t_us)
