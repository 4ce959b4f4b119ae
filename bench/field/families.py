"""The families of sessions by number and seed: kinds of trouble, each in a standard and a hard version.

Seeds below 200 are for tuning, those from 200 on for reporting; a number fitted on the ones is reported on the others.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from bench.field import camera_trouble, messy, other_trouble, standard
from bench.field import hard as harder
from sim.world.scenario import Scenario

Split = Literal["tune", "report"]
REPORT_FROM = 200
UNRELATED = 18
"""Number of the family in which nobody who is seen is ours."""
_ROUND = 100
"""Seeds after which the kinds of session begin anew."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Version:
    """How the k-th kind of session of a family is made, and what the kinds are called."""

    make: Callable[[int, np.random.Generator], Scenario]
    labels: tuple[str, ...]
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


def _family(number: int, name: str, easy: Version, tough: Version) -> tuple[int, Family]:
    return number, Family(number=number, name=name, standard=easy, hard=tough)


def _of(
    make: Callable[[int, np.random.Generator], Scenario],
    labels: tuple[str, ...],
    film: Callable[[int, Scenario, np.random.Generator], Scenario] | None = None,
) -> Version:
    return Version(make=make, labels=labels, film=film)


_THREE = ("straight", "curved", "open")
_BIASES = tuple(f"{bias:g} m" for bias in standard.BIASES_M)
_CROWDS = tuple(f"{n} {('straight', 'curved')[k % 2]}" for k, n in enumerate(standard.CROWDS))
_CLOSE = tuple(label for label, _, _ in harder.CLOSE)
_COLUMNS = ("column 8 m", "column 9 m", "column 10 m")

FAMILIES: dict[int, Family] = dict(
    (
        _family(1, "nominal", _of(standard.nominal, standard.GROUNDS), _of(harder.nominal, _THREE)),
        _family(2, "paper-noise", _of(standard.paper_noise, standard.VIEWS), _of(harder.paper_noise, harder.DENSE)),
        _family(3, "corr-gnss", _of(standard.corr_gnss, _BIASES), _of(harder.corr_gnss, _CLOSE)),
        _family(4, "attitude", _of(standard.attitude, standard.GROUNDS), _of(harder.attitude, _THREE)),
        _family(5, "timing", _of(standard.timing, standard.GROUNDS), _of(harder.timing, _THREE)),
        _family(6, "false-pos", _of(standard.false_positives, standard.GROUNDS), _of(harder.false_positives, _THREE)),
        _family(7, "occlusion", _of(standard.occlusion, standard.GROUNDS), _of(harder.occlusion, _THREE)),
        _family(8, "in-out", _of(standard.in_out, standard.GROUNDS), _of(harder.in_out, harder.WIDE)),
        _family(
            9, "hard-geom", _of(standard.hard_geometry, standard.FORMATIONS), _of(harder.hard_geometry, harder.TIGHT)
        ),
        _family(10, "oblique", _of(standard.oblique, standard.MOUNTS), _of(harder.oblique, harder.MOUNTS)),
        _family(11, "scale", _of(standard.scale, _CROWDS), _of(harder.scale, ("straight", "curved"))),
        _family(12, "no-heading", _of(standard.no_heading, standard.GROUNDS), _of(harder.no_heading, _COLUMNS)),
        _family(
            13, "bad-telem", _of(standard.bad_telemetry, standard.FAULTS), _of(harder.bad_telemetry, harder.FAULTS)
        ),
        _family(14, "pose-free", _of(standard.pose_free, standard.GROUNDS), _of(harder.pose_free, harder.BLIND)),
        _family(15, "unmodelled", _of(standard.unmodelled, standard.UNLIKE), _of(harder.unmodelled, harder.UNLIKE)),
        _family(
            16,
            "shaking",
            _of(camera_trouble.shaking, camera_trouble.SHAKING),
            _of(camera_trouble.shaking_hard, camera_trouble.SHAKING_HARD),
        ),
        _family(
            17,
            "spoofers",
            _of(other_trouble.spoofers, other_trouble.SPOOFERS),
            _of(other_trouble.spoofers_hard, other_trouble.SPOOFERS_HARD),
        ),
        _family(
            UNRELATED,
            "unrelated film",
            _of(other_trouble.unrelated, other_trouble.FILMS, other_trouble.unrelated_film),
            _of(other_trouble.unrelated_hard, other_trouble.FILMS_HARD, other_trouble.unrelated_film_hard),
        ),
        _family(
            19,
            "wrong camera",
            _of(camera_trouble.wrong_camera, camera_trouble.WRONG_CAMERAS),
            _of(camera_trouble.wrong_camera_hard, camera_trouble.WRONG_CAMERAS_HARD),
        ),
        _family(
            20,
            "hill",
            _of(camera_trouble.hill, camera_trouble.HILLS),
            _of(camera_trouble.hill_hard, camera_trouble.HILLS_HARD),
        ),
        _family(
            21,
            "other errors",
            _of(other_trouble.other_errors, other_trouble.OTHER_ERRORS),
            _of(other_trouble.other_errors_hard, other_trouble.OTHER_ERRORS_HARD),
        ),
        _family(
            22,
            "smooth reports",
            _of(other_trouble.smooth, other_trouble.SMOOTH),
            _of(other_trouble.smooth_hard, other_trouble.SMOOTH_HARD),
        ),
        _family(
            23,
            "altitudes",
            _of(camera_trouble.altitudes, camera_trouble.ALTITUDES),
            _of(camera_trouble.altitudes_hard, camera_trouble.ALTITUDES_HARD),
        ),
        _family(24, "messy", _of(messy.messy, messy.MESSY), _of(messy.messy_hard, messy.MESSY_HARD)),
        _family(25, "crowded", _of(messy.crowded, messy.CROWDED), _of(messy.crowded_hard, messy.CROWDED_HARD)),
        _family(26, "late", _of(messy.late, messy.LATE), _of(messy.late_hard, messy.LATE_HARD)),
        _family(27, "missing", _of(messy.missing, messy.MISSING), _of(messy.missing_hard, messy.MISSING_HARD)),
        _family(
            28,
            "unknown camera",
            _of(camera_trouble.unknown, camera_trouble.UNKNOWN),
            _of(camera_trouble.unknown_hard, camera_trouble.UNKNOWN_HARD),
        ),
    )
)
