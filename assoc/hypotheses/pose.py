"""The camera's pose correction: one Gauss–Newton step on the whitened residuals of matched pairs, with priors.

The bias filters' gains do not depend on θ, so innovations are linear in it: one pass over the blocks carries the
residual and its Jacobian together, as ten columns.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from assoc.evidence.blocks import Blocks
from assoc.evidence.likelihood import Noise, PairState
from assoc.geometry.ground import HEIGHT, THETA

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

_ROUNDS = 3
"""Rounds of reweighting: weights settle in two or three."""
_OUTLIER = 40.0
"""Squared innovation, in variances, from which it is no innovation of this pair."""


def is_gross(mean: FloatArray) -> bool:
    """Tell whether a part of the prior is an error that does not come in flight, as heights do over hills.

    Args:
        mean: (9,) of that part.
    """
    return bool(np.any(np.delete(mean, HEIGHT)))


@dataclass(frozen=True, slots=True, kw_only=True)
class PosePrior:
    """Gaussian, or with ``others`` a mixture of Gaussians of which this one has nearly all the weight."""

    std: FloatArray
    """(9,) 1σ of θ."""
    mean: FloatArray = field(default_factory=lambda: np.zeros(THETA))
    """(9,)."""
    log_share: float = 0.0
    """ln of its weight in the mixture."""
    at_once: bool = False
    """True: every update starts at its mean too, until film and telemetry fit clearly."""
    others: tuple[PosePrior, ...] = ()
    """The other parts: errors that are rare and large."""

    def cost(self, theta: FloatArray) -> float:
        """½ (θ − μ)ᵀΛ(θ − μ) − ln w of this part."""
        return float(0.5 * np.sum(((theta - self.mean) / self.std) ** 2)) - self.log_share

    def part_at(self, theta: FloatArray) -> PosePrior:
        """The part of the mixture that has most of the density at θ."""
        parts = (self, *self.others)
        std = np.array([part.std for part in parts])
        off = (theta - np.array([part.mean for part in parts])) / std
        # −ln w N(θ; μ, Λ⁻¹), up to a constant
        cost = np.sum(0.5 * off**2 + np.log(std), axis=1) - np.array([part.log_share for part in parts])
        return parts[int(np.argmin(cost))]


@dataclass(frozen=True, slots=True, kw_only=True)
class Whitened:
    """Innovations of P pairs over B blocks, divided by their 1σ."""

    e: FloatArray
    """(B, P, 2) at the blocks' θ; 0 where there is no sample."""
    jacobian: FloatArray
    """(B, P, 2, 9)."""
    samples: FloatArray
    """(P,) number of residuals of each pair."""
    theta: FloatArray
    """(9,) where the Jacobian was taken."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Fitted:
    """A correction fitted to matched pairs."""

    theta: FloatArray
    """(9,)."""
    std: FloatArray
    """(9,) its 1σ, √diag (Λ + JᵀJ)⁻¹."""
    cost: float
    """½ ln|Λ| − ½ ln|Λ + JᵀJ|."""


@dataclass(frozen=True, slots=True, kw_only=True)
class BiasModels:
    """C models of how the vehicles' position biases wander."""

    std: FloatArray
    """(C,) σ_b, metres."""
    decay: FloatArray
    """(C,) correlation from one block to the next."""


def _own_variance(blocks: Blocks, tracks: IntArray, vehicles: IntArray, noise: Noise) -> FloatArray:
    """(B, P) variance of a block's mean about the bias."""
    count = np.maximum(blocks.count[:, tracks, vehicles], 1.0)
    variance = (noise.white_var + blocks.box_var[:, tracks]) / count
    return np.asarray(variance + noise.floor_var + blocks.extra_var[:, tracks, vehicles])


def whiten(blocks: Blocks, tracks: IntArray, vehicles: IntArray, state: PairState, noise: Noise) -> Whitened:
    """Innovations of some pairs as linear functions of θ.

    Args:
        blocks: All residuals.
        tracks: (P,) columns.
        vehicles: (P,) vehicles.
        state: State of the bias filters before the first block.
        noise: Noise levels.

    Returns:
        The whitened innovations.
    """
    has = blocks.count[:, tracks, vehicles] > 0
    x = np.concatenate([blocks.mean[:, tracks, vehicles][..., None], blocks.jacobian[:, tracks]], axis=3)
    variance = _own_variance(blocks, tracks, vehicles, noise)
    M = np.concatenate([state.mean[tracks, vehicles][..., None], np.zeros((len(tracks), 2, THETA))], axis=2)
    V = state.var[tracks, vehicles]
    model = BiasModels(std=np.array([noise.bias_std]), decay=np.array([noise.decay]))
    steps = _innovations(x, has, variance, blocks.jump_var[:, vehicles], M[None], V[None], model)
    e, s, used = (np.stack(part)[:, 0] for part in zip(*steps, strict=True))
    out = e * np.where(used, 1.0 / np.sqrt(s), 0.0)[..., None, None]
    return Whitened(e=out[..., 0], jacobian=out[..., 1:], samples=2.0 * np.sum(has, axis=0), theta=blocks.theta)


