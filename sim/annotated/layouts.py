"""Annotated tracks in the layouts of public data sets.

A layout is recognised by the file's first line, its name, and what stands in its columns:

    csv       a header with frame, id (or track_id), x1,y1,...,x4,y4 and, if known, class (class_id): corners in px, in
              order round the box, frames from 0. DRIFT's tables are of this kind, further columns are not used;
              class numbers are DRIFT's (0 bus, 1 car, 2 truck).
    mot       MOT Challenge: frame,id,left,top,width,height[,conf[,class,visibility | ,x,y,z]], frames from 1. Classes
              are named by a labels.txt beside the file, one a line; without it all are vehicles where the file has one
              class, and only MOT16's class 3 where it has several.
    visdrone  VisDrone-MOT and -VID: frame,id,left,top,width,height,score,category,truncation,occlusion, frames from 1.
    uavdt     UAVDT-M: NAME_gt_whole.txt: frame,id,left,top,width,height,out-of-view,occlusion,category, frames from 1;
              NAME_gt.txt: frame,id,left,top,width,height,1,-1,-1.

References:
    A. Milan et al., "MOT16: A Benchmark for Multi-Object Tracking", arXiv 1603.00831.
    P. Zhu et al., "Detection and Tracking Meet Drones Challenge", TPAMI 2021, doi:10.1109/TPAMI.2021.3119563.
    D. Du et al., "The Unmanned Aerial Vehicle Benchmark", ECCV 2018, doi:10.1007/978-3-030-01249-6_23.
    H. Lee et al., "DRIFT open dataset", arXiv 2504.11019.
"""

from __future__ import annotations

import csv
import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from infra.files.safe_open import read_small
from infra.text_numbers import number
from sim.annotated.tracks import AnnotatedTracks, upright_corners
from sim.errors import AnnotationError, UnusedLabelError

MAX_BYTES = 1 << 30
"""A label file has some ten million rows at most."""
MAX_NUMBER = 2**53
"""Maximum number of an image or a vehicle: up to here floating point has every whole number."""
LAYOUTS = ("csv", "mot", "visdrone", "uavdt")
CORNER_COLUMNS = ("x1", "y1", "x2", "y2", "x3", "y3", "x4", "y4")
DRIFT_KINDS = {"0": "bus", "1": "car", "2": "truck"}
VISDRONE_KINDS = {4: "car", 5: "van", 6: "truck", 9: "bus"}
UAVDT_KINDS = {1: "car", 2: "truck", 3: "bus"}
MOT16_KINDS = {3: "car"}
WORDS = {"lorry": "truck", "trailer": "truck", "minibus": "van"}
"""Other words for kinds that are known."""
NOT_VEHICLES = {"person", "pedestrian", "people", "bicycle", "cyclist", "motor", "motorcycle", "tricycle"}
VISDRONE_HEAVY, UAVDT_LARGE, MOT_HALF = 2, 4, 0.5
"""Occlusion from which a label says that more than half is hidden; in MOT the visible share."""
_Rows = Sequence[Sequence[str]]


@dataclass(frozen=True, slots=True)
class _VehicleLabel:
    frame: int
    track: int
    box: tuple[float, ...]
    """Box as left, top, width and height, or eight numbers of four corners."""
    kind: str
    hidden: bool


_Parser = Callable[[Sequence[str]], _VehicleLabel]


def read_tracks(path: Path, layout: str = "auto", first_frame: int | None = None) -> AnnotatedTracks:
    """Read a label file.

    Args:
        layout: one of ``LAYOUTS``, or "auto".
        first_frame: number of the film's first image in the file; None: 0 for csv and 1 for the others.

    Raises:
        AnnotationError: no such file, no layout that is known, or not one row that can be used.
    """
    try:
        lines = read_small(path, MAX_BYTES).decode("utf-8-sig", errors="replace").splitlines()
    except (OSError, ValueError) as error:
        raise AnnotationError(
            f"{path}: cannot be read: {getattr(error, 'strerror', None) or error}; give a file of labels"
        ) from error
    rows = [row for row in csv.reader(lines, delimiter=_delimiter(lines)) if any(cell.strip() for cell in row)]
    if not rows:
        raise AnnotationError(f"{path}: no label in it")
    layout = _recognised_layout(rows, path) if layout == "auto" else layout
    first = (0 if layout == "csv" else 1) if first_frame is None else first_frame
    parse = _PARSERS[layout](rows, path)
    found, left_out = _parsed(rows[1:] if layout == "csv" else rows, parse, first)
    if not found:
        reasons = ", ".join(f"{count} {reason}" for reason, count in left_out.items())
        raise AnnotationError(f"{path}: read as {layout}, no row can be used ({reasons}); is --layout right?")
    return _tracks(found, layout, left_out)


