"""MOTChallenge's folders: what TrackEval reads, and the figures that it gave (bench/results/interop/mot.md)."""

from configparser import ConfigParser
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import linear_sum_assignment

from gcs.errors import SessionError
from gcs.export.formats import FORMATS
from gcs.export.job import ExportJob
from tests.support.bundled import SWARM, shortened
from tests.support.command_line import run_gcs
from tests.support.snapshots import box, snapshot

GT, TRACKERS = "gt/rollcall-all", "trackers/rollcall-all"


def idf1(truth, found):
    """Ristani et al. 2016: each id paired with the one that it shares most boxes with, at IoU 0.5 of upright boxes."""
    shared = {}
    for frame in np.unique(truth[:, 0]):
        true, ours = (rows[rows[:, 0] == frame] for rows in (truth, found))
        for one in true:
            for other in ours:
                low, high = np.maximum(one[2:4], other[2:4]), np.minimum(one[2:4] + one[4:6], other[2:4] + other[4:6])
                both = np.prod(np.maximum(high - low, 0.0))
                if both / (one[4] * one[5] + other[4] * other[5] - both) >= 0.5:
                    shared[one[1], other[1]] = shared.get((one[1], other[1]), 0) + 1
    table = np.array([[shared.get((a, b), 0) for b in np.unique(found[:, 1])] for a in np.unique(truth[:, 1])])
    return 200.0 * table[linear_sum_assignment(-table)].sum() / (len(truth) + len(found))


def exported(path, snapshots, **job):
    sink = FORMATS["mot"].open(ExportJob(path=path, name="a b", **job))
    for each in snapshots:
        sink.write(each)
    sink.close()
    return path


def rows(path):
    return np.loadtxt(path, delimiter=",", ndmin=2)


@pytest.mark.slow
def test_ids_are_those_that_trackeval_found(tmp_path):
    flight = shortened(SWARM, tmp_path / "short-swarm", 150)
    code, _, err = run_gcs("export", flight, "-f", "mot", "-o", tmp_path / "mot")
    assert code == 0, err
    truth = rows(tmp_path / "mot" / GT / "short-swarm/gt/gt.txt")
    assert set(truth[:, 1]) == {2, 3, 4, 5, 6, 7}
    trackers = [rows(tmp_path / "mot" / TRACKERS / name / "data/short-swarm.txt") for name in ("names", "tracks")]
    assert [round(idf1(truth, found), 2) for found in trackers] == [99.63, 88.15]  # bench/results/interop/mot.md
    info = ConfigParser()
    info.read(tmp_path / "mot" / GT / "short-swarm/seqinfo.ini")
    about = info["Sequence"]
    assert (about["seqLength"], about["frameRate"], about["imWidth"], about["imHeight"]) == (
        "150",
        "10",
        "1920",
        "1080",
    )
    assert (tmp_path / "mot/gt/seqmaps/rollcall-all.txt").read_text() == "name\nshort-swarm\n"
    code, _, err = run_gcs("export", flight, "-f", "mot", "-o", tmp_path / "mot")
    assert code
    assert "exists already" in err


def test_strangers_and_boxes_that_were_not_seen_have_no_name(tmp_path):
    boxes = [box(1, 2), box(2, 0), box(3, 3, coasting=True), box(0, 0), replace(box(4, 3), confidence=float("nan"))]
    out = exported(tmp_path / "out", [snapshot(4, boxes=boxes), snapshot(9)])
    names, tracks = (rows(out / TRACKERS / name / "data/a-b.txt") for name in ("names", "tracks"))
    assert names[:, [0, 1, 6]].tolist() == [[1, 2, 0.98], [1, 3, -1]]
    assert tracks[:, [0, 1, 6]].tolist() == [[1, 1, 0.9], [1, 2, 0.9], [1, 4, 0.9]]
    assert (out / "vehicles.csv").read_text() == "id,name\n2,Alpha\n3,UGV-3\n"
    assert not (out / GT / "a-b/gt").exists()


def test_the_truth_is_that_of_the_exported_frames_and_of_our_vehicles(tmp_path):
    truth = tmp_path / "truth.csv"
    truth.write_text("frame,cx,cy,w,h,angle,system_id\n3,10,10,4,2,0,2\n4,20,20,4,2,0,0\n4,30,30,4,2,0,3\n5,x\n")
    told = []
    out = exported(tmp_path / "out", [snapshot(2), snapshot(4)], truth=truth, note=told.append)
    assert (out / GT / "a-b/gt/gt.txt").read_text() == "2,3,28.00,29.00,4.00,2.00,1,1,1\n"
    assert told == ["1 rows of the truth could not be used"]


def test_an_id_stands_once_in_a_frame(tmp_path):
    told = []
    shown = snapshot(boxes=[box(1, 2), box(2, 2)])
    out = exported(tmp_path / "out", [shown, replace(shown, seen_us=1)], note=told.append)
    assert rows(out / TRACKERS / "names/data/a-b.txt")[:, :2].tolist() == [[1, 2]]
    assert len(told) == 1


def test_what_breaks_off_leaves_nothing_and_nothing_is_overwritten(tmp_path):
    sink = FORMATS["mot"].open(ExportJob(path=tmp_path / "out"))
    sink.write(snapshot(boxes=[box(1, 2)]))
    (tmp_path / "out").mkdir()
    with pytest.raises(SessionError, match="exists already"):
        sink.close()
    del sink
    assert list(tmp_path.rglob("*")) == [tmp_path / "out"]
