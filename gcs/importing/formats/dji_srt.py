"""Subtitles of DJI drones, beside the video or in it, as the UAV's log.

They tell no velocity, and times of frames or of whole seconds: the path is smoothed, and where coordinates have four
decimals only, 11 m apart, that makes them fit to be used.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gcs.errors import ImportFileError
from gcs.importing.checks.row_times import numbered, row_times
from gcs.importing.checks.two_clocks import DATE_IN_UTC, film_date
from gcs.importing.formats.dji_cue import DjiCue, read_cue
from gcs.importing.formats.subtitles import SubtitleCue
from gcs.importing.smoothing import smoothed_places
from gcs.importing.vehicle_log import AngleTrack, ImportNotes, PlaceTrack, VehicleLog, ViewTrack, whole_places
from mavlink.estimation.camera_models import from_focal_length

Floats = NDArray[np.float64]

_DEG_M = 111_320.0
_NOISE_M = 0.3
"""1σ of a receiver's noise from one position to the next; the rest of its error wanders slowly."""
_LEVEL_STD_M = 1.5
_FAR_US = 86_400_000_000
_FINER = 0.25
"""Share of positions that may have fewer decimals than the others: one zero at the end comes in one of five."""
_LARGEST_STD_M = 10_000.0


def log_of_cues(source: str, cues: Iterable[SubtitleCue]) -> VehicleLog:
    """The UAV's log.

    Raises:
        ImportFileError: not one of them has a position.
    """
    skipped: Counter[str] = Counter()
    rows: list[tuple[int, DjiCue]] = []
    numbers: list[int] = []
    for number, cue in enumerate(cues, 1):
        values = read_cue(cue.text)
        if values is None:
            skipped["subtitles without a position"] += 1
        elif not whole_places(np.array([values.lat_deg]), np.array([values.lon_deg]))[0]:
            skipped["positions before the first fix, or none on Earth"] += 1
        elif cue.start_us > _FAR_US:
            skipped["times beyond a day"] += 1
        else:
            rows.append((cue.start_us, values))
            numbers.append(number)
    if not rows:
        why = ", ".join(f"{count} {reason}" for reason, count in skipped.items())
        raise ImportFileError(f"{source}: no position in it ({why}); is it a DJI drone's, with satellites in view?")
    at = np.array([(cue.lat_deg, cue.lon_deg) for _, cue in rows])
    shown_us = np.array([t for t, _ in rows], np.int64)
    ordered = row_times(shown_us, at, source, numbered("subtitle", numbers), blocks=True)
    t_us, read = ordered.t_us, [rows[k][1] for k in ordered.rows.tolist()]
    skipped.update(ordered.skipped)
    family = Counter(cue.family for cue in read).most_common(1)[0][0]
    decimals = _decimals(read)
    unix_us = np.array([cue.unix_us for cue in read], np.int64)
    zero_us, assumed = film_date("the date in its subtitles", unix_us, t_us, cut=True)
    found = [f"DJI subtitles, {family}", f"{len(read)} positions of {decimals} decimals"]
    return VehicleLog(
        source=source,
        clock="video",
        zero_us=zero_us,
        places=_places(t_us, read, decimals),
        attitudes=_angles(t_us, read, lambda cue: cue.body_deg),
        gimbal=_angles(t_us, read, lambda cue: cue.gimbal_deg),
        view=_view(t_us, read),
        notes=ImportNotes(
            found=tuple(found),
            assumed=(*((DATE_IN_UTC,) if zero_us else ()), *assumed, *ordered.assumed),
            skipped=dict(skipped),
        ),
    )


def _decimals(read: Sequence[DjiCue]) -> int:
    """Return the number of decimals that most positions have: some writers drop a zero at the end, and a few finer ones
    do not make the others so."""
    return int(np.quantile([cue.decimals for cue in read], _FINER, method="lower"))


def _places(t_us: NDArray[np.int64], read: Sequence[DjiCue], decimals: int) -> PlaceTrack:
    rounding_m = _DEG_M * 10.0**-decimals / math.sqrt(12.0)
    columns = np.array([(cue.lat_deg, cue.lon_deg, cue.alt_m, cue.height_m) for cue in read])
    return smoothed_places(
        t_us,
        columns[:, :2],
        alt_m=columns[:, 2],
        height_m=columns[:, 3],
        noise_m=_NOISE_M,
        cell_deg=10.0**-decimals,
        std_m=min(math.hypot(rounding_m, _LEVEL_STD_M), _LARGEST_STD_M),
    )


def _angles(
    t_us: NDArray[np.int64], read: Sequence[DjiCue], of: Callable[[DjiCue], tuple[float, float, float]]
) -> AngleTrack:
    angles = np.radians(np.array([of(cue) for cue in read]))
    known = np.isfinite(angles[:, 1]) & (np.abs(angles[:, 1]) <= np.pi)
    return AngleTrack(t_us=t_us[known], angles=angles[known])


def _view(t_us: NDArray[np.int64], read: Sequence[DjiCue]) -> ViewTrack:
    """Field of view by the focal length; none under digital zoom, which the focal length may have in or not."""
    focal = np.array([cue.focal_mm for cue in read])
    known, zoom = np.isfinite(focal), max(cue.zoom for cue in read)
    if not known.any():
        return ViewTrack.empty()
    if zoom != 1.0:
        values = f"a focal length of {np.median(focal[known]):.4g} mm and a digital zoom of {zoom:.2f}"
        return replace(
            ViewTrack.empty(),
            source=f"{values} in the subtitles, which do not tell whether the one has the other in it",
        )
    return ViewTrack(
        t_us=t_us[known],
        hfov=from_focal_length(focal[known]),
        source=f"focal length of {np.median(focal[known]):.3g} mm equivalent in the subtitles",
    )
