"""Motion of the camera beyond what is known of it, seen from all tracks and boxes at once.

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

Floats = NDArray[np.float64]
Indices = NDArray[np.intp]

ANCHORS = 6
"""Tracks from which candidates are made, each together with the one that is farthest from it."""
VOTERS = 16
"""Tracks by which the candidates are compared before the best of them are refined."""
PARTNERS = 3
"""Number of the farthest tracks that anchors take in turn as their partner."""
FINALISTS = 5
"""Candidates that are refined."""
REFINEMENTS = 2
"""Rounds of least squares, each on the pairs that fit the last one."""
MAX_NEAR = 12
"""Boxes that are considered for each track, the nearest ones."""
TURN_STD = 0.03
"""1σ of the rotation in one frame, rad: as fast as a fixed camera that looks ahead rolls in gusts."""
ZOOM_STD = 0.015
"""1σ of the change of scale in one frame: perspective that the model does not contain, and climbing."""
COMPATIBLE = 12.0
"""Squared distance from the nearest candidate below which two pairs make one (2 degrees of freedom)."""
SIZE_STD = 0.2
"""1σ of the logarithm of a box's size relative to its track's."""
AXIS_LIMIT = 0.6
"""Largest difference of axes, rad, of a track and its box, if both are elongated."""
ELONGATED = 1.25
"""Ratio of sides above which a box has an axis that counts."""
TOLERANCE = 0.2
"""1σ of what a candidate leaves before it is refined, sizes."""
MOTION_WEIGHT = 3.0
"""Weight of ln(1 + d²/2σ²), the prior of a displacement d: its tails are heavy since gusts come suddenly."""
EVIDENT_SHARE = 0.9
"""Share of all that could be explained from which a small motion is taken without looking for another."""
MIN_GAIN = 12.0
"""A motion has to explain more than none by as much, in units of the squared distance; less may be chance."""
_PRECISION = np.diag([1e-9, 1e-9, TURN_STD**-2, ZOOM_STD**-2])
"""Λ of θ in least squares: shifts are free."""


@dataclass(frozen=True, slots=True, kw_only=True)
class BoxShapes:
    """n boxes, of tracks where they are expected or of a frame."""

    centre: Floats
    """(n, 2) px."""
    size: Floats
    """(n,) √(w h), px."""
    axis: Floats
    """(n,) direction of the longer side, rad modulo π; NaN where no side is clearly longer."""

    @classmethod
    def of(cls, rows: Floats) -> BoxShapes:
        """Read rows cx cy w h angle, (n, 5)."""
        w, h = rows[:, 2], rows[:, 3]
        axis = rows[:, 4] + np.where(w < h, 0.5 * np.pi, 0.0)
        long = np.maximum(w, h) > ELONGATED * np.minimum(w, h)
        return cls(centre=rows[:, :2], size=np.maximum(np.sqrt(w * h), 1.0), axis=np.where(long, axis, np.nan))


@dataclass(frozen=True, slots=True, kw_only=True)
class Lens:
    """Optics of the camera, as far as they are known."""

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
    """Share of all that could be explained."""
    moved_px: float
    """Displacement of the middle of the tracks."""


def align(
    tracks: BoxShapes, variance: Floats, boxes: BoxShapes, *, worth: Floats, reach: Floats, usual_px: float, lens: Lens
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
    """
    pairs = _near(tracks, boxes, variance, worth, reach, lens)
    if len(pairs.motion) < 3:
        # two tracks cannot show more than a shift: any two boxes fit some rotation and scale
        pairs.motion[:, :, 2:] = 0.0
    prior = _Prior(mean=pairs.motion.mean(axis=0), usual_px=usual_px)
    possible = float(np.sort(worth)[-len(boxes.centre) :].sum())
    none = np.zeros((1, 4))
    theta, score = _best(none, pairs, tracks.size, prior, len(boxes.centre))
    if score < EVIDENT_SHARE * possible:
        order = np.argsort(variance, kind="stable")[:VOTERS]
        found = _candidates(pairs.of(order), tracks.centre[order])
        if len(found) > FINALISTS:
            loose = variance[order] + (TOLERANCE * tracks.size[order]) ** 2
            rough = _fit(found, pairs.of(order), loose).max(axis=2).sum(axis=1) - prior.penalty(found)
            found = found[np.argpartition(-rough, FINALISTS)[:FINALISTS]]
        theta, score = _best(np.concatenate([none, found]), pairs, tracks.size, prior, len(boxes.centre))
    moved = float(np.linalg.norm(prior.mean @ theta))
    return Alignment(H=_homography(theta, lens), score=score, share=score / possible, moved_px=moved)