def _innovations(
    x: FloatArray,
    has: BoolArray,
    variance: FloatArray,
    jump_var: FloatArray,
    M: FloatArray,
    V: FloatArray,
    models: BiasModels,
) -> Iterator[tuple[FloatArray, FloatArray, BoolArray]]:
    """Filter the biases of P pairs under C models, block by block.

    Args:
        x: (B, P, 2, c) residuals in column 0; columns beyond go through the same gains.
        has: (B, P) where there are samples.
        variance: (B, P) of a block's mean about the bias.
        jump_var: (B, P) jumps of the reports themselves.
        M: (C, P, 2, c) bias before the first block.
        V: (C, P) its variance.
        models: How biases wander.

    Yields:
        Innovations (C, P, 2, c), their variances (C, P), and whether they count (C, P).
    """
    prior, decay = models.std[:, None] ** 2, models.decay[:, None]
    renewed = (1.0 - decay**2) * prior + jump_var[:, None, :]
    for b in range(len(x)):
        M, V = decay[..., None, None] * M, decay**2 * V + renewed[b]
        s = V + variance[b]
        e = x[b] - M
        if not has[b].any():
            yield e, s, np.broadcast_to(has[b], s.shape)
            continue
        # a pair that begins only now, after a tracker's swap: its earlier residuals carry no information about the pose
        outlier = has[b] & (np.sum(e[..., 0] ** 2, axis=2) > _OUTLIER * s)
        used = has[b] & ~outlier
        yield e, s, used
        gain = np.where(used, V / s, 0.0)
        M = np.where(outlier[..., None, None], 0.0, M + gain[..., None, None] * e)
        V = np.where(outlier, prior, V - gain * V)


def log_evidence(
    blocks: Blocks,
    tracks: IntArray,
    vehicles: IntArray,
    theta: FloatArray,
    state: PairState,
    noise: Noise,
    models: BiasModels,
) -> FloatArray:
    """Return the evidence of models of the biases by the residuals of some pairs.

    ln p = −Σ ln s − ½ Σ |e|²/s over the innovations e of each pair's bias filter

    Args:
        blocks: All residuals.
        tracks: (P,) columns.
        vehicles: (P,) vehicles.
        theta: (9,) correction to evaluate at.
        state: State of the bias filters before the first block; unknown biases start from the model's own prior.
        noise: Noise levels; its bias part is not used.
        models: C of them.

    Returns:
        (C,) up to a constant.
    """
    has = blocks.count[:, tracks, vehicles] > 0
    x = blocks.mean[:, tracks, vehicles] + blocks.jacobian[:, tracks] @ (theta - blocks.theta)
    variance = _own_variance(blocks, tracks, vehicles, noise)
    M = np.broadcast_to(state.mean[tracks, vehicles][..., None], (len(models.std), len(tracks), 2, 1))
    V = np.minimum(state.var[tracks, vehicles], models.std[:, None] ** 2)
    total = np.zeros(V.shape)
    for e, s, used in _innovations(x[..., None], has, variance, blocks.jump_var[:, vehicles], M, V, models):
        total -= np.where(used, np.log(s) + 0.5 * np.sum(e[..., 0] ** 2, axis=2) / s, 0.0)
    return np.asarray(np.sum(total, axis=1))


def misfit(white: Whitened, theta: FloatArray) -> FloatArray:
    """(P,) ½ Σ e² of each pair at θ."""
    e = white.e + white.jacobian @ (theta - white.theta)
    return np.asarray(0.5 * np.sum(e * e, axis=(0, 2)))


def fit(white: Whitened, prior: PosePrior) -> Fitted:
    """θ of least cost, with pairs that fit badly weighted down.

    Args:
        white: Innovations of the matched pairs.
        prior: Prior of θ.

    Returns:
        θ with its uncertainty, and what the fitted freedom costs in the evidence.
    """
    precision: FloatArray = np.diag(1.0 / prior.std**2)
    theta = white.theta
    H = precision
    for _ in range(_ROUNDS):
        d2 = 2.0 * misfit(white, theta)
        # weight of a pair: min(1, 2·dof/d²)
        weight = np.minimum(1.0, 2.0 * np.maximum(white.samples, 1.0) / np.maximum(d2, 1e-9))
        J = (white.jacobian * np.sqrt(weight)[:, None, None]).reshape(-1, THETA)
        e = (white.e * np.sqrt(weight)[:, None]).reshape(-1)
        H = precision + J.T @ J
        # (Λ + JᵀJ) θ = Λμ + Jᵀ(J θ₀ − e)
        theta = np.asarray(np.linalg.solve(H, precision @ prior.mean + J.T @ (J @ white.theta - e)), np.float64)
    cost = 0.5 * (np.linalg.slogdet(precision)[1] - np.linalg.slogdet(H)[1])
    return Fitted(theta=theta, std=np.sqrt(np.diagonal(np.linalg.inv(H))), cost=float(cost))
