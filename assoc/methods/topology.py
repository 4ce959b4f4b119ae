"""Topology-based association of one frame: bearing and aspect of every target, in the world and in the image.

Reference: Chen, Du, Wu, Drones 2025, 9(9), 612, section 3.3, doi:10.3390/drones9090612.

World: v₀ is the UAV's heading, v₀ᵢ leads from the UAV to vehicle i, vᵢ is vehicle i's heading; α = ∠(v₀ᵢ, v₀),
β = ∠(v₀ᵢ, vᵢ). Image: v₀ is straight up, v₀ⱼ leads from the image centre to box j, vⱼ is its front. All vectors are
given here as (right, forward): east and north in the world, +u and −v in the image.

As printed, angles come from the law of cosines and lie in [0, π], so left and right cannot be distinguished; the signed
variant can.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

__all__ = ["associate_by_topology", "signed_angles", "signed_topology_cost", "topology_angles", "topology_cost"]

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


def _unit(heading: FloatArray) -> FloatArray:
    """Heading clockwise from forward → (right, forward)."""
    return np.stack([np.sin(heading), np.cos(heading)], axis=-1)


def _cosine_law(p: FloatArray, q: FloatArray) -> FloatArray:
    """∠(p, q) = arccos((|p|² + |q|² − |p − q|²) / 2|p||q|), π/2 for a vector without length."""
    a2, b2 = np.sum(p * p, axis=-1), np.sum(q * q, axis=-1)
    c2 = np.sum((p - q) ** 2, axis=-1)
    length = 2.0 * np.sqrt(a2 * b2)
    cosine = np.where(length > 0.0, (a2 + b2 - c2) / np.where(length > 0.0, length, 1.0), 0.0)
    return np.asarray(np.where(np.isnan(length), np.nan, np.arccos(np.clip(cosine, -1.0, 1.0))))


def topology_angles(offset: FloatArray, heading: FloatArray, reference: float = 0.0) -> FloatArray:
    """α and β of every target, unsigned.

    Args:
        offset: (n, 2) vector to the target, (right, forward): from the UAV in metres, or from the image centre.
        heading: (n,) of the target, clockwise from forward, radians; NaN unknown.
        reference: Heading of v₀: the UAV's in the world, 0 in the image.

    Returns:
        (n, 2) in [0, π]; β is NaN where the heading is unknown.
    """
    v0 = np.broadcast_to(_unit(np.asarray(reference, np.float64)), offset.shape)
    return np.stack([_cosine_law(offset, v0), _cosine_law(offset, _unit(heading))], axis=-1)


def signed_angles(offset: FloatArray, heading: FloatArray, reference: float = 0.0) -> FloatArray:
    """α and β with their sense of rotation, (n, 2) in (−π, π]; arguments as for :func:`topology_angles`."""
    bearing = np.arctan2(offset[..., 0], offset[..., 1])
    return np.stack([_wrap(bearing - reference), _wrap(heading - bearing)], axis=-1)


def _wrap(angle: FloatArray) -> FloatArray:
    """Into (−π, π]."""
    return np.asarray(np.pi - np.mod(np.pi - angle, 2.0 * np.pi))


def topology_cost(image: FloatArray, world: FloatArray) -> FloatArray:
    """c_ji = ‖(α_j, β_j) − (α_i, β_i)‖₂.

    Args:
        image: (m, 2) angles in the image.
        world: (n, 2) angles in the world.

    Returns:
        (m, n) radians; an unknown β counts as agreement.
    """
    d = np.nan_to_num(image[:, None, :] - world[None, :, :])
    return np.asarray(np.sqrt(np.sum(d * d, axis=2)))


def signed_topology_cost(image: FloatArray, world: FloatArray) -> FloatArray:
    """As :func:`topology_cost` for signed angles: differences are wrapped into (−π, π]."""
    d = np.nan_to_num(_wrap(image[:, None, :] - world[None, :, :]))
    return np.asarray(np.sqrt(np.sum(d * d, axis=2)))


def associate_by_topology(cost: FloatArray) -> IntArray:
    """Assignment of least total cost (Hungarian algorithm).

    Args:
        cost: (m, n) tracks × vehicles.

    Returns:
        (m,) vehicle of each track, −1 for surplus tracks.
    """
    answer = np.full(len(cost), -1, np.int64)
    if cost.size:
        rows, columns = linear_sum_assignment(cost)
        answer[rows] = columns
    return answer
