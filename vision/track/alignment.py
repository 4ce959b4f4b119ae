"""How far the camera moved beyond what is known of it, seen from all tracks and boxes at once.

Expected tracks and boxes are two pictures of one constellation. The motion that leads from the first to the second has
four parameters θ = (tₓ, t_y, r, s): relative to the middle of the image, a track expected at (x, y) moves by A θ,

    A = [1 + x²/f²   x y/f²     −y   x]
        [x y/f²      1 + y²/f²   x   y]

so that t is the shift in the middle, r a rotation, s a change of scale; the terms in 1/f² are the perspective of a
camera with the focal length f that turns up or sideways. Candidates for θ come from two tracks and a box for each of
them, as in RANSAC, but all that are compatible are tried. They are compared by the likelihood of all tracks and boxes,
and the best are refined by least squares.

Reference:
    M. A. Fischler, R. C. Bolles, "Random Sample Consensus: A Paradigm for Model Fitting with Applications to Image
    Analysis and Automated Cartography", Comm. ACM 24(6), 1981, doi:10.1145/358669.358692.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["Alignment", "Boxes", "Lens", "align"]

Floats = NDArray[np.float64]
Indices = NDArray[np.intp]

ANCHORS = 6
"""Tracks from which candidates are made, each together with the one that is farthest from it."""
VOTERS = 16
"""Tracks by which the candidates are compared before the best of them are refined."""
PARTNERS = 3
"""The farthest ones, of which one anchor after the other takes the next."""
FINALISTS = 5
"""Candidates that are refined."""
REFINEMENTS = 2
"""Rounds of least squares, each on the pairs that fit the last one."""
MOST_NEAR = 16
"""Boxes that are considered for each track, the nearest ones."""
TURN_STD = 0.03
"""1σ of the rotation in one frame, rad: a fixed camera that looks ahead rolls so fast in gusts."""
ZOOM_STD = 0.015
"""1σ of the change of scale in one frame: perspective that the model does not contain, and climbing."""
COMPATIBLE = 12.0
"""Two pairs make a candidate if their squared distance from the nearest one is less (2 degrees of freedom)."""
SIZE_STD = 0.2
"""1σ of the logarithm of a box's size relative to its track's."""
AXIS_LIMIT = 0.6
"""A box whose axis differs by more from a track's, rad, is not its, if both are longer than wide ..."""
ELONGATED = 1.25
"""... by this factor."""
TOLERANCE = 0.2
"""1σ of what a candidate leaves before it is refined, sizes."""
MOTION_WEIGHT = 3.0
"""Weight of ln(1 + d²/2σ²), the prior of a displacement d: its tails are heavy since gusts come suddenly."""
LEAST_GAIN = 12.0
"""A motion has to explain more than none by as much, in units of the squared distance; less may be chance."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Boxes:
    """n boxes, of tracks where they are expected or of a frame."""

    centre: Floats
    """(n, 2) px."""
    size: Floats
    """(n,) √(w h), px."""
    axis: Floats
    """(n,) direction of the longer side, rad modulo π; NaN where no side is clearly longer."""

    @classmethod
    def of(cls, rows: Floats) -> Boxes:
        """From rows cx cy w h angle, (n, 5)."""
        w, h = rows[:, 2], rows[:, 3]
        axis = rows[:, 4] + np.where(w < h, 0.5 * np.pi, 0.0)
        long = np.maximum(w, h) > ELONGATED * np.minimum(w, h)
        return cls(centre=rows[:, :2], size=np.maximum(np.sqrt(w * h), 1.0), axis=np.where(long, axis, np.nan))


@dataclass(frozen=True, slots=True, kw_only=True)
class Lens:
    """What is known of the camera's optics."""

    middle: Floats
    """(2,) px."""
    focal_px: float = np.inf
    """Infinite where it is unknown, which leaves a similarity."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Alignment:
    """A motion common to all tracks."""

    H: Floats
    """(3, 3) homography from where tracks were expected to where they are; the identity where none is evident."""
    score: float
    """−2 ln of the likelihood that it explains, less that of its prior."""
    share: float
    """Of all that could be explained."""
    moved_px: float
    """Displacement of the middle of the tracks."""


def align(
    tracks: Boxes, variance: Floats, boxes: Boxes, *, worth: Floats, reach: Floats, usual_px: float, lens: Lens
) -> Alignment:
    """The common motion that brings tracks onto boxes, if there is evidence for one.

    Args:
        tracks: (n,) where they are expected.
        variance: (n,) px², of expected and measured place together, per axis.
        boxes: (m,) of the frame.
        worth: (n,) by how much it is better, in units of the squared distance, that a track is seen in a certain place
            than that it is missed and something else is there.
        reach: (n,) px, no track is displaced further.
        usual_px: 1σ of the displacements of the frames before.
        lens: of the camera.
    """
    n = len(tracks.centre)
    offset, value, column = _near(tracks, boxes, worth, reach)
    motion = _motion(tracks.centre - lens.middle, lens.focal_px)
    if n < 3:
        # two tracks cannot show more than a shift: any two boxes fit some rotation and scale
        motion[:, :, 2:] = 0.0
    prior = _Prior(mean=motion.mean(axis=0), usual_px=usual_px)
    order = np.argsort(variance, kind="stable")[:VOTERS]
    theta = _candidates(motion, offset, value, variance, order, tracks.centre)
    if len(theta) > FINALISTS:
        loose = variance[order] + (TOLERANCE * tracks.size[order]) ** 2
        fit = _fit(theta, motion[order], offset[order], value[order], loose)
        score = fit.max(axis=2).sum(axis=1) - prior.penalty(theta)
        theta = theta[np.argpartition(-score, FINALISTS)[:FINALISTS]]
    theta = np.concatenate([np.zeros((1, 4)), theta])
    spread = TOLERANCE * tracks.size
    for _ in range(REFINEMENTS):
        fit = _fit(theta, motion, offset, value, variance + spread * spread)
        theta = _refined(fit, motion, offset, variance)
        spread = 0.5 * spread
    theta = np.concatenate([np.zeros((1, 4)), theta])
    fit = _fit(theta, motion, offset, value, variance)
    score = _explained(fit, column, len(boxes.centre)) - prior.penalty(theta)
    best = int(np.argmax(score))
    if score[best] < score[0] + LEAST_GAIN:
        best = 0
    moved = float(np.linalg.norm(prior.mean @ theta[best]))
    possible = float(np.sort(worth)[-len(boxes.centre) :].sum())
    return Alignment(
        H=_homography(theta[best], lens), score=float(score[best]), share=float(score[best]) / possible, moved_px=moved
    )


def _near(tracks: Boxes, boxes: Boxes, worth: Floats, reach: Floats) -> tuple[Floats, Floats, Indices]:
    """The c nearest compatible boxes of each track.

    Returns:
        offset (n, c, 2) px; value (n, c) of such a pair where it fits exactly, -inf where it is none; column (n, c).
    """
    between = boxes.centre - tracks.centre[:, None]
    squared = (between * between).sum(axis=2)
    turned = np.abs((boxes.axis - tracks.axis[:, None] + 0.5 * np.pi) % np.pi - 0.5 * np.pi)
    with np.errstate(invalid="ignore"):
        possible = (squared < (reach * reach)[:, None]) & ~(turned > AXIS_LIMIT)
    squared = np.where(possible, squared, np.inf)
    most = min(int(possible.sum(axis=1).max(initial=1)) or 1, MOST_NEAR)
    column = np.argsort(squared, axis=1, kind="stable")[:, :most]
    larger = np.log(boxes.size[column] / tracks.size[:, None]) / SIZE_STD
    rows = np.arange(len(column))[:, None]
    value = np.where(possible[rows, column], worth[:, None] - larger * larger, -np.inf)
    return between[rows, column], value, column


def _motion(p: Floats, focal_px: float) -> Floats:
    """A (n, 2, 4) at places (n, 2) px relative to the middle."""
    x, y = p[:, 0], p[:, 1]
    A = np.zeros((len(p), 2, 4))
    A[:, :, :2] = np.eye(2) + p[:, :, None] * p[:, None, :] / focal_px**2
    A[:, 0, 2], A[:, 0, 3], A[:, 1, 2], A[:, 1, 3] = -y, x, x, y
    return A


@dataclass(frozen=True, slots=True, kw_only=True)
class _Prior:
    """What motions are to be expected."""

    mean: Floats
    """(2, 4) mean of A over the tracks."""
    usual_px: float

    def penalty(self, theta: Floats) -> Floats:
        """(h,) −2 ln of its density up to a constant."""
        d = theta @ self.mean.T
        unusual = 0.5 * (d * d).sum(axis=1) / self.usual_px**2
        return np.asarray(
            MOTION_WEIGHT * np.log1p(unusual) + (theta[:, 2] / TURN_STD) ** 2 + (theta[:, 3] / ZOOM_STD) ** 2
        )


_PRECISION = np.diag([1e-9, 1e-9, TURN_STD**-2, ZOOM_STD**-2])
"""Λ of θ in least squares: shifts are free."""


def _candidates(A: Floats, offset: Floats, value: Floats, variance: Floats, anchors: Indices, place: Floats) -> Floats:
    """θ (h, 4) of each two tracks, an anchor and the one farthest from it, with every box that both may have."""
    found = [np.empty((0, 4))]
    seen = anchors[np.isfinite(value[anchors, 0])]
    between = place[seen][:, None] - place[seen]
    farthest = np.argsort(-(between * between).sum(axis=2), axis=1, kind="stable")
    couples: dict[tuple[int, int], None] = {}
    for k in range(min(len(seen), ANCHORS)):
        # not always the farthest, which may be what has a box of something else
        partner = int(farthest[k, min(k % PARTNERS, max(len(seen) - 2, 0))])
        couples[min(k, partner), max(k, partner)] = None
    for a, b in [(int(seen[i]), int(seen[j])) for i, j in couples]:
        one, other = (offset[i][np.isfinite(value[i])] for i in (a, b))
        two = [a] if a == b else [a, b]
        J, w = A[two].reshape(-1, 4), np.repeat(1.0 / variance[two], 2)
        # θ = (Jᵀ W J + Λ)⁻¹ Jᵀ W d for all d = (one, other)
        gain = np.linalg.solve((J.T * w) @ J + _PRECISION, J.T * w)
        if a == b:
            found.append(one @ gain.T)
            continue
        d = np.concatenate([np.repeat(one, len(other), axis=0), np.tile(other, (len(one), 1))], axis=1)
        theta = d @ gain.T
        left = d - theta @ J.T
        distance = (left * left) @ w + (theta[:, 2:] ** 2) @ np.diagonal(_PRECISION)[2:]
        found.append(theta[distance < COMPATIBLE])
    return np.concatenate(found)


def _fit(theta: Floats, A: Floats, offset: Floats, value: Floats, variance: Floats) -> Floats:
    """How well θ (h, 4) explains each track with each of its boxes, (h, n, c), at least 0."""
    # d² = |offset − A θ|² / variance
    moved = np.tensordot(theta, A, axes=(1, 2))[:, :, None]
    x, y = offset[..., 0] - moved[..., 0], offset[..., 1] - moved[..., 1]
    return np.asarray(np.maximum(value - (x * x + y * y) / variance[:, None], 0.0))


def _refined(fit: Floats, A: Floats, offset: Floats, variance: Floats) -> Floats:
    """θ (h, 4) by least squares on the best pair of each track that has one."""
    best = fit.argmax(axis=2)
    rows = np.arange(len(A))
    w = (fit[np.arange(len(fit))[:, None], rows, best] > 0.0) / variance
    d = offset[rows, best]
    # θ = (Σ w AᵀA + Λ)⁻¹ Σ w Aᵀd
    N = np.tensordot(w, A.transpose(0, 2, 1) @ A, axes=(1, 0)) + _PRECISION
    g = np.einsum("hn,nik,hni->hk", w, A, d)
    return np.asarray(np.linalg.solve(N, g[..., None])[..., 0])


def _explained(fit: Floats, column: Indices, boxes: int) -> Floats:
    """(h,) by how much boxes and tracks are explained, a box by one track only."""
    best = fit.argmax(axis=2)
    h, n = best.shape
    rows = np.arange(n)
    by_box = np.zeros((h, boxes))
    np.maximum.at(by_box, (np.arange(h)[:, None], column[rows, best]), fit[np.arange(h)[:, None], rows, best])
    return np.asarray(by_box.sum(axis=1))


def _homography(theta: Floats, lens: Lens) -> Floats:
    """(3, 3) of a motion θ, exact to second order."""
    (tx, ty, r, s), bend = theta, lens.focal_px**-2
    # about the middle: (p + t + r p⊥ + s p) / (1 − t·p / f²)
    H = np.array([[1.0 + s, -r, tx], [r, 1.0 + s, ty], [-tx * bend, -ty * bend, 1.0]])
    to, back = np.eye(3), np.eye(3)
    to[:2, 2], back[:2, 2] = -lens.middle, lens.middle
    return np.asarray(back @ H @ to)
