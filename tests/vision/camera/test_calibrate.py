"""A camera that is known exactly, found again from views of a board: OpenCV's projection is the oracle."""

import cv2
import numpy as np
import pytest

from tests.support.films.board_video import BoardCamera, poses
from vision.camera.calibrate import PARAMETERS, calibrate, doubts
from vision.camera.calibrate_views import BLURRED_PX, Board, BoardView, chosen, find_view
from vision.errors import CameraError
from vision.video.video import Frame

SIZE = (1280, 720)
K = np.array([[905.0, 0.0, 655.0], [0.0, 902.0, 349.0], [0.0, 0.0, 1.0]])
LENS = np.array([-0.28, 0.11, 0.0012, -0.0008, -0.02])
TRUE = np.array([905.0, 902.0, 655.5, 349.5, *LENS])
BOARD = Board(columns=9, rows=6, square_m=0.025)
MIDDLE = BOARD.points.mean(axis=0)


def views(n=40, noise_px=0.1, seed=0, **how):
    """Corners as a camera sees them, without images."""
    rng = np.random.default_rng(seed)
    made = []
    for k, (R, t) in enumerate(poses(n, rng, K, LENS, SIZE, **how)):
        uv = cv2.projectPoints(BOARD.points.astype(float), R, t - R @ MIDDLE, K, LENS)[0][:, 0]
        uv += rng.normal(0.0, noise_px, uv.shape)
        made.append(view(k, uv.astype(np.float32)))
    return made


def view(frame, corners, blur_px=1.5, pose=None):
    pose = np.array([frame, 0, 0, 0, 0], dtype=float) if pose is None else np.asarray(pose, dtype=float)
    return BoardView(frame=frame, corners=corners, blur_px=blur_px, pose=pose)


def found(calibration):
    camera = calibration.intrinsics
    return np.array([camera.fx, camera.fy, camera.cx, camera.cy, *camera.distortion])


def test_spread_of_the_parameters_is_the_one_that_opencv_gives():
    calibration = calibrate(views(), BOARD, SIZE)
    corners = [v.corners.reshape(-1, 1, 2) for v in calibration.views]
    std = cv2.calibrateCameraExtended([BOARD.points] * len(corners), corners, SIZE, None, None)[5]
    np.testing.assert_allclose(calibration.std, std.ravel()[: len(PARAMETERS)], rtol=1e-4)


@pytest.mark.slow
def test_spread_of_the_pixels_is_what_many_calibrations_have():
    """The worst pixel of the image, over calibrations that differ by their noise alone."""
    u, v = np.meshgrid(np.linspace(0, SIZE[0], 17), np.linspace(0, SIZE[1], 10))
    ideal = cv2.undistortPoints(np.stack([u, v], axis=-1).reshape(-1, 1, 2) - 0.5, K, LENS)[:, 0]
    rays = np.concatenate([ideal, np.ones((len(ideal), 1))], axis=1)
    exact, rng, pixels, told = views(20, noise_px=0.0), np.random.default_rng(0), [], []
    for _ in range(25):
        noisy = [view(w.frame, w.corners + rng.normal(0, 0.1, (54, 2)).astype(np.float32)) for w in exact]
        calibration = calibrate(noisy, BOARD, SIZE)
        pixels.append(calibration.intrinsics.pixels(rays)[0])
        told.append(calibration.pixel_px)
    assert np.sqrt(np.var(pixels, axis=0).sum(axis=-1)).max() == pytest.approx(np.median(told), rel=0.4)


@pytest.mark.slow_but_first
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_finds_the_camera_within_what_it_says_of_its_own_error(seed):
    calibration = calibrate(views(seed=seed), BOARD, SIZE)
    off = (found(calibration) - TRUE) / calibration.std
    assert np.abs(off).max() < 4.0 and np.sqrt((off**2).mean()) < 2.0, dict(zip(PARAMETERS, off, strict=True))
    assert calibration.rms_px == pytest.approx(0.1 * np.sqrt(2), rel=0.1)
    assert list(doubts(calibration)) == []


def test_disturbed_view_is_left_out():
    good = views()
    bent = view(99, good[7].corners + np.random.default_rng(3).normal(0, 3.0, (54, 2)).astype(np.float32))
    calibration = calibrate([*good, bent], BOARD, SIZE)
    assert 99 not in [v.frame for v in calibration.views]
    assert calibration.rms_px < 0.2


def test_too_few_views_are_refused():
    with pytest.raises(CameraError, match="3 views of a 9x6 board; 12 are needed: film for a minute"):
        calibrate(views(3), BOARD, SIZE)
    (doubt, *_) = doubts(calibrate(views(8), BOARD, SIZE))
    assert doubt.startswith("only ") and "12 are needed" in doubt


@pytest.mark.slow
def test_board_that_was_never_on_one_side_is_refused():
    right = [v for v in views(140) if v.corners[:, 0].min() > 640]
    assert len(right) >= 12
    told = " ".join(doubts(calibrate(right, BOARD, SIZE)))
    assert "60% are needed: hold it also to the" in told and "left" in told


def test_bad_corners_are_refused():
    told = " ".join(doubts(calibrate(views(noise_px=1.2), BOARD, SIZE)))
    assert "px off: glue the board on something flat" in told


def test_boards_that_were_never_tilted_are_refused():
    told = " ".join(doubts(calibrate(views(14, noise_px=0.4, tilt=0.002), BOARD, SIZE)))
    assert "the focal length is unsure: tilt the board" in told


def test_views_that_differ_are_chosen_and_the_sharper_of_two_alike():
    corners = np.zeros((54, 2), np.float32)
    place = np.random.default_rng(0).uniform(0, 1, (30, 5))
    once = [view(k, corners, 2.0, place[k]) for k in range(30)]
    again = [view(100 + k, corners, 1.0, place[k] + 0.001) for k in range(30)]
    kept = chosen([*once, *again], 60)
    assert [v.frame for v in kept] == list(range(100, 130))
    few = chosen(once, 10)
    apart = [np.linalg.norm(a.pose - b.pose) for a in few for b in few if a is not b]
    assert 5 <= len(few) <= 10 and min(apart) > 0.3


@pytest.mark.parametrize("bad", [{"columns": 2}, {"rows": 60}, {"square_m": 0.0}, {"square_m": np.nan}])
def test_boards_that_cannot_be_are_refused(bad):
    with pytest.raises(CameraError, match=r"board of|squares of"):
        Board(**{"columns": 9, "rows": 6, "square_m": 0.025, **bad})


def test_corners_in_an_image_are_where_the_camera_shows_them_and_blur_is_seen():
    small = (640, 360)
    camera = BoardCamera(small, K * [[0.5], [0.5], [1.0]], LENS)
    rng = np.random.default_rng(2)
    R, t = poses(1, rng, camera.K, LENS, small)[0]
    image = camera.draw(R, t, rng)
    seen = find_view(Frame(index=3, t_us=0, image=image), BOARD)
    exact = cv2.projectPoints(BOARD.points.astype(float), R, t - R @ MIDDLE, camera.K, LENS)[0][:, 0]
    # a board of an odd and an even side may be found from its other end
    off = min(np.abs(seen.corners - order).max() for order in (exact, exact[::-1]))
    assert seen.frame == 3 and off < 0.3 and seen.blur_px < BLURRED_PX
    shaken = cv2.blur(image, (13, 1))
    blurred = find_view(Frame(index=4, t_us=0, image=shaken), BOARD)
    assert blurred is None or blurred.blur_px > BLURRED_PX
    assert find_view(Frame(index=5, t_us=0, image=np.zeros_like(image)), BOARD) is None
