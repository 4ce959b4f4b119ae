"""Contact sheets of clusters, and the table in which a person notes which way they face.

A sheet shows crops as clustering turned them, uncertain ones first: all should face the same way. ``corrections.csv``
has a row for every cluster, to be checked, and takes a row for every crop that is wrong on its sheet:

    what,number,front
    cluster,0,right      the vehicles on sheet 0 face right
    cluster,1,?          not decided: these crops are left out
    crop,127,left        crop 127 faces left on its sheet, whatever its cluster has
    crop,130,none        no vehicle, or no front to be seen: left out
"""

from __future__ import annotations

import csv
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from training.fronts.cluster import Clusters
from vision.errors import LabelError

Image = NDArray[np.uint8]
RIGHT, LEFT, NONE, UNDECIDED = "right", "left", "none", "?"
"""Words that a person may write in ``corrections.csv``."""
COLUMNS = 16
"""Crops side by side on a sheet."""
ROWS = 12
"""Rows below each other: a sheet is 1,536 px wide."""
WIDTH, HEIGHT = 96, 64
"""Size of a crop on a sheet, px."""
LINE = 16
"""Height of a line of text, px."""
COLUMN_NAMES = ("what", "number", "front")
"""Column names of ``corrections.csv``."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Corrections:
    """Corrections by a person."""

    clusters: Mapping[int, str]
    crops: Mapping[int, str]


def draw_sheets(folder: Path, images: Image, clusters: Clusters, guesses: Mapping[int, str]) -> list[Path]:
    """Write ``cluster-<number>-<page>.jpg`` for every cluster.

    Args:
        folder: made if it is not there.
        images: (n, h, w, 3) crops.
        clusters: where they went.
    """
    folder.mkdir(parents=True, exist_ok=True)
    paths = []
    for number, guess in guesses.items():
        members = np.flatnonzero(clusters.number == number)
        members = members[np.argsort(clusters.sure[members], kind="stable")]
        for page, start in enumerate(range(0, len(members), COLUMNS * ROWS)):
            part = members[start : start + COLUMNS * ROWS]
            title = f"cluster {number}, page {page + 1}: {len(members)} crops, doubtful first. Facing: {guess}"
            paths.append(folder / f"cluster-{number:02d}-{page + 1}.jpg")
            cells = [_cell(images[k], turned=bool(clusters.turned[k]), number=int(k)) for k in part]
            cv2.imwrite(str(paths[-1]), _sheet(cells, title), [cv2.IMWRITE_JPEG_QUALITY, 90])
    return paths


def write_corrections(path: Path, guesses: Mapping[int, str]) -> None:
    """Write the table to be checked.

    Raises:
        FileExistsError: it is there already, perhaps with a person's work in it.
    """
    with path.open("x", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(COLUMN_NAMES)
        writer.writerows(("cluster", number, guess) for number, guess in guesses.items())


def read_corrections(path: Path, crops: int, clusters: int) -> Corrections:
    """Read the table back; of two rows for one thing the later counts.

    Raises:
        LabelError: a row that cannot be understood.
    """
    corrections: dict[str, dict[int, str]] = {"cluster": {}, "crop": {}}
    choices = {"cluster": (RIGHT, LEFT, NONE, UNDECIDED), "crop": (RIGHT, LEFT, NONE, UNDECIDED)}
    most = {"cluster": clusters, "crop": crops}
    with path.open(newline="") as file:
        rows = [[cell.strip().lower() for cell in row] for row in csv.reader(file)]
    if not rows or tuple(rows[0]) != COLUMN_NAMES:
        raise LabelError(f"{path}, line 1: must be {','.join(COLUMN_NAMES)}")
    for line, row in enumerate(rows[1:], start=2):
        if not any(row):
            continue
        if len(row) != len(COLUMN_NAMES) or row[0] not in corrections:
            raise LabelError(f"{path}, line {line}: must be cluster,<number>,<front> or crop,<number>,<front>")
        what, number, front = row
        if not number.isdecimal() or int(number) >= most[what]:
            raise LabelError(f"{path}, line {line}: no {what} {number!r}; there are 0 to {most[what] - 1}")
        if front not in choices[what]:
            raise LabelError(f"{path}, line {line}: front is {front!r}; write right, left, none or ?")
        corrections[what][int(number)] = front
    return Corrections(clusters=corrections["cluster"], crops=corrections["crop"])


def fronts(clusters: Clusters, corrections: Corrections) -> tuple[NDArray[np.intp], NDArray[np.bool_]]:
    """Masks of the crops with a known front, and of those with it at the right of the crop as cut: (m,), (m,)."""
    faces = [
        corrections.crops.get(k, corrections.clusters.get(int(c), UNDECIDED)) for k, c in enumerate(clusters.number)
    ]
    known = np.flatnonzero([face in (RIGHT, LEFT) for face in faces])
    shown_right = np.array([faces[k] == RIGHT for k in known], dtype=bool)
    # what faces right on the sheet and was turned for it faces left as it was cut
    return known, shown_right ^ clusters.turned[known]


def _cell(image: Image, *, turned: bool, number: int) -> Image:
    cell = np.full((HEIGHT + LINE, WIDTH, 3), 255, np.uint8)
    cell[:HEIGHT] = cv2.resize(image[::-1, ::-1] if turned else image, (WIDTH, HEIGHT), interpolation=cv2.INTER_AREA)
    _text(cell, str(number), (3, HEIGHT + LINE - 4), 0.4)
    return cell


def _sheet(cells: list[Image], title: str) -> Image:
    blank = np.full_like(cells[0], 255)
    cells = cells + [blank] * (-len(cells) % COLUMNS)
    rows = [np.hstack(cells[k : k + COLUMNS]) for k in range(0, len(cells), COLUMNS)]
    head = np.full((2 * LINE, COLUMNS * WIDTH, 3), 255, np.uint8)
    _text(head, title, (6, 2 * LINE - 10), 0.6)
    return np.vstack([head, *rows])


def _text(image: Image, text: str, at: tuple[int, int], size: float) -> None:
    cv2.putText(image, text, at, cv2.FONT_HERSHEY_SIMPLEX, size, (0, 0, 0), 1, cv2.LINE_AA)
