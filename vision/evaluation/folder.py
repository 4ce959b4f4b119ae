"""A folder of labelled images in any of the known layouts.

Labels lie beside the images, or in ``labels``, ``labelTxt`` or ``annotations`` where the images lie in ``images``; or,
of COCO, in JSON files anywhere in the folder. An empty label file means that nothing is there; an image without one is
not judged and is counted.
"""

from __future__ import annotations

import math
import os
import zipfile
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from infra.files.safe_open import open_to_read
from infra.text_numbers import number_or_nan
from infra.yaml_text import parse_yaml
from vision.errors import LabelError
from vision.evaluation.coco import find_coco, read_coco
from vision.evaluation.labels import LabelFile, read_dota, read_text, read_visdrone, read_yolo
from vision.evaluation.truth import LabelledImage, Truth
from vision.video.image_file import read_image

Image = NDArray[np.uint8]
Format = Literal["yolo", "dota", "visdrone", "coco", "shards"]
FORMATS: tuple[Format, ...] = get_args(Format)
"""Label formats, as given on the command line."""
IMAGES = frozenset((".jpg", ".jpeg", ".png", ".bmp", ".tif", ".tiff", ".webp"))
"""Suffixes of files that are read as images."""
LABEL_FOLDERS = ("labels", "labelTxt", "annotations")
"""Folders of label files in place of ``images``: of YOLO, DOTA, and others."""
NAME_FILES = ("data.yaml", "dataset.yaml", "classes.txt", "obj.names")
"""Files with the names of classes: of YOLO and Darknet."""
WANTED = f"NAME.txt beside NAME.jpg, or in one of {', '.join(LABEL_FOLDERS)} beside images, or a COCO file NAME.json"
"""Folder in which labels are looked for."""
VEHICLE = "vehicle"
"""Name of the only class."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Folder:
    """Images and labels that were found."""

    format: Format
    images: tuple[LabelledImage, ...]
    """Images in the order of their names."""
    unlabelled: int
    """Images without a label file, or of which none of COCO's files tells."""
    missing: int = 0
    """Images of a COCO file that are not in the folder."""
    without_area: int = 0
    """Boxes without height or width, which were left out."""


def open_folder(
    path: Path,
    format: Format | None = None,
    *,
    names: Sequence[str] | None = None,
    corners_tell_front: bool = False,
) -> Folder:
    """Read all labels of a folder; pixels are read later.

    Args:
        path: the folder; also a single shard.
        format: of the labels; None = recognised by their content.
        names: of YOLO classes in their order; None = from data.yaml or classes.txt in the folder, else numbers.
        corners_tell_front: the first two corners of an oriented label are those of the front.

    Raises:
        LabelError: no such folder, nothing in it that is labelled, or labels that make no sense.
    """
    if not path.exists():
        raise LabelError(f"{path}: no such folder; give one with images and their labels")
    shards = [path] if path.is_file() else sorted(path.glob("crops_*.npz"))
    if format == "shards" or (format is None and shards):
        if not shards:
            raise LabelError(
                f"{path}: no crops_*.npz in it; a checkout makes some: python -m training.rendered.crops --out ..."
            )
        return Folder(format="shards", images=tuple(p for s in shards for p in read_shard(s)), unlabelled=0)
    paths = sorted(p for p in path.rglob("*") if p.suffix.lower() in IMAGES)
    pairs = [(image, label) for image in paths if (label := _label_of(image)) is not None]
    if format == "coco" or (format is None and not pairs):
        return _open_coco(path, paths)
    if not pairs:
        raise LabelError(f"{path}: {len(paths)} images, none with labels; wanted {WANTED}")
    kind = format or _recognised_format([label for _, label in pairs])
    called = dict(enumerate(names)) if names is not None else _class_names(path)
    read = partial(_read, kind=kind, names=called, corners_tell_front=corners_tell_front)
    images, without_area = [], 0
    for image, label in pairs:
        labels = read(image, label)
        without_area += labels.without_area
        name = str(image.relative_to(path))
        images.append(LabelledImage(name=name, read=partial(_pixels, image), truth=labels.truth, gsd_m=labels.gsd_m))
    unlabelled = len(paths) - len(pairs)
    return Folder(format=kind, images=tuple(images), unlabelled=unlabelled, without_area=without_area)


def _read(image: Path, label: Path, *, kind: Format, names: Mapping[int, str], corners_tell_front: bool) -> LabelFile:
    if kind == "visdrone":
        return read_visdrone(label)
    if kind == "dota":
        return read_dota(label, corners_tell_front)
    height, width = _pixels(image).shape[:2]
    return read_yolo(label, (width, height), names, corners_tell_front)