@dataclass(frozen=True, slots=True, kw_only=True)
class _PairPoints:
    """n tracks and c boxes that each of them may have."""

    motion: Floats
    """(n, 2, 4) A of each track."""
    variance: Floats
    """(n,) px²."""
    offset: Floats
    """(n, c, 2) from track to box, px."""
    value: Floats
    """(n, c) of a pair that fits exactly, -inf where there is none."""
    column: Indices
    """(n, c) of the box."""

    def of(self, rows: Indices) -> _PairPoints:
        """Return the pairs of some of the tracks."""
        return _PairPoints(
            motion=self.motion[rows],
            variance=self.variance[rows],
            offset=self.offset[rows],
            value=self.value[rows],
            column=self.column[rows],
        )


def _near(
    tracks: BoxShapes, boxes: BoxShapes, variance: Floats, worth: Floats, reach: Floats, lens: Lens
) -> _PairPoints:
    """The nearest compatible boxes of each track."""
    between = boxes.centre - tracks.centre[:, None]
    squared = (between * between).sum(axis=2)
    turned = np.abs((boxes.axis - tracks.axis[:, None] + 0.5 * np.pi) % np.pi - 0.5 * np.pi)
    with np.errstate(invalid="ignore"):
        possible = (squared < (reach * reach)[:, None]) & ~(turned > AXIS_LIMIT)
    squared = np.where(possible, squared, np.inf)
    most = min(int(possible.sum(axis=1).max(initial=1)) or 1, MAX_NEAR)
    column = np.argsort(squared, axis=1, kind="stable")[:, :most]
    larger = np.log(boxes.size[column] / tracks.size[:, None]) / SIZE_STD
    rows = np.arange(len(column))[:, None]
    return _PairPoints(
        motion=_motion(tracks.centre - lens.middle, lens.focal_px),
        variance=variance,
        offset=between[rows, column],
        value=np.where(possible[rows, column], worth[:, None] - larger * larger, -np.inf),
        column=column,
    )


def _best(theta: Floats, pairs: _PairPoints, size: Floats, prior: _Prior, boxes: int) -> tuple[Floats, float]:
    """The best of candidates (h, 4) after refinement, and its score; zero if none is clearly better than that."""
    none = np.zeros((1, 4))
    spread = TOLERANCE * size
    for _ in range(REFINEMENTS):
        theta = _refined(_fit(theta, pairs, pairs.variance + spread * spread), pairs)
        spread = 0.5 * spread
    theta = np.concatenate([none, theta])
    score = _explained(_fit(theta, pairs, pairs.variance), pairs.column, boxes) - prior.penalty(theta)
    best = int(np.argmax(score))
    if score[best] < score[0] + MIN_GAIN:
        best = 0
    return theta[best], float(score[best])


def _motion(p: Floats, focal_px: float) -> Floats:
    """A (n, 2, 4) at places (n, 2) px relative to the middle."""
    x, y = p[:, 0], p[:, 1]
    A = np.zeros((len(p), 2, 4))
    A[:, :, :2] = np.eye(2) + p[:, :, None] * p[:, None, :] / focal_px**2
    A[:, 0, 2], A[:, 0, 3], A[:, 1, 2], A[:, 1, 3] = -y, x, x, y
    return A


@dataclass(frozen=True, slots=True, kw_only=True)
class _Prior:
    """Prior of the motions that are to be expected."""

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


