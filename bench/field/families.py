"""The families of sessions by number and seed: kinds of trouble, each in a standard and a hard version.

Seeds below 200 are for tuning, those from 200 on for reporting; a number fitted on the ones is reported on the others.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from bench.field import camera_trouble as camera
from bench.field import messy, ordinary
from bench.field import other_trouble as other
from sim.world.scenario import Scenario

Split = Literal["tune", "report"]
Make = Callable[[int, np.random.Generator], Scenario]
Labels = tuple[str, ...]
REPORT_FROM = 200
UNRELATED = 18
"""Number of the family in which nobody who is seen is ours."""
_ROUND = 100
"""Seeds after which the kinds of session begin again."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Version:
    """Recipe of the k-th kind of session of a family, and the kinds' names."""

    make: Make
    labels: Labels
    film: Callable[[int, Scenario, np.random.Generator], Scenario] | None = None
    """Scenario that is seen instead, from the kind's number and the flight; None: the flight itself."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Family:
    """One kind of trouble."""

    number: int
    name: str
    standard: Version
    hard: Version

    def version(self, hard: bool) -> Version:
        """The hard or the standard version."""
        return self.hard if hard else self.standard


def scenario_of(number: int, hard: bool, seed: int) -> Scenario:
    """One session; equal arguments give equal sessions, byte for byte.

    Raises:
        KeyError: there is no family of that number.
    """
    family = FAMILIES[number]
    made = family.version(hard).make(_kind(family.version(hard), seed), np.random.default_rng([number, hard, seed]))
    name = f"{number:02d} {family.name}{', hard' if hard else ''}: {label_of(number, hard, seed)}"
    return replace(made, name=name, seed=10_000 * number + 5_000 * hard + seed)


def film_of(number: int, hard: bool, seed: int) -> Scenario | None:
    """The flight that is seen with the telemetry of :func:`scenario_of`, where it is another ordinary."""
    version = FAMILIES[number].version(hard)
    if version.film is None:
        return None
    flown = scenario_of(number, hard, seed)
    return version.film(_kind(version, seed), flown, np.random.default_rng([number, hard, seed, 1]))


def has_pixels(number: int, hard: bool, seed: int) -> bool:
    """True if frames are drawn, for the camera's motion to be seen in them; boxes are modelled all the same."""
    return "pixels" in label_of(number, hard, seed).split(", ")


def label_of(number: int, hard: bool, seed: int) -> str:
    """Name of the kind of session that a seed gives."""
    version = FAMILIES[number].version(hard)
    return version.labels[_kind(version, seed)]


def seeds_of(number: int, hard: bool, split: Split, most: int | None = None) -> tuple[int, ...]:
    """Seeds of a family: one for each kind of session.

    Args:
        number: of the family.
        hard: which version.
        split: which half of the seeds.
        most: at most this many.
    """
    count = len(FAMILIES[number].version(hard).labels)
    first = REPORT_FROM if split == "report" else 0
    return tuple(range(first, first + (count if most is None else min(most, count))))


def _kind(version: Version, seed: int) -> int:
    return seed % _ROUND % len(version.labels)


_THREE = ("straight", "curved", "open")
_BIASES = tuple(f"{bias:g} m" for bias in ordinary.BIASES_M)
_CROWDS = tuple(f"{n} {('straight', 'curved')[k % 2]}" for k, n in enumerate(ordinary.CROWDS))
_CLOSE = tuple(label for label, _, _ in ordinary.CLOSE)
_COLUMNS = ("column 8 m", "column 9 m", "column 10 m")


def _labelled(
    make: Callable[[str, int, np.random.Generator], Scenario], labels: Labels, labels_hard: Labels
) -> tuple[Make, Labels, Make, Labels]:
    """Both versions of a family of which the label of a kind tells all."""
    standard, hard = (lambda k, rng, words=words: make(words[k], k, rng) for words in (labels, labels_hard))
    return standard, labels, hard, labels_hard


