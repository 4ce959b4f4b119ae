"""Random errors of positions: noise from report to report, and errors that last."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sim.world.scenario import Gnss

FloatArray = NDArray[np.float64]

FILTER_S = 0.6
"""Time constant with which an autopilot's filter follows its receiver."""
OUTLIER_SHARE, OUTLIER_FACTOR = 1.0 / 25.0, 5.0
"""How many reports are outliers, and how much wider they scatter; a choice after urban GNSS."""


def lasting_error(gnss: Gnss, steps: int, shape: tuple[int, ...], dt_s: float, rng: np.random.Generator) -> FloatArray:
    """(steps, *shape) metres: the error that lasts, of the kind that is asked for, every dt_s."""
    if gnss.bias_kind == "gauss-markov":
        return gauss_markov(steps, shape, gnss.bias_m, gnss.tau_s, dt_s, rng)
    if gnss.bias_kind == "filtered":
        return _smoothed(gauss_markov(steps, shape, gnss.bias_m, gnss.tau_s, dt_s, rng), dt_s)
    start = rng.normal(0.0, gnss.bias_m, shape)
    if gnss.bias_kind == "walk":
        # b_{k+1} = b_k + σ √(Δt/τ) w
        moves = rng.normal(0.0, gnss.bias_m * np.sqrt(dt_s / gnss.tau_s), (steps, *shape))
        return np.asarray(start + np.cumsum(moves, axis=0))
    if gnss.bias_kind == "sine":
        # b = √2 σ sin(2π t/τ' + φ),  τ' within a third of τ
        period, phase = gnss.tau_s * rng.uniform(0.75, 1.33, shape), rng.uniform(0.0, 2.0 * np.pi, shape)
        t = dt_s * np.arange(steps).reshape(-1, *(1 for _ in shape))
        return np.asarray(np.sqrt(2.0) * gnss.bias_m * np.sin(2.0 * np.pi * t / period + phase))
    fresh = rng.normal(0.0, gnss.bias_m, (steps, *shape))
    fresh[0] = start
    # all axes of a vehicle step at once
    changes = rng.random((steps, *shape[:-1], 1)) < dt_s / gnss.tau_s
    changes[0] = True
    last = np.maximum.accumulate(np.where(changes, np.arange(steps).reshape(-1, *(1 for _ in shape)), 0), axis=0)
    return np.take_along_axis(fresh, np.broadcast_to(last, fresh.shape), axis=0)


def _smoothed(values: FloatArray, dt_s: float) -> FloatArray:
    """Values (steps, ...) through two poles, each of the time constant of an autopilot's position filter."""
    keep = np.exp(-dt_s / FILTER_S)
    for _ in range(2):
        for k in range(1, len(values)):
            values[k] = keep * values[k - 1] + (1.0 - keep) * values[k]
    return values


def report_noise(kind: str, shape: tuple[int, int], rng: np.random.Generator) -> FloatArray:
    """Noise (k, n) of unit scale, each row of one report: normal, Laplace of variance 1, or normal with outliers."""
    noise = rng.normal(0.0, 1.0, shape)
    if kind == "laplace":
        # x = √E z with E exponential of mean 1 has Laplace's density of variance 1
        return np.asarray(noise * np.sqrt(rng.exponential(1.0, shape)))
    if kind == "outliers":
        return np.asarray(noise * np.where(rng.random((shape[0], 1)) < OUTLIER_SHARE, OUTLIER_FACTOR, 1.0))
    return noise


def gauss_markov(
    steps: int, shape: tuple[int, ...], std: float, tau_s: float, dt_s: float, rng: np.random.Generator
) -> FloatArray:
    """(steps, *shape) first-order Gauss–Markov processes in their steady state."""
    # b_{k+1} = λ b_k + σ √(1 − λ²) w,  λ = exp(−Δt/τ)
    keep = np.exp(-dt_s / tau_s)
    draws = rng.normal(0.0, std, (steps, *shape))
    values = np.empty_like(draws)
    values[0] = draws[0]
    for k in range(1, steps):
        values[k] = keep * values[k - 1] + np.sqrt(1.0 - keep * keep) * draws[k]
    return values
