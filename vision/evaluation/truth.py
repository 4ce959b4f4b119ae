"""Truth: what is really on an image, and which of it counts."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from vision.detect.yolo_classes import vehicle_classes
from vision.errors import LabelError

Image = NDArray[np.uint8]
Floats = NDArray[np.float64]

HIDDEN = ("in full sight", "partly hidden", "mostly hidden")
"""Values of ``Truth.hidden``; −1 where it is not given."""
REGION = "ignored regions"
"""Name of an area in which nothing was labelled."""
NEITHER = frozenset(
    ("motor", "motorcycle", "motorbike", "bicycle", "bike", "tricycle", "awning-tricycle", "others", REGION)
)
"""Classes that neither count nor are background unless they are chosen: they are much like vehicles."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Truth:
    """The n labelled objects of one image."""

    boxes: Floats
    """(n, 5) cx, cy, w, h px, angle rad."""
    heading: Floats
    """(n,) clockwise from image up, rad, NaN where labels do not have the front."""
    name: NDArray[np.str_]
    """(n,) of the class."""
    counts: NDArray[np.bool_]
    """(n,) False: neither helps nor hurts."""
    hidden: NDArray[np.int64]
    """(n,) index into HIDDEN, −1 unknown."""
    upright: bool = False
    """Labels are upright boxes: a detection is judged by the upright box around it."""

    def __post_init__(self) -> None:
        n = len(self.name)
        wanted = {"boxes": (n, 5), "heading": (n,), "counts": (n,), "hidden": (n,)}
        for key, shape in wanted.items():
            if getattr(self, key).shape != shape:
                raise ValueError(f"truth needs {key} of shape {shape}, got {getattr(self, key).shape}")

    def __len__(self) -> int:
        return len(self.name)

    def select(self, index: NDArray[np.bool_]) -> Truth:
        """The objects of a mask (n,)."""
        kept = {key: getattr(self, key)[index] for key in ("boxes", "heading", "name", "counts", "hidden")}
        return replace(self, **kept)


@dataclass(frozen=True, slots=True, kw_only=True)
class LabelledImage:
    """One labelled image; its pixels are read on demand."""

    name: str
    """Path below the folder, or shard and number."""
    read: Callable[[], Image]
    """(H, W, 3) BGR.

    Raises:
        LabelError: the file is no image.
    """
    truth: Truth
    gsd_m: float = np.nan
    """Metres on the ground per pixel, NaN where the labels do not have it."""
    as_seen: bool = False
    """A training crop: Rollcall's own network takes it unscaled."""

    def ground_resolution_m(self, native_m: float | None) -> float | None:
        """Resolution that is given to a detector, metres per pixel, None unknown.

        Args:
            native_m: at which the detector sees images unscaled, None for one that does not scale them.
        """
        if np.isfinite(self.gsd_m):
            return self.gsd_m
        return native_m if self.as_seen else None


@dataclass(frozen=True, slots=True, kw_only=True)
class Choice:
    """Classes that count; what is in neither set is background, and a detection on it a false alarm."""

    counts: frozenset[str]
    neither: frozenset[str]


def choose_classes(
    names: Collection[str], wanted: Sequence[str] | None = None, neither: Sequence[str] | None = None
) -> Choice:
    """Decide which of the labels' classes count.

    Args:
        wanted: names that count; None = those named like vehicles, or all where labels have only numbers.
        neither: names that neither count nor are background; None = NEITHER.

    Raises:
        LabelError: a name that does not occur, or none sounds like a vehicle.
    """
    real = sorted(set(names) - {REGION})
    spare = frozenset(neither) | {REGION} if neither is not None else NEITHER - frozenset(wanted or ())
    if wanted is None and all(name.isdigit() for name in real):
        return Choice(counts=frozenset(real) - spare, neither=spare)
    try:
        chosen = vehicle_classes(dict(enumerate(real)), len(real), wanted)
    except ValueError as error:
        present = ", ".join(real) or "none at all"
        raise LabelError(f"classes of the labels: {present}; name those that count with --classes") from error
    return Choice(counts=frozenset(real[k] for k in chosen) - spare, neither=spare)


def choose(truth: Truth, choice: Choice) -> Truth:
    """The objects that matter, with those set aside that count neither way."""
    counted, aside = (np.isin(truth.name, list(names)) for names in (choice.counts, choice.neither))
    kept = truth.select(counted | aside)
    return replace(kept, counts=kept.counts & counted[counted | aside])


def choose_in_all(
    images: Sequence[LabelledImage], wanted: Sequence[str] | None = None, neither: Sequence[str] | None = None
) -> tuple[list[LabelledImage], Choice]:
    """``choose_classes`` of all that occurs on some images, and the images with what was chosen.

    Raises:
        LabelError: as ``choose_classes``.
    """
    choice = choose_classes({str(name) for image in images for name in image.truth.name}, wanted, neither)
    return [replace(image, truth=choose(image.truth, choice)) for image in images], choice
