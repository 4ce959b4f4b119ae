"""``gcs eval-detector``: how good a detector is on labelled images."""

from __future__ import annotations

import json
import os
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from gcs.cli.output.console import AsJson, check_range, print_json, print_lines, print_note
from gcs.cli.output.progress import progress
from gcs.cli.output.tables import print_table
from gcs.errors import GcsError
from infra.files.safe_open import create
from infra.plain_text import plain
from vision.evaluation.measures import FLOOR

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from vision.detect.detections import Detections
    from vision.detect.detector import Detector
    from vision.evaluation import Evaluation, LabelledImage

RESULTS = ("eval.json", "eval.md", "worst.png", "apart.png")
"""Files that are written into the folder of the results."""
BUNDLED = "bundled"
"""Word in place of a file's name for Rollcall's own model."""
GSD_M = (1e-4, 100.0)
"""Bounds of the ground resolution, metres per pixel: from a close-up to a satellite's."""


def eval_detector(
    folder: Annotated[Path, typer.Argument(help="Labelled images: YOLO, DOTA, VisDrone-DET, COCO, or our own shards.")],
    model: Annotated[Path | None, typer.Option(help="ONNX detector; the bundled one if left out.")] = None,
    against: Annotated[
        str | None, typer.Option(help="Another ONNX detector to compare with on the same images, or 'bundled'.")
    ] = None,
    front: Annotated[Path | None, typer.Option(help="ONNX classifier of fronts, for boxes without.")] = None,
    gsd: Annotated[
        float | None,
        typer.Option(callback=check_range(*GSD_M), help="Metres on the ground per pixel; overrides the labels'."),
    ] = None,
    score: Annotated[
        float, typer.Option(callback=check_range(FLOOR, 1.0), help="Operating score, of precision, recall and errors.")
    ] = 0.3,
    form: Annotated[
        str | None, typer.Option("--format", help="yolo, dota, visdrone, coco or shards; else detected.")
    ] = None,
    classes: Annotated[str | None, typer.Option(help="Labelled classes that count, by comma; else vehicles.")] = None,
    ignore: Annotated[str | None, typer.Option(help="Classes that count neither way, by comma.")] = None,
    names: Annotated[str | None, typer.Option(help="Names of YOLO class numbers, by comma.")] = None,
    corners_tell_front: Annotated[
        bool, typer.Option("--corners-tell-front", help="The first two corners of a label are its front.")
    ] = False,
    out: Annotated[Path | None, typer.Option("--out", "-o", help="Folder for eval.json, eval.md and images.")] = None,
    as_json: AsJson = False,
) -> None:
    """Measure a detector on a folder of labelled images."""
    from vision.evaluation import evaluate
    from vision.evaluation.comparison import Comparison, compare
    from vision.evaluation.report import WORDS, as_markdown, tables
    from vision.evaluation.report import as_json as to_json
    from vision.evaluation.sheet import worst_sheet

    # all that can be refused is refused before an image is looked at
    detector, native = open_model(model, front)
    other = None if against is None else open_model(None if against == BUNDLED else Path(against), front)
    if out is not None:
        _make_folder(out)
    labels, images = open_images(folder, form, names, classes, ignore, corners_tell_front)
    found, took = detect_in_all(images, detector, gsd, native)
    result = evaluate(found, [p.truth for p in images], score=score)
    about = {
        "pictures": folder.name,
        "labels": labels,
        "judged by": "upright boxes" if any(p.truth.upright for p in images) else "oriented boxes",
        "model": model.name if model else BUNDLED,
        "fronts": front.name if front else "the model's own",
        "ground resolution": f"{gsd:g} m per px" if gsd else "from the labels",
        "time a picture, ms": f"{1e3 * took / max(len(images), 1):.0f}",
    }
    result, about = plain_classes(result), {what: plain(which) for what, which in about.items()}
    sheets = {"worst.png": lambda: worst_sheet(images, found, score)}
    beside = None
    if against is not None and other is not None:
        theirs, _ = detect_in_all(images, other[0], gsd, other[1])
        name, truth = plain(Path(against).name), [p.truth for p in images]
        beside = Comparison(
            against=name,
            other=plain_classes(evaluate(theirs, truth, score=score)),
            differences=compare(found, theirs, truth, score),
        )
        sheets["apart.png"] = lambda: _apart(images, found, theirs, score, name)
    if as_json:
        print_json(json.loads(to_json(result, about, beside)))
    else:
        for head, rows in tables(result, about, beside):
            print_table(head, rows, right=head[1:] if head[0] != "what" else ())
            print_lines("")
        print_lines(*WORDS.split("\n"))
    if out is not None:
        _write(out, to_json(result, about, beside), as_markdown(result, about, beside), sheets)


