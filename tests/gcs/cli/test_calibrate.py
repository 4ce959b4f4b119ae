"""``gcs calibrate`` on a coded video of a board before a known camera."""

import sys

import cv2
import numpy as np
import pytest

from gcs.cli.app import main
from gcs.mission.mission import load_mission
from tests.support.bundled import CURVED_ROAD
from tests.support.films.board_video import BoardCamera, poses, write_video
from vision.camera.lens_file import read_lens

SIZE = (640, 360)
K = np.array([[452.4, 0.0, 327.4], [0.0, 451.0, 174.4], [0.0, 0.0, 1.0]])
LENS = np.array([-0.28, 0.11, 0.0012, -0.0008, -0.02])
VIEWS = 36


@pytest.fixture(scope="module")
def video(tmp_path_factory):
    path = tmp_path_factory.mktemp("board") / "board.mp4"
    camera, rng = BoardCamera(SIZE, K, LENS), np.random.default_rng(4)
    write_video(path, (camera.draw(R, t, rng) for R, t in poses(VIEWS, rng, K, LENS, SIZE)), SIZE)
    return path


def run(monkeypatch, *words):
    """Exit code of the command, 0 when it returns."""
    monkeypatch.setattr(sys, "argv", ["gcs", "calibrate", *map(str, words)])
    with pytest.raises(SystemExit) as ended:
        main()
    return ended.value.code or 0


@pytest.mark.slow
def test_camera_is_found_from_its_video_and_serves_a_mission(video, tmp_path, monkeypatch, capsys):
    out = tmp_path / "lens.toml"
    assert run(monkeypatch, video, "--board", "9x6", "--square", "0.025", "-o", out) == 0
    said = capsys.readouterr()
    assert "views of 640×360" in said.out and "board seen in" in said.out and "±" in said.out
    assert f"wrote {out}" in said.err
    lens = read_lens(out)
    assert lens.fx == pytest.approx(K[0, 0], rel=0.005) and lens.fy == pytest.approx(K[1, 1], rel=0.005)
    assert (lens.cx, lens.cy) == pytest.approx((K[0, 2] + 0.5, K[1, 2] + 0.5), abs=3.0)
    # every ray of the true camera comes out where it went in
    u, v = np.meshgrid(np.linspace(0, SIZE[0], 33), np.linspace(0, SIZE[1], 19))
    shown = np.stack([u, v], axis=-1).reshape(-1, 1, 2)
    criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 100, 1e-12)
    ideal = cv2.undistortPoints(shown - 0.5, K, LENS, criteria=criteria)[:, 0]
    again, seen = lens.pixels(np.concatenate([ideal, np.ones((len(ideal), 1))], axis=1))
    assert seen.all()
    assert np.linalg.norm(again - shown[:, 0], axis=1).max() < 0.5

    mission = tmp_path / "m.toml"
    mission.write_text('[uav]\nsystem_id = 1\n[[ugv]]\nsystem_id = 2\n[camera]\nlens = "lens.toml"\n')
    assert load_mission(mission).camera.fx == lens.fx

    before = out.read_bytes()
    assert run(monkeypatch, video, "-o", out) == 2
    assert "exists already and is not overwritten" in capsys.readouterr().err
    assert out.read_bytes() == before


@pytest.mark.slow
def test_too_short_a_video_or_another_board_writes_nothing(tmp_path, monkeypatch, capsys):
    camera, rng = BoardCamera(SIZE, K, LENS), np.random.default_rng(1)
    path = tmp_path / "short.mp4"
    write_video(path, [camera.draw(R, t, rng) for R, t in poses(6, rng, K, LENS, SIZE)], SIZE)
    assert run(monkeypatch, path, "-o", tmp_path / "lens.toml") == 2
    assert "lens.toml is not written: only " in capsys.readouterr().err
    assert run(monkeypatch, path, "--board", "12x9", "-o", tmp_path / "lens.toml") == 2
    assert "0 views of a 12x9 board; 12 are needed" in capsys.readouterr().err
    assert not (tmp_path / "lens.toml").exists()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--board", "nine"), "write it as 9x6"),
        (("--board", "1x9"), "3 to 50 each way"),
        (("--square", "0"), "give the side of one square"),
        (("-o", "absent/lens.toml"), "the folder does not exist"),
    ],
)
def test_what_cannot_be_asked(tmp_path, monkeypatch, capsys, words, message):
    monkeypatch.chdir(tmp_path)
    assert run(monkeypatch, CURVED_ROAD / "video.mp4", "-o", "lens.toml", *words) == 2
    assert message in capsys.readouterr().err


def test_what_is_no_video(tmp_path, monkeypatch, capsys):
    (tmp_path / "a.mp4").write_text("no")
    assert run(monkeypatch, tmp_path / "a.mp4", "-o", tmp_path / "lens.toml") == 2
    assert "a.mp4" in capsys.readouterr().err
