import cv2
import numpy as np
import pytest

from bench.annotated.films import find_films
from bench.annotated.fronts import turned_fronts
from bench.annotated.linking import fill_in, link
from bench.annotated.made_films import make_films
from bench.annotated.table import measure_films, text_of_films
from gcs.annotated_film import FilmOptions, session_from_film
from gcs.errors import GcsError
from gcs.session.tables import Table
from sim.annotated.layouts import read_tracks
from vision.evaluation import open_folder

SPEEDS_PX = ((0.0, 0.0), (14.0, 0.0), (-11.0, 3.0))
"""Of three vehicles, from one picture to the next."""


@pytest.fixture(scope="module")
def pictures(tmp_path_factory):
    """Six pictures of ground that slides by, with three vehicles, and YOLO labels in another order each time."""
    folder = tmp_path_factory.mktemp("pictures")
    rng = np.random.default_rng(3)
    ground = cv2.resize(rng.integers(60, 200, (60, 90, 3), dtype=np.uint8), (720, 480), interpolation=cv2.INTER_CUBIC)
    for index in range(6):
        image = np.roll(ground, (2 * index, -3 * index), axis=(0, 1))[:300, :500].copy()
        rows = []
        for k in rng.permutation(3).tolist():
            x, y = np.array([120.0 + 90 * k, 80.0 + 60 * k]) + index * np.add(SPEEDS_PX[k], (-3.0, 2.0))
            cv2.rectangle(image, (int(x) - 15, int(y) - 7), (int(x) + 15, int(y) + 7), (30 + 60 * k, 40, 40), -1)
            rows.append(f"0 {x / 500} {y / 300} {30 / 500} {14 / 300}")
        cv2.imwrite(str(folder / f"MOS{index + 7}.png"), image)
        (folder / f"MOS{index + 7}.txt").write_text("\n".join(rows) + "\n")
    return folder


def test_labels_of_pictures_in_a_row_are_linked(pictures):
    images = sorted(open_folder(pictures).images, key=lambda image: int(image.name[3:-4]))
    linked = link(images)
    assert len(linked) == 6
    tracks = {}
    for picture in linked:
        for track, box in zip(picture.track.tolist(), picture.boxes, strict=True):
            tracks.setdefault(track, []).append(box[:2])
    assert [len(places) for places in tracks.values()] == [6, 6, 6]
    moved = sorted(tuple(np.round(places[-1] - places[0]).tolist()) for places in tracks.values())
    assert moved == sorted((5 * (dx - 3.0), 5 * (dy + 2.0)) for dx, dy in SPEEDS_PX)


def test_pictures_in_between_have_the_vehicles_where_they_are_labelled(pictures):
    linked = link(sorted(open_folder(pictures).images, key=lambda image: int(image.name[3:-4])))
    filled = fill_in(linked, 4)
    assert len(filled) == 21
    np.testing.assert_array_equal(filled[4].image, linked[1].image)
    halfway = filled[10]
    for k, (x, y) in zip(halfway.track.tolist(), halfway.boxes[:, :2], strict=True):
        ends = [p.boxes[p.track == k][0, :2] for p in (linked[2], linked[3])]
        np.testing.assert_allclose((x, y), np.mean(ends, axis=0), atol=0.7)
        # vehicles are drawn in a flat colour that the ground has nowhere, with little green and red
        assert halfway.image[int(y), int(x), 1:].max() < 60
        assert filled[10].image[int(y), int(x) - 30, 1:].max() >= 60


