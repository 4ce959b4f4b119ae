from __future__ import annotations

import cv2
import numpy as np
import pytest

from training.fronts.cluster import Clusters
from training.fronts.sheets import (
    draw_sheets,
    fronts,
    read_corrections,
    write_corrections,
)
from vision.errors import LabelError

CLUSTERS = Clusters(
    number=np.array([0, 0, 0, 1, 1, 2]),
    turned=np.array([False, True, False, False, True, False]),
    sure=np.array([0.9, 0.8, 0.1, 0.7, 0.6, 0.5]),
)
GUESSES = {0: "right", 1: "left", 2: "?"}


def table(tmp_path, *rows):
    path = tmp_path / "corrections.csv"
    path.write_text("\n".join(["what,number,front", *rows]) + "\n")
    return path


def test_what_is_written_is_read_and_never_written_over(tmp_path):
    path = tmp_path / "corrections.csv"
    write_corrections(path, GUESSES)
    said = read_corrections(path, crops=6, clusters=3)
    assert said.clusters == GUESSES
    assert said.crops == {}
    with pytest.raises(FileExistsError):
        write_corrections(path, GUESSES)


def test_a_front_is_brought_back_to_the_crop_as_it_was_cut(tmp_path):
    path = table(tmp_path, "cluster,0,right", "cluster,1,left", "cluster,2,?")
    known, right = fronts(CLUSTERS, read_corrections(path, 6, 3))
    assert known.tolist() == [0, 1, 2, 3, 4]
    # crop 1 was turned to face right, crop 4 to face left
    assert right.tolist() == [True, False, True, False, True]


def test_a_crop_s_own_row_counts_before_its_cluster_s(tmp_path):
    path = table(tmp_path, "cluster,0,right", "Cluster,1, LEFT", "crop,1,left", "crop,2,none", "", "crop,5,right")
    known, right = fronts(CLUSTERS, read_corrections(path, 6, 3))
    assert known.tolist() == [0, 1, 3, 4, 5]
    assert right.tolist() == [True, True, False, True, True]


@pytest.mark.parametrize(
    ("row", "told"),
    [
        ("crop,6,left", "no crop '6'; there are 0 to 5"),
        ("cluster,3,left", "no cluster '3'; there are 0 to 2"),
        ("crop,-1,left", "no crop '-1'"),
        ("crop,2,up", "front is 'up'; write right, left, none or ?"),
        ("sheet,2,left", "must be cluster,<number>,<front> or crop"),
        ("crop,2", "must be cluster"),
    ],
)
def test_a_row_that_cannot_be_understood_is_told_with_its_line(tmp_path, row, told):
    with pytest.raises(LabelError) as caught:
        read_corrections(table(tmp_path, "cluster,0,right", row), 6, 3)
    assert told in str(caught.value)
    assert "line 3" in str(caught.value)


def test_a_table_without_its_first_line_is_refused(tmp_path):
    path = tmp_path / "corrections.csv"
    path.write_text("cluster,0,right\n")
    with pytest.raises(LabelError, match="line 1"):
        read_corrections(path, 6, 3)


def test_sheets_show_crops_facing_one_way_the_doubtful_first(tmp_path):
    images = np.zeros((6, 96, 144, 3), np.uint8)
    for k, turned in enumerate(CLUSTERS.turned):  # red at the end that is right on the sheet
        images[k, :, slice(0, 72) if turned else slice(72, 144)] = (0, 0, 40 * k + 50)
    paths = draw_sheets(tmp_path / "sheets", images, CLUSTERS, GUESSES)
    assert [path.name for path in paths] == ["cluster-00-1.jpg", "cluster-01-1.jpg", "cluster-02-1.jpg"]
    sheet = cv2.imread(str(paths[0]))
    assert sheet.shape[1] == 16 * 96
    cells = [sheet[32 : 32 + 64, 96 * k : 96 * (k + 1), 2] for k in range(3)]
    reds = [cell[30:60, 60:90].mean() for cell in cells]
    np.testing.assert_allclose(reds, [130.0, 90.0, 50.0], atol=6.0)  # crops 2, 1, 0
    assert all(cell[30:60, 6:36].mean() < 10.0 for cell in cells)


def test_a_large_cluster_fills_several_sheets(tmp_path):
    n = 200
    many = Clusters(number=np.zeros(n, int), turned=np.zeros(n, bool), sure=np.linspace(0, 1, n))
    assert len(draw_sheets(tmp_path, np.zeros((n, 96, 144, 3), np.uint8), many, {0: "right"})) == 2
