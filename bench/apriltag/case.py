"""One flight: the tags read in its frames, and the names that the product gives in the same ones."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bench.apriltag.flight import SIDES_M, scenario_of, tags_of, write_flight
from bench.apriltag.tags import read_image, read_tags
from bench.field.product import identify
from gcs.session.frame_tables import read_truth
from gcs.session.tables import Table
from sim.world.scenario import Scenario
from vision.video.video import VideoFile

__all__ = ["SETTLED_S", "TagCase", "TagCount", "TagOutcome", "count_tags", "play"]

Bools = NDArray[np.bool_]

SETTLED_S = 4.0
"""Identification needs motion: results are also counted from this time on."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TagCase:
    """Parameters of one flight."""

    camera: str
    height_m: float
    duration_s: float
    fps: float
    seed: int = 1


@dataclass(frozen=True, slots=True, kw_only=True)
class TagCount:
    """Numbers of boxes of the vehicles with tags of one size."""

    side_m: float
    boxes: int
    plain: int
    """Boxes whose tag is read correctly in the whole image with OpenCV's default settings."""
    read: int
    """Boxes whose tag is read correctly in a crop about the vehicle."""
    known: int
    """As ``read``, in this frame or an earlier one: with a tracker that never loses a vehicle."""
    wrong: int
    """Boxes in which a number is read that is not on the vehicle."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TagOutcome:
    """Counts of boxes of our vehicles in view."""

    case: TagCase
    vehicle_px: float
    """Median length of a vehicle."""
    tags: tuple[TagCount, ...]
    boxes: int
    right: int
    """Boxes that the product names correctly."""
    named: int
    """Boxes of our vehicles and of the look-alike that the product gives any name."""
    late_boxes: int
    """Boxes from ``SETTLED_S`` on."""
    late_right: int
    """Of those, boxes that the product names correctly."""


def play(case: TagCase) -> TagOutcome:
    """Render a flight, read its tags, and have the product identify its vehicles."""
    scenario = scenario_of(case.camera, case.height_m, case.duration_s, case.fps, case.seed)
    with tempfile.TemporaryDirectory(prefix="apriltag-") as folder:
        session = Path(folder) / "session"
        write_flight(scenario, session)
        truth = read_truth(session / "truth.csv")
        tags = count_tags(scenario, session / "video.mp4", truth)
        matched = identify(session, Path(folder) / "out").matched
    ours = matched.truth > 0
    right = ours & (matched.named == matched.truth)
    late = ours & (matched.frame >= SETTLED_S * case.fps)
    return TagOutcome(
        case=case,
        vehicle_px=float(np.median(truth["w"][truth["system_id"] > 0])),
        tags=tags,
        boxes=int(ours.sum()),
        right=int(right.sum()),
        # boxes less than half in the image have no truth to compare with
        named=int(((matched.named > 0) & (matched.truth >= 0)).sum()),
        late_boxes=int(late.sum()),
        late_right=int((right & late).sum()),
    )


def count_tags(scenario: Scenario, video: Path, truth: Table) -> tuple[TagCount, ...]:
    """Read the tags of every vehicle in view, frame by frame."""
    side = {tag.number: tag.side_m for tag in tags_of(scenario)}
    boxes = dict.fromkeys(SIDES_M, 0)
    plain, read, known, wrong = dict(boxes), dict(boxes), dict(boxes), dict(boxes)
    read_so_far: set[int] = set()
    with VideoFile.open(video) as film:
        for frame in film.frames():
            mine = np.flatnonzero((truth["frame"] == frame.index) & (truth["system_id"] > 0))
            places = np.stack([truth[key][mine] for key in ("cx", "cy", "w", "h")], axis=-1)
            everywhere = read_image(frame.image)
            numbers = truth["system_id"][mine].astype(int).tolist()
            for number, seen in zip(numbers, read_tags(frame.image, places), strict=True):
                size = side[number]
                read_so_far |= {number} & seen
                boxes[size] += 1
                plain[size] += number in everywhere
                read[size] += number in seen
                known[size] += number in read_so_far
                wrong[size] += bool(seen - {number})
    return tuple(
        TagCount(side_m=s, boxes=boxes[s], plain=plain[s], read=read[s], known=known[s], wrong=wrong[s])
        for s in SIDES_M
    )