def plain_classes(result: Evaluation) -> Evaluation:
    """Names of classes as a terminal can show them."""
    return replace(result, classes=tuple(replace(share, name=plain(share.name)) for share in result.classes))


def _apart(
    images: list[LabelledImage], found: list[Detections], theirs: list[Detections], score: float, name: str
) -> NDArray[np.uint8]:
    """Boxes that this detector finds and the other does not, and the other way round."""
    from vision.evaluation.apart_sheet import apart_sheet, disagreements

    truth = [p.truth for p in images]
    mine, alarms = disagreements(found, theirs, truth, score)
    others, their_alarms = disagreements(theirs, found, truth, score)
    kinds = [("found by this alone", mine), (f"found by {name} alone", others)]
    return apart_sheet(
        images, [*kinds, ("false alarms of this alone", alarms), (f"false alarms of {name} alone", their_alarms)]
    )


def open_images(
    folder: Path,
    form: str | None,
    names: str | None,
    classes: str | None,
    ignore: str | None,
    corners_tell_front: bool,
) -> tuple[str, list[LabelledImage]]:
    """The format of a folder's labels, and its images with the classes that count; arguments as the commands have them.

    Raises:
        LabelError, GcsError: they cannot be used.
    """
    from vision.evaluation import choose_in_all, open_folder

    opened = open_folder(folder, _format(form), names=_split(names), corners_tell_front=corners_tell_front)
    if opened.unlabelled:
        print_note(f"{opened.unlabelled} images have no label file and are not judged")
    if opened.missing:
        print_note(f"{opened.missing} images of the COCO file are not in {folder}")
    if opened.without_area:
        print_note(f"{opened.without_area} boxes have no height or no width and are left out")
    images, choice = choose_in_all(opened.images, _split(classes), _split(ignore))
    print_note(f"classes that count: {', '.join(sorted(choice.counts)) or 'none'}")
    return opened.format, images


def _split(text: str | None) -> list[str] | None:
    return None if text is None else [part.strip() for part in text.split(",") if part.strip()]


def _format(form: str | None) -> Any:  # noqa: ANN401  (one of FORMATS from here on)
    from vision.evaluation.folder import FORMATS

    if form is not None and form not in FORMATS:
        raise GcsError(f"--format {form}: there are {', '.join(FORMATS)}")
    return form


def open_model(model: Path | None, front: Path | None = None) -> tuple[Detector, float | None]:
    """The detector, and the ground resolution at which it looks at images as they are, if it is Rollcall's own."""
    from vision.detect.detector import BUNDLED, open_detector
    from vision.detect.onnx_model import metadata, open_session

    detector = open_detector(model, score=FLOOR)
    notes = metadata(open_session(model or BUNDLED, ("CPUExecutionProvider",), 1))
    own = "rollcall" in notes
    native = float(notes["nominal_length_m"]) / float(notes["nominal_length_px"]) if own else None
    if front is None:
        return detector, native
    from vision.detect.front import FrontedDetector, open_front_classifier

    return FrontedDetector(detector, open_front_classifier(front)), native


def detect_in_all(
    images: Sequence[LabelledImage], detector: Detector, gsd: float | None, native: float | None
) -> tuple[list[Detections], float]:
    """Detections of each image, and the seconds that all of them took."""
    found, took, blind = [], 0.0, 0
    with progress("eval-detector") as report:
        for labelled in images:
            used = gsd or labelled.ground_resolution_m(native)
            blind += used is None
            image: NDArray[np.uint8] = labelled.read()
            began = time.perf_counter()
            found.append(detector.detect(image, gsd_m=used))
            took += time.perf_counter() - began
            report(len(found), len(images))
    if blind:
        print_note(f"{blind} images of unknown ground resolution: their scale is found by the vehicles in them")
    return found, took


def _make_folder(out: Path) -> None:
    """Make a folder for results; one that holds some is refused."""
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise GcsError(f"{out}: cannot be made: {error.strerror}; give another folder") from error
    there = [path for path in map(out.joinpath, RESULTS) if path.exists()]
    if there:
        raise GcsError(f"{there[0]}: exists already and is never overwritten; give another folder")


def _write(out: Path, figures: str, text: str, sheets: Mapping[str, Callable[[], NDArray[np.uint8]]]) -> None:
    import cv2

    words = text + "".join(f"\n![{Path(name).stem}]({name})\n" for name in sheets)
    files = {"eval.json": figures.encode(), "eval.md": words.encode()}
    files |= {name: cv2.imencode(".png", draw())[1].tobytes() for name, draw in sheets.items()}
    try:
        for name, data in files.items():
            with os.fdopen(create(out / name), "wb") as file:
                file.write(data)
    except OSError as error:
        raise GcsError(f"{error.filename or out}: cannot be written: {error.strerror}; give another folder") from error
    print_note(f"wrote {out}")
