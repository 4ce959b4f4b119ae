"""Two detectors on the same images: by how much one is better, and how sure that is.

Images are the sample: each of many draws takes as many images as there are, with replacement, for both detectors the
same, and the difference of a figure is taken on them. Its interval holds 95 % of these differences (percentile
bootstrap; Efron and Tibshirani 1993, doi:10.1201/9780429246593, chapter 13).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vision.detect.detections import Detections
from vision.evaluation.centres import match_centres
from vision.evaluation.matching import ASIDE, Matches, match
from vision.evaluation.measures import Evaluation
from vision.evaluation.precision import average_precision
from vision.evaluation.truth import Truth

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

DRAWS = 400
"""Bounds of a 95 % interval are then known to about a tenth of its width."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Difference:
    """A figure of two detectors, NaN unknown."""

    name: str
    one: float
    other: float
    interval: tuple[float, float]
    """95 % of ``one − other`` over draws of the images; NaN with fewer than two images."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Comparison:
    """A detector beside another."""

    against: str
    """Name of the other."""
    other: Evaluation
    """Quality of the other by itself."""
    differences: tuple[Difference, ...]


def compare(
    one: Sequence[Detections], other: Sequence[Detections], truth: Sequence[Truth], score: float, *, seed: int = 0
) -> tuple[Difference, ...]:
    """Figures of both, and how sure their differences are."""
    objects = np.array([int(t.counts.sum()) for t in truth], dtype=np.int64)
    draws = _draws(len(truth), seed)
    differences = []
    for label, judge in (("", match), (" of centres", match_centres)):
        pair = [_judge(found, truth, judge) for found in (one, other)]
        for name, figure in _FIGURES.items():
            mine, theirs = (np.array([figure(judged, objects, times, score) for times in draws]) for judged in pair)
            known = (mine - theirs)[1:][np.isfinite((mine - theirs)[1:])]
            low, high = np.quantile(known, (0.025, 0.975)) if len(known) else (np.nan, np.nan)
            both = Difference(name=name + label, one=mine[0], other=theirs[0], interval=(float(low), float(high)))
            differences.append(both)
    return tuple(differences)


def _draws(images: int, seed: int) -> Ints:
    """(draws, images) how often each image is drawn; first each once."""
    each = np.ones((1, images), np.int64)
    if images < 2:
        return each
    return np.concatenate([each, np.random.default_rng(seed).multinomial(images, np.full(images, 1.0 / images), DRAWS)])


@dataclass(frozen=True, slots=True, kw_only=True)
class _JudgedBoxes:
    """The k detections of all images, those set aside left out."""

    score: Floats
    number: Ints
    """(k,) object, or FALSE_ALARM."""
    image: Ints
    """(k,) index of theirs."""


def _judge(
    found: Sequence[Detections], truth: Sequence[Truth], judge: Callable[[Detections, Truth], Matches]
) -> _JudgedBoxes:
    numbers = [judge(d, t).truth[0] for d, t in zip(found, truth, strict=True)]
    number = np.concatenate([np.empty(0, np.int64), *numbers])
    kept = number != ASIDE
    return _JudgedBoxes(
        score=np.concatenate([np.empty(0), *(d.score for d in found)])[kept],
        number=number[kept],
        image=np.repeat(np.arange(len(found)), [len(d) for d in found])[kept],
    )


def _ap(judged: _JudgedBoxes, objects: Ints, times: Ints, score: float) -> float:
    return average_precision(judged.score, judged.number >= 0, int(objects @ times), times[judged.image])


def _precision(judged: _JudgedBoxes, objects: Ints, times: Ints, score: float) -> float:
    given = times[judged.image] * (judged.score >= score)
    return float(given @ (judged.number >= 0)) / given.sum() if given.any() else float("nan")


def _recall(judged: _JudgedBoxes, objects: Ints, times: Ints, score: float) -> float:
    given = times[judged.image] * (judged.score >= score)
    return float(given @ (judged.number >= 0)) / int(objects @ times) if (objects @ times) else float("nan")


_FIGURES: dict[str, Callable[[_JudgedBoxes, Ints, Ints, float], float]] = {
    "AP50": _ap,
    "precision": _precision,
    "recall": _recall,
}