def _parsed(body: _Rows, parse: _Parser, first: int) -> tuple[list[_VehicleLabel], dict[str, int]]:
    found: dict[tuple[int, int], _VehicleLabel] = {}
    left_out: Counter[str] = Counter()
    for cells in body:
        try:
            row = parse(cells)
            if row.frame < first:
                raise UnusedLabelError("before the film's first image")
            if (row.frame, row.track) in found:
                raise UnusedLabelError("a second label of the same vehicle in a frame")
            _check_box(row.box)
        except UnusedLabelError as reason:
            left_out[str(reason)] += 1
        except (ValueError, IndexError, OverflowError):
            left_out["unreadable"] += 1
        else:
            found[row.frame, row.track] = _VehicleLabel(row.frame - first, row.track, row.box, row.kind, row.hidden)
    return sorted(found.values(), key=lambda row: (row.frame, row.track)), dict(left_out)


def _check_box(box: tuple[float, ...]) -> None:
    if not all(math.isfinite(value) and abs(value) < 1e6 for value in box):
        raise ValueError("not a place in an image")
    if len(box) == 4 and min(box[2:]) <= 0.0:
        raise UnusedLabelError("without width or height")


def _tracks(rows: Sequence[_VehicleLabel], layout: str, left_out: dict[str, int]) -> AnnotatedTracks:
    boxes = np.array([row.box for row in rows])
    corners = boxes.reshape(-1, 4, 2) if boxes.shape[1] == 8 else upright_corners(*boxes.T)
    return AnnotatedTracks(
        layout=layout,
        frame=np.array([row.frame for row in rows], dtype=np.int64),
        track=np.array([row.track for row in rows], dtype=np.int64),
        corners=corners,
        kind=np.array([row.kind for row in rows], dtype=np.str_),
        hidden=np.array([row.hidden for row in rows], dtype=bool),
        left_out=left_out,
    )


def _delimiter(lines: Sequence[str]) -> str:
    first = next((line for line in lines if line.strip()), "")
    return next((mark for mark in (",", ";", "\t") if mark in first), " ")


def _recognised_layout(rows: _Rows, path: Path) -> str:
    """Recognise the layout of a file by its rows.

    Raises:
        AnnotationError: none that is known.
    """
    if any(cell.strip().lower() == "frame" for cell in rows[0]):
        return "csv"
    if path.stem.endswith(("_gt", "_gt_whole")) and len(rows[0]) == 9:
        return "uavdt"
    widths = Counter(len([cell for cell in row if cell.strip()]) for row in rows)
    width = widths.most_common(1)[0][0]
    if width == 10 and all(_whole(row, slice(7, 10)) for row in rows[:1000] if len(row) == 10):
        return "visdrone"
    if 6 <= width <= 10:
        return "mot"
    raise AnnotationError(
        f"{path}: rows of {width} columns are none of {', '.join(LAYOUTS)}; write them as csv with a header "
        f"frame,id,{','.join(CORNER_COLUMNS)},class"
    )


def _whole(row: Sequence[str], columns: slice) -> bool:
    """Tell whether category, truncation and occlusion of VisDrone can stand there."""
    try:
        category, truncation, occlusion = (_whole_number(number(cell)) for cell in row[columns])
    except ValueError:
        return False
    return 0 <= category <= 11 and 0 <= truncation <= 1 and 0 <= occlusion <= 2