def _open_coco(path: Path, images: Sequence[Path]) -> Folder:
    files = find_coco(path)
    if not files:
        raise LabelError(f"{path}: {len(images)} images, none with labels; wanted {WANTED}")
    by_name: dict[str, list[Path]] = defaultdict(list)
    for image in images:
        by_name[image.name].append(image)
    truths: dict[Path, Truth] = {}
    missing = without_area = 0
    for file in files:
        labels, left_out = read_coco(file)
        without_area += left_out
        for written, truth in labels.items():
            name = written.replace("\\", "/")  # as programs under Windows write it
            places = [p for p in by_name[Path(name).name] if p.as_posix().endswith("/" + name)]
            places = places or by_name[Path(name).name]
            if len(places) > 1:
                raise LabelError(f"{file}: {name!r} may be {places[0]} or {places[1]}; write more of its path")
            if any(place in truths for place in places):
                raise LabelError(f"{file}: {name!r} is labelled more than once; keep one of the files in the folder")
            missing += not places
            truths |= dict.fromkeys(places, truth)
    if not truths:
        raise LabelError(f"{files[0]}: none of its images is in {path}")
    found = [
        LabelledImage(name=str(image.relative_to(path)), read=partial(_pixels, image), truth=truths[image])
        for image in images
        if image in truths
    ]
    unlabelled = len(images) - len(found)
    return Folder(format="coco", images=tuple(found), unlabelled=unlabelled, missing=missing, without_area=without_area)


def _label_of(image: Path) -> Path | None:
    places = [image.with_suffix(".txt")]
    parts = image.parts
    for i in (i for i in range(len(parts) - 1) if parts[i] == "images"):
        places += [Path(*parts[:i], folder, *parts[i + 1 :]).with_suffix(".txt") for folder in LABEL_FOLDERS]
    return next((place for place in places if place.is_file()), None)


def _recognised_format(labels: Sequence[Path]) -> Format:
    """Tell the format from the first line with content."""
    for path in labels:
        for i, line in enumerate(read_text(path).splitlines(), 1):
            if not line.strip():
                continue
            fields = line.split()
            if line.lower().startswith(("imagesource", "gsd")) or (
                len(fields) in (9, 10) and math.isnan(number_or_nan(fields[8]))
            ):
                return "dota"
            if line.count(",") >= 7:
                return "visdrone"
            if len(fields) in (5, 9) and not any(map(math.isnan, map(number_or_nan, fields))):
                return "yolo"
            raise LabelError(
                f"{path}, line {i}: {line.strip()[:60]!r} is no label of YOLO, DOTA or VisDrone; see --format"
            )
    return "yolo"


def _class_names(folder: Path) -> dict[int, str]:
    """Names of the first file of class names in the folder or above it; empty without."""
    places = [place / name for place in (folder, folder.parent) for name in NAME_FILES]
    path = next((p for p in places if p.is_file()), None)
    if path is None:
        return {}
    text = read_text(path)
    if path.suffix != ".yaml":
        return {number: line.strip() for number, line in enumerate(text.splitlines()) if line.strip()}
    return _yaml_names(text, path)


def _yaml_names(text: str, path: Path) -> dict[int, str]:
    """The list or the numbered names under ``names``."""
    try:
        table = parse_yaml(text)
    except ValueError as error:
        raise LabelError(f"{path}: {error}") from None
    names = table.get("names") if isinstance(table, dict) else None
    if isinstance(names, list):
        names = dict(enumerate(names))
    if not isinstance(names, dict) or not names or not all(isinstance(number, int) for number in names):
        raise LabelError(f"{path}: no list of class names under 'names:'; give them with --names")
    return {number: str(name) for number, name in names.items()}


def _pixels(path: Path) -> Image:
    image = read_image(path)
    if image is None:
        raise LabelError(f"{path}: cannot be read as an image; remove it or mend it")
    return image


def shard_truth(rows: ArrayLike) -> Truth:
    """Labels of one crop.

    Args:
        rows: (n, 6) cx, cy, length, width px, heading (rad, clockwise from image up), weight (½ and less: does not
            count).
    """
    table = np.asarray(rows, dtype=np.float64).reshape(-1, 6)
    # the width axis of a box points to the front: angle = heading − π/2
    boxes = np.column_stack([table[:, :4], table[:, 4] - 0.5 * np.pi])
    return Truth(
        boxes=boxes,
        heading=table[:, 4],
        name=np.full(len(table), VEHICLE),
        counts=table[:, 5] > 0.5,
        hidden=np.full(len(table), -1),
    )


def read_shard(path: Path) -> list[LabelledImage]:
    """All crops of a shard.

    Raises:
        LabelError: it is no such file.
    """
    try:
        with os.fdopen(open_to_read(path), "rb") as file, np.load(file) as shard:
            images, boxes, n = shard["images"], shard["boxes"], shard["n"]
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
        raise LabelError(f"{path}: no shard of crops with images, boxes and n: {error}") from error
    fits = images.ndim == 4 and images.shape[3] == 3 and boxes.ndim == 3 and boxes.shape[2] == 6
    if not fits or not len(images) == len(boxes) == len(n) or (len(n) and n.max() > boxes.shape[1]):
        raise LabelError(f"{path}: images {images.shape}, boxes {boxes.shape} and n {n.shape} do not belong together")
    return [
        LabelledImage(name=f"{path.stem} {i}", read=_reader(image), truth=shard_truth(rows[:k]), as_seen=True)
        for i, (image, rows, k) in enumerate(zip(images, boxes, n.tolist(), strict=True))
    ]


def _reader(image: Image) -> Callable[[], Image]:
    return partial(np.asarray, image)
