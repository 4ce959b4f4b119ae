"""Lost tracks continued: leftover detections are compared with projected telemetry.

Reference: Chen, Du, Wu, Drones 2025, 9(9), 612, Algorithm 1 lines 15–22, doi:10.3390/drones9090612. As printed, a
detection takes the nearest vehicle however far away that is; the gated version demands plausibility and that the
choice is mutual.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

GATE = 9.21
"""99 % of χ² with two degrees of freedom."""


def _squares(predicted: FloatArray, centres: FloatArray) -> FloatArray:
    """(b, n) squared distances; not finite → inf."""
    d = centres[:, None, :] - predicted[None, :, :]
    square = np.sum(d * d, axis=2)
    return np.asarray(np.where(np.isfinite(square), square, np.inf))


def reattach(predicted: FloatArray, lost_vehicle: IntArray, centres: FloatArray) -> IntArray:
    """Algorithm 1, lines 15–22.

    Args:
        predicted: (n, 2) ŷ_i of all vehicles in this frame, NaN unknown.
        lost_vehicle: (a,) vehicle of each unmatched track, −1 unnamed.
        centres: (b, 2) detections left over, in the order in which they choose.

    Returns:
        (p, 2) rows of ``lost_vehicle`` and of ``centres`` that belong together.
    """
    waiting = {int(vehicle): row for row, vehicle in reversed(list(enumerate(lost_vehicle))) if vehicle >= 0}
    pairs: list[tuple[int, int]] = []
    if len(predicted):
        square = _squares(predicted, centres)
        for d in range(len(centres)):
            # d.ID = argmin_i |d.pos − ŷ_i|
            nearest = int(np.argmin(square[d]))
            if np.isfinite(square[d, nearest]) and nearest in waiting:
                pairs.append((waiting.pop(nearest), d))
    return np.array(pairs, np.int64).reshape(-1, 2)


def reattach_gated(
    predicted: FloatArray, variance: FloatArray, lost_vehicle: IntArray, centres: FloatArray, gate: float = GATE
) -> IntArray:
    """Reattach tracks with a gate: nearest in units of the prediction's own σ, close enough, and each other's best.

    Args:
        predicted: (n, 2) positions of all vehicles, any planar unit, NaN unknown.
        variance: (n,) variance of a prediction against a detection per axis, same unit squared.
        lost_vehicle: (a,) vehicle of each unmatched track, −1 unnamed; a vehicle named twice is left out.
        centres: (b, 2) detections left over.
        gate: Largest squared distance in σ². Raise → more tracks continue, more of them wrongly.

    Returns:
        (p, 2) rows of ``lost_vehicle`` and of ``centres`` that belong together.
    """
    if not len(predicted) or not len(centres):
        return np.empty((0, 2), np.int64)
    square = _squares(predicted, centres) / np.maximum(variance, 1e-12)[None, :]
    nearest = np.argmin(square, axis=1)
    chosen = np.argmin(square, axis=0)
    names, counts = np.unique(lost_vehicle, return_counts=True)
    single = set(names[(counts == 1) & (names >= 0)].tolist())
    pairs = [
        (row, int(chosen[vehicle]))
        for row, vehicle in enumerate(lost_vehicle.tolist())
        if vehicle in single and nearest[chosen[vehicle]] == vehicle and square[chosen[vehicle], vehicle] <= gate
    ]
    return np.array(pairs, np.int64).reshape(-1, 2)
