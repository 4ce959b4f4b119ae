"""Derivatives of places in the image and on the ground against differences."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from vision.motion.attitude_fusion import ground_jacobians, image_jacobians

STEP = 1e-6
R = Rotation.from_euler("zx", [0.7, np.pi - 0.5]).as_matrix()
P, PLACES = np.array([3.0, -2.0, 40.0]), np.array([[10.0, 25.0, 0.0], [-15.0, 12.0, 0.0], [0.0, 30.0, 0.0]])


def image(places, rotation):
    d = (places - P) @ rotation
    return d[:, :2] / d[:, 2:]


def ground(rays, rotation):
    d = rays @ rotation.T
    return -P[2] / d[:, 2:] * d[:, :2]


def turned(axis):
    return R @ Rotation.from_rotvec(STEP * np.eye(3)[axis]).as_matrix()


def test_places_in_the_image():
    u, by_xi, by_place = image_jacobians((PLACES - P) @ R, R)
    assert u == pytest.approx(image(PLACES, R))
    for axis in range(3):
        assert by_xi[:, :, axis] == pytest.approx((image(PLACES, turned(axis)) - u) / STEP, abs=1e-4)
    for axis in range(2):
        moved = PLACES + STEP * np.eye(3)[axis]
        assert by_place[:, :, axis] == pytest.approx((image(moved, R) - u) / STEP, abs=1e-4)


def test_rays_on_the_ground():
    rays = np.column_stack([image(PLACES, R), np.ones(3)])
    g, by_xi, by_ray = ground_jacobians(rays, R, P[2])
    assert g == pytest.approx(PLACES[:, :2] - P[:2])
    for axis in range(3):
        assert by_xi[:, :, axis] == pytest.approx((ground(rays, turned(axis)) - g) / STEP, rel=1e-3, abs=1e-2)
    for axis in range(2):
        moved = rays + STEP * np.eye(3)[axis]
        assert by_ray[:, :, axis] == pytest.approx((ground(moved, R) - g) / STEP, rel=1e-3, abs=1e-2)
