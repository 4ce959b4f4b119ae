"""Camera motion from rendered images: against the true cameras, with vehicles, cuts and text drawn on the image."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sim.render.exposure import Exposure
from sim.render.ground import GroundStyle
from sim.render.render import Renderer, Style
from sim.world.view import OTHER_VEHICLE, Bodies, CameraView, Road, Scene, project, ray_ground
from tests.support.snapshots import boxes
from vision.camera.intrinsics import Intrinsics
from vision.motion.estimator import MotionEstimator
from vision.motion.plane_fit import mapped
from vision.motion.rotation import GroundShift, rotation_of

WIDTH, HEIGHT, FOCAL = 960, 540, 600.0
INTRINSICS = Intrinsics(width=WIDTH, height=HEIGHT, fx=FOCAL, fy=FOCAL, cx=WIDTH / 2, cy=HEIGHT / 2)
STEPS = np.linspace(-90.0, 90.0, 181)
ROADS = (
    Road(centre=np.stack([STEPS, 6 * np.sin(STEPS / 30)], axis=1), width=7.0, lanes=2),
    Road(centre=np.stack([20 + STEPS / 30, STEPS], axis=1), width=5.0, lanes=1),
)


def camera(turn_deg=(0.0, 0.0, 0.0), at=(0.0, 0.0, 40.0), pitch_deg=-90.0):
    """A camera that looks north and down, turned by a rotation vector about its own axes."""
    down = np.deg2rad(-pitch_deg)
    s, c = np.sin(down), np.cos(down)
    level = np.array([[1.0, 0.0, 0.0], [0.0, -s, c], [0.0, -c, -s]])
    return CameraView(
        width=WIDTH,
        height=HEIGHT,
        fx=FOCAL,
        fy=FOCAL,
        cx=WIDTH / 2,
        cy=HEIGHT / 2,
        distortion=np.zeros(5),
        R_enu_cam=level @ Rotation.from_rotvec(np.deg2rad(turn_deg)).as_matrix(),
        p_enu=np.array(at, dtype=float),
    )


def cars(xy, length=4.6, width=2.0):
    xy = np.asarray(xy, dtype=float).reshape(-1, 2)
    n = len(xy)
    return Bodies(
        kind=np.full(n, OTHER_VEHICLE, np.int8),
        x=xy[:, 0],
        y=xy[:, 1],
        heading=np.zeros(n),
        length=np.full(n, length),
        width=np.full(n, width),
        height=np.full(n, 1.5),
        color=np.tile(np.array([40, 40, 220], np.uint8), (n, 1)),
    )


@pytest.fixture(scope="module")
def ground():
    return Renderer(Scene(roads=ROADS), Style(ground=GroundStyle(side_px=2048)), seed=1)


def image(ground, view, index=0, bodies=None, exposure=None):
    return ground.draw(view, cars([]) if bodies is None else bodies, index, exposure)


def motion_of(first, then, found=None):
    estimator = MotionEstimator()
    assert estimator.update(first, found) is None, "there is nothing to compare the first image with"
    return estimator.update(then)


def error_px(motion, before, later):
    """How far the homography is off, px, at most anywhere on the ground in the image."""
    places = np.stack(np.meshgrid(np.linspace(9, 951, 9), np.linspace(9, 531, 6)), axis=-1).reshape(-1, 2)
    true = project(later, ray_ground(before, places))[0]
    return float(np.nanmax(np.linalg.norm(mapped(motion.H, places) - true, axis=1)))


SHAKEN = {
    "still": (camera(), camera()),
    "turned about three axes": (camera(), camera((1.0, 0.5, 2.0))),
    "a rough jump": (camera(), camera((3.0, -2.5, 1.0))),
    "moved and turned": (camera(), camera((0.5, 0.0, -1.0), at=(0.8, -0.5, 40.3))),
    "oblique": (camera(pitch_deg=-30.0), camera((1.5, 0.5, 1.0), at=(0.3, 0.4, 40.0), pitch_deg=-30.0)),
}


@pytest.mark.parametrize("views", SHAKEN.values(), ids=SHAKEN)
def test_the_ground_is_carried_to_where_it_is(ground, views):
    motion = motion_of(image(ground, views[0], 0), image(ground, views[1], 1))
    assert error_px(motion, *views) < 0.5
    assert motion.share > 0.8
    assert motion.inliers > 100
    assert motion.std_px < 0.5


@pytest.mark.parametrize("views", SHAKEN.values(), ids=SHAKEN)
def test_the_turn_is_known_as_well_as_it_is_said_to_be(ground, views):
    before, later = views
    motion = motion_of(image(ground, before, 0), image(ground, later, 1))
    R = before.R_enu_cam
    shift = GroundShift(
        shift=R.T @ (later.p_enu - before.p_enu), shift_std=0.02, down=R.T @ [0.0, 0.0, -1.0], height=before.p_enu[2]
    )
    turn = rotation_of(motion, INTRINSICS, shift)
    true = Rotation.from_matrix(later.R_enu_cam.T @ R).as_rotvec()
    off = turn.vector - true
    assert np.degrees(np.abs(off)).max() < 0.05
    assert off @ np.linalg.solve(turn.cov, off) < 16.3, "chi-square of three, one in a thousand"


def test_a_displacement_that_is_not_known_makes_the_turn_uncertain(ground):
    before, later = camera(), camera((1.0, 0.0, 0.0), at=(0.0, 1.0, 40.0))
    motion = motion_of(image(ground, before, 0), image(ground, later, 1))
    down = np.array([0.0, 0.0, 1.0])
    known, unknown = (
        rotation_of(motion, INTRINSICS, GroundShift(shift=shift, shift_std=std, down=down, height=40.0))
        for shift, std in ((np.array([0.0, -1.0, 0.0]), 0.02), (np.zeros(3), 1.0))
    )
    assert np.degrees(known.vector) == pytest.approx([-1.0, 0.0, 0.0], abs=0.05)
    sure, unsure = (np.degrees(np.sqrt(np.diag(turn.cov))) for turn in (known, unknown))
    assert unsure[0] > 1.2 * sure[0], "a displacement along the image looks nearly like a turn about the other axis"
    assert unsure[2] == pytest.approx(sure[2], rel=0.05), "and never like one about the optical axis"


def test_no_ground_in_the_image_tells_no_turn(ground):
    motion = motion_of(image(ground, camera(), 0), image(ground, camera((0.0, 0.0, 1.0)), 1))
    up = GroundShift(shift=np.zeros(3), shift_std=0.1, down=np.array([0.0, 0.0, -1.0]), height=40.0)
    assert rotation_of(motion, INTRINSICS, up) is None


def test_vehicles_do_not_move_the_ground(ground):
    before, later = camera(), camera((0.3, -0.2, 0.5))
    xy = np.stack(np.meshgrid(np.linspace(-24, 24, 6), np.linspace(-12, 12, 4)), axis=-1).reshape(-1, 2)
    # most of the image is covered by lorries that drive off together
    first = image(ground, before, 0, cars(xy, 5.5, 6.5))
    then = image(ground, later, 1, cars(xy + np.array([0.0, 0.9]), 5.5, 6.5))
    centre = project(before, np.column_stack([xy, np.zeros(len(xy))]))[0]
    found = boxes(centre, angle=np.pi / 2, w=5.5 * FOCAL / 40, h=6.5 * FOCAL / 40)
    unmasked = motion_of(first, then)
    assert unmasked is None or error_px(unmasked, before, later) > 3.0, "without boxes they pass for the ground"
    motion = motion_of(first, then, found)
    assert motion is None or error_px(motion, before, later) < 1.5


def test_a_few_vehicles_that_nobody_detected_are_outliers(ground):
    before, later = camera(), camera((0.3, -0.2, 0.5))
    xy = np.array([[-20.0, 3.0], [-10.0, -4.0], [0.0, 5.0], [12.0, -8.0], [20.0, 9.0]])
    first, then = image(ground, before, 0, cars(xy)), image(ground, later, 1, cars(xy + np.array([0.0, 1.5])))
    motion = motion_of(first, then)
    assert error_px(motion, before, later) < 0.6
    assert motion.share < 1.0


def with_display(picture):
    """Text and lines as an on-screen display has them, black bars above and below."""
    picture = picture.copy()
    for k in range(9):
        at = (20 + k % 3 * 320, 110 + k // 3 * 160)
        cv2.putText(picture, "ALT 40.2 SPD 3.1", at, cv2.FONT_HERSHEY_SIMPLEX, 0.8, (255, 255, 255), 2)
    cv2.circle(picture, (WIDTH // 2, HEIGHT // 2), 60, (0, 255, 0), 2)
    picture[:60], picture[-60:] = 0, 0
    return picture


def test_text_on_the_image_does_not_hold_it(ground):
    before, later = camera(), camera((0.8, -0.5, 0.7))
    motion = motion_of(*(with_display(image(ground, view, k)) for k, view in enumerate((before, later))))
    assert error_px(motion, before, later) < 2.5


def test_ground_that_moves_wins_over_text_that_has_more_corners():
    # a field with little to see, under a display that is full of text
    scene = np.full((HEIGHT, WIDTH + 40, 3), 90, np.uint8)
    rng = np.random.default_rng(2)
    for x, y in rng.uniform((0, 0), (WIDTH + 40, HEIGHT), (70, 2)).astype(int):
        cv2.circle(scene, (int(x), int(y)), 6, (60, 130, 70), -1)
    first, then = scene[:, 40:].copy(), scene[:, 28:-12].copy()
    for picture in (first, then):
        for y in range(30, HEIGHT, 60):
            cv2.putText(picture, "12:03:55 N 47.1 E 8.5 H 40", (10, y), cv2.FONT_HERSHEY_SIMPLEX, 1.1, (255,) * 3, 2)
    motion = motion_of(first, then)
    assert motion.H[:2, 2] == pytest.approx([12.0, 0.0], abs=1.5)
    assert motion.share < 0.5


def test_a_change_of_exposure_is_no_motion(ground):
    before, later = camera(), camera((0.8, -0.5, 0.7))
    first, then = image(ground, before, 0), image(ground, later, 1)
    darker = np.clip(then * 0.6 + 8, 0, 255).astype(np.uint8)
    assert error_px(motion_of(first, darker), before, later) < 0.6


def test_motion_blur_and_compression(ground):
    before, later = camera(), camera((0.8, -0.5, 0.7))
    pictures = []
    for index, view in enumerate((before, later)):
        blurred = cv2.blur(image(ground, view, index, exposure=Exposure(noise=4.0)), (9, 1))
        packed = cv2.imencode(".jpg", blurred, [cv2.IMWRITE_JPEG_QUALITY, 30])[1]
        pictures.append(cv2.imdecode(packed, cv2.IMREAD_COLOR))
    assert error_px(motion_of(*pictures), before, later) < 1.5


def test_the_same_image_again_is_no_motion(ground):
    picture = image(ground, camera())
    motion = motion_of(picture, picture)
    np.testing.assert_allclose(motion.H, np.eye(3), atol=1e-6)
    assert motion.share == 1.0


def test_nothing_is_said_of_what_cannot_be_compared(ground):
    picture = image(ground, camera())
    elsewhere = image(ground, camera((0.0, 0.0, 90.0), at=(60.0, 40.0, 70.0)))
    rng = np.random.default_rng(1)
    plain = [np.clip(120 + rng.normal(0, 3, picture.shape), 0, 255).astype(np.uint8) for _ in range(2)]
    assert motion_of(picture, elsewhere) is None, "a cut"
    assert motion_of(*plain) is None, "noise alone"
    assert motion_of(plain[0] * 0, plain[0] * 0) is None, "black"
    assert motion_of(picture, np.ascontiguousarray(picture[:-20])) is None, "another size"
    assert motion_of(picture[:40, :40], picture[:40, :40]) is None, "next to nothing"


def test_after_a_cut_it_goes_on(ground):
    estimator = MotionEstimator()
    picture = image(ground, camera())
    elsewhere = [image(ground, camera((0.0, 0.0, 90.0 + k), at=(60.0, 40.0, 70.0)), k) for k in range(2)]
    found = [estimator.update(frame) is not None for frame in (picture, *elsewhere)]
    assert found == [False, False, True]


@pytest.mark.parametrize("size", [(1920, 1080), (641, 513), (320, 240)])
def test_it_works_in_pixels_of_the_image_whatever_its_size(ground, size):
    pictures = [cv2.resize(image(ground, view, 0), size) for view in (camera(), camera((0.0, 0.0, 3.0)))]
    motion = motion_of(*pictures)
    kx, ky = size[0] / WIDTH, size[1] / HEIGHT
    S = np.diag([kx, ky, 1.0])
    half = motion_of(*(image(ground, view, 0) for view in (camera(), camera((0.0, 0.0, 3.0)))))
    expected = S @ half.H @ np.linalg.inv(S)
    corners = np.array([[0.0, 0.0], [size[0], 0.0], [size[0], size[1]]])
    assert mapped(motion.H, corners) == pytest.approx(mapped(expected, corners), abs=1.2)
