"""Residuals of all segments against all vehicles, and the covariance of those of one vehicle.

r_ij(t) = g_i(t) − p_j(t), per second, linear in the pose correction θ. What a right pair leaves is

    r = b_j(t) + c(t) + d_j v_j(t) + noise, Cov b_j = σ_b² exp(−|Δt|/τ),  Cov c = σ_c² exp(−|Δt|/τ_c),  d_j ~ N(0, σ_d²)

with an error b_j of the vehicle's positions that wanders, one c that all share (of the camera's place, of their
reference station), and a lateness d_j of its reports at its velocity v_j.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from assoc.evidence.blocks import Blocks, make_blocks
from assoc.evidence.likelihood import block_constants
from assoc.evidence.motion import Samples
from assoc.geometry.ground import ground_tracks
from assoc.hypotheses.priors import noise_of
from assoc.params import IdentifierParams
from assoc.whole_flight.evidence import Segments

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

_LATE_STD_S = 0.3
"""σ_d, seconds."""
_MIN_SPREAD_M = 1.0
"""Least 1σ per axis of where vehicles are in a frame, metres."""
_AREA_EVERY = 10
"""Frames from one measurement of that to the next."""


@dataclass(frozen=True, slots=True)
class Errors:
    """Size of the errors of the vehicles' positions, and the time in which they wander."""

    bias_std: float
    """σ_b per axis, metres."""
    tau_s: float
    """τ, seconds."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Residuals:
    """Residuals by block of a second, linearised at ``blocks.theta``. B blocks, S segments, n vehicles."""

    blocks: Blocks
    var: FloatArray
    """(B, S, n) variance of a block's mean beside b, c and d, m²."""
    motion: FloatArray
    """(B, S, n) ln ratio of how the samples of a block scatter to their vehicle's own past: 0 without samples."""
    speed: FloatArray
    """(B, n, 2) velocity of each vehicle, m/s."""
    jumped: FloatArray
    """(B, n) Σ ln (1 + jump²/m²) of the vehicle's reports so far."""
    aside: IntArray
    """(S, n) blocks that are left out, since the track comes from another object there, or goes on to one."""
    area_m2: float
    """Ground over which tracks are spread at a time."""

    def at(self, theta: FloatArray, common: FloatArray) -> FloatArray:
        """(B, S, n, 2) mean residuals, metres.

        Args:
            theta: (9,) pose correction.
            common: (B, 2) c, metres.
        """
        moved = self.blocks.jacobian @ (theta - self.blocks.theta) + common[:, None]
        return np.asarray(self.blocks.mean + moved[:, :, None, :])

    def rows(self, segment: int, vehicle: int, most: int) -> IntArray:
        """(a,) blocks in which a pair was compared, evenly thinned to ``most``."""
        return thinned(np.flatnonzero(self.blocks.count[:, segment, vehicle] > 0), most)

    def chain_rows(self, chain: IntArray, vehicle: int) -> tuple[IntArray, IntArray]:
        """(a,) blocks in which the segments of a chain were compared with their vehicle, (a,) and which segment."""
        which, rows = np.nonzero(self.blocks.count[:, chain, vehicle].T > 0)
        return rows, chain[which]

    def chains(self, owner: IntArray) -> Iterator[tuple[int, IntArray, IntArray]]:
        """Vehicles with segments that were compared, and (a,) blocks and (a,) segments of each.

        Args:
            owner: (S,) vehicle of each segment, −1 none.
        """
        for vehicle in np.unique(owner[owner >= 0]).tolist():
            rows, of = self.chain_rows(np.flatnonzero(owner == vehicle), vehicle)
            if len(rows):
                yield vehicle, rows, of

    def covariance(self, vehicle: int, rows: IntArray, others: IntArray, errors: Errors) -> FloatArray:
        """(2a, 2b) covariance of b + d v between blocks of one vehicle: east of all, then north of all.

        Args:
            vehicle: The vehicle.
            rows: (a,) blocks.
            others: (b,) blocks.
            errors: Their size and course.
        """
        # a jump of the reports counts like a long time
        clock = np.arange(len(self.jumped)) / errors.tau_s + self.jumped[:, vehicle]
        wanders = errors.bias_std**2 * np.exp(-np.abs(clock[rows][:, None] - clock[others]))
        late = (
            _LATE_STD_S**2 * self.speed[rows, vehicle].T[:, None, :, None] * self.speed[others, vehicle].T[:, None, :]
        )
        late[0, 0] += wanders
        late[1, 1] += wanders
        return np.asarray(late.transpose(0, 2, 1, 3).reshape(2 * len(rows), 2 * len(others)))

    def noisy_covariance(self, vehicle: int, rows: IntArray, of: int | IntArray, errors: Errors) -> FloatArray:
        """(2a, 2a) covariance of b + d v + noise of one vehicle's blocks: east of all, then north of all.

        Args:
            vehicle: The vehicle.
            rows: (a,) blocks.
            of: (a,) segments, or the one of all.
            errors: Size and course of b.
        """
        cov = self.covariance(vehicle, rows, rows, errors)
        cov[np.diag_indices_from(cov)] += np.tile(self.var[rows, of, vehicle], 2)
        return cov


