"""The video as it is: when each frame is shown, its size, and what its container says of camera and date.

Header and first picture are read in this process, once a process of its own has read the same and the whole index.
"""

from __future__ import annotations

from contextlib import closing
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
from av.container import InputContainer
from numpy.typing import NDArray

from gcs.importing.checks.row_times import gaps
from infra.plain_text import plain
from vision.video.frame_index import count_films, film_stream, first_picture, open_video
from vision.video.video import VideoFile

_MODEL_TAGS = ("encoder", "model", "com.apple.quicktime.model", "com.android.model")
_MAX_WORDS = 60
_HDR = {16: "PQ", 18: "HLG"}
"""Transfer characteristics of ITU-T H.273 that stand for more than a screen shows."""
_MIN_CUT_S, _MIN_CUT_STEPS = 1.0, 5.0
"""Least part of a film that is missed at its end, in seconds and in usual steps between frames: the last one is shown
for some time."""
_SLANT_DEG = 3
"""Largest turn of a picture that is rounding."""
_MIN_YEAR = 2005
"""Cameras whose clock was never set begin in 1904, 1970 or 2000."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ImportedFilm:
    """Video file to be imported."""

    path: Path
    elapsed_us: NDArray[np.int64]
    """(n,) µs of each frame since the first."""
    width: int
    height: int
    aspect: float = 1.0
    """Width of a pixel by its height, as coded: pictures are shown drawn out by it."""
    shown_as: str = ""
    """Difference in words between how its pictures are shown and how they are coded; empty as coded."""
    assumed: tuple[str, ...] = ()
    """Assumptions about its pictures, in words."""
    created_us: int
    """Unix µs as the container has it, 0 unknown."""
    model: str
    """Name of the camera in the container, perhaps only its encoder; empty unknown."""


def open_film(path: Path) -> ImportedFilm:
    """Open a video file.

    Raises:
        VideoError: no such file, or no video in it.
    """
    with closing(VideoFile.open(path)) as video:
        elapsed_us, size = video.times_us, (video.width, video.height)
        aspect, shown_as = video.aspect, video.shown_as
    with closing(open_video(path)) as container:
        transfer = _HDR.get(film_stream(container).codec_context.color_trc)
        cut_off = _cut_off(path, container, elapsed_us)
        others = count_films(container) - 1
        tags = {name.lower(): value for name, value in container.metadata.items()}
    return ImportedFilm(
        path=path,
        elapsed_us=elapsed_us,
        width=size[0],
        height=size[1],
        aspect=aspect,
        shown_as=shown_as,
        assumed=(*cut_off, *_assumptions(path, transfer, others, elapsed_us)),
        created_us=_unix_us(tags.get("creation_time", "")),
        model=plain(next((tags[name] for name in _MODEL_TAGS if name in tags), ""))[:_MAX_WORDS],
    )


def _cut_off(path: Path, container: InputContainer, elapsed_us: NDArray[np.int64]) -> tuple[str, ...]:
    """Return a sentence on where a file has less of a film than its header tells, as of a copy that broke off."""
    film = film_stream(container)
    told = [float(film.duration * film.time_base)] if film.duration and film.time_base else []
    told += [container.duration * 1e-6] if container.duration else []
    # durations count from 0, where players begin, and not from the first frame
    last_s = float((film.start_time or 0) * (film.time_base or 0)) + float(elapsed_us[-1]) * 1e-6
    step_s = float(np.median(np.diff(elapsed_us))) * 1e-6 if len(elapsed_us) > 1 else 0.0
    if not told or min(told) - last_s <= max(_MIN_CUT_S, _MIN_CUT_STEPS * step_s):
        return ()
    return (f"{path.name} ends after {last_s:.1f} s of the {min(told):.1f} s that its header tells: is it cut off?",)


def _assumptions(path: Path, transfer: str | None, others: int, elapsed_us: NDArray[np.int64]) -> tuple[str, ...]:
    """Describe how pictures of a film are taken where that is not how players show them."""
    first, words = first_picture(path), []
    if others > 0:
        words.append(f"{path.name} has {others + 1} films in it: the one that players show first is taken")
    if first is not None and abs(turned_deg := (first.rotation + 45) % 90 - 45) > _SLANT_DEG:
        words.append(f"{path.name} is to be turned by {turned_deg}° more, which players differ about and is not done")
    for frame in gaps(elapsed_us)[:1].tolist():
        away_s = float(elapsed_us[frame + 1] - elapsed_us[frame]) * 1e-6
        words.append(f"{path.name} has no picture for {away_s:.1f} s after frame {frame}")
    if first is not None and first.interlaced_frame:
        words.append(
            f"{path.name} is interlaced: every other line of a picture is of half a picture's time later, and is taken "
            "to be of its time; what moves fast has combed edges"
        )
    if transfer:
        words.append(f"{path.name} is HDR ({transfer}): pictures are taken as coded, paler than players show them")
    return tuple(words)


def _unix_us(text: str) -> int:
    try:
        when = datetime.fromisoformat(text)
    except ValueError:
        return 0
    when = when if when.tzinfo else when.replace(tzinfo=UTC)
    return round(when.timestamp() * 1e6) if when.year >= _MIN_YEAR else 0
