"""The time of the film on the fleet's clock: as its files say, and as the user corrects that."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from gcs.errors import ImportFileError
from gcs.importing.film import ImportedFilm
from gcs.importing.vehicle_log import VehicleLog

_MIN_OVERLAP_US = 1_000_000
_MOST_OF_FILM = 0.9
"""Share of the film that a log has to cover, or its gap is reported."""
_ABOUT_US = 60_000_000
"""Time beside a film, µs, within which reports are still about it."""
_LONGER_US = 2_000_000
"""Least time, µs, by which a log outlasts its film before that is told: recorders stop one after the other."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FilmTimes:
    """Shifts from the clocks of film and UAV to the fleet's."""

    film_us: int
    """Unix µs of the film's first frame."""
    uav_shift_us: int
    """Shift from the clock of the UAV's log to Unix time, µs."""
    clock_source: str
    """Words on where the offset is from."""
    assumed: tuple[str, ...] = ()


def on_film(uav: VehicleLog, film: ImportedFilm) -> VehicleLog:
    """A log whose times are numbers of frames, with the times of these frames.

    Raises:
        ImportFileError: not one of them is in the film.
    """
    if uav.clock != "frame":
        return uav
    rows = np.flatnonzero(uav.places.t_us < len(film.elapsed_us))
    if not len(rows):
        raise ImportFileError(f"{uav.source}: its first frame comes after the film's last, {len(film.elapsed_us) - 1}")

    def timed(t_us: NDArray[np.int64]) -> NDArray[np.int64]:
        return film.elapsed_us[t_us[t_us < len(film.elapsed_us)]]

    body, gimbal, view = (track.t_us < len(film.elapsed_us) for track in (uav.attitudes, uav.gimbal, uav.view))
    return replace(
        uav,
        clock="video",
        places=replace(uav.places.select(rows), t_us=timed(uav.places.t_us)),
        attitudes=replace(uav.attitudes, t_us=timed(uav.attitudes.t_us), angles=uav.attitudes.angles[body]),
        gimbal=replace(uav.gimbal, t_us=timed(uav.gimbal.t_us), angles=uav.gimbal.angles[gimbal]),
        view=replace(uav.view, t_us=timed(uav.view.t_us), hfov=uav.view.hfov[view]),
    )


def find_timeline(
    film: ImportedFilm, uav: VehicleLog | None, fleet_span_us: tuple[int, int], clock_s: float | None
) -> FilmTimes:
    """The film's place on the fleet's clock.

    Args:
        uav: the UAV's log; None: its telemetry is in the fleet's.
        fleet_span_us: first and last position of the fleet, Unix µs.
        clock_s: by how much the fleet's clock is ahead of the film's; None: not known.
    """
    shift_us = round((clock_s or 0.0) * 1e6)
    shift_text = "" if clock_s is None else f", {clock_s:+g} s as given"
    if uav is not None and uav.clock == "video":
        start_us, source = (
            (uav.zero_us, "the date beside the positions") if uav.zero_us else _of_film(film, fleet_span_us)
        )
        film_us = start_us + shift_us
        return FilmTimes(
            film_us=film_us, uav_shift_us=film_us, clock_source=source + shift_text, assumed=_longer_words(film, uav)
        )
    start_us, source = _of_film(film, fleet_span_us)
    if uav is None:
        return FilmTimes(film_us=start_us + shift_us, uav_shift_us=0, clock_source=source + shift_text)
    first_us = int(uav.places.t_us[0])
    if uav.clock == "own":
        film_us = start_us + shift_us
        assumed = (f"{uav.source} knows no date: the film begins with it",)
        return FilmTimes(
            film_us=film_us, uav_shift_us=film_us - first_us, clock_source=source + shift_text, assumed=assumed
        )
    last_us = int(uav.places.t_us[-1])
    if film.created_us and first_us - film_length_us(film) < film.created_us + shift_us < last_us:
        return FilmTimes(film_us=film.created_us + shift_us, uav_shift_us=0, clock_source=source + shift_text)
    assumed = ("the film begins with the UAV's log",)
    return FilmTimes(
        film_us=first_us + shift_us, uav_shift_us=0, clock_source="the UAV's log" + shift_text, assumed=assumed
    )


