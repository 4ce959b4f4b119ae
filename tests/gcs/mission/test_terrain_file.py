"""Elevations from GeoTIFF files: grids of all kinds that are read, and what is said of those that are not."""

import numpy as np
import pytest
from PIL import Image
from pyproj import Transformer

from gcs.errors import ConfigError
from gcs.mission import terrain_file
from gcs.mission.mission import load_mission
from gcs.mission.terrain_file import TerrainFile
from tests.support.films.board_video import POINT, write_geotiff

LAT, LON = 47.01, 8.02
ROWS, COLUMNS, CELL = 40, 60, 0.0005


def plane(lat, lon):
    """A slope, which is the same between cells as it is in them."""
    return 500.0 + 2000.0 * (np.asarray(lat) - LAT) - 900.0 * (np.asarray(lon) - LON)


def grid(kind=np.float32, *, middle=0.5):
    lat = LAT - (np.arange(ROWS) + middle) * CELL
    lon = LON + (np.arange(COLUMNS) + middle) * CELL
    return plane(lat[:, None], lon[None, :]).astype(kind)


@pytest.fixture
def places():
    rng = np.random.default_rng(1)
    return LAT - rng.uniform(0.001, 0.019, 20), LON + rng.uniform(0.001, 0.029, 20)


@pytest.mark.slow_but_first
@pytest.mark.parametrize("save", [{}, {"compression": "tiff_adobe_deflate"}, {"compression": "tiff_lzw"}])
def test_a_grid_in_degrees(tmp_path, places, save):
    path = write_geotiff(tmp_path / "a.tif", grid(), (LON, LAT), (CELL, CELL), **save)
    np.testing.assert_allclose(TerrainFile(path).elevations(*places), plane(*places), atol=1e-3)


def test_tie_points_may_be_of_centres(tmp_path, places):
    path = write_geotiff(tmp_path / "a.tif", grid(middle=0.0), (LON, LAT), (CELL, CELL), raster=POINT)
    np.testing.assert_allclose(TerrainFile(path).elevations(*places), plane(*places), atol=1e-3)


def test_whole_metres(tmp_path, places):
    path = write_geotiff(tmp_path / "a.tif", np.round(grid()).astype(np.int32), (LON, LAT), (CELL, CELL))
    np.testing.assert_allclose(TerrainFile(path).elevations(*places), plane(*places), atol=0.51)


def test_a_projection(tmp_path, places):
    to_utm = Transformer.from_crs(4326, 32632, always_xy=True)
    x0, y0 = to_utm.transform(LON, LAT)
    x, y = x0 - 100.0 + 20.0 * (np.arange(150) + 0.5), y0 + 100.0 - 20.0 * (np.arange(140) + 0.5)
    lon, lat = to_utm.transform(*np.meshgrid(x, y), direction="INVERSE")
    path = write_geotiff(
        tmp_path / "a.tif", plane(lat, lon).astype(np.float32), (x0 - 100.0, y0 + 100.0), (20.0, 20.0), epsg=32632
    )
    np.testing.assert_allclose(TerrainFile(path).elevations(*places), plane(*places), atol=0.02)


def test_outside_and_in_gaps_nothing_is_known(tmp_path):
    z = grid()
    z[10:15] = -9999.0
    terrain = TerrainFile(write_geotiff(tmp_path / "a.tif", z, (LON, LAT), (CELL, CELL), no_data=-9999))
    lat = np.array([LAT + 0.1, LAT - 12 * CELL, LAT - 0.015, np.nan])
    assert np.isfinite(terrain.elevations(lat, np.full(4, LON + 0.01))).tolist() == [False, False, True, False]


def test_what_cannot_be_read_is_said(tmp_path, monkeypatch):
    place = (LON, LAT), (CELL, CELL)
    (tmp_path / "text.tif").write_text("no picture")
    Image.fromarray(grid()).save(tmp_path / "nowhere.tif")
    write_geotiff(tmp_path / "colour.tif", np.zeros((4, 4, 3), np.uint8), *place)
    write_geotiff(tmp_path / "feet.tif", grid(), *place, keys=[(4099, 9002)])
    write_geotiff(tmp_path / "own.tif", grid(), *place, epsg=32767)
    said = {
        "gone.tif": "no such file; [map] terrain needs a GeoTIFF",
        "text.tif": "cannot be read as TIFF",
        "nowhere.tif": "has no place",
        "colour.tif": "has 3 bands",
        "feet.tif": "not in metres",
        "own.tif": "no EPSG code",
    }
    for name, text in said.items():
        with pytest.raises(ConfigError) as error:
            TerrainFile(tmp_path / name)
        assert str(error.value).startswith(f"{tmp_path / name}: ") and text in str(error.value)
    monkeypatch.setattr(terrain_file, "MAX_CELLS", 100)
    with pytest.raises(ConfigError, match="60 × 40 cells are too many"):
        TerrainFile(write_geotiff(tmp_path / "large.tif", grid(), *place))


@pytest.mark.slow_but_first
@pytest.mark.parametrize(
    ("tag", "value", "said"),
    [
        (33550, (1.0,), "has no place"),
        (33550, "0.1", "has no place"),
        (33550, (float("nan"), 1.0, 0.0), "no size or place"),
        (33922, (0.0, 0.0, 0.0), "has no place"),
        (33922, (0.0, 0.0, 0.0, float("inf"), 0.0, 0.0), "no size or place"),
        (34735, 1, "no EPSG code"),
        (34735, "words", "no EPSG code"),
        (34735, (1, 1, 0, 1, 2048, 0, 1), "no EPSG code"),
        (34735, (1, 1, 0, 1, 2048, 0, 1, 60000), "EPSG:60000: "),
    ],
)
def test_tags_that_are_short_or_of_another_type(tag, value, said, tmp_path):
    path = write_geotiff(tmp_path / "a.tif", grid(), (LON, LAT), (CELL, CELL))
    with Image.open(path) as image:
        tags = image.tag_v2
        tags.tagtype.pop(tag)
        tags[tag] = value
        image.save(tmp_path / "b.tif", tiffinfo=tags)
    with pytest.raises(ConfigError, match=said):
        TerrainFile(tmp_path / "b.tif")


def test_a_mission_names_it_beside_itself(tmp_path):
    path = tmp_path / "m.toml"
    path.write_text('[uav]\nsystem_id = 1\n[[ugv]]\nsystem_id = 11\n[map]\nterrain = "area.tif"\n')
    assert load_mission(path).terrain == tmp_path / "area.tif"
    path.write_text("[uav]\nsystem_id = 1\n[[ugv]]\nsystem_id = 11\n")
    assert load_mission(path).terrain is None
