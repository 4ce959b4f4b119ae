"""An evaluation as Markdown and as JSON."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from typing import Any

from infra.markdown import markdown_table
from vision.evaluation.comparison import Comparison
from vision.evaluation.measures import USUAL_PRECISION, Evaluation
from vision.evaluation.reliability import ScoreBin
from vision.evaluation.shares import Share, range_name

WORDS = """\
AP: area under the precision-recall curve, all-point interpolation; AP50-95 is the mean over overlaps of 0.50 to 0.95.
Detections are matched image by image, best score first, each object once. The detector returns no classes: AP50 of a
class sets the others' objects aside and holds every false alarm against it, which is hard on rare ones. Centres: a
detection is right if its centre lies in an object, which is fair where labels are upright boxes around turned vehicles;
thirds are of each image's objects, from the top down. Share right: of detections of this score and length, by centres
with upright labels, by overlap with others. 95 % of a difference: over draws of the images, so that other images of
their kind are expected to be within; it is – for one image."""
"""Meaning of the figures."""


def as_json(result: Evaluation, about: Mapping[str, Any], beside: Comparison | None = None) -> str:
    """All figures as JSON; unknown numbers are null."""
    figures = asdict(result)
    figures = {"pictures": figures.pop("images"), **figures}  # the key of earlier files
    if beside is not None:
        figures["comparison"] = asdict(beside)
    return json.dumps(_plain({"about": dict(about), **figures}), indent=2, ensure_ascii=False) + "\n"


def as_markdown(result: Evaluation, about: Mapping[str, Any], beside: Comparison | None = None) -> str:
    """Tables to read; arguments as ``tables``."""
    every = (markdown_table(head, rows) for head, rows in tables(result, about, beside))
    parts = ["# Detector on labelled images", *every]
    return "\n\n".join([*parts, WORDS]) + "\n"


def tables(
    result: Evaluation, about: Mapping[str, Any], beside: Comparison | None = None
) -> Iterator[tuple[Sequence[str], Sequence[Sequence[str]]]]:
    """Names of the columns, and the rows, of each table; numbers are in all columns but the first."""
    yield ("what", "which"), [(k, str(v)) for k, v in about.items()]
    yield ("figure", "value"), _figures(result)
    for title, shares, with_ap in (
        ("class", result.classes, True),
        ("length, px", result.sizes, False),
        ("occlusion", result.hidden, False),
        ("centres by length, px", result.centres.sizes, False),
        ("centres by place", result.centres.places, False),
    ):
        if shares:
            yield _shares(title, shares, with_ap)
    yield _reliability(result.reliability.bins)
    if beside is not None:
        yield from comparison_tables(result, beside)


def comparison_tables(
    result: Evaluation, beside: Comparison
) -> Iterator[tuple[Sequence[str], Sequence[Sequence[str]]]]:
    """Tables that compare two detectors."""
    yield _differences(beside)
    for title, mine, theirs in (
        ("centres by length, px", result.centres.sizes, beside.other.centres.sizes),
        ("centres by place", result.centres.places, beside.other.centres.places),
        ("class", result.classes, beside.other.classes),
    ):
        if mine:
            yield _recalls(title, mine, theirs, beside.against)


def _figures(r: Evaluation) -> list[tuple[str, str]]:
    d = r.directions
    rows = [
        ("images", str(r.images)),
        ("objects that count", str(r.objects)),
        ("objects set aside", str(r.aside)),
        (f"detections at score {r.score:g}", str(r.detections)),
        ("AP50", number(r.ap50, 3)),
        ("AP50-95", number(r.ap50_95, 3)),
        (f"precision at score {r.score:g}", number(r.precision, 3)),
        (f"recall at score {r.score:g}", number(r.recall, 3)),
        ("AP of centres", number(r.centres.ap, 3)),
        (f"precision of centres at score {r.score:g}", number(r.centres.precision, 3)),
        (f"recall of centres at score {r.score:g}", number(r.centres.recall, 3)),
        (f"score from which on {USUAL_PRECISION:.0%} are right", number(r.reliability.usual_score, 2)),
        ("median distance of centres, px", number(r.centre_px, 2)),
        ("median error of the long axis, °", number(d.axis_deg, 1)),
    ]
    if d.given or d.missing:
        rows += [
            ("median error of the heading, °", number(d.heading_deg, 1)),
            ("fronts more than 90° off, %", number(100.0 * d.turned_about, 1)),
            ("fronts not given, %", number(100.0 * d.missing / (d.given + d.missing), 1)),
        ]
    return rows


def _differences(beside: Comparison) -> tuple[Sequence[str], Sequence[Sequence[str]]]:
    head = ("beside", "this", beside.against, "difference", "95 % of it")
    rows = []
    for d in beside.differences:
        low, high = (_signed(bound) for bound in d.interval)
        rows.append([d.name, number(d.one, 3), number(d.other, 3), _signed(d.one - d.other), f"{low} to {high}"])
    return head, rows


def _recalls(
    title: str, mine: Sequence[Share], theirs: Sequence[Share], against: str
) -> tuple[Sequence[str], Sequence[Sequence[str]]]:
    pairs = zip(mine, theirs, strict=True)
    rows = [[m.name, str(m.objects), number(m.found / m.objects, 3), number(t.found / t.objects, 3)] for m, t in pairs]
    return (title, "objects", "recall of this", f"of {against}"), rows


def _signed(value: float) -> str:
    return f"{value:+.3f}" if math.isfinite(value) else "–"


def _reliability(bins: Sequence[ScoreBin]) -> tuple[Sequence[str], Sequence[Sequence[str]]]:
    lengths = list(dict.fromkeys(b.length_px for b in bins))
    head = ("score", *(f"share right, {range_name(*length)} px" for length in lengths))
    rows = []
    for score in dict.fromkeys(b.score for b in bins):
        mine = [b for b in bins if b.score == score]
        cells = [f"{b.right / b.detections:.2f} of {b.detections}" if b.detections else "–" for b in mine]
        rows.append([range_name(*score), *cells])
    return head, rows


def _shares(title: str, shares: Sequence[Share], with_ap: bool) -> tuple[Sequence[str], Sequence[Sequence[str]]]:
    head = (title, "objects", "found", "recall", *(("AP50",) if with_ap else ()))
    rows = []
    for s in shares:
        row = [s.name, str(s.objects), str(s.found), number(s.found / s.objects, 3)]
        rows.append([*row, number(s.ap50, 3)] if with_ap else row)
    return head, rows


def number(value: float, digits: int) -> str:
    """A number, – for unknown."""
    return f"{value:.{digits}f}" if math.isfinite(value) else "–"


def _plain(value: Any) -> Any:  # noqa: ANN401  (whatever JSON can hold)
    if isinstance(value, dict):
        return {str(k): _plain(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(v) for v in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
