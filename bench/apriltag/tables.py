"""The results as text: ``apriltag.csv`` and ``apriltag.md``."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from bench.apriltag.case import SETTLED_S, TagOutcome
from bench.apriltag.flight import CAMERAS, CRF, DIAGONAL_DEG, SHUTTER_S, SIDES_M, SPACING_M, camera_of
from infra.markdown import markdown_table

__all__ = ["METHODS", "report", "shares", "write_csv"]

METHODS = (
    *(f"tag {side:g} m{more}" for side in SIDES_M for more in (", plain", "", ", remembered")),
    *("product", "product, later"),
)
"""Columns of both tables."""


def shares(o: TagOutcome) -> dict[str, float]:
    """Share of vehicles in view that each method identifies, 0 to 1, NaN where none is in view."""
    parts = [part for tag in o.tags for part in ((tag.plain, tag.boxes), (tag.read, tag.boxes), (tag.known, tag.boxes))]
    parts += [(o.right, o.boxes), (o.late_right, o.late_boxes)]
    return {name: part / whole if whole else float("nan") for name, (part, whole) in zip(METHODS, parts, strict=True)}


def write_csv(outcomes: Sequence[TagOutcome], path: Path) -> None:
    """One row a flight; shares 0 to 1."""
    with path.open("w", newline="", encoding="utf-8") as file:
        rows = csv.writer(file, lineterminator="\n")
        rows.writerow(("camera", "height_m", "gsd_m", "vehicle_px", "boxes", *METHODS, "wrong of names", "tags wrong"))
        for o in outcomes:
            gsd = o.case.height_m / camera_of(o.case.camera).fx
            wrong = (_wrong_names(o), sum(t.wrong for t in o.tags) / max(sum(t.boxes for t in o.tags), 1))
            cells = [f"{v:.4f}" for v in (*shares(o).values(), *wrong)]
            rows.writerow((o.case.camera, f"{o.case.height_m:g}", f"{gsd:.4f}", f"{o.vehicle_px:.0f}", o.boxes, *cells))


def report(outcomes: Sequence[TagOutcome], quick: bool) -> str:
    """A table for each camera, in Markdown."""
    parts = [f"# Tags on roofs, and the product, against height{' (quick look)' if quick else ''}", _words(outcomes)]
    for camera in CAMERAS:
        mine = sorted((o for o in outcomes if o.case.camera == camera), key=lambda o: o.case.height_m)
        if mine:
            parts += [f"## {camera}", _limits(mine), _table(mine)]
    return "\n\n".join([*parts, "![share against height](apriltag.png)"]) + "\n"


def _words(outcomes: Sequence[TagOutcome]) -> str:
    case = outcomes[0].case
    return f"""\
Share of our vehicles in view that are identified, percent of boxes. Seven rovers of 2.2 × 1.4 m, {SPACING_M:g} m
apart in each lane of a winding road, and one more of the same make that is not ours; seen from straight above by a
camera of {DIAGONAL_DEG:g}° across the diagonal. Flights of {case.duration_s:g} s at {case.fps:g} frames a second,
shutter 1/{1.0 / SHUTTER_S:.0f} s, sensor noise, H.264 at CRF {CRF}. Positions are off by 1 m, the compass by 3°, the
gimbal by 0.7° and 0.5°.

tag: AprilTag 36h11 with a black square of that side, level and clean on the roof; every other vehicle has the larger
one. A tag that the image's edge cuts cannot be read. plain: read in the whole image by OpenCV's ArUco detector as
it comes. Without that word: in a crop about every vehicle's true place, enlarged, with settings for small squares:
the most that tags can give. remembered: the same in this
frame or in an earlier one, as if a tracker never lost a vehicle. product: the bundled detector, the tracker and the
identifier on the same decoded frames; right names of our boxes, from the first frame on, and later: from second
{SETTLED_S:g} on. wrong of names: those that are not right of the names it gives, to ours or to the other. It reads no
tags, and needs every vehicle's telemetry; a tag needs none."""


def _limits(mine: Sequence[TagOutcome]) -> str:
    """Up to where tags are read in half of the frames."""
    lines = [f"Tags of {side:g} m are read in at least half of the frames {_reach(mine, side)}." for side in SIDES_M]
    least = min(shares(o)["product, later"] for o in mine)
    return " ".join([*lines, f"The product names at least {100 * least:.1f} % rightly from second {SETTLED_S:g} on."])


def _reach(mine: Sequence[TagOutcome], side: float) -> str:
    """``plain up to 20 m, in crops up to 40 m``."""
    parts = []
    for how, name in (("plain", f"tag {side:g} m, plain"), ("in crops", f"tag {side:g} m")):
        good = [o.case.height_m for o in mine if shares(o)[name] >= 0.5]
        parts.append(f"{how} up to {max(good):g} m" if good else f"{how} at none of these heights")
    return ", ".join(parts)


def _table(mine: Sequence[TagOutcome]) -> str:
    head = ("height, m", "vehicle, px", "boxes", *METHODS, "wrong of names")
    rows = []
    for o in mine:
        cells = [_percent(v) for v in (*shares(o).values(), _wrong_names(o))]
        rows.append([f"{o.case.height_m:g}", f"{o.vehicle_px:.0f}", str(o.boxes), *cells])
    return markdown_table(head, rows)


def _wrong_names(o: TagOutcome) -> float:
    return (o.named - o.right) / o.named if o.named else float("nan")


def _percent(share: float) -> str:
    return f"{100.0 * share:.1f}" if np.isfinite(share) else "–"
