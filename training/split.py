"""Labelled images in two parts that show different places, as far as folders and names tell.

Neighbouring frames of a film show the same vehicles: a network that learnt one of them is not measured by the other.
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import PurePath

import numpy as np

from vision.errors import LabelError
from vision.evaluation import LabelledImage

KEPT_FOLDERS = frozenset(("val", "valid", "validation", "test"))
"""Folders that are never trained on, as data sets have them."""
TRIES = 500
"""Random sets of groups of which the best is taken: all of them where there are up to eight groups, likely."""
MIN_SHARE, MAX_SHARE = 0.3, 2.5
"""Limits, times the wanted share: a set of groups beyond is too small to measure with, or leaves too little."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Split:
    """Two parts of some images."""

    rest: tuple[LabelledImage, ...]
    kept: tuple[LabelledImage, ...]
    how: str
    """Description of the kept part, in words."""


def split(images: Sequence[LabelledImage], share: float, seed: int) -> Split:
    """Keep a share of images apart: folders named so, else whole folders or sequences, else the last in order of names.

    A sequence is what has one name but for the number at its end.

    Args:
        images: at least two.
        share: of the labelled objects, wanted in the kept part.

    Raises:
        LabelError: there are fewer than two images, or all lie in folders that are kept apart.
    """
    if len(images) < 2:
        raise LabelError(f"{len(images)} labelled images cannot be split; wanted some to train on and some to measure")
    named = np.array([bool(KEPT_FOLDERS & {p.lower() for p in PurePath(i.name).parts[:-1]}) for i in images])
    if named.all():
        raise LabelError("all images lie in folders of validation or test data; nothing is left to train on")
    if named.any():
        return _parts(images, named, "the folders for validation and test")
    for how, keys in (
        ("whole folders", [str(PurePath(i.name).parent) for i in images]),
        ("whole sequences", [_sequence(i.name) for i in images]),
    ):
        chosen = _groups(keys, np.array([1 + len(i.truth) for i in images]), share, seed)
        if chosen is not None:
            return _parts(images, chosen, how)
    count = min(max(round(share * len(images)), 1), len(images) - 1)
    last = np.arange(len(images)) >= len(images) - count
    return _parts(images, last, "the last in order of names: their neighbours may show the same vehicles")


def _parts(images: Sequence[LabelledImage], kept: np.ndarray, how: str) -> Split:
    return Split(
        rest=tuple(image for image, apart in zip(images, kept, strict=True) if not apart),
        kept=tuple(image for image, apart in zip(images, kept, strict=True) if apart),
        how=how,
    )


def _sequence(name: str) -> str:
    path = PurePath(name)
    return str(path.with_name(re.sub(r"[\W_]*\d+$", "", path.stem) or "-"))


def _groups(keys: Sequence[str], objects: np.ndarray, share: float, seed: int) -> np.ndarray | None:
    """(n,) mask of the groups that come nearest to the share, None where none comes near."""
    of_group: dict[str, list[int]] = defaultdict(list)
    for i, key in enumerate(keys):
        of_group[key].append(i)
    members = list(of_group.values())
    if len(members) < 2:
        return None
    size = np.array([objects[own].sum() for own in members]) / objects.sum()
    rng = np.random.default_rng(seed)
    tried = rng.random((TRIES, len(members))) < rng.uniform(0.0, 2.0 * share, (TRIES, 1))
    tried = np.concatenate([tried, np.eye(len(members), dtype=bool)])
    total = np.where(tried.any(axis=1), tried @ size, np.inf)
    best = int(np.argmin(np.abs(total - share)))
    if not MIN_SHARE * share <= total[best] <= min(MAX_SHARE * share, 0.5 + 1e-9):
        return None
    kept = np.zeros(len(keys), dtype=bool)
    for own, apart in zip(members, tried[best], strict=True):
        kept[own] = apart
    return kept