def _csv_parser(rows: _Rows, path: Path) -> _Parser:
    at = {name.strip().lower(): index for index, name in enumerate(rows[0])}
    track = next((at[name] for name in ("id", "track_id") if name in at), None)
    missing = [name for name in ("frame", *CORNER_COLUMNS) if name not in at] + ["id"] * (track is None)
    if track is None or missing:
        raise AnnotationError(
            f"{path}: no column {', '.join(missing)} in its header; csv needs frame,id,x1,y1,...,x4,y4"
        )
    named, kind = at.get("class", at.get("class_id")), ""

    def parse(cells: Sequence[str]) -> _VehicleLabel:
        word = cells[named].strip().lower() if named is not None else kind
        box = tuple(number(cells[at[name]]) for name in CORNER_COLUMNS)
        return _VehicleLabel(
            _whole_number(number(cells[at["frame"]])),
            _whole_number(number(cells[track])),
            box,
            _kind_of(word),
            hidden=False,
        )

    return parse


def _kind_of(word: str) -> str:
    if word.isdigit():
        word = DRIFT_KINDS.get(word, word)
    word = WORDS.get(word, word)
    if word in NOT_VEHICLES:
        raise UnusedLabelError("not a vehicle")
    return word if word in ("car", "van", "truck", "bus") else "vehicle"


def _mot_parser(rows: _Rows, path: Path) -> _Parser:
    names = path.parent / "labels.txt"
    classes = {cells[7].strip() for cells in rows if len(cells) > 7}
    classed = all(name.isdigit() and name != "0" for name in classes)
    kinds: dict[int, str] | None = None
    if names.is_file():
        words = read_small(names, MAX_BYTES).decode("utf-8", errors="replace").splitlines()
        kinds = {number: word.strip().lower() for number, word in enumerate(words, start=1)}
    elif classed and len(classes) > 1:
        kinds = MOT16_KINDS

    def parse(cells: Sequence[str]) -> _VehicleLabel:
        numbers = [number(cell) for cell in cells if cell.strip()]
        if len(numbers) > 6 and numbers[6] == 0.0:
            raise UnusedLabelError("marked as not to be considered")
        kind = _kind_of(_listed(int(numbers[7]), kinds)) if classed and kinds and len(numbers) > 7 else "vehicle"
        hidden = classed and len(numbers) > 8 and 0.0 <= numbers[8] < MOT_HALF
        return _VehicleLabel(*_frame_and_track(numbers), tuple(numbers[2:6]), kind, hidden)

    return parse


def _visdrone_parser(rows: _Rows, path: Path) -> _Parser:
    del rows, path  # the layout has no heading

    def parse(cells: Sequence[str]) -> _VehicleLabel:
        numbers = [number(cell) for cell in cells[:10]]
        if numbers[6] == 0.0:
            raise UnusedLabelError("marked as not to be considered")
        kind = _listed(int(numbers[7]), VISDRONE_KINDS)
        return _VehicleLabel(*_frame_and_track(numbers), tuple(numbers[2:6]), kind, numbers[9] >= VISDRONE_HEAVY)

    return parse


def _uavdt_parser(rows: _Rows, path: Path) -> _Parser:
    del rows, path  # the layout has no heading

    def parse(cells: Sequence[str]) -> _VehicleLabel:
        numbers = [number(cell) for cell in cells[:9]]
        kind = UAVDT_KINDS.get(int(numbers[8]), "vehicle")
        return _VehicleLabel(*_frame_and_track(numbers), tuple(numbers[2:6]), kind, numbers[7] >= UAVDT_LARGE)

    return parse


def _listed(number: int, kinds: Mapping[int, str]) -> str:
    if number not in kinds:
        raise UnusedLabelError("not a vehicle")
    return kinds[number]


def _frame_and_track(numbers: Sequence[float]) -> tuple[int, int]:
    if numbers[1] < 0.0:
        raise UnusedLabelError("without a track (a detection)")
    return _whole_number(numbers[0]), _whole_number(numbers[1])


def _whole_number(value: float) -> int:
    if not (value.is_integer() and 0.0 <= value < MAX_NUMBER):
        raise ValueError("not the number of an image or a vehicle")
    return int(value)


_PARSERS: dict[str, Callable[[_Rows, Path], _Parser]] = {
    "csv": _csv_parser,
    "mot": _mot_parser,
    "visdrone": _visdrone_parser,
    "uavdt": _uavdt_parser,
}
