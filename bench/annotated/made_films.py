"""Annotated films from labelled pictures: a camera that moves over each, and runs of pictures taken in a row.

python -m bench.annotated.made_films PICTURES -o FOLDER

Over a single picture a virtual camera pans, turns and climbs; its vehicles stand. Pictures of one size whose names are
the same but for a number that counts on are one film: their labels are linked into tracks by where the ground and each
vehicle's speed would have them. Where they are fewer than a video has, a second film NAME-filled has pictures in
between.
"""

from __future__ import annotations

import argparse
import re
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from bench.annotated.linking import fill_in, link
from gcs.cli.output.console import errors_as_exit_codes, print_note
from sim.render.film import encode
from vision.detect.boxes import corners
from vision.evaluation import LabelledImage, open_folder

__all__ = ["make_films", "pan"]

FloatArray = NDArray[np.float64]
Image = NDArray[np.uint8]

SIZE = (1280, 720)
"""Of the virtual camera, px; a smaller picture is filmed at its own size less the room to move."""
FPS, SECONDS = 10.0, 20.0
"""Of a film over one picture."""
MOST_OF_SIDE = 0.8
"""The virtual camera sees at most so much of the picture's width and height, so that it has room to move."""
TURN = np.radians(6.0)
"""How far it turns to either side."""
CLIMB = 0.1
"""How much larger and smaller things get."""
PERIODS_S = (13.0, 17.0, 19.0, 23.0)
"""Of its motion across, along, in turn and in height: they do not come round within a film."""
SEQUENCE_FPS = 2.0
"""Of pictures taken one after the other, as aerial cameras do, where nothing says it."""
LEAST_RUN = 5
"""Pictures that make a film."""
CRF = 17
"""Quality of the films: no difference is seen."""


def make_films(pictures: Path, out: Path, sequence_fps: float = SEQUENCE_FPS) -> list[str]:
    """Write NAME.mp4, NAME.csv and NAME.toml for each film into a folder; returns their names.

    Args:
        pictures: folder in one of the layouts of ``gcs eval-detector``.
        out: is made.
        sequence_fps: pictures a second of those taken one after the other.
    """
    out.mkdir(parents=True, exist_ok=True)
    names = []
    for name, images in _runs(open_folder(pictures).images).items():
        if len(images) >= LEAST_RUN:
            linked = link(images)
            films = [(name, linked, sequence_fps)]
            steps = round(FPS / sequence_fps)
            if steps > 1:
                films.append((f"{name}-filled", fill_in(linked, steps), steps * sequence_fps))
            for film, shown, fps in films:
                rows = [row for frame, picture in enumerate(shown) for row in picture.rows(frame)]
                _write(out / film, [picture.image for picture in shown], rows, fps)
                names.append(film)
            continue
        for image in images:
            if len(image.truth.name):
                _write(out / f"{Path(image.name).stem}-pan", *pan(image), FPS)
                names.append(f"{Path(image.name).stem}-pan")
    return names


def _runs(images: Sequence[LabelledImage]) -> dict[str, list[LabelledImage]]:
    """Pictures taken one after the other, by the name of the first; all others alone."""
    runs: dict[str, list[LabelledImage]] = {}
    last: dict[str, tuple[int, str]] = {}
    numbered = sorted(images, key=lambda image: [int(n) for n in re.findall(r"\d+", image.name)])
    for image in numbered:
        digits = re.findall(r"\d+", Path(image.name).stem)
        number = int(digits[-1]) if digits else 0
        stem = f"{re.sub(r'[0-9]+$', '', Path(image.name).stem)} {image.read().shape}"
        before = last.get(stem)
        first = before[1] if digits and before and before[0] == number - 1 else Path(image.name).stem
        runs.setdefault(first, []).append(image)
        last[stem] = (number, first)
    return runs


def pan(image: LabelledImage) -> tuple[list[Image], list[str]]:
    """Images of a virtual camera over a picture, and rows of labels."""
    picture, boxes = np.asarray(image.read()), image.truth.boxes[image.truth.counts]
    kinds = image.truth.name[image.truth.counts].tolist()
    height, width = picture.shape[:2]
    share = min(1.0, MOST_OF_SIDE * width / SIZE[0], MOST_OF_SIDE * height / SIZE[1])
    size = tuple(2 * int(0.5 * share * side) for side in SIZE)
    points = corners(boxes)
    frames, rows = [], []
    middle = boxes[:, :2].mean(axis=0)
    room = np.maximum(0.5 * (np.array([width, height]) - 1.25 * np.array(size)), 0.0)
    centre = np.clip(middle, 0.5 * np.array([width, height]) - room, 0.5 * np.array([width, height]) + room)
    reach = np.minimum(room, 0.35 * np.array(size))
    for frame in range(int(FPS * SECONDS)):
        wave = np.sin(2.0 * np.pi * frame / FPS / np.array(PERIODS_S))
        at, scale, turn = centre + reach * wave[:2], 1.0 + CLIMB * wave[3], TURN * wave[2]
        A = scale * np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
        M = np.column_stack([A, 0.5 * np.array(size) - A @ at])
        frames.append(np.asarray(cv2.warpAffine(picture, M, size, flags=cv2.INTER_AREA), np.uint8))
        moved = points @ A.T + M[:, 2]
        middles = moved.mean(axis=1)
        inside = np.minimum(middles, np.array(size) - middles).min(axis=1) > 0.0
        rows += [_row(frame, k, moved[k], kinds[k]) for k in np.flatnonzero(inside).tolist()]
    return frames, rows


def _row(frame: int, track: int, points: FloatArray, name: str) -> str:
    return f"{frame},{track},{','.join(f'{value:.2f}' for value in points.ravel())},{name}"


def _write(path: Path, frames: Sequence[Image], rows: Sequence[str], fps: float) -> None:
    height, width = frames[0].shape[:2]
    t = np.arange(len(frames)) / fps
    encode(frames, t, path.with_name(f"{path.name}.mp4"), size=(width, height), fps=fps, crf=CRF)
    header = "frame,id,x1,y1,x2,y2,x3,y3,x4,y4,class"
    path.with_name(f"{path.name}.csv").write_text("\n".join([header, *rows, ""]), encoding="utf-8")


def main() -> None:
    parser = argparse.ArgumentParser(
        prog="python -m bench.annotated.made_films", description=(__doc__ or "").split("\n")[0]
    )
    parser.add_argument("pictures", type=Path, metavar="PICTURES", help="labelled pictures, as for gcs eval-detector")
    parser.add_argument("--out", "-o", type=Path, required=True, help="folder of the films")
    parser.add_argument(
        "--fps", type=float, default=SEQUENCE_FPS, help="of pictures taken one after the other (%(default)g)"
    )
    options = parser.parse_args()
    names = make_films(options.pictures, options.out, options.fps)
    print_note(f"{len(names)} films written to {options.out}: {', '.join(names)}")


if __name__ == "__main__":
    with errors_as_exit_codes():
        main()
