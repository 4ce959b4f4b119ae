"""Good inputs with a clock that begins again, is set or repeats itself: read as if whole, or told in words."""

import dataclasses
import datetime

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs.errors import ImportFileError
from gcs.importing.formats.dji_srt import log_of_cues
from gcs.importing.formats.klv import log_of_klv
from gcs.importing.formats.subtitles import cues_of
from gcs.importing.formats.timed_bytes import TimedBytes
from gcs.importing.sources import read_vehicle_logs
from tests.support.imports.film_writers import klv_set
from tests.support.imports.srt_writers import Spot, srt

N, STEP_S = 120, 0.5
T0_S = 1_760_000_000.0
TIMES_S = np.arange(N) * STEP_S
LAT, LON = 47.1 + 4e-6 * np.arange(N), 8.1 + 2e-6 * np.arange(N)


def csv_text(times_s):
    rows = zip(times_s.tolist(), LAT, LON, strict=True)
    return "time_s,lat,lon\n" + "".join(f"{T0_S + t:.3f},{lat:.9f},{lon:.9f}\n" for t, lat, lon in rows)


def gpx_text(times_s):
    points = []
    for t, lat, lon in zip(times_s.tolist(), LAT, LON, strict=True):
        when = datetime.datetime.fromtimestamp(T0_S + t, datetime.UTC).isoformat()
        points.append(f'<trkpt lat="{lat:.9f}" lon="{lon:.9f}"><time>{when}</time></trkpt>')
    return f"<gpx><trk><trkseg>{''.join(points)}</trkseg></trk></gpx>"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("broken")


WRITERS = {"rover.csv": csv_text, "rover.gpx": gpx_text}


def read(folder, name, times_s):
    (folder / name).write_text(WRITERS[name](times_s))
    (log,) = read_vehicle_logs(folder / name)
    return log


def assert_as_whole(log):
    assert log.places.t_us == pytest.approx((T0_S + TIMES_S) * 1e6, abs=5000)
    assert np.abs(log.places.lat_deg - LAT).max() * 111_320 < 0.05
    assert np.abs(log.places.lon_deg - LON).max() * 111_320 < 0.05


@pytest.mark.parametrize("name", WRITERS)
def test_whole(name, folder):
    assert_as_whole(read(folder, name, TIMES_S))


@pytest.mark.parametrize("name", WRITERS)
@given(row=st.integers(10, N - 10), by_s=st.floats(-4000.0, -2.0))
def test_a_clock_that_is_set_back_is_refused(name, row, by_s, folder):
    with pytest.raises(ImportFileError, match=rf"times begin again: position {row + 1} of {N}"):
        read(folder, name, np.where(np.arange(N) >= row, TIMES_S + by_s, TIMES_S))


@pytest.mark.parametrize("name", WRITERS)
@given(row=st.integers(1, N - 1), by_s=st.floats(6.0, 4000.0))
def test_a_clock_that_is_set_forward_is_told_as_a_gap(name, row, by_s, folder):
    log = read(folder, name, np.where(np.arange(N) >= row, TIMES_S + by_s, TIMES_S))
    assert log.notes.assumed == (f"nothing was logged for {by_s + STEP_S:.1f} s after position {row} of {N}",)


@pytest.mark.parametrize("name", WRITERS)
@given(row=st.integers(1, N - 5))
def test_one_row_that_comes_late_is_put_in_its_place(name, row, folder):
    order = np.insert(np.delete(np.arange(N), row), row + 3, row)
    text = WRITERS[name](TIMES_S).replace("<trkpt", "\n<trkpt").splitlines(keepends=True)
    (folder / name).write_text("".join([text[0], *(text[1 + k].removesuffix("</trkseg></trk></gpx>") for k in order)]))
    if name.endswith("gpx"):
        with (folder / name).open("a") as file:
            file.write("</trkseg></trk></gpx>")
    (log,) = read_vehicle_logs(folder / name)
    assert_as_whole(log)
    assert log.notes.assumed == ("1 positions stand behind later ones: put in order",)


SPOTS = [
    (t, Spot(lat, lon, 45.0, 30.0, 120.0, -60.0, round((T0_S + t) * 1e6)))
    for t, lat, lon in zip(TIMES_S.tolist(), LAT.tolist(), LON.tolist(), strict=True)
]


@given(row=st.integers(10, N - 10))
def test_subtitles_that_begin_again_are_refused(row):
    again = [(t - SPOTS[row][0], spot) for t, spot in SPOTS[row:]]
    with pytest.raises(ImportFileError, match="times begin again"):
        log_of_cues("a.srt", cues_of(srt("keyed", [*SPOTS[:row], *again]).splitlines()))


@given(row=st.integers(10, N - 10), by_s=st.floats(-4000.0, 4000.0).filter(lambda s: abs(s) > 1.0))
def test_a_date_in_klv_that_is_set_does_not_move_places(row, by_s):
    def sets(shift_us):
        return [
            TimedBytes(
                round(t * 1e6),
                klv_set(dataclasses.replace(spot, unix_us=spot.unix_us + shift_us * (k >= row)), (0.0, 0.0, 30.0)),
            )
            for k, (t, spot) in enumerate(SPOTS)
        ]

    log, whole = log_of_klv("a.ts", sets(round(by_s * 1e6))), log_of_klv("a.ts", sets(0))
    assert log.places.t_us == pytest.approx(whole.places.t_us, abs=5000)
    assert log.places.lat_deg == pytest.approx(whole.places.lat_deg, abs=1e-9)
    assert f"steps by {by_s:+.1f} s" in log.notes.assumed[0]