def _longer_words(film: ImportedFilm, uav: VehicleLog) -> tuple[str, ...]:
    """Return a sentence on where a log that counts from the film's beginning goes on for long behind its end."""
    log_us, length_us = int(uav.places.t_us[-1]), film_length_us(film)
    if log_us - length_us <= max(_LONGER_US, (1.0 - _MOST_OF_FILM) * length_us):
        return ()
    return (
        f"{uav.source} tells of {log_us * 1e-6:.1f} s since the film's beginning, the film has "
        f"{length_us * 1e-6:.1f} s: is it another film's, or was this one cut?",
    )


def film_length_us(film: ImportedFilm) -> int:
    """Return the duration from the film's first frame to its last, µs."""
    return int(film.elapsed_us[-1])


def _of_film(film: ImportedFilm, fleet_span_us: tuple[int, int]) -> tuple[int, str]:
    if film.created_us:
        return film.created_us, "the date of the video's container"
    return fleet_span_us[0], "nothing: the film is taken to begin with the fleet's telemetry"


def check_overlap(
    film: ImportedFilm,
    timeline: FilmTimes,
    uav: tuple[str, tuple[int, int]],
    fleet_span_us: tuple[int, int],
    assumed: Collection[str] = (),
    vehicles: Mapping[str, tuple[int, int]] = MappingProxyType({}),
) -> tuple[str, ...]:
    """See that the UAV and the fleet report while it is filmed, and say where one of them does so in a part of it.

    Args:
        timeline: when.
        uav: what tells of the UAV, and its first and last position, Unix µs.
        vehicles: the same of each ground vehicle, of which those are told that report less than the fleet.
        assumed: of the fleet's times, for the message.

    Raises:
        ImportFileError: one of them does not.
    """
    film_us = timeline.film_us, timeline.film_us + film_length_us(film)
    taken = f"{film.path}: taken {_words(*film_us)} by {timeline.clock_source}"
    assumptions = "".join(f" ({words})" for words in assumed)
    if not _overlaps(film_us, fleet_span_us):
        raise ImportFileError(
            f"{taken}, while the fleet reports {_words(*fleet_span_us)}; give by how much the fleet's clock is ahead "
            f"of the film's: --clock +SECONDS{assumptions}"
        )
    source, span_us = uav
    if not _overlaps(film_us, span_us):
        away_s = (span_us[0] - film_us[0]) * 1e-6
        raise ImportFileError(
            f"{taken}, while {source} tells of {_words(*span_us)}, from {away_s:+.1f} s of the film on: it does not "
            "cover the film; is it of that flight, are its times in the unit of their column?"
        )
    enough_us = _MOST_OF_FILM * film_length_us(film)
    least_us = min(enough_us, _MOST_OF_FILM * _shared_us(film_us, fleet_span_us))
    reports = [(source, span_us, enough_us), ("the fleet", fleet_span_us, enough_us)]
    reports += [(who, span, least_us) for who, span in vehicles.items()]
    return tuple(_share_words(film_us, who, span) for who, span, least in reports if _shared_us(film_us, span) < least)


def _share_words(film_us: tuple[int, int], who: str, span_us: tuple[int, int]) -> str:
    shared_s = _shared_us(film_us, span_us) * 1e-6
    if shared_s > 0.0:
        return f"{who} tells of {shared_s:.1f} s of the film's {(film_us[1] - film_us[0]) * 1e-6:.1f} s"
    from_s = (span_us[0] - film_us[0]) * 1e-6
    return f"{who} tells nothing of the film: of {_words(*span_us)}, from {from_s:+.1f} s of the film on"


def _shared_us(film_us: tuple[int, int], span_us: tuple[int, int]) -> int:
    return min(film_us[1], span_us[1]) - max(film_us[0], span_us[0])


def _overlaps(film_us: tuple[int, int], span_us: tuple[int, int]) -> bool:
    return _shared_us(film_us, span_us) >= min(_MIN_OVERLAP_US, film_us[1] - film_us[0])


def is_about(film_us: tuple[int, int], span_us: tuple[int, int]) -> bool:
    """Tell whether reports, from and to Unix µs, are of a film's time, or of that shortly before or after."""
    return _shared_us(film_us, span_us) > -_ABOUT_US


def _words(first_us: int, last_us: int) -> str:
    first, last = (datetime.fromtimestamp(t // 1_000_000, UTC) for t in (first_us, last_us))
    return f"{first:%Y-%m-%d %H:%M:%S} to {last:%Y-%m-%d %H:%M:%S}"
