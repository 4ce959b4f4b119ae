import dataclasses
import re

import numpy as np
import pytest

from gcs.errors import ImportFileError
from gcs.importing.formats.dji_cue import read_cue
from gcs.importing.formats.dji_srt import log_of_cues
from gcs.importing.formats.subtitles import read_cues
from tests.support.imports.srt_writers import LAYOUTS, Spot, srt

SPOTS = [
    (
        k / 10,
        Spot(36.6146 + 2e-6 * k, -6.1120 - 3e-6 * k, 45.0, 30.0, 120.0, -60.0, 1_700_000_000_000_000 + k * 100_000),
    )
    for k in range(200)
]
FIXES_M = {"old_mavic": 8.0, "matrice": 8.0, "positional": 8.0}
"""Of layouts with four decimals; others have six."""


def read(tmp_path, text, encoding="utf-8"):
    path = tmp_path / "DJI_0001.SRT"
    path.write_bytes(text.encode(encoding))
    return log_of_cues(path.name, read_cues(path))


def error_m(log):
    """Largest distance from the path."""
    at = (log.places.t_us * 1e-6)[:, None] * 10
    lat, lon = 36.6146 + 2e-6 * at[:, 0], -6.1120 - 3e-6 * at[:, 0]
    return np.hypot((log.places.lat_deg - lat) * 111e3, (log.places.lon_deg - lon) * 89e3).max()


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("quirk", ["", "mark and line ends", "UTF-16"])
def test_every_layout_tells_the_path(layout, quirk, tmp_path):
    if quirk == "mark and line ends":
        log = read(tmp_path, "\ufeff" + srt(layout, SPOTS, end="\r\n"))
    else:
        log = read(tmp_path, srt(layout, SPOTS), "utf-16" if quirk else "utf-8")
    assert error_m(log) < FIXES_M.get(layout, 0.5)
    above_the_sea = layout in ("misspelt", "autel")
    height = log.places.alt_m if above_the_sea else log.places.height_m
    assert height == pytest.approx(45.0 if above_the_sea else 30.0)
    assert log.notes.found[0].startswith("DJI subtitles")
    if layout in ("enterprise", "phantom_rtk", "autel"):
        assert np.degrees(log.gimbal.angles[5]) == pytest.approx((0.0, -60.0, 120.0))
    else:
        assert len(log.gimbal) == 0
    assert len(log.attitudes) == (len(SPOTS) if layout in ("phantom_rtk", "autel") else 0)
    dated = layout not in ("positional", "phantom_rtk")
    assert abs(log.zero_us - 1_700_000_000_000_000 * dated) < 1_000_000


def test_velocity_by_the_smoothed_path(tmp_path):
    log = read(tmp_path, srt("keyed", SPOTS))
    assert log.places.v_ned[20:-20, 0] == pytest.approx(2e-5 * 111_320, abs=0.1)
    assert np.isnan(log.places.v_ned[:, 2]).all()


def test_four_decimals_are_less_precise(tmp_path):
    assert read(tmp_path, srt("matrice", SPOTS)).places.std_m > 3.0
    assert read(tmp_path, srt("keyed", SPOTS)).places.std_m < 2.0


@pytest.mark.parametrize("fine", [0, 1, 100])
def test_finer_positions_do_not_make_the_others_so(fine, tmp_path):
    rows = [*SPOTS[:fine], *((t, Spot(round(s.lat, 4), round(s.lon, 4), s.alt, s.height)) for t, s in SPOTS[fine:])]
    assert read(tmp_path, srt("keyed", rows).replace("00]", "]")).places.std_m > 3.0


def test_zeros_that_are_left_out_do_not_make_positions_coarse(tmp_path):
    text = re.sub(r"(\.\d+?)0*\]", r"\1]", srt("keyed", SPOTS))
    assert read(tmp_path, text).places.std_m < 2.0


def test_whole_degrees_are_told_as_that(tmp_path):
    text = "1\n00:00:01,000 --> 00:00:02,000\n[latitude: 36] [longitude: -6] [rel_alt: 1.0 abs_alt: 2.0]\n"
    assert read(tmp_path, text).places.std_m == 10_000.0


@pytest.mark.parametrize(
    ("text", "mm"),
    [
        ("[focal_len : 240]", 24.0),
        ("[focal_len: 24.00]", 24.0),
        ("[focal_len: 284.80]", 284.8),
        ("[focal_len: 0]", None),
    ],
)
def test_focal_length(text, mm):
    cue = read_cue(f"[latitude: 1.5] [longitude: 2.5] [rel_alt: 1 abs_alt: 2] {text}")
    assert cue.focal_mm == pytest.approx(mm or np.nan, nan_ok=True)


def test_field_of_view_of_24_mm(tmp_path):
    view = read(tmp_path, srt("keyed", SPOTS)).view
    assert np.degrees(view.hfov[0]) == pytest.approx(71.6, abs=0.1)


