from __future__ import annotations

import cv2
import numpy as np
import pytest

from vision.detect.front_crops import rectify


def pixel_middles(height, width):
    y, x = np.mgrid[:height, :width] + 0.5
    return x, y


def colours(value):
    return np.repeat(np.clip(np.rint(value), 0, 255).astype(np.uint8)[..., None], 3, axis=2)


def expected(box, side, margin, value):
    """A function of image coordinates at the middles of a crop's pixels."""
    cx, cy, w, h, angle = box
    x, y = pixel_middles(side, side)
    along, across = (x / side - 0.5) * w * (1 + margin), (y / side - 0.5) * h * (1 + margin)
    return value(
        cx + np.cos(angle) * along - np.sin(angle) * across, cy + np.sin(angle) * along + np.cos(angle) * across
    )


def smooth(x, y):
    return 128 + 60 * np.sin(x / 11.0) + 50 * np.cos(y / 13.0 + 1.0)


@pytest.mark.parametrize("angle", np.arange(-3.1, 3.2, 0.7).tolist())
@pytest.mark.parametrize("size", [(30.0, 14.0), (7.3, 5.1), (90.5, 61.7)])  # as many pixels, enlarged, shrunk
def test_a_crop_is_the_image_at_the_box(angle, size):
    image = colours(smooth(*pixel_middles(200, 240)))
    box = np.array([121.3, 97.6, *size, angle])
    (crop,) = rectify(image, box[None], 32, 0.15)
    np.testing.assert_allclose(crop[..., 1].astype(float), expected(box, 32, 0.15, smooth), atol=2.5)


def test_a_box_of_whole_pixels_is_cut_out_unchanged():
    image = np.random.default_rng(0).integers(0, 256, (40, 50, 3), dtype=np.uint8)
    upright = [20.0, 18.0, 16.0, 16.0, 0.0]
    turned = [20.0, 18.0, 16.0, 16.0, np.pi]
    crops = rectify(image, [upright, turned], 16)
    np.testing.assert_array_equal(crops[0], image[10:26, 12:28])
    np.testing.assert_array_equal(crops[1], crops[0][::-1, ::-1])


def test_parts_of_a_pixel_count():
    def ramp(x, y):
        return 4.0 * x - 40.0

    image = colours(ramp(*pixel_middles(60, 100)))
    for shift in (0.0, 0.25, 0.5, 0.75):
        (crop,) = rectify(image, [[50.0 + shift, 30.0, 20.0, 10.0, 0.0]], 20)
        np.testing.assert_allclose(crop[..., 0].mean(), 160.0 + 4.0 * shift, atol=0.1)


@pytest.mark.parametrize("angle", [0.0, 0.4])
def test_fine_detail_of_a_large_box_is_averaged_not_skipped(angle):
    x, y = pixel_middles(400, 400)
    board = colours(255.0 * ((np.floor(x) + np.floor(y)) % 2))
    (crop,) = rectify(board, [[200.0, 200.0, 192.0, 128.0, angle]], 32)
    np.testing.assert_allclose(crop.astype(float), 127.5, atol=12.0)


def test_beyond_the_image_its_edge_is_repeated():
    image = np.zeros((20, 20, 3), np.uint8)
    image[:, :10] = 200
    (crop,) = rectify(image, [[0.0, 10.0, 16.0, 16.0, 0.0]], 16)
    assert (crop == 200).all()
    assert (rectify(image, [[-500.0, 900.0, 4.0, 4.0, 1.0]], 16) == 200).all()


def test_boxes_without_extent_and_none_at_all():
    image = np.full((20, 20, 3), 7, np.uint8)
    assert (rectify(image, [[5.0, 5.0, 0.0, 0.0, 0.3]], 8) == 7).all()
    assert rectify(image, np.empty((0, 5)), 8).shape == (0, 8, 8, 3)


def test_an_arrow_points_to_the_right_whichever_way_it_lay():
    for angle in np.linspace(-np.pi, np.pi, 25):
        fine = np.zeros((960, 960, 3), np.uint8)
        tip = np.array([60.0 + 25 * np.cos(angle), 60.0 + 25 * np.sin(angle)])
        back = np.array([60.0 - 25 * np.cos(angle), 60.0 - 25 * np.sin(angle)])
        side = 12 * np.array([-np.sin(angle), np.cos(angle)])
        points = np.rint((np.stack([tip, back + side, back - side]) * 8 - 0.5) * 16).astype(np.int32)
        cv2.fillConvexPoly(fine, points, (255, 255, 255), shift=4)
        image = np.asarray(cv2.resize(fine, (120, 120), interpolation=cv2.INTER_AREA), np.uint8)
        (crop,) = rectify(image, [[60.0, 60.0, 50.0, 24.0, angle]], 48)
        columns = crop[..., 0].astype(float).sum(axis=0) / 255.0
        # the triangle's width falls from the whole crop at its foot to nothing at its tip
        np.testing.assert_allclose(columns[1:], 48 - np.arange(48)[1:] - 0.5, atol=1.5)
