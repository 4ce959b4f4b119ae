import numpy as np
import pytest

from sim.annotated.layouts import LAYOUTS, read_tracks
from sim.annotated.session import read_attributes
from sim.errors import AnnotationError
from tests.support.films.annotated import FILMED, SUFFIXES, film_of, labels_of

VISDRONE = """\
1,0,593,743,176,106,1,4,0,0
1,1,10,10,20,30,1,1,0,0
1,2,10,10,20,30,0,0,0,0
2,0,595,744,176,106,1,4,0,2
2,0,595,744,176,106,1,4,0,0
three,0,595,744,176,106,1,4,0,0
2,7,595,744,0,106,1,9,0,0
0,8,595,744,10,106,1,9,0,0
2,9,nan,744,10,106,1,9,0,0
2,99999999999999999999,595,744,10,106,1,9,0,0
1e40,9,595,744,10,106,1,9,0,0
"""


def written(path, text):
    path.write_text(text)
    return path


@pytest.mark.slow_but_first
@pytest.mark.parametrize("layout", LAYOUTS)
def test_every_layout_is_told_and_read(layout, tmp_path):
    world, _ = film_of(FILMED)
    told = read_tracks(written(tmp_path / SUFFIXES[layout], labels_of(world, layout)))
    csv = read_tracks(written(tmp_path / "all.csv", labels_of(world, "csv")))
    assert told.layout == layout
    assert told.frame.tolist() == csv.frame.tolist()
    assert told.track.tolist() == csv.track.tolist()
    assert set(told.kind.tolist()) == ({"vehicle"} if layout == "mot" else {"car"})
    np.testing.assert_allclose(told.centre, csv.centre, atol=0.05)


def test_rows_that_are_not_used_are_counted(tmp_path):
    tracks = read_tracks(written(tmp_path / "uav.txt", VISDRONE))
    assert tracks.layout == "visdrone"
    assert tracks.frame.tolist() == [0, 1]
    assert tracks.hidden.tolist() == [False, True]
    assert tracks.left_out == {
        "not a vehicle": 1,
        "marked as not to be considered": 1,
        "a second label of the same vehicle in a frame": 1,
        "unreadable": 4,
        "without width or height": 1,
        "before the film's first image": 1,
    }


def test_tables_of_drift(tmp_path):
    head = "track_id,frame,center_x,center_y,width,height,angle,x1,y1,x2,y2,x3,y3,x4,y4,confidence,class_id"
    text = f"{head}\n3.0,0,15,10,20,10,0.0,25,15,25,5,5,5,5,15,0.93,0\n"
    tracks = read_tracks(written(tmp_path / "drone_1.csv", text))
    assert (tracks.layout, tracks.track.tolist(), tracks.kind.tolist()) == ("csv", [3], ["bus"])
    np.testing.assert_allclose(np.abs(tracks.boxes()), [[15.0, 10.0, 20.0, 10.0, np.pi]])


@pytest.mark.parametrize(
    ("text", "kinds"),
    [
        ("1,1,5,5,9,9,1\n", ["vehicle"]),  # a tracker's, seven columns
        ("1,1,5,5,9,9,1,-1,-1,-1\n", ["vehicle"]),  # MOT15, ten columns
        ("1,1,5,5,9,9,1,1,0.9\n", ["vehicle"]),  # one class alone is ours, whatever its number
        ("1,1,5,5,9,9,1,1,0.9\n1,2,5,5,9,9,1,3,0.9\n", ["car"]),  # MOT16: 1 persons, 3 cars
    ],
)
def test_columns_of_mot(text, kinds, tmp_path):
    assert read_tracks(written(tmp_path / "gt.txt", text)).kind.tolist() == kinds


def test_names_of_classes_beside_mot_labels(tmp_path):
    (tmp_path / "labels.txt").write_text("pedestrian\nLorry\n")
    tracks = read_tracks(written(tmp_path / "gt.txt", "1,1,5,5,9,9,1,1,1.0\n1,2,5,5,9,9,1,2,0.1\n"))
    assert (tracks.kind.tolist(), tracks.hidden.tolist()) == (["truck"], [True])


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("", "no label"),
        ("hello\n", "none of csv, mot"),
        ("frame,id,x1\n1,2,3\n", "no column y1"),
        ("1,-1,5,5,9,9,0.8,-1,-1,-1\n", "1 without a track"),
    ],
)
def test_a_file_that_cannot_be_used(text, told, tmp_path):
    with pytest.raises(AnnotationError, match=told):
        read_tracks(written(tmp_path / "labels.txt", text))
    with pytest.raises(AnnotationError, match="cannot be read"):
        read_tracks(tmp_path / "nothing.txt")


def test_first_frame(tmp_path):
    path = written(tmp_path / "gt.txt", "7,1,5,5,9,9,1\n8,1,5,5,9,9,1\n")
    assert read_tracks(path, first_frame=7).frame.tolist() == [0, 1]


def test_attributes_of_uavdt(tmp_path):
    (tmp_path / "M_attr" / "train").mkdir(parents=True)
    (tmp_path / "M_attr" / "train" / "M0101_attr.txt").write_text("1,0,0,0,1,0,0,0,1,0\n")
    (tmp_path / "GT").mkdir()
    assert read_attributes(tmp_path / "GT" / "M0101_gt_whole.txt") == ("daylight", "medium-alt", "bird-view")
    assert read_attributes(tmp_path / "GT" / "M0102_gt.txt") == ()
