"""Constant-velocity Kalman filter of box centres, all tracks in one call.

State of each of k tracks: x = (cx, cy, vx, vy), px and px/s, with covariance P. Velocity wanders as a random walk of
intensity q, so that one step of 2·dt says the same as two steps of dt: frames may drop or come at any pace.

Reference:
    Y. Bar-Shalom, X. R. Li, T. Kirubarajan, "Estimation with Applications to Tracking and Navigation", 2001,
    section 6.2.2 (continuous white noise acceleration model).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["correct", "initial", "innovation", "jacobian", "map_points", "predict", "warp"]

Floats = NDArray[np.float64]

_I2 = np.eye(2)
_SIGNS = np.array([[1.0, -1.0], [-1.0, 1.0]])


def initial(centre: Floats, noise: Floats, speed: Floats) -> tuple[Floats, Floats]:
    """State (k, 4) and covariance (k, 4, 4) of things seen once.

    Args:
        centre: (k, 2) px.
        noise: (k,) px, standard deviation of the centre.
        speed: (k,) px/s, standard deviation of the unknown velocity.
    """
    x = np.zeros((len(centre), 4))
    x[:, :2] = centre
    P = np.zeros((len(centre), 4, 4))
    P[:, [0, 1], [0, 1]] = noise[:, None] ** 2
    P[:, [2, 3], [2, 3]] = speed[:, None] ** 2
    return x, P


def predict(x: Floats, P: Floats, dt: float, wander: Floats) -> tuple[Floats, Floats]:
    """State and covariance ``dt`` seconds on.

    Args:
        x: (k, 4) px, px/s.
        P: (k, 4, 4).
        dt: s, zero or more.
        wander: (k,) px/s, by how much the velocity changes in one second (standard deviation).
    """
    F = np.array([[1.0, 0.0, dt, 0.0], [0.0, 1.0, 0.0, dt], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
    # x ← F x,  P ← F P Fᵀ + q [dt³/3 dt²/2; dt²/2 dt] ⊗ I
    a, b, c = dt**3 / 3, dt**2 / 2, dt
    Q = np.array([[a, 0.0, b, 0.0], [0.0, a, 0.0, b], [b, 0.0, c, 0.0], [0.0, b, 0.0, c]])
    return x @ F.T, F @ P @ F.T + (wander**2)[:, None, None] * Q


def innovation(P: Floats, noise: Floats) -> Floats:
    """S = H P Hᵀ + R of a measured centre with standard deviation ``noise`` (k,) px: (k, 2, 2)."""
    return np.asarray(P[:, :2, :2] + (noise**2)[:, None, None] * _I2)


def correct(x: Floats, P: Floats, centre: Floats, noise: Floats) -> tuple[Floats, Floats]:
    """State and covariance after seeing the centres (k, 2) px with standard deviation ``noise`` (k,) px."""
    # K = P Hᵀ S⁻¹,  x ← x + K (z − H x)
    K = P[:, :, :2] @ _inverse(innovation(P, noise))
    x = x + (K @ (centre - x[:, :2])[:, :, None])[:, :, 0]
    # P ← P − K H P, kept symmetric
    P = P - K @ P[:, :2, :]
    return x, (P + P.transpose(0, 2, 1)) / 2


def map_points(H: Floats, points: Floats) -> Floats:
    """Points (k, 2) through the homography H (3, 3)."""
    return np.asarray((points @ H[:2, :2].T + H[:2, 2]) / _depth(H, points)[:, None])


def jacobian(H: Floats, points: Floats) -> Floats:
    """∂(map_points)/∂(points), (k, 2, 2)."""
    # y = (A p + b) / w with w = c·p + d  ⇒  J = (A − y cᵀ) / w
    mapped = map_points(H, points)
    return np.asarray((H[:2, :2] - mapped[:, :, None] * H[2, :2]) / _depth(H, points)[:, None, None])


def warp(x: Floats, P: Floats, H: Floats) -> tuple[Floats, Floats]:
    """The same states and covariances in a picture that H (3, 3) leads to; velocity turns and scales with its place."""
    J = jacobian(H, x[:, :2])
    velocity = (J @ x[:, 2:, None])[:, :, 0]
    # P ← T P Tᵀ with T = diag(J, J)
    T = np.zeros_like(P)
    T[:, :2, :2] = T[:, 2:, 2:] = J
    return np.concatenate([map_points(H, x[:, :2]), velocity], axis=1), T @ P @ T.transpose(0, 2, 1)


def _inverse(S: Floats) -> Floats:
    """Inverses of symmetric S (k, 2, 2)."""
    adjugate = S[:, ::-1, ::-1] * _SIGNS
    return np.asarray(adjugate / (S[:, 0, 0] * S[:, 1, 1] - S[:, 0, 1] ** 2)[:, None, None])


def _depth(H: Floats, points: Floats) -> Floats:
    """The homogeneous coordinate, (k,), kept off zero."""
    w = points @ H[2, :2] + H[2, 2]
    return np.where(np.abs(w) < 1e-9, 1e-9, w)