def test_no_field_of_view_under_digital_zoom(tmp_path):
    assert not len(read(tmp_path, srt("enterprise", SPOTS).replace("dzoom_ratio: 1.00", "dzoom_ratio: 1.77")).view)


@pytest.mark.parametrize(
    ("text", "place"),
    [
        ("[latitude: 41,424724] [longitude: 2,234156] [rel_alt: 1,300 abs_alt: 132,860]", (41.424724, 2.234156, 1.3)),
        ("GPS (-82,6669; 27,7716; 10), D 2,80m, H 4,50m, H.S 0.00m/s", (27.7716, -82.6669, 4.5)),
        ("GPS(131.1660,-25.2088,14) BAROMETER:5.5", (-25.2088, 131.1660, 5.5)),
        ("gps(36.6146,-6.1120,0.0M) barometer:0.3M", (36.6146, -6.1120, 0.3)),
    ],
)
def test_numbers_as_other_languages_write_them(text, place):
    cue = read_cue(text)
    assert (cue.lat_deg, cue.lon_deg, cue.height_m) == pytest.approx(place)


def test_before_the_first_fix_and_without_a_place(tmp_path):
    early = [(k / 10, Spot(0.0, 0.0, 0.0, 0.0)) for k in range(7)]
    late = [(t + 1.0, spot) for t, spot in SPOTS]
    text = srt("keyed", [*early, *late]) + "900\n00:09:00,000 --> 00:09:01,000\nfly safely\n"
    log = read(tmp_path, text)
    assert log.notes.skipped == {
        "positions before the first fix, or none on Earth": 7,
        "subtitles without a position": 1,
    }
    assert log.places.t_us[0] == 1_000_000


def test_repeated_missing_and_shuffled_subtitles(tmp_path):
    kept = [spot for k, spot in enumerate(SPOTS) if k % 7]
    log = read(tmp_path, srt("keyed", [*kept[50:], *kept[:50], *kept[:3]]))
    assert log.notes.skipped == {"positions that are there twice": 3}
    assert error_m(log) < 0.5


def test_a_minute_of_sixty_seconds(tmp_path):
    text = srt("matrice", SPOTS[:1]).replace("00:00:00,030", "00:00:60,000")
    assert len(read(tmp_path, text).places) == 1


def test_cut_in_the_middle(tmp_path):
    text = srt("keyed", SPOTS)
    log = read(tmp_path, text[: len(text) // 2])
    assert 90 <= len(log.places) <= 101


@pytest.mark.parametrize(
    "text", ["", "hello", "1\n00:00:00,000 --> 00:00:01,000\nhello\n", "\x00" * 5000, "[latitude: 1]"]
)
def test_what_is_none_is_one_clear_line(text, tmp_path):
    with pytest.raises(ImportFileError, match=r"DJI_0001\.SRT") as caught:
        read(tmp_path, text)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "angles",
    [
        "[Drone: Yaw:30.6, Pitch:3.0, Roll:-0.5]",
        "[drone_yaw: 30.6 drone_pitch: 3.0 drone_roll: -0.5]",
        "[drone_yaw: 30.6, drone_pitch: 3.0, drone_roll: -0.5]",
    ],
)
def test_the_bodys_angles(angles):
    text = f"[latitude: 48.0] [longitude: 11.0] [gb_yaw: 10 gb_pitch: -60 gb_roll: 0] {angles} </font>"
    cue = read_cue(text)
    assert cue.body_deg == (-0.5, 3.0, 30.6)
    assert cue.gimbal_deg == (0.0, -60.0, 10.0)
    assert cue.family == "keyed, with the angles of the gimbal and the body"
    assert read_cue(text.replace("gb_yaw: 10 gb_pitch: -60 gb_roll: 0", "Gimbal: Pitch:-60, Yaw:10, Roll:0")) == cue


def test_a_digital_zoom_is_told_where_the_field_of_view_is_missed(tmp_path):
    text = srt("keyed", SPOTS).replace("[rel_alt", "[focal_len: 643.30] [dzoom_ratio: 4.00] [rel_alt")
    log = read(tmp_path, text)
    assert not len(log.view)
    assert "a focal length of 643.3 mm and a digital zoom of 4.00 in the subtitles" in log.view.source


def test_subtitles_of_two_films_in_one_file_are_refused(tmp_path):
    with pytest.raises(ImportFileError, match=r"times begin again: subtitle 202 is 19\.80 s earlier"):
        read(tmp_path, srt("keyed", SPOTS) + srt("keyed", [(t, SPOTS[0][1]) for t, _ in SPOTS]))


def test_a_date_that_steps_is_that_of_most_subtitles(tmp_path):
    late = [
        (t, dataclasses.replace(spot, unix_us=spot.unix_us + 3_600_000_000 * (k >= 101)))
        for k, (t, spot) in enumerate(SPOTS[:201])
    ]
    assert abs(read(tmp_path, srt("keyed", late)).zero_us - 1_700_000_000_000_000) < 1000
