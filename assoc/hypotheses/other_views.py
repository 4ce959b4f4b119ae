"""Evidence from the views of other cameras over the same fleet: what they learnt of the vehicles' receivers.

A receiver's error is the same in whichever picture its vehicle is. A view A that surely knows vehicle v has estimated
v's bias as N(m, V). What is left of its camera's errors θ moves each place on the ground by J θ: all that it sees alike
by some c_A, as its level position and its tilt do, and each by J' θ, with J' = J − mean J, more. So in a view B, with
c = c_A − c_B,

    p(b_v | A) = N(b_v; λ (m − ĉ), λ² (V + ½ tr J' Σ J'ᵀ + σ_c²) + (1 − λ²) σ_b²),  λ = exp(−|Δt| / τ)

takes the place of the prior N(0, σ_b²) of every pair of a track and v of which nothing was compared yet, so that the
likelihood of each pair, and with it names and B's own pose, follow as ever. The process is reversible in time: what was
learnt later tells of earlier, too. ĉ and σ_c come from the vehicles that both know,

    σ_c⁻² = s⁻² + Σ_v 1 / (V_A + V_B),   ĉ = σ_c² Σ_v (m_A − m_B) / (V_A + V_B),   c ~ N(0, s²) before;

while B knows nobody, its own pose, which is fitted, takes c, and may be off by as much as both.

A vehicle that B knows itself goes on by B's own evidence. So what was told takes the place of a prior, and is never
multiplied with one: no evidence counts twice, however often it goes to and fro.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from assoc.evidence.likelihood import PairState
from assoc.hypotheses.search import Hypothesis
from assoc.records import CameraState

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

_STALE = 0.5
"""Age, in τ, from which on what this view learnt of a vehicle itself gives way to what is told."""
_FRAME_VAR = 2.0 * (1.3**2 + 0.8**2)
"""s², m²: of two cameras' level positions per axis as the identifier assumes them, and of tilts of 1.2° from 40 m."""
_FAR_STDS = 3.0
"""A bias further out, in its prior's 1σ, is rather that of another vehicle, whose track has the wrong name."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LearntBiases:
    """Biases of k receivers that one view learnt from its boxes."""

    system_id: IntArray
    """(k,) of the vehicles."""
    t_us: IntArray
    """(k,) when, on the telemetry's clock, Unix µs."""
    mean: FloatArray
    """(k, 2) east and north, metres."""
    var: FloatArray
    """(k,) per axis, m²: also for how the camera's own errors move one place more than another."""

    @staticmethod
    def best_of(told: Sequence[LearntBiases]) -> LearntBiases:
        """The biases that are known best, of what several views told."""
        joined = {name: np.concatenate([getattr(each, name) for each in told]) for name in LearntBiases.__slots__}
        order = np.argsort(joined["var"], kind="stable")
        _, first = np.unique(joined["system_id"][order], return_index=True)
        return LearntBiases(**{name: values[order[first]] for name, values in joined.items()})


