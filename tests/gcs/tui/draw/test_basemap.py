"""Tiles under the map: the right ground in the right place, dim, and text as readable as without."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from gcs.mission.tile_file import TileFile
from gcs.tui.draw.basemap import STRENGTH, Basemap
from gcs.tui.draw.ground_view import MapView
from gcs.tui.draw.map_canvas import MapExtras, chart_cells
from gcs.tui.palette import FAINT, PANEL, pack, use_theme
from gcs.tui.panes.map import MapPane
from mavlink.geodesy import LocalFrame
from tests.support.fake_station import FakeStation, make_snapshot, polled, running, text_of
from tests.support.films.board_video import make_tiles

ORIGIN = LocalFrame(47.397742, 8.545594)
SNAPSHOT = replace(make_snapshot(), origin=ORIGIN)
ZOOM = 19
PAPER = 0x000000


def tile_of(lat_deg, lon_deg, zoom=ZOOM):
    """Column and row of a place, as the OpenStreetMap wiki has it."""
    n = 2**zoom
    lat = math.radians(lat_deg)
    return int((lon_deg + 180) / 360 * n), int((1 - math.log(math.tan(lat) + 1 / math.cos(lat)) / math.pi) / 2 * n)


def checkers(path, zoom=ZOOM, reach=6):
    """Tiles round the origin, each of a colour of its own."""
    column, row = tile_of(ORIGIN.lat_deg, ORIGIN.lon_deg, zoom)
    tiles = {
        (zoom, column + x, row + y): (100 + 10 * x, 100 + 10 * y, 250)
        for x in range(-reach, reach + 1)
        for y in range(-reach, reach + 1)
    }
    return tiles, make_tiles(path, tiles)


@pytest.mark.slow_but_first
@pytest.mark.parametrize(("east", "north", "scale"), [(0.0, 0.0, 0.5), (60.0, -40.0, 0.28), (-30.0, 80.0, 0.05)])
def test_every_cell_shows_the_tile_of_its_ground(tmp_path, east, north, scale):
    tiles, path = checkers(tmp_path / "a.mbtiles")
    view = MapView(east=east, north=north, metres_per_dot=scale, columns=80, rows=24)
    picture = Basemap(TileFile(path)).picture(view, ORIGIN, PAPER)
    assert picture.shape == (48, 80)
    right = 0
    for row in range(24):
        for column in range(80):
            lat, lon, _ = ORIGIN.to_geodetic((*view.ground(column, row), 0.0))
            blue, green, red = tiles[(ZOOM, *tile_of(float(lat), float(lon)))]
            seen = int(picture[2 * row, column])
            want = [STRENGTH * each for each in (red, green, blue)]
            right += all(abs((seen >> s & 255) - each) <= 5 for s, each in zip((16, 8, 0), want, strict=True))
    # cells on an edge between tiles are of both
    assert right > 0.9 * 24 * 80


def test_a_scale_has_tiles_that_fit_it(tmp_path):
    """Far out: few coarse tiles, not thousands of fine ones; closer than the finest: those, larger."""
    fine, coarse = (tile_of(ORIGIN.lat_deg, ORIGIN.lon_deg, zoom) for zoom in (19, 12))
    around = {(19, fine[0] + x, fine[1] + y): (0, 0, 250) for x in range(-3, 4) for y in range(-3, 4)}
    both = around | {(12, coarse[0] + x, coarse[1] + y): (0, 250, 0) for x in (-1, 0, 1) for y in (-1, 0, 1)}
    basemap = Basemap(TileFile(make_tiles(tmp_path / "a.mbtiles", both)))
    for scale, colour in ((0.02, 16), (0.3, 16), (20.0, 8)):
        view = MapView(east=0.0, north=0.0, metres_per_dot=scale, columns=60, rows=20)
        picture = basemap.picture(view, ORIGIN, PAPER)
        assert (picture[20, 30] >> colour & 255) == pytest.approx(STRENGTH * 250, abs=5), scale
    elsewhere = MapView(east=0.0, north=3e6, metres_per_dot=1.0, columns=60, rows=20)
    assert basemap.picture(elsewhere, ORIGIN, PAPER) is None
    assert basemap.picture(replace(elsewhere, north=0.0, metres_per_dot=10_000.0), ORIGIN, PAPER) is None
    assert basemap.picture(replace(elsewhere, north=0.0), None, PAPER) is None


def test_where_there_is_no_tile_is_the_background(tmp_path):
    column, row = tile_of(ORIGIN.lat_deg, ORIGIN.lon_deg)
    path = make_tiles(tmp_path / "a.mbtiles", {(ZOOM, column, row): (255, 255, 255)})
    view = MapView(east=0.0, north=0.0, metres_per_dot=1.0, columns=80, rows=24)
    picture = Basemap(TileFile(path)).picture(view, ORIGIN, 0x0E121A)
    assert (picture == 0x0E121A).mean() > 0.5 and (picture != 0x0E121A).any()


def bright(colour):
    """Relative luminance as WCAG 2.2 has it."""
    parts = [(colour >> shift & 255) / 255 for shift in (16, 8, 0)]
    linear = [part / 12.92 if part <= 0.03928 else ((part + 0.055) / 1.055) ** 2.4 for part in parts]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


@pytest.mark.parametrize("theme", ["dark", "light", "high-contrast"])
def test_text_over_the_picture_has_its_contrast(theme):
    use_theme(theme)
    try:
        view = MapView(east=0.0, north=0.0, metres_per_dot=0.5, columns=100, rows=30)
        ground = np.full((60, 100), 0xFFFFFF if theme != "light" else 0, dtype=np.int64)
        cells = chart_cells(SNAPSHOT, 0, view, None, MapExtras(ground=ground, credit="© Somebody"))
        said = [strip.text for strip in cells.strips()]
        for name in ("UGV-11", "UGV-12", "UAV"):
            row = next(y for y, text in enumerate(said) if name in text)
            at = said[row].index(name)
            for x in range(at, at + len(name)):
                light, dark = sorted((bright(int(cells.ink[row, x])), bright(int(cells.paper[row, x]))), reverse=True)
                assert (light + 0.05) / (dark + 0.05) >= 4.5
        assert said[-1].rstrip().endswith("© Somebody")
        assert cells.paper[30, 5] == pack(PANEL) and cells.ink[30, 1] == pack(FAINT)
    finally:
        use_theme("dark")


async def test_the_map_pane_shows_it(tmp_path):
    _, path = checkers(tmp_path / "a.mbtiles")
    station = FakeStation(snapshot=SNAPSHOT)
    station.tiles = path
    async with running(station, size=(160, 48)) as (app, pilot, _):
        await pilot.press("M")
        chart = app.query_one(MapPane)
        assert "▀" in text_of(chart) and "© Somebody" in text_of(chart) and "UGV-12" in text_of(chart)


async def test_tiles_that_are_gone_are_an_event_of_a_replay_that_goes_on(tmp_path):
    station = FakeStation(snapshot=SNAPSHOT)
    station.tiles = tmp_path / "gone.mbtiles"
    async with running(station, size=(160, 48)) as (app, pilot, _):
        await polled(app, pilot)
        assert "UGV-12" in text_of(app.query_one(MapPane))
    assert [event.level for event in station.said if "gone.mbtiles: no such file" in event.text] == ["warning"]
