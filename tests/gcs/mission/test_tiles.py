from __future__ import annotations

import sqlite3
import struct
import zlib

import pytest

from gcs.errors import ConfigError
from gcs.mission.mission import load_mission
from gcs.mission.tile_file import MAX_KEPT, MAX_SLOW, TILE_PX, TileFile
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
    tiles = TileFile(make_tiles(tmp_path / "a.mbtiles", {(9, n, 0): (n, n, n) for n in range(MAX_KEPT + 40)}))
    for n in range(MAX_KEPT + 40):
        assert tiles.tile(9, n, 0)[0, 0, 0] == n
    assert len(tiles._kept) == MAX_KEPT


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


def quoted(path):
    """A damaged schema, which SQLite quotes with letters that are none."""
    data = path.read_bytes().replace(b"tablemetadata", b"tablemetadat\xab").replace(b"metadata (", b"metadata\x08(")
    path.write_bytes(data)
    return path


@pytest.mark.parametrize(
    ("made", "said"),
    [
        (lambda path: path, "no such file"),
        (lambda path: path.write_bytes(b"no database at all" * 100) and path, "cannot be read as MBTiles"),
        (lambda path: path.mkdir() or path, "no such file"),
        (lambda path: spoil(path, "CREATE TABLE other (a)"), "cannot be read as MBTiles"),
        (lambda path: quoted(make_tiles(path, {})), "cannot be read as MBTiles"),
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


ENDLESS = "WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n) SELECT i"
AS_VIEW = "CREATE VIEW tiles AS SELECT zoom_level, tile_column, tile_row, %s AS tile_data FROM kept"


@pytest.mark.slow_but_first
@pytest.mark.parametrize(
    "statements",
    [
        [
            "ALTER TABLE metadata RENAME TO m",
            f"CREATE VIEW metadata AS {ENDLESS} AS name, i AS value FROM n WHERE i < 0",
        ],
        ["ALTER TABLE tiles RENAME TO kept", AS_VIEW % f"({ENDLESS} FROM n WHERE i < 0)"],
        ["ALTER TABLE tiles RENAME TO kept", AS_VIEW % "zeroblob(900000000)"],
    ],
    ids=["endless notes", "endless tiles", "a gigabyte"],
)
def test_what_a_file_asks_of_the_database_is_bounded(tmp_path, monkeypatch, statements):
    monkeypatch.setattr("gcs.mission.tile_file.MAX_OPEN_S", 0.3)
    path = spoil(make_tiles(tmp_path / "a.mbtiles", {(1, 0, 0): (1, 2, 3)}), *statements)
    with pytest.raises(ConfigError, match="cannot be read as MBTiles"):
        TileFile(path)


def test_a_file_whose_tiles_take_too_long_is_left_alone(tmp_path, monkeypatch):
    monkeypatch.setattr("gcs.mission.tile_file.MAX_READ_S", 0.05)
    slow = f"CASE tile_row WHEN 1 THEN ({ENDLESS} FROM n WHERE i < 0) ELSE tile_data END"
    path = make_tiles(tmp_path / "a.mbtiles", {(1, 0, 1): (1, 2, 3), **{(9, n, 510): (1, 2, 3) for n in range(5)}})
    tiles = TileFile(spoil(path, "ALTER TABLE tiles RENAME TO kept", AS_VIEW % slow))
    assert [tiles.tile(9, n, 510) is None for n in range(5)] == [True] * 5
    assert tiles._slow == MAX_SLOW


@pytest.mark.parametrize("sides", [(20_000, 20_000), (20_000, 1)])
def test_a_picture_of_any_size_is_not_decoded(tmp_path, sides):
    picture = bytearray(png((7, 7, 7), 1))
    picture[16:24] = struct.pack("!II", *sides)
    picture[29:33] = struct.pack("!I", zlib.crc32(picture[12:29]))
    path = make_tiles(tmp_path / "a.mbtiles", {(1, 0, 0): (1, 2, 3), (1, 1, 0): bytes(picture)})
    tiles = TileFile(path)
    assert tiles.tile(1, 1, 0) is None and tiles.tile(1, 0, 0) is not None


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
