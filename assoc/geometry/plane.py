"""Vectors in the ground plane as complex numbers, east + i north, so that one array operation does both axes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]


def to_complex(p: FloatArray) -> ComplexArray:
    """(...) complex numbers of (..., 2) east, north."""
    return np.asarray(p[..., 0] + 1j * p[..., 1])


def to_east_north(z: ComplexArray) -> FloatArray:
    """(..., 2) east, north of (...) complex numbers."""
    p = np.empty((*z.shape, 2))
    p[..., 0], p[..., 1] = z.real, z.imag
    return p


def squared_magnitude(z: ComplexArray) -> FloatArray:
    """|z|², without the square root of ``abs``."""
    return np.asarray(z.real**2 + z.imag**2)
