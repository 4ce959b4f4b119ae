"""Rotations as vectors, against SciPy."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from vision.motion.rotation import turned_by, vector_of


@pytest.mark.parametrize("angle", [0.0, 1e-12, 1e-6, 0.03, 1.0, 2.6, 3.1, np.pi - 1e-9])
def test_a_vector_and_its_rotation_are_those_of_scipy(angle: float) -> None:
    for axis in np.random.default_rng(1).normal(size=(20, 3)):
        v = angle * axis / np.linalg.norm(axis)
        R = Rotation.from_rotvec(v).as_matrix()
        np.testing.assert_allclose(turned_by(v), R, atol=1e-14)
        np.testing.assert_allclose(vector_of(R), v, rtol=1e-7, atol=1e-14)
