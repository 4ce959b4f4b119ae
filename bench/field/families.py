"""The families of sessions by number and seed: kinds of trouble, each in a standard and a hard version.

Seeds below 200 are for tuning, those from 200 on for reporting; a number fitted on the ones is reported on the others.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from bench.field import camera_trouble as camera
from bench.field import hard, messy
from bench.field import other_trouble as other
from bench.field import standard as easy
from sim.world.scenario import Scenario

Split = Literal["tune", "report"]
Make = Callable[[int, np.random.Generator], Scenario]
Labels = tuple[str, ...]
REPORT_FROM = 200
UNRELATED = 18
"""Number of the family in which nobody who is seen is ours."""
_ROUND = 100
"""Seeds after which the kinds of session begin anew."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Version:
    """How the k-th kind of session of a family is made, and what the kinds are called."""

    make: Make
    labels: Labels
    film: Callable[[int, Scenario, np.random.Generator], Scenario] | None = None
    """What is seen instead of the flight, from the kind's number and the flight; None: the flight itself."""


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
    """The flight that is seen with the telemetry of :func:`scenario_of`, where it is another one."""
    version = FAMILIES[number].version(hard)
    if version.film is None:
        return None
    flown = scenario_of(number, hard, seed)
    return version.film(_kind(version, seed), flown, np.random.default_rng([number, hard, seed, 1]))


def has_pixels(number: int, hard: bool, seed: int) -> bool:
    """Whether frames are drawn, for the camera's motion to be seen in them; boxes are modelled all the same."""
    return "pixels" in label_of(number, hard, seed).split(", ")


def label_of(number: int, hard: bool, seed: int) -> str:
    """What kind of session of its family a seed gives."""
    version = FAMILIES[number].version(hard)
    return version.labels[_kind(version, seed)]


def seeds_of(number: int, hard: bool, split: Split, most: int | None = None) -> tuple[int, ...]:
    """Seeds of a family: one for each kind of session.

    Args:
        number: of the family.
        hard: which version.
        split: which half of the seeds.
        most: at most so many.
    """
    count = len(FAMILIES[number].version(hard).labels)
    first = REPORT_FROM if split == "report" else 0
    return tuple(range(first, first + (count if most is None else min(most, count))))


def _kind(version: Version, seed: int) -> int:
    return seed % _ROUND % len(version.labels)


_THREE = ("straight", "curved", "open")
_BIASES = tuple(f"{bias:g} m" for bias in easy.BIASES_M)
_CROWDS = tuple(f"{n} {('straight', 'curved')[k % 2]}" for k, n in enumerate(easy.CROWDS))
_CLOSE = tuple(label for label, _, _ in hard.CLOSE)
_COLUMNS = ("column 8 m", "column 9 m", "column 10 m")

_ALL: tuple[tuple[str, Make, Labels, Make, Labels], ...] = (
    ("nominal", easy.nominal, easy.GROUNDS, hard.nominal, _THREE),
    ("paper-noise", easy.paper_noise, easy.VIEWS, hard.paper_noise, hard.DENSE),
    ("corr-gnss", easy.corr_gnss, _BIASES, hard.corr_gnss, _CLOSE),
    ("attitude", easy.attitude, easy.GROUNDS, hard.attitude, _THREE),
    ("timing", easy.timing, easy.GROUNDS, hard.timing, _THREE),
    ("false-pos", easy.false_positives, easy.GROUNDS, hard.false_positives, _THREE),
    ("occlusion", easy.occlusion, easy.GROUNDS, hard.occlusion, _THREE),
    ("in-out", easy.in_out, easy.GROUNDS, hard.in_out, hard.WIDE),
    ("hard-geom", easy.hard_geometry, easy.FORMATIONS, hard.hard_geometry, hard.TIGHT),
    ("oblique", easy.oblique, easy.MOUNTS, hard.oblique, hard.MOUNTS),
    ("scale", easy.scale, _CROWDS, hard.scale, ("straight", "curved")),
    ("no-heading", easy.no_heading, easy.GROUNDS, hard.no_heading, _COLUMNS),
    ("bad-telem", easy.bad_telemetry, easy.FAULTS, hard.bad_telemetry, hard.FAULTS),
    ("pose-free", easy.pose_free, easy.GROUNDS, hard.pose_free, hard.BLIND),
    ("unmodelled", easy.unmodelled, easy.UNLIKE, hard.unmodelled, hard.UNLIKE),
    ("shaking", camera.shaking, camera.SHAKING, camera.shaking_hard, camera.SHAKING_HARD),
    ("spoofers", other.spoofers, other.SPOOFERS, other.spoofers_hard, other.SPOOFERS_HARD),
    ("unrelated film", other.unrelated, other.FILMS, other.unrelated_hard, other.FILMS_HARD),
    ("wrong camera", camera.wrong_camera, camera.WRONG_CAMERAS, camera.wrong_camera_hard, camera.WRONG_CAMERAS_HARD),
    ("hill", camera.hill, camera.HILLS, camera.hill_hard, camera.HILLS_HARD),
    ("other errors", other.other_errors, other.OTHER_ERRORS, other.other_errors_hard, other.OTHER_ERRORS_HARD),
    ("smooth reports", other.smooth, other.SMOOTH, other.smooth_hard, other.SMOOTH_HARD),
    ("altitudes", camera.altitudes, camera.ALTITUDES, camera.altitudes_hard, camera.ALTITUDES_HARD),
    ("messy", messy.messy, messy.MESSY, messy.messy_hard, messy.MESSY_HARD),
    ("crowded", messy.crowded, messy.CROWDED, messy.crowded_hard, messy.CROWDED_HARD),
    ("late", messy.late, messy.LATE, messy.late_hard, messy.LATE_HARD),
    ("missing", messy.missing, messy.MISSING, messy.missing_hard, messy.MISSING_HARD),
    ("unknown camera", camera.unknown, camera.UNKNOWN, camera.unknown_hard, camera.UNKNOWN_HARD),
)
"""Name, and how the standard and the hard version are made, with what their kinds are called; the n-th is family n."""

_FILMS = {UNRELATED: (other.unrelated_film, other.unrelated_film_hard)}

FAMILIES: dict[int, Family] = {}
for _number, (_name, _make, _labels, _make_hard, _labels_hard) in enumerate(_ALL, 1):
    _film, _film_hard = _FILMS.get(_number, (None, None))
    FAMILIES[_number] = Family(
        number=_number,
        name=_name,
        standard=Version(make=_make, labels=_labels, film=_film),
        hard=Version(make=_make_hard, labels=_labels_hard, film=_film_hard),
    )