def thinned(rows: IntArray, most: int) -> IntArray:
    """Every k-th of (a,) rows, so that at most ``most`` are left."""
    return rows[:: max(-(-len(rows) // most), 1)]


def residuals_at(segments: Segments, q: IdentifierParams, theta: FloatArray, errors: Errors) -> Residuals:
    """The residuals linearised at a pose correction (9,)."""
    history, log = segments.history, segments.log
    first, last = int(history.t[0]) - 1, int(history.t[history.n - 1]) + 1
    white_std_m = log.white_std_m
    noise = noise_of(
        q,
        segments.camera,
        white_std_m=white_std_m,
        bias_std=errors.bias_std,
        tau_s=errors.tau_s,
        in_view_bonus=np.zeros(log.n_vehicles),
        by_place=False,
    )
    tracks = ground_tracks(history, 0, theta, np.arange(segments.seen.shape[1]))
    samples = log.samples(first * q.block_s, (last + 1) * q.block_s)
    blocks = make_blocks(
        tracks,
        samples,
        log.n_vehicles,
        first=first,
        last=last,
        block_s=q.block_s,
        gap_max_s=q.gap_max_s,
        heading_std=q.search.heading_std,
        white_var=noise.white_var,
        pixel_var=noise.pixel_var,
    )
    var, constant = block_constants(blocks, noise)
    compared = blocks.count > 0
    # of the first block one sample says where the pair is, and not how it moves
    first_of = compared & (np.cumsum(compared, axis=0) == 1)
    share = np.where(first_of, 1.0 - 1.0 / np.maximum(blocks.count, 1.0), 1.0)
    return Residuals(
        blocks=blocks,
        var=var,
        motion=np.where(compared, np.maximum(constant - share * blocks.log_null, -q.increment_max), 0.0),
        speed=_speeds(samples, log.n_vehicles, np.asarray((first + 0.5 + np.arange(last - first + 1)) * q.block_s)),
        jumped=np.cumsum(np.log1p(blocks.jump_var / errors.bias_std**2), axis=0),
        aside=np.zeros(compared.shape[1:], np.int64),
        area_m2=min(_area_m2(tracks.p), 0.5 * float(np.exp(noise.log_area_at(theta)))),
    )


def _speeds(samples: Samples, n: int, t: FloatArray) -> FloatArray:
    """(B, n, 2) velocity of each vehicle about times (B,), m/s, by where it reports to be a second before and after."""
    speed = np.zeros((len(t), n, 2))
    for j in range(n):
        own = samples.vehicle == j
        if np.count_nonzero(own) > 1:
            for axis, p in enumerate(samples.p[own].T):
                after, before = (np.interp(t + step, samples.t[own], p) for step in (1.0, -1.0))
                speed[:, j, axis] = 0.5 * (after - before)
    return speed


def _area_m2(p: FloatArray) -> float:
    """Ground over which tracks (F, S, 2) are spread at a time, m²: 4π √det of their covariance, the median."""
    areas = []
    for row in p[::_AREA_EVERY]:
        seen = row[np.isfinite(row[:, 0])]
        if len(seen) > 3:
            spread = np.cov(seen.T) + _MIN_SPREAD_M**2 * np.eye(2)
            areas.append(4.0 * np.pi * np.sqrt(np.linalg.det(spread)))
    return float(np.median(areas)) if areas else np.inf
