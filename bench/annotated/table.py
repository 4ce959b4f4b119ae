"""What the product makes of annotated films, one row each: boxes, tracks, fronts, names."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from bench.annotated.films import AnnotatedFilm
from bench.annotated.fronts import turned_fronts
from bench.field.measure import tally
from bench.field.product import identify
from bench.field.summary import summarise
from bench.field.tables import number
from gcs.annotated_film import session_from_film
from gcs.errors import GcsError
from gcs.report.score import Matched
from infra.markdown import markdown_table
from sim.annotated.layouts import read_tracks
from sim.errors import SimError
from vision.errors import VisionError

__all__ = ["FilmScore", "Looked", "measure_films", "text_of_films"]

IntArray = NDArray[np.int64]
Looked = Literal["film", "labels"]


@dataclass(frozen=True, slots=True, kw_only=True)
class FilmScore:
    """One film; shares in percent, NaN where there is nothing to take a share of."""

    film: str
    boxes: Looked
    """What was named: what the detector found in the film, or the labels."""
    frames: int
    vehicles: int
    team: int
    recall: float
    """Of the labels, share with a box over it."""
    box_precision: float
    """Of the boxes, share over a label; vehicles that nobody labelled count against it."""
    tracks: int
    on_nothing: float
    """Of the tracks, share that is over no label most of the time."""
    track_frames: float
    """Median length of a track."""
    fronts: int
    """Boxes with a front, of tracks over vehicles that have driven two of their lengths since the track began."""
    turned: float
    """Of those, share that points more than 90° away from where the vehicle drives."""
    precision: float
    """Of the names."""
    right: float
    """Of the labels of ours, share with the right name."""
    fper: float
    wrong_sure_s: float
    first_s: float
    """Median time to the first right name that holds, inf never."""
    mismatch_s: float
    """Seconds to the alarm that video and telemetry do not match, inf never."""


def measure_films(
    films: Sequence[AnnotatedFilm],
    looked: Sequence[Looked] = ("film", "labels"),
    report: Callable[[int, int], None] = lambda done, total: None,
) -> tuple[list[FilmScore], list[str]]:
    """Put telemetry under each film, identify it and compare.

    Args:
        films: labels, pixels and options.
        looked: what is named, a row each.
        report: called with the rows that are done so far, and all there are.

    Returns:
        the rows; and what could not be used, a line each.
    """
    rows, failed = [], []
    for film in films:
        for boxes in looked:
            try:
                rows.append(_score(film, boxes))
            except (GcsError, SimError, VisionError) as error:
                failed.append(f"{film.name}: {error}")
                break
            report(len(rows), len(films) * len(looked))
    return rows, failed


def _score(film: AnnotatedFilm, boxes: Looked) -> FilmScore:
    with tempfile.TemporaryDirectory(prefix="annotated-") as folder:
        session = Path(folder) / "session"
        options = replace(film.options, boxes_from_labels=boxes == "labels")
        made = session_from_film(film.labels, film.video, session, options).film
        run = identify(session, Path(folder) / "out")
    labels = read_tracks(film.labels, options.layout, options.first_frame)
    turned = turned_fronts(labels, made.labelled, made.world, run.logged)
    m = run.matched
    s = summarise([tally(m, made.world.scenario.fps)])
    labelled, boxed = m.truth >= 0, m.named >= 0
    tracks = np.unique(m.track[m.track > 0])
    return FilmScore(
        film=film.name,
        boxes=boxes,
        frames=made.world.scenario.frame_count,
        vehicles=made.vehicles,
        team=len(made.team),
        recall=_percent(boxed[labelled]),
        box_precision=_percent(labelled[boxed]),
        tracks=len(tracks),
        on_nothing=_percent(np.array([_over_nothing(m, track) for track in tracks.tolist()])),
        track_frames=float(np.median([np.count_nonzero(m.track == track) for track in tracks])) if len(tracks) else 0.0,
        fronts=len(turned),
        turned=_percent(turned),
        precision=s.precision,
        right=s.right,
        fper=s.fper,
        wrong_sure_s=s.wrong_sure_s,
        first_s=s.first_median_s,
        mismatch_s=run.mismatch_s,
    )


def _over_nothing(m: Matched, track: int) -> bool:
    return bool(np.mean(m.truth[m.track == track] < 0) > 0.5)


def _percent(flags: NDArray[np.bool_]) -> float:
    return 100.0 * float(flags.mean()) if len(flags) else float("nan")


def text_of_films(rows: Sequence[FilmScore], failed: Sequence[str], title: str) -> str:
    """The table in Markdown."""
    head = (
        *(
            "film",
            "boxes",
            "frames",
            "vehicles",
            "team",
            "found",
            "on labels",
            "tracks",
            "on nothing",
            "frames a track",
            "fronts",
            "turned",
        ),
        *("names right", "of ours right", "FPER", "wrong ≥ 0.9, s", "first name, s", "alarm after, s"),
    )
    cells = [
        [
            *(r.film, r.boxes, str(r.frames), str(r.vehicles), str(r.team)),
            *(number(r.recall, 1), number(r.box_precision, 1)),
            *(str(r.tracks), number(r.on_nothing, 1), number(r.track_frames, 0)),
            *(str(r.fronts), number(r.turned, 1)),
            *(number(r.precision, 1), number(r.right, 1), number(r.fper, 1)),
            *(number(r.wrong_sure_s, 1), number(r.first_s, 1), number(r.mismatch_s, 1)),
        ]
        for r in rows
    ]
    left = "".join(f"\n- not used: {line}" for line in failed)
    return f"# {title}\n\n{_WORDS}\n\n{markdown_table(head, cells)}\n{left}{chr(10) if left else ''}"


_WORDS = """\
Shares in percent. boxes: what was named, what the detector found in the film or the labels themselves: then what is
wrong is not the detector's fault. found: labels with a box over it; on labels: boxes over a label, where vehicles that
nobody labelled count against it; on nothing: tracks that are over no label most of the time; fronts: boxes that show
one, of vehicles that have driven two of their lengths since their track began; turned: of those, pointing more than 90°
away from where the labels drive. Words of names as in the field suite."""
