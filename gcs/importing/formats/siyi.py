"""Subtitles of SIYI cameras, in the video, as the UAV's log.

    2026-08-28_02-52-58 stream->FrameCnt:0
    focal_len:4.500000mm … latitude:S35°16′38.6″ longitude:E148°56′36.3″ rel_alt:651.65 abs_alt:651.65
    gb_yaw:14.5, gb_pitch:-80.0, gb_roll:0.0

Layout as in the tests of MAVProxy's player of such videos. Coordinates are rounded to 0.1″, 3 m, dates cut to seconds;
``rel_alt`` repeats the altitude above sea level; the gimbal's yaw counts from the nose, whose heading is not reported.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Sequence
from datetime import UTC, datetime

import numpy as np

from gcs.errors import ImportFileError
from gcs.importing.checks.row_times import numbered, row_times
from gcs.importing.checks.two_clocks import DATE_IN_UTC, film_date
from gcs.importing.formats.subtitles import SubtitleCue
from gcs.importing.smoothing import smoothed_places
from gcs.importing.vehicle_log import AngleTrack, ImportNotes, VehicleLog, whole_places

_ANGLE = r"([NSEW])\s?([0-9]{1,3})°\s?([0-9]{1,2})['′]\s?([0-9]{1,2}(?:\.[0-9]{1,6})?)[\"″]"
_LAT = re.compile(rf"latitude\s?:\s?{_ANGLE}")
_LON = re.compile(rf"longitude\s?:\s?{_ANGLE}")
_NUMBERS = re.compile(r"\b(abs_alt|gb_yaw|gb_pitch|gb_roll)\s?:\s?([-+]?[0-9]{1,6}(?:\.[0-9]{1,9})?)")
_DATE = re.compile(r"\b([0-9]{4})-([0-9]{2})-([0-9]{2})_([0-9]{2})-([0-9]{2})-([0-9]{2})\b")
STD_M = 3.0
"""1σ per axis: 0.1″ is 3.1 m, and whole seconds make another metre or two of a flying camera."""
_CELL_DEG = 0.1 / 3600.0
_NOISE_M = 0.5


def is_siyi(cues: Sequence[SubtitleCue]) -> bool:
    """Tell whether subtitles are in this layout."""
    return any(_LAT.search(cue.text) for cue in cues[:100])


def siyi_log(source: str, cues: Sequence[SubtitleCue]) -> VehicleLog:
    """The UAV's log.

    Raises:
        ImportFileError: not one of the subtitles has a position.
    """
    skipped: Counter[str] = Counter()
    rows, dates, numbers = [], [], []
    for number, cue in enumerate(cues, 1):
        lat, lon = _degrees(_LAT.search(cue.text)), _degrees(_LON.search(cue.text))
        if not whole_places(np.array([lat]), np.array([lon]))[0]:
            skipped["subtitles without a position"] += 1
            continue
        values = {name: float(value) for name, value in _NUMBERS.findall(cue.text)}
        angles = (math.radians(values.get(f"gb_{axis}", math.nan)) for axis in ("roll", "pitch", "yaw"))
        rows.append((cue.start_us, lat, lon, values.get("abs_alt", math.nan), *angles))
        dates.append(_unix_us(cue.text))
        numbers.append(number)
    if not rows:
        raise ImportFileError(f"{source}: no position in its subtitles; were satellites in view?")
    table, unix_us = np.array(rows), np.array(dates, np.int64)
    ordered = row_times(table[:, 0].astype(np.int64), table[:, 1:3], source, numbered("subtitle", numbers), blocks=True)
    table, unix_us, t_us = table[ordered.rows], unix_us[ordered.rows], ordered.t_us
    zero_us, assumed = film_date("the date in its subtitles", unix_us, t_us, cut=True)
    known = np.isfinite(table[:, 5])
    return VehicleLog(
        source=source,
        clock="video",
        zero_us=zero_us,
        places=smoothed_places(
            t_us,
            table[:, 1:3],
            alt_m=table[:, 3],
            height_m=np.full(len(t_us), np.nan),
            noise_m=_NOISE_M,
            cell_deg=_CELL_DEG,
            std_m=STD_M,
        ),
        gimbal=AngleTrack(t_us=t_us[known], angles=table[known, 4:7], yaw_from="nose"),
        notes=ImportNotes(
            found=("SIYI's subtitles in the video", f"{len(t_us)} positions to 3 m, dates to whole seconds"),
            assumed=(*((DATE_IN_UTC,) if zero_us else ()), *assumed, *ordered.assumed),
            skipped={**skipped, **ordered.skipped},
        ),
    )


def _degrees(match: re.Match[str] | None) -> float:
    if match is None:
        return math.nan
    side, degrees, minutes, seconds = match.groups()
    if int(minutes) >= 60 or float(seconds) >= 60.0:
        return math.nan
    value = int(degrees) + int(minutes) / 60.0 + float(seconds) / 3600.0
    return -value if side in "SW" else value


def _unix_us(text: str) -> int:
    date = _DATE.search(text)
    if date is None:
        return 0
    try:
        when = datetime(*(int(part) for part in date.groups()), tzinfo=UTC)  # type: ignore[misc,arg-type]
    except ValueError:
        return 0
    return max(0, round(when.timestamp()) * 1_000_000)
