import math

import numpy as np
import pytest

from gcs.errors import ScoreError
from gcs.report.score import Matched, score, score_files

TRUTH = "frame,cx,cy,w,h,angle,system_id\n"
SAID = "time_us,frame,track_id,system_id,confidence,cx,cy,w,h,angle,heading,lat,lon\n"


def matched(rows):
    """(frame, truth, named, track, confidence) rows, ten frames a second."""
    a = np.array(rows, dtype=float)
    frame, truth, named, track = (a[:, k].astype(np.int64) for k in range(4))
    return Matched(frame=frame, time_us=frame * 100_000.0, truth=truth, named=named, track=track, confidence=a[:, 4])


def files(tmp_path, truth, said):
    (tmp_path / "truth.csv").write_text(TRUTH + truth)
    (tmp_path / "identity.csv").write_text(SAID + said)
    return tmp_path / "truth.csv", tmp_path / "identity.csv"


def test_every_share_by_hand():
    result = score(
        matched(
            [
                (0, 2, 2, 1, 0.9),  # right
                (0, 3, 2, 2, 0.8),  # wrong
                (0, 0, 0, 3, 0.9),  # false target left out
                (1, 2, 0, 1, 0.5),  # ours, unnamed
                (1, 3, 3, 2, 0.9),  # right, and the name changed
                (1, 0, 4, 3, 0.95),  # false target named, and surely
                (1, -1, 0, 4, 0.9),  # a box over nothing, left out
                (1, 4, -1, 0, np.nan),  # ours, not in the log
            ]
        )
    )
    assert result.precision == pytest.approx(2 / 4)
    assert result.coverage == pytest.approx(3 / 5)
    assert result.right == pytest.approx(2 / 5)
    assert result.fper == pytest.approx(2 / 3)
    assert result.switches == 1
    assert result.idf1 == pytest.approx(2 * 2 / (5 + 4))
    assert result.wrong_sure_s == pytest.approx(0.1)
    # Confidences .9 .9 .95 hold two right of three, .8 none of one: |2.75 - 2| + |0.8 - 0| over 4.
    assert result.ece == pytest.approx((0.75 + 0.8) / 4)
    # with what has no name: .9 and more four right of five, .8 none of one, .5 (ours) none of one
    assert result.ece_all == pytest.approx((4.55 - 4 + 0.8 + 0.5) / 7)


def test_boxes_of_ours_that_were_surely_called_strangers():
    result = score(matched([(k, truth, 0, 1, sure) for k, (truth, sure) in enumerate([(2, 0.95), (2, 0.8), (0, 1.0)])]))
    assert result.false_strangers == pytest.approx(1 / 2)


def test_frames_that_the_log_lacks_are_told():
    rows = [(0, 2, 2, 1, 0.9), (1, 2, -1, 0, np.nan), (1, 3, -1, 0, np.nan), (2, 2, 0, 1, 0.5), (2, 3, -1, 0, np.nan)]
    result = score(matched(rows))
    assert (result.frames, result.frames_unlogged) == (3, 1)


def test_track_idf1_pairs_whole_tracks():
    # Vehicle 2 is track 1 for three frames and track 2 for one: 3 in common, 4 true, 4 tracked.
    result = score(matched([(k, 2, 2, 1 if k < 3 else 2, 0.9) for k in range(4)]))
    assert result.track_idf1 == pytest.approx(2 * 3 / 8)


def test_boxes_are_matched_by_place_not_by_order(tmp_path):
    truth, said = files(
        tmp_path,
        "0,100,100,60,30,0,2\n0,400,100,60,30,0,3\n",
        "5,0,1,3,0.99,401,101,60,30,0,,,\n5,0,2,2,0.99,99,99,60,30,0,,,\n5,0,3,4,0.9,900,900,60,30,0,,,\n",
    )
    result = score_files(truth, said)
    assert (result.ours, result.named, result.false_targets) == (2, 3, 1)
    assert result.precision == pytest.approx(2 / 3)


def test_nothing_named_has_no_precision(tmp_path):
    truth, said = files(tmp_path, "0,100,100,60,30,0,2\n", "5,0,1,,0.2,100,100,60,30,0,,,\n")
    result = score_files(truth, said)
    assert math.isnan(result.precision)
    assert result.coverage == 0


def test_recordings_that_do_not_belong_together(tmp_path):
    truth, said = files(tmp_path, "0,100,100,60,30,0,2\n", "5,7,1,2,0.9,100,100,60,30,0,,,\n")
    with pytest.raises(ScoreError, match="no frame in common"):
        score_files(truth, said)
    truth, said = files(tmp_path, "", "")
    with pytest.raises(ScoreError, match="no true box"):
        score_files(truth, said)
