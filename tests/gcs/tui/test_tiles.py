"""The pictures of all cameras in one field of cells."""

from dataclasses import replace

import pytest

from gcs.station import CameraPicture
from gcs.tui.tiles import tile_at, tile_rects, tiled_cells
from tests.support.fake_station import make_snapshot

SHOWN = make_snapshot()


def cameras(count, snapshot=SHOWN):
    return [CameraPicture(name=f"UAV-{k}", snapshot=snapshot, on_show=k == 2) for k in range(1, count + 1)]


@pytest.mark.parametrize(
    ("count", "columns", "rows", "rects"),
    [
        (0, 80, 24, []),
        (2, 160, 24, [(0, 0, 80, 24), (80, 0, 80, 24)]),  # beside each other
        (2, 60, 40, [(0, 0, 60, 20), (0, 20, 60, 20)]),  # one below the other
        (3, 120, 40, [(0, 0, 60, 20), (60, 0, 60, 20), (0, 20, 60, 20)]),
        (4, 120, 40, [(0, 0, 60, 20), (60, 0, 60, 20), (0, 20, 60, 20), (60, 20, 60, 20)]),
        (4, 12, 3, [(0, 0, 12, 3)]),  # no room: the first alone
        (2, 0, 0, []),
    ],
)
def test_as_many_are_beside_each_other_as_makes_them_largest(count, columns, rows, rects):
    assert tile_rects(cameras(count), columns, rows) == rects


def test_each_has_its_name_and_its_labels():
    first, second, third = cameras(3)
    tiles = [first, second, replace(third, snapshot=None)]
    cells, labels = tiled_cells(tiles, 11, 120, 40)
    rows = ["".join(map(chr, row)) for row in cells.letter.tolist()]
    assert (rows[0][:6], rows[0][60:66], rows[20][:6]) == (" UAV-1", "▸UAV-2", " UAV-3")
    assert "waiting for the first frame" in rows[21] and sum("UGV-12" in row[:60] for row in rows) == 1
    assert set(labels) == {0, 1}, "of the first two; two cameras may have one name"
    again, _ = tiled_cells(tiles, 11, 120, 40, former=labels)
    assert (again.letter == cells.letter).all(), "labels stay"
    assert tile_at(tiles, 61, 1, 120, 40) == (second, (60, 1, 60, 19)) and tile_at(tiles, 61, 0, 120, 40) is None