class SharedBiases:
    """Biases of n vehicles that this view learnt and has to tell, and those that the others told it."""

    def __init__(self, n: int) -> None:
        self._own_t, self._own_mean, self._own_var = np.zeros(n), np.zeros((n, 2)), np.full(n, np.inf)
        self._t, self._mean, self._var = np.zeros(n), np.zeros((n, 2)), np.full(n, np.inf)

    def learn(self, t: float, rows: IntArray, best: Hypothesis) -> None:
        """Have the biases to tell of some tracks of the best hypothesis, its rows (p,), at time t, seconds."""
        vehicles = best.vehicle[rows]
        self._own_t[vehicles], self._own_mean[vehicles] = t, best.final.mean[rows, vehicles]
        self._own_var[vehicles] = best.final.var[rows, vehicles] + _place_var(best, rows)

    def forget(self, vehicles: Sequence[int] | None = None) -> None:
        """Have nothing to tell of some vehicles any more; None: of all."""
        self._own_var[slice(None) if vehicles is None else list(vehicles)] = np.inf

    def told(self, system_ids: IntArray, origin_us: int) -> LearntBiases:
        """The biases that there are to tell.

        Args:
            system_ids: (n,) of the vehicles.
            origin_us: Unix time of this view's second 0, µs.
        """
        known = np.flatnonzero(np.isfinite(self._own_var))
        t_us = origin_us + np.rint(self._own_t[known] * 1e6).astype(np.int64)
        return LearntBiases(
            system_id=system_ids[known], t_us=t_us, mean=self._own_mean[known], var=self._own_var[known]
        )

    def hear(self, system_ids: IntArray, origin_us: int, told: LearntBiases) -> None:
        """Take what the others know of these vehicles (n,) in place of what they told before; second 0: as above."""
        self._var[:] = np.inf
        place = {system_id: k for k, system_id in enumerate(system_ids.tolist())}
        ours = [k for k, system_id in enumerate(told.system_id.tolist()) if system_id in place]
        rows = [place[system_id] for system_id in told.system_id[ours].tolist()]
        self._t[rows], self._mean[rows] = (told.t_us[ours] - origin_us) * 1e-6, told.mean[ours]
        self._var[rows] = told.var[ours]

    def better_of(
        self, t: FloatArray, mean: FloatArray, var: FloatArray, bias_std: float, tau_s: float
    ) -> tuple[FloatArray, FloatArray, BoolArray]:
        """Biases as told, where they are known better so than they were.

        Args:
            t: (T,) when, seconds.
            mean: (T, n, 2) as they were known without it, metres.
            var: (T, n) variances per axis, m².
            bias_std: σ_b, metres.
            tau_s: τ, seconds.

        Returns:
            Means, variances, and (T, n) which are as told.
        """
        if np.isinf(self._var).all():
            return mean, var, np.zeros(var.shape, np.bool_)
        prior = bias_std**2
        shift, shift_var = self._frame(prior, tau_s)
        told_mean = self._mean - shift
        usable = np.sum(told_mean**2, axis=1) < _FAR_STDS**2 * (prior + self._var + shift_var)
        unknown = np.isinf(self._own_var) | (t[:, None] - self._own_t > _STALE * tau_s)
        decay = np.exp(-np.abs(t[:, None] - self._t) / tau_s)
        told_var = decay**2 * np.minimum(self._var + shift_var, prior) + (1.0 - decay**2) * prior
        better = np.isfinite(self._var) & usable & unknown & (told_var < var)
        told = decay[..., None] * told_mean
        return np.where(better[..., None], told, mean), np.where(better, told_var, var), better

    def _frame(self, prior: float, tau_s: float) -> tuple[FloatArray, float]:
        """ĉ (2,), metres, and σ_c², m²; prior: σ_b², m²."""
        own = np.isfinite(self._own_var)
        both = own & np.isfinite(self._var)
        if not own.any():
            return np.zeros(2), 0.0
        decay = np.exp(-np.abs(self._t - self._own_t)[both] / tau_s)
        apart = decay[:, None] * self._mean[both] - self._own_mean[both]
        weight = 1.0 / (decay**2 * self._var[both] + (1.0 - decay**2) * prior + self._own_var[both])
        total = float(np.sum(weight)) + 1.0 / _FRAME_VAR
        return weight @ apart / total, 1.0 / total

    def placed(self, camera: CameraState, usual_m: float) -> CameraState:
        """The camera, whose level position takes the others' error too while this view knows nobody itself.

        Args:
            camera: as it is known.
            usual_m: 1σ of its level position per axis where it does not say, metres.
        """
        if np.isinf(self._var).all() or np.isfinite(self._own_var).any():
            return camera
        own_m = camera.position_std_m if np.isfinite(camera.position_std_m) else usual_m
        return replace(camera, position_std_m=float(np.hypot(own_m, np.sqrt(0.5 * _FRAME_VAR))))

    def begun(self, state: PairState, begun_s: FloatArray, bias_std: float, tau_s: float) -> PairState:
        """The evidence of T tracks before the first block: of pairs that were not compared yet with what was told.

        Args:
            state: of the tracks.
            begun_s: (T,) when they were seen first, seconds.
            bias_std: σ_b, metres.
            tau_s: τ, seconds.
        """
        known = np.where(state.seen, 0.0, state.var)
        mean, var, better = self.better_of(begun_s, state.mean, known, bias_std, tau_s)
        if not better.any():
            return state
        return replace(state, mean=mean, var=np.where(better, var, state.var))


def _place_var(best: Hypothesis, rows: IntArray) -> FloatArray:
    """(p,) ½ tr J' Σ J'ᵀ in each track's last block, m²."""
    if not len(rows):
        return np.zeros(0)
    blocks = best.blocks
    has = blocks.count[:, rows, best.vehicle[rows]] > 0
    last = len(has) - 1 - np.argmax(has[::-1], axis=0)
    jacobian = blocks.jacobian[last, rows]
    moved = (jacobian - np.mean(jacobian, axis=0)) * best.theta_std
    return np.asarray(0.5 * np.sum(moved**2, axis=(1, 2)))