def _candidates(pairs: _PairPoints, place: Floats) -> Floats:
    """θ (h, 4) of two tracks each, one of the first and another far from it, with every two boxes that fit."""
    found = [np.empty((0, 4))]
    seen = np.flatnonzero(np.isfinite(pairs.value[:, 0]))
    between = place[seen][:, None] - place[seen]
    farthest = np.argsort(-(between * between).sum(axis=2), axis=1, kind="stable")
    couples: dict[tuple[int, int], None] = {}
    for k in range(min(len(seen), ANCHORS)):
        # not always the farthest, which may be where something else has a box
        partner = int(farthest[k, min(k % PARTNERS, max(len(seen) - 2, 0))])
        couples[min(k, partner), max(k, partner)] = None
    for k, partner in couples:
        two = seen[[k, partner]]
        one, other = (pairs.offset[i][np.isfinite(pairs.value[i])] for i in two)
        J, w = pairs.motion[two].reshape(-1, 4), np.repeat(1.0 / pairs.variance[two], 2)
        # d = (one, other) gives θ = G d, G = (Jᵀ W J + Λ)⁻¹ Jᵀ W, and is dᵀ Q d away from it, Q = W − W J G
        G = np.linalg.solve((J.T * w) @ J + _PRECISION, J.T * w)
        Q = np.diag(w) - w[:, None] * (J @ G)
        left = _squares(one, Q[:2, :2])[:, None] + _squares(other, Q[2:, 2:]) + 2.0 * one @ Q[:2, 2:] @ other.T
        i, j = np.nonzero(left < COMPATIBLE)
        found.append(one[i] @ G[:, :2].T + other[j] @ G[:, 2:].T)
    return np.concatenate(found)


def _squares(d: Floats, Q: Floats) -> Floats:
    """dᵀ Q d of rows d (p, 2), (p,)."""
    return np.asarray(((d @ Q) * d).sum(axis=1))


def _fit(theta: Floats, pairs: _PairPoints, variance: Floats) -> Floats:
    """Score with which θ (h, 4) explains each track with each of its boxes, (h, n, c), at least 0."""
    # |offset − A θ|² / variance
    moved = np.tensordot(theta, pairs.motion, axes=(1, 2))[:, :, None]
    x, y = pairs.offset[..., 0] - moved[..., 0], pairs.offset[..., 1] - moved[..., 1]
    return np.asarray(np.maximum(pairs.value - (x * x + y * y) / variance[:, None], 0.0))


def _refined(fit: Floats, pairs: _PairPoints) -> Floats:
    """θ (h, 4) by least squares on the best pair of each track that has one."""
    best = fit.argmax(axis=2)
    rows, A = np.arange(len(pairs.motion)), pairs.motion
    w = (fit.max(axis=2) > 0.0) / pairs.variance
    # θ = (Σ w AᵀA + Λ)⁻¹ Σ w Aᵀd
    N = np.tensordot(w, A.transpose(0, 2, 1) @ A, axes=(1, 0)) + _PRECISION
    g = np.einsum("hn,nik,hni->hk", w, A, pairs.offset[rows, best])
    return np.asarray(np.linalg.solve(N, g[..., None])[..., 0])


def _explained(fit: Floats, column: Indices, boxes: int) -> Floats:
    """(h,) by how much boxes and tracks are explained, a box by one track only."""
    best, value = fit.argmax(axis=2), fit.max(axis=2)
    by_box = np.zeros((len(fit), boxes))
    np.maximum.at(by_box, (np.arange(len(fit))[:, None], column[np.arange(len(column)), best]), value)
    return np.asarray(by_box.sum(axis=1))


def _homography(theta: Floats, lens: Lens) -> Floats:
    """(3, 3) of a motion θ, exact to second order."""
    (tx, ty, r, s), bend = theta, lens.focal_px**-2
    # about the middle: (p + t + r p⊥ + s p) / (1 − t·p / f²)
    H = np.array([[1.0 + s, -r, tx], [r, 1.0 + s, ty], [-tx * bend, -ty * bend, 1.0]])
    to, back = np.eye(3), np.eye(3)
    to[:2, 2], back[:2, 2] = -lens.middle, lens.middle
    return np.asarray(back @ H @ to)
