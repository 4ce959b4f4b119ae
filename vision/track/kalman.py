"""Constant-velocity Kalman filter of box centres, all tracks in one call.

State of each of k tracks: x = (cx, cy, vx, vy), px and px/s, with covariance P. Velocity wanders as a random walk of
intensity q, so that one step of 2·dt equals two steps of dt: frames may drop or come at any pace.

Reference:
    Y. Bar-Shalom, X. R. Li, T. Kirubarajan, "Estimation with Applications to Tracking and Navigation", 2001,
    section 6.2.2 (continuous white noise acceleration model).
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

_MOVE = np.eye(4, k=2)
"""N of F = I + dt N: position changes by velocity."""
_STILL = np.eye(4)
"""I of the four states."""
_MOVE_EITHER = np.kron(_MOVE, _STILL) + np.kron(_STILL, _MOVE)
"""F ⊗ F = I + dt (N ⊗ I + I ⊗ N) + dt² N ⊗ N: its linear part, for vec P."""
_MOVE_BOTH = np.kron(_MOVE, _MOVE)
"""Quadratic part of F ⊗ F."""
_STILL_BOTH = np.eye(16)
"""Constant part of F ⊗ F."""


def initial(centre: Floats, noise: Floats, speed: Floats) -> tuple[Floats, Floats]:
    """State (k, 4) and covariance (k, 4, 4) of boxes seen once.

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
    F, FF, Q = _step(dt)
    # x ← F x,  P ← F P Fᵀ + q Q, entry by entry (F ⊗ F) vec P
    moved = P.reshape(-1, 16) @ FF + (wander * wander)[:, None] * Q
    return x @ F, moved.reshape(-1, 4, 4)


def mahalanobis(offset: Floats, P: Floats, noise: Floats) -> tuple[Floats, Floats]:
    """Distances of measured centres from predicted ones.

    Args:
        offset: (p, 2) px, measured less predicted.
        P: (p, 4, 4) covariances of the predictions.
        noise: (p,) px, standard deviation of the measured centres.

    Returns:
        d² = offsetᵀ S⁻¹ offset and det S with S = H P Hᵀ + R, (p,) each.
    """
    variance = noise * noise
    a, b, c = P[:, 0, 0] + variance, P[:, 0, 1], P[:, 1, 1] + variance
    dx, dy = offset[:, 0], offset[:, 1]
    # S = [a b; b c] = [1 0; g 1] diag(a, s) [1 g; 0 1],  d² = dx²/a + (dy − g dx)²/s
    g = b / a
    s, beyond = c - g * b, dy - g * dx
    return dx * dx / a + beyond * beyond / s, a * s


def correct(x: Floats, P: Floats, centre: Floats, noise: Floats) -> tuple[Floats, Floats]:
    """State and covariance after seeing the centres (k, 2) px with standard deviation ``noise`` (k,) px."""
    # the state as one more row above its covariance, since one rule corrects both; tracks last, which is quicker
    W = np.concatenate([x.T[None], P.transpose(1, 2, 0)])
    W[0, :2] -= centre.T
    variance = noise * noise
    for a in (0, 1):
        # g = Pₐ / (Pₐₐ + r²),  x ← x − (xₐ − zₐ) g,  P ← P − Pₐᵀ g
        row = W[1 + a]
        W = W - W[:, a, None] * (row / (row[a] + variance))
    W[0, :2] += centre.T
    # rounding would let the two halves of P part
    P = W[1:]
    return W[0].T, (0.5 * (P + P.transpose(1, 0, 2))).transpose(2, 0, 1)


def warp(x: Floats, P: Floats, H: Floats) -> tuple[Floats, Floats, Floats]:
    """Move states into a frame that H (3, 3) leads to; velocity turns and scales with its place.

    Returns:
        x (k, 4), P (k, 4, 4) and the Jacobian J (k, 2, 2) of the map at each place.
    """
    centre, J = _mapped(H, x[:, :2])
    # x ← (map(p), J v),  P ← T P Tᵀ with T = diag(J, J)
    velocity = (J @ x[:, 2:, None])[:, :, 0]
    T = np.zeros_like(P)
    T[:, :2, :2] = T[:, 2:, 2:] = J
    return np.concatenate([centre, velocity], axis=1), T @ P @ T.transpose(0, 2, 1), J


@lru_cache(maxsize=32)
def _step(dt: float) -> tuple[Floats, Floats, Floats]:
    """Fᵀ (4, 4), (F ⊗ F)ᵀ (16, 16) and vec Q (16,) of one step; films come at few different paces."""
    # F = I + dt N,  F ⊗ F = I + dt (N ⊗ I + I ⊗ N) + dt² N ⊗ N,  Q = [dt³/3 dt²/2; dt²/2 dt] ⊗ I
    FF = _STILL_BOTH + dt * _MOVE_EITHER + dt * dt * _MOVE_BOTH
    a, b, c = dt**3 / 3, dt**2 / 2, dt
    Q = np.array([a, 0, b, 0, 0, a, 0, b, b, 0, c, 0, 0, b, 0, c])
    return (_STILL + dt * _MOVE).T, FF.T, Q


def _mapped(H: Floats, points: Floats) -> tuple[Floats, Floats]:
    """Points (k, 2) through H (3, 3), and the Jacobian of the map there, (k, 2, 2)."""
    # (y w, w) = H (p, 1) with w kept off zero
    y = H[:, :2] @ points.T + H[:, 2:]
    w = y[2]
    w[np.abs(w) < 1e-9] = 1e-9
    y = y[:2] / w
    # J = (A − y cᵀ) / w
    return y.T, ((H[:2, :2, None] - y[:, None] * H[2, :2, None]) / w).transpose(2, 0, 1)
