"""Recall of some of the objects: of a class, of a size, of those partly hidden."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from vision.evaluation.matching import FALSE_ALARM, Matches
from vision.evaluation.precision import average_precision
from vision.evaluation.truth import HIDDEN, Truth

Floats = NDArray[np.float64]
Seen = Sequence[NDArray[np.int64]]
"""Detections by image (n,): the one that found each object at the operating score, −1 none."""

SIZES_PX = (0.0, 12.0, 16.0, 24.0, 32.0, 48.0, 64.0, 96.0, np.inf)
"""Edges of the classes by length, px."""

PLACES = ("upper third", "middle third", "lower third")
"""Places of an image's objects."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Share:
    """Number of some objects that were found at the operating score."""

    name: str
    objects: int
    found: int
    ap50: float = np.nan
    """AP50 of these alone, the others set aside; false alarms count in full for each. NaN where it is not asked for."""


def range_name(low: float, high: float) -> str:
    """``16–24``, or ``96 and more``."""
    return f"{low:g}–{high:g}" if np.isfinite(high) else f"{low:g} and more"


def by_class(score: Floats, matches: Sequence[Matches], truth: Sequence[Truth], seen: Seen) -> tuple[Share, ...]:
    """Recall and AP50 of each class that counts.

    Args:
        score: (k,) of the detections of all images.
    """
    number = np.concatenate([np.empty(0, np.int64), *(m.truth[0] for m in matches)])
    hit_name = np.concatenate([np.empty(0, np.str_), *(_hit_names(m, t) for m, t in zip(matches, truth, strict=True))])
    shares = []
    for name in sorted({str(n) for t in truth for n in t.name[t.counts]}):
        share = _share(name, (t.counts & (t.name == name) for t in truth), seen)
        mine = hit_name == name
        kept = mine | (number == FALSE_ALARM)
        shares.append(replace(share, ap50=average_precision(score[kept], mine[kept], share.objects)))
    return tuple(shares)


def by_size(truth: Sequence[Truth], seen: Seen) -> tuple[Share, ...]:
    """Recall by length, px; sizes that do not occur are left out."""
    length = [np.where(t.counts, np.maximum(t.boxes[:, 2], t.boxes[:, 3]), np.nan) for t in truth]
    shares = []
    for low, high in pairwise(SIZES_PX):
        shares.append(_share(range_name(low, high), ((one >= low) & (one < high) for one in length), seen))
    return tuple(s for s in shares if s.objects)


def by_place(truth: Sequence[Truth], seen: Seen) -> tuple[Share, ...]:
    """Recall by thirds of the objects of each image, from the top down: on oblique images the top is farthest."""
    counted = [np.where(t.counts, t.boxes[:, 1], np.nan) for t in truth]
    edges = [np.nanquantile(y, (0.0, 1 / 3, 2 / 3, 1.0)) if np.isfinite(y).any() else np.zeros(4) for y in counted]
    shares = []
    for k, name in enumerate(PLACES):
        # the lowest object belongs to the lowest third
        upto = [np.inf if k == len(PLACES) - 1 else edge[k + 1] for edge in edges]
        which = [(y >= edge[k]) & (y < high) for y, edge, high in zip(counted, edges, upto, strict=True)]
        shares.append(_share(name, which, seen))
    return tuple(s for s in shares if s.objects)


def by_hiding(truth: Sequence[Truth], seen: Seen) -> tuple[Share, ...]:
    """Recall by how hidden objects are, where labels have it; last that of objects that do not count."""
    shares = [_share(name, (t.counts & (t.hidden == k) for t in truth), seen) for k, name in enumerate(HIDDEN)]
    shares.append(_share("do not count", (~t.counts for t in truth), seen))
    return tuple(s for s in shares if s.objects)


def _hit_names(matches: Matches, truth: Truth) -> NDArray[np.str_]:
    """(m,) class of the object that each detection hit, empty for none."""
    number = matches.truth[0]
    return np.asarray(np.append(truth.name, "")[np.where(number >= 0, number, len(truth))], dtype=np.str_)


def _share(name: str, which: Iterable[NDArray[np.bool_]], seen: Seen) -> Share:
    objects = found = 0
    for mask, by in zip(which, seen, strict=True):
        objects, found = objects + int(mask.sum()), found + int((by[mask] >= 0).sum())
    return Share(name=name, objects=objects, found=found)
