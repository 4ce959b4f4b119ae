"""Parts of frames that were looked at, written and read again: a replay knows what a flight did not see."""

from dataclasses import replace

import numpy as np
import pytest

from gcs.session.frame_tables import look_rows, read_detections
from infra.session_format import DETECTIONS, LOOKS
from tests.support.snapshots import boxes


@pytest.mark.parametrize(
    "parts", [None, np.zeros((0, 4)), np.array([[0.0, 0.0, 1.0 / 3.0, 8.0], [5.0, 5.0, 9.0, 9.0]])]
)
def test_what_was_looked_at_is_read_as_it_was_written(parts, tmp_path):
    frames = [replace(boxes(np.zeros((0, 2))), looked=looked) for looked in (parts, None, parts)]
    (tmp_path / DETECTIONS.name).write_text(DETECTIONS.header)
    (tmp_path / LOOKS.name).write_text(LOOKS.header + "".join(look_rows(k, now) for k, now in enumerate(frames)))
    again = read_detections(tmp_path / DETECTIONS.name)
    places = [(0.0, 0.0), (0.2, 7.0), (7.0, 7.0), (20.0, 20.0)]
    for k, now in enumerate(frames):
        assert again.at(k).looked_at(places).tolist() == now.looked_at(places).tolist()
        assert again.at(k).looked_share((10, 10)) == now.looked_share((10, 10))
        assert (again.at(k).looked is None) == (now.looked is None)


def test_rows_that_cannot_be_used_are_counted_by_table(tmp_path):
    (tmp_path / DETECTIONS.name).write_text(DETECTIONS.header)
    (tmp_path / LOOKS.name).write_text(LOOKS.header + "0,a,1,2,3\n0,1,1,2,2\n")
    seen = read_detections(tmp_path / DETECTIONS.name)
    assert (seen.skipped, seen.looks_skipped) == (0, 1)
