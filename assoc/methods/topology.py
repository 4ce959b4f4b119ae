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

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


def topology_angles(offset: FloatArray, heading: FloatArray, reference: float = 0.0) -> FloatArray:
    """α and β of every target, unsigned.

    Args:
        offset: (n, 2) vector to the target, (right, forward): from the UAV in metres, or from the image centre.
        heading: (n,) of the target, clockwise from forward, radians; NaN unknown.
        reference: Heading of v₀: the UAV's in the world, 0 in the image.

    Returns:
        (n, 2) in [0, π]; β is NaN where the heading is unknown.
    """
    # p = v₀ᵢ; q = v₀ and vᵢ, (n, 2) each; whole columns, for at these sizes it is the number of calls that counts
    px, py = np.asarray(offset, np.float64).T[..., None]
    towards = np.empty((len(offset), 2))
    towards[:, 0], towards[:, 1] = reference, heading
    qx, qy = np.sin(towards), np.cos(towards)
    # ∠(p, q) = arccos((|p|² + |q|² − |p − q|²) / 2|p||q|), π/2 for a vector without length
    p2, q2 = px * px + py * py, qx * qx + qy * qy
    dx, dy = px - qx, py - qy
    length = 2.0 * np.sqrt(p2 * q2)
    cosine = np.divide(p2 + q2 - (dx * dx + dy * dy), length, out=np.zeros_like(length), where=length != 0.0)
    return np.asarray(np.arccos(np.minimum(np.maximum(cosine, -1.0), 1.0)))


def signed_angles(offset: FloatArray, heading: FloatArray, reference: float = 0.0) -> FloatArray:
    """α and β with their sense of rotation, (n, 2) in (−π, π]; arguments as for :func:`topology_angles`."""
    bearing = np.arctan2(offset[..., 0], offset[..., 1])
    return np.stack([_wrap(bearing - reference), _wrap(heading - bearing)], axis=-1)


def _wrap(angle: FloatArray) -> FloatArray:
    """Wrap angles into (−π, π]."""
    return np.asarray(np.pi - np.mod(np.pi - angle, 2.0 * np.pi))


def topology_cost(image: FloatArray, world: FloatArray) -> FloatArray:
    """c_ji = ‖(α_j, β_j) − (α_i, β_i)‖₂.

    Args:
        image: (m, 2) angles in the image.
        world: (n, 2) angles in the world.

    Returns:
        (m, n) radians; an unknown β counts as agreement.
    """
    d = image[:, None, :] - world
    d[np.isnan(d)] = 0.0
    d *= d
    return np.asarray(np.sqrt(d[..., 0] + d[..., 1]))


def signed_topology_cost(image: FloatArray, world: FloatArray) -> FloatArray:
    """Cost like :func:`topology_cost` for signed angles: differences are wrapped into (−π, π]."""
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