def test_films_are_made_found_and_measured(pictures, tmp_path):
    assert make_films(pictures, tmp_path / "films", 2.0) == ["MOS7", "MOS7-filled"]
    (tmp_path / "films" / "MOS7.toml").write_text('team = 2\nerrors = "hard"\npitch_deg = -90\n')
    film, filled = find_films(tmp_path / "films")
    assert (filled.name, filled.options) == ("MOS7-filled", FilmOptions())
    assert film.options == FilmOptions(team=2, errors="hard", pitch_deg=-90.0)
    (row,), failed = measure_films([film], ("labels",))
    assert not failed
    assert (row.frames, row.vehicles, row.team, row.recall, row.box_precision) == (6, 3, 2, 100.0, 100.0)
    # in six pictures motion tells no front yet
    assert row.fronts == 0
    assert np.isnan(row.turned)
    text = text_of_films([row], ["other: no label"], "Films")
    assert "| MOS7" in text
    assert "| 0 | – |" in text
    assert "- not used: other: no label" in text


def test_fronts_of_vehicles_that_drive_are_held_against_their_way(pictures, tmp_path):
    make_films(pictures, tmp_path, 2.0)
    path, video = tmp_path / "MOS7-filled.csv", tmp_path / "MOS7-filled.mp4"
    made = session_from_film(path, video, tmp_path / "session", FilmOptions(pitch_deg=-90.0)).film
    labels = read_tracks(path)
    way = np.zeros(len(labels))
    for vehicle in made.labelled:
        own = labels.track == vehicle.track
        over_ground = labels.centre[own][-1] - labels.centre[own][0] - 5 * np.array([-3.0, 2.0])
        # clockwise from image up
        way[own] = np.arctan2(over_ground[0], -over_ground[1])
    cx, cy, w, h, angle = labels.boxes().T
    boxes = {"frame": labels.frame, "track_id": labels.track + 10, "cx": cx, "cy": cy, "w": w, "h": h, "angle": angle}
    unknown = np.full(len(labels), np.nan)
    logged = {**boxes, "time_us": 1e5 * labels.frame, "system_id": unknown, "confidence": unknown}
    for heading, turned in ((way + 0.5, False), (way + 0.5 + np.pi, True)):
        found = turned_fronts(
            labels, made.labelled, made.world, Table(columns={**logged, "heading": heading}, skipped=0)
        )
        # one of the three drives two lengths, 60 px, in the last pictures
        assert 1 <= len(found) <= 8
        assert (found == turned).all()
    assert not len(
        turned_fronts(labels, made.labelled, made.world, Table(columns={**logged, "heading": unknown}, skipped=0))
    )


def test_a_film_over_one_picture(pictures, tmp_path):
    alone = tmp_path / "alone"
    alone.mkdir()
    for suffix in (".png", ".txt"):
        (alone / f"street{suffix}").write_bytes((pictures / f"MOS7{suffix}").read_bytes())
    assert make_films(alone, tmp_path / "films") == ["street-pan"]
    tracks = read_tracks(tmp_path / "films" / "street-pan.csv")
    assert set(tracks.track.tolist()) == {0, 1, 2}
    away = np.ptp(tracks.centre[tracks.track == 1], axis=0)
    assert away.min() > 5.0


def test_films_of_the_data_sets_are_found(tmp_path):
    for name in (
        "A/img1/1.jpg",
        "A/gt/gt.txt",
        "GT/M1_gt.txt",
        "GT/M1_gt_whole.txt",
        "GT/M1_gt_ignore.txt",
        "M1/1.jpg",
    ):
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.touch()
    for name in ("annotations/uav1.txt", "sequences/uav1/0000001.jpg", "drift.csv", "drift.mp4", "notes.txt"):
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.touch()
    found = {film.name: (film.labels.name, film.video.name) for film in find_films(tmp_path)}
    assert found == {
        "A": ("gt.txt", "img1"),
        "M1": ("M1_gt_whole.txt", "M1"),
        "uav1": ("uav1.txt", "uav1"),
        "drift": ("drift.csv", "drift.mp4"),
    }
    with pytest.raises(GcsError, match="no film with labels"):
        find_films(tmp_path / "GT")
    (tmp_path / "drift.toml").write_text("hight_m = 250\n")
    with pytest.raises(GcsError, match="height_m"):
        find_films(tmp_path)