_ALL: tuple[tuple[str, Make, Labels, Make, Labels], ...] = (
    ("nominal", ordinary.nominal, ordinary.GROUNDS, ordinary.nominal_hard, _THREE),
    ("paper-noise", ordinary.paper_noise, ordinary.VIEWS, ordinary.paper_noise_hard, ordinary.DENSE),
    ("corr-gnss", ordinary.corr_gnss, _BIASES, ordinary.corr_gnss_hard, _CLOSE),
    ("attitude", ordinary.attitude, ordinary.GROUNDS, ordinary.attitude_hard, _THREE),
    ("timing", ordinary.timing, ordinary.GROUNDS, ordinary.timing_hard, _THREE),
    ("false-pos", ordinary.false_positives, ordinary.GROUNDS, ordinary.false_positives_hard, _THREE),
    ("occlusion", ordinary.occlusion, ordinary.GROUNDS, ordinary.occlusion_hard, _THREE),
    ("in-out", ordinary.in_out, ordinary.GROUNDS, ordinary.in_out_hard, ordinary.WIDE),
    ("hard-geom", ordinary.hard_geometry, ordinary.FORMATIONS, ordinary.hard_geometry_hard, ordinary.TIGHT),
    ("oblique", ordinary.oblique, ordinary.MOUNTS, ordinary.oblique_hard, ordinary.MOUNTS_HARD),
    ("scale", ordinary.scale, _CROWDS, ordinary.scale_hard, ("straight", "curved")),
    ("no-heading", ordinary.no_heading, ordinary.GROUNDS, ordinary.no_heading_hard, _COLUMNS),
    ("bad-telem", ordinary.bad_telemetry, ordinary.FAULTS, ordinary.bad_telemetry_hard, ordinary.FAULTS_HARD),
    ("pose-free", ordinary.pose_free, ordinary.GROUNDS, ordinary.pose_free_hard, ordinary.BLIND),
    ("unmodelled", ordinary.unmodelled, ordinary.UNLIKE, ordinary.unmodelled_hard, ordinary.UNLIKE_HARD),
    ("shaking", *_labelled(camera.shaking, camera.SHAKING, camera.SHAKING_HARD)),
    ("spoofers", other.spoofers, other.SPOOFERS, other.spoofers_hard, other.SPOOFERS_HARD),
    ("unrelated film", other.unrelated, other.FILMS, other.unrelated_hard, other.FILMS_HARD),
    ("wrong camera", *_labelled(camera.wrong_camera, camera.WRONG_CAMERAS, camera.WRONG_CAMERAS_HARD)),
    ("hill", *_labelled(camera.hill, camera.HILLS, camera.HILLS_HARD)),
    ("other errors", other.other_errors, other.OTHER_ERRORS, other.other_errors_hard, other.OTHER_ERRORS_HARD),
    ("smooth reports", other.smooth, other.SMOOTH, other.smooth_hard, other.SMOOTH_HARD),
    ("altitudes", *_labelled(camera.altitudes, camera.ALTITUDES, camera.ALTITUDES_HARD)),
    ("messy", *_labelled(messy.messy, messy.MESSY, messy.MESSY_HARD)),
    ("crowded", *_labelled(messy.crowded, messy.CROWDED, messy.CROWDED_HARD)),
    ("late", *_labelled(messy.late, messy.LATE, messy.LATE_HARD)),
    ("missing", *_labelled(messy.missing, messy.MISSING, messy.MISSING_HARD)),
    ("unknown camera", *_labelled(camera.unknown, camera.UNKNOWN, camera.UNKNOWN_HARD)),
    ("two boxes", *_labelled(messy.two_boxes, messy.TWO_BOXES, messy.TWO_BOXES_HARD)),
    ("bays", *_labelled(messy.bays, messy.BAYS, messy.BAYS_HARD)),
    ("zoom", *_labelled(camera.zoom, camera.ZOOM, camera.ZOOM_HARD)),
)
"""Name, and how the standard and the hard version are made, with what their kinds are called; the n-th is family n."""

_FILMS = {(UNRELATED, False): other.unrelated_film, (UNRELATED, True): other.unrelated_film_hard}

FAMILIES: dict[int, Family] = {
    number: Family(
        number=number,
        name=name,
        standard=Version(make=make, labels=labels, film=_FILMS.get((number, False))),
        hard=Version(make=make_hard, labels=labels_hard, film=_FILMS.get((number, True))),
    )
    for number, (name, make, labels, make_hard, labels_hard) in enumerate(_ALL, 1)
}
