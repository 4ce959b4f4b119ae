from __future__ import annotations

import sqlite3

import pytest

from gcs.errors import ConfigError
from gcs.mission.mission import load_mission
from gcs.mission.tile_file import MOST_KEPT, TILE_PX, TileFile
from gcs.session.metadata import mission_table
from tests.support.films.board_video import make_tiles, png

ONE_PIXEL = png((7, 7, 7), 1)
MISSION = '[uav]\nsystem_id = 1\n[[ugv]]\nsystem_id = 2\n[map]\ntiles = "area.mbtiles"\n'


def test_a_tile_is_the_one_of_its_place(tmp_path):
    tiles = TileFile(make_tiles(tmp_path / "a b#.mbtiles", {(3, 4, 1): (10, 200, 30), (3, 4, 2): (200, 10, 30)}))
    assert tiles.zooms == (3,) and tiles.credit == "© Somebody"
    assert tiles.tile(3, 4, 1).shape == (TILE_PX, TILE_PX, 3)
    assert tiles.tile(3, 4, 1)[9, 9].tolist() == [10, 200, 30]
    assert tiles.tile(3, 4, 2)[9, 9].tolist() == [200, 10, 30]
    assert tiles.tile(3, 5, 1) is None and tiles.tile(9, 0, 0) is None
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a b#.mbtiles"]


def test_few_tiles_are_kept(tmp_path):
    tiles = TileFile(make_tiles(tmp_path / "a.mbtiles", {(9, n, 0): (n, n, n) for n in range(MOST_KEPT + 40)}))
    for n in range(MOST_KEPT + 40):
        assert tiles.tile(9, n, 0)[0, 0, 0] == n
    assert len(tiles._kept) == MOST_KEPT


@pytest.mark.parametrize("data", [b"", b"\x89PNG but no more", ONE_PIXEL, b"x" * 5_000_000, "text", None])
def test_a_damaged_tile_is_left_out(tmp_path, data):
    path = make_tiles(tmp_path / "a.mbtiles", {(1, 0, 0): (1, 2, 3)})
    with sqlite3.connect(path) as base:
        base.execute("INSERT INTO tiles VALUES (1, 1, 1, ?)", (data,))
    base.close()
    tile = TileFile(path).tile(1, 1, 0)
    assert tile is None or (data == ONE_PIXEL and tile.shape == (TILE_PX, TILE_PX, 3))


def spoil(path, *statements):
    with sqlite3.connect(path) as base:
        for statement in statements:
            base.execute(statement)
    base.close()
    return path


@pytest.mark.parametrize(
    ("made", "said"),
    [
        (lambda path: path, "no such file"),
        (lambda path: path.write_bytes(b"no database at all" * 100) and path, "cannot be read as MBTiles"),
        (lambda path: path.mkdir() or path, "no such file"),
        (lambda path: spoil(path, "CREATE TABLE other (a)"), "cannot be read as MBTiles"),
        (lambda path: make_tiles(path, {}), "it has no tiles"),
        (lambda path: make_tiles(path, {(1, 0, 0): (1, 1, 1)}, kind="pbf"), "vector tiles"),
        (lambda path: make_tiles(path, {(1, 0, 0): b"\x1f\x8b\x08"}, kind=""), "vector tiles"),
        (lambda path: make_tiles(path, {(1, 0, 0): (1, 1, 1)}, kind="svg"), "PNG, JPEG or WebP"),
        (lambda path: make_tiles(path, {(40, 0, 0): (1, 1, 1)}), "no tiles at a zoom"),
    ],
)
def test_what_is_no_use_is_told_clearly(tmp_path, made, said):
    path = made(tmp_path / "area.mbtiles")
    with pytest.raises(ConfigError, match=said) as error:
        TileFile(path)
    assert str(path) in str(error.value) and "\n" not in str(error.value)


def test_the_mission_has_it_beside_itself_and_a_session_keeps_it(tmp_path):
    (tmp_path / "mission.toml").write_text(MISSION)
    mission = load_mission(tmp_path / "mission.toml")
    assert mission.tiles == tmp_path / "area.mbtiles"
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "session.toml").write_text(mission_table(mission, {}))
    assert load_mission(tmp_path / "other" / "session.toml").tiles == tmp_path / "area.mbtiles"
    (tmp_path / "bare.toml").write_text(MISSION.split("[map]")[0])
    bare = load_mission(tmp_path / "bare.toml")
    assert bare.tiles is None and "[map]" not in mission_table(bare, {})
