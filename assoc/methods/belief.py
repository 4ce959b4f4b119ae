"""Association costs turned into Dempster–Shafer mass functions and fused by Dempster's rule.

Reference: Chen, Du, Wu, Drones 2025, 9(9), 612, section 3.4, doi:10.3390/drones9090612. Masses lie on singletons only:
row j of a mass matrix holds the support for each vehicle being track j.

Where the formulas are undefined: a matrix of equal costs carries no information, so every row is uniform; so is a row
of zeros, and the result of two rows in full conflict (K = 1).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


def min_max_norm(x: FloatArray) -> FloatArray:
    """(x − min) / (max − min) over the whole matrix; zeros where max = min."""
    if x.size == 0:
        return x.copy()
    low, high = float(x.min()), float(x.max())
    # halves, so that the range of the largest floats stays finite
    span = high / 2.0 - low / 2.0
    if not span > 0.0:
        return np.zeros_like(x)
    return np.asarray((x / 2.0 - low / 2.0) / span)


def row_norm(x: FloatArray) -> FloatArray:
    """x_ij / Σ_k x_ik for x ≥ 0; rows without any weight become uniform."""
    total = x.sum(axis=1, keepdims=True)
    uniform = np.full(x.shape, 1.0 / max(x.shape[1], 1))
    return np.asarray(np.divide(x, total, out=uniform, where=total > 0.0))


def masses(cost: FloatArray) -> FloatArray:
    """Masses of a cost matrix: M = RowNorm(1 − MinMaxNorm(cost)).

    Args:
        cost: (m, n) finite, smaller is better: pixel errors E or topology costs C.

    Returns:
        (m, n) rows sum to 1.
    """
    return row_norm(1.0 - min_max_norm(cost))


def conflict(first: FloatArray, second: FloatArray) -> FloatArray:
    """Conflict of the two masses of every track: K_i = Σ_{k≠j} m¹_ik m²_ij.

    Args:
        first: (m, n) masses.
        second: (m, n) masses.

    Returns:
        (m,) in [0, 1].
    """
    total = np.sum(first, axis=1) * np.sum(second, axis=1)
    return np.asarray(np.clip(total - np.sum(first * second, axis=1), 0.0, 1.0))


def fuse(first: FloatArray, second: FloatArray) -> FloatArray:
    """Dempster's rule: m_ij = m¹_ij m²_ij / (1 − K_i), rows renormalised.

    The division by 1 − K cancels in the renormalisation, so it is not carried out: the result is the normalised
    product, also where K is within rounding of 1.

    Args:
        first: (m, n) masses.
        second: (m, n) masses.

    Returns:
        (m, n) rows sum to 1.
    """
    return row_norm(_of_largest(first) * _of_largest(second))


def _of_largest(x: FloatArray) -> FloatArray:
    """Rows scaled to a largest mass of 1, so that products of small masses do not vanish; zeros stay."""
    largest = x.max(axis=1, keepdims=True, initial=0.0)
    return np.asarray(np.divide(x, largest, out=np.zeros(x.shape), where=largest > 0.0))
