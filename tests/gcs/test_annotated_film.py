import json
import tomllib

import av
import cv2
import numpy as np
import pytest

from gcs.annotated_film import FilmOptions, NumberedImages, session_from_film
from gcs.errors import GcsError
from gcs.report.score import score_files
from sim.render.film import Film, write_video
from tests.support.command_line import run_gcs
from tests.support.films.annotated import FILMED, FOV_DEG, SUFFIXES, film_of, ground_errors, labels_of


@pytest.fixture(scope="module")
def filmed(tmp_path_factory):
    """A folder with a film, and its labels in every layout."""
    folder = tmp_path_factory.mktemp("film")
    world, times = film_of(FILMED)
    write_video(world, times, folder / "film.mp4")
    for layout, name in SUFFIXES.items():
        (folder / name).write_text(labels_of(world, layout))
    return folder


@pytest.mark.slow
def test_ground_positions_by_the_pixels(filmed, tmp_path):
    options = FilmOptions(height_m=45.0, fov_deg=FOV_DEG, pitch_deg=-90.0, team=4)
    made = session_from_film(filmed / "tracks.csv", filmed / "film.mp4", tmp_path / "session", options)
    world, times = film_of(FILMED)
    assert np.median(ground_errors(world, made.film, times)) < 0.5
    assert "49 of 49 steps" in dict(made.lines)["motion"]
    assert tomllib.loads((tmp_path / "session" / "film.toml").read_text()) == dict(made.lines)


@pytest.mark.slow_but_first
@pytest.mark.parametrize(("layout", "errors", "right"), [("csv", "standard", 0.95), ("visdrone", "hard", 0.80)])
def test_labels_are_named_on_the_command_line(filmed, layout, errors, right, tmp_path):
    session, out = tmp_path / "session", tmp_path / "out"
    words = ("--video", filmed / "film.mp4", "-o", session, "--team", 4, "--errors", errors, "--boxes", "labels")
    code, told, _ = run_gcs("sim", "from-tracks", filmed / SUFFIXES[layout], *words, "--json")
    assert code == 0
    assert json.loads(told)["labels"].endswith(f"read as {layout}")
    assert run_gcs("identify", session, "-o", out)[0] == 0
    result = score_files(session / "truth.csv", out / "identity.csv")
    assert result.precision >= 0.95
    # with hard errors the first of the ten seconds pass without names
    assert result.right >= right
    assert result.false_targets > 0
    assert result.fper >= 0.95


@pytest.mark.slow
def test_numbered_images_in_their_order(tmp_path):
    folder = tmp_path / "img1"
    folder.mkdir()
    world, times = film_of(FILMED)
    film = Film(world)
    for index, now in enumerate(times[:3].tolist()):
        odd = cv2.copyMakeBorder(film.image(now, index), 0, 1, 0, 0, cv2.BORDER_REPLICATE)
        cv2.imwrite(str(folder / f"frame_{index + 9}.png"), odd)
    (tmp_path / "gt").mkdir()
    (tmp_path / "gt" / "gt.txt").write_text(labels_of(world, "mot"))
    (tmp_path / "seqinfo.ini").write_text("[Sequence]\nname=x\nframeRate=5\n")
    made = session_from_film(tmp_path / "gt" / "gt.txt", folder, tmp_path / "session", FilmOptions(team=2))
    lines = dict(made.lines)
    assert lines["film"] == "3 images of 640×360 px, 0.4 s, 5 a second by seqinfo.ini"
    assert "after the film's last image" in lines["left_out"]
    with av.open(str(tmp_path / "session" / "video.mp4")) as video:
        images = [frame.to_ndarray(format="bgr24") for frame in video.decode(video=0)]
    assert len(images) == 3
    assert np.abs(images[2].astype(float) - film.image(times[2], 2)).mean() < 6.0


def test_an_image_of_another_size(tmp_path):
    for name, size in (("1.png", (64, 64)), ("2.png", (32, 64))):
        cv2.imwrite(str(tmp_path / name), np.zeros((*size, 3), np.uint8))
    with pytest.raises(GcsError, match=r"2\.png: not an image of 64×64"):
        list(NumberedImages(tmp_path, 5.0).images())


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("none.txt", "--video", "film.mp4"), "none.txt: cannot be read"),
        (("gt.txt", "--video", "gt.txt"), "not a video file"),
        (("gt.txt", "--video", "film.mp4", "--fps", "5"), "leave --fps out"),
        (("gt.txt", "--video", "film.mp4", "--duration", "0.5", "--vehicle", "77"), "vehicle 77"),
        (("tracks.csv", "--video", "film.mp4", "--layout", "mot"), "is --layout right?"),
    ],
)
def test_what_cannot_be_used_is_said(filmed, words, told, tmp_path, monkeypatch):
    monkeypatch.chdir(filmed)
    code, _, err = run_gcs("sim", "from-tracks", *words, "-o", tmp_path / "out")
    assert code == 2
    assert told in err
    assert not (tmp_path / "out").exists()


def test_labels_of_another_film_are_doubted(filmed, tmp_path):
    left, right = tmp_path / "gt.txt", "".join(f"{frame},9,{700 - 20 * frame},5,40,20,1\n" for frame in range(1, 10))
    left.write_text(right)
    made = session_from_film(left, filmed / "film.mp4", tmp_path / "session", FilmOptions(static=True))
    assert dict(made.lines)["doubts"].startswith("3 labels lie outside the image")
    hidden = tmp_path / "M0101_gt_whole.txt"
    hidden.write_text("1,9,70,5,40,20,1,4,1\n")
    with pytest.raises(GcsError, match="every vehicle is mostly hidden"):
        session_from_film(hidden, filmed / "film.mp4", tmp_path / "other", FilmOptions())


def test_nothing_is_overwritten(filmed, tmp_path):
    with pytest.raises(GcsError, match="exists already"):
        session_from_film(filmed / "gt.txt", filmed / "film.mp4", tmp_path, FilmOptions())
