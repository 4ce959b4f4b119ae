"""``gcs train-detector``: the bundled detector, fine-tuned on a user's labelled images."""

from __future__ import annotations

import contextlib
import json
import signal
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from gcs.cli.detectors.eval_detector import BUNDLED, GSD_M, detect_in_all, open_images, open_model, plain_classes
from gcs.cli.output.console import check_range, print_lines, print_note
from gcs.cli.output.progress import progress
from gcs.cli.output.tables import print_table
from gcs.errors import GcsError

if TYPE_CHECKING:
    from training.finetune import FineTuning
    from vision.evaluation import LabelledImage

CHECKOUT = Path(__file__).parents[3]
"""Folder with what is not in the package, of a program that runs from a checkout."""
INTERRUPTED = 130
"""Exit code of a program that the keyboard ended."""
KEPT_SHARE, WATCHED_SHARE = 0.2, 0.15
"""Shares of the labelled objects: those kept apart for the figures at the end and, of the others, those that tell when
to stop. A choice."""
SCORE = 0.3
"""Operating score of the figures at the end, as missions have it unless they say otherwise."""
STEPS, MINUTES, SHARES, SEEDS = (20, 100_000), (1.0, 10_000.0), (0.0, 0.9), (0, 2**31 - 1)
"""Ranges of the options."""


def train_detector(
    folder: Annotated[Path, typer.Argument(help="Labelled images: YOLO, DOTA, VisDrone-DET, COCO, or our own shards.")],
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder of the run, new; model.onnx is written there.")],
    resume: Annotated[bool, typer.Option("--resume", help="Continue the run in --out, with the same options.")] = False,
    minutes: Annotated[float, typer.Option(callback=check_range(*MINUTES), help="Time limit of the training.")] = 60.0,
    steps: Annotated[int, typer.Option(min=STEPS[0], max=STEPS[1], help="Maximum number of training steps.")] = 3000,
    rendered: Annotated[
        float, typer.Option(callback=check_range(*SHARES), help="Share of rendered images, so that nothing is lost.")
    ] = 0.4,
    seed: Annotated[int, typer.Option(min=SEEDS[0], max=SEEDS[1], help="Seed of the choice and order of images.")] = 0,
    gsd: Annotated[
        float | None,
        typer.Option(callback=check_range(*GSD_M), help="Metres on the ground per pixel; overrides the labels'."),
    ] = None,
    form: Annotated[
        str | None, typer.Option("--format", help="yolo, dota, visdrone, coco or shards; else detected.")
    ] = None,
    classes: Annotated[str | None, typer.Option(help="Labelled classes that are vehicles, by comma.")] = None,
    ignore: Annotated[str | None, typer.Option(help="Classes that are neither vehicle nor background.")] = None,
    names: Annotated[str | None, typer.Option(help="Names of YOLO class numbers, by comma.")] = None,
    corners_tell_front: Annotated[
        bool, typer.Option("--corners-tell-front", help="The first two corners of a label are its front.")
    ] = False,
) -> None:
    """Fine-tune the bundled detector on labelled images: an hour on a CPU, less on a GPU that torch finds."""
    if not (CHECKOUT / "training" / "finetune.py").is_file():
        raise GcsError(
            "training needs a checkout of Rollcall, it is not in the package: run make there, then "
            "python -m pip install -e '.[train]'; a model of any trainer that exports YOLO-OBB flies as well"
        )
    if missing := [name for name in ("torch", "onnx") if find_spec(name) is None]:
        raise GcsError(f"training needs {' and '.join(missing)}: in the checkout, python -m pip install -e '.[train]'")
    sys.path.append(str(CHECKOUT))
    from training.finetune import FineTuning, TrainingOptions
    from training.split import split
    from training.train import best_device

    _, images = open_images(folder, form, names, classes, ignore, corners_tell_front)
    if gsd is not None:
        images = [replace(image, gsd_m=gsd) for image in images]
    kept = split(images, KEPT_SHARE, seed)
    watched = split(kept.rest, WATCHED_SHARE, seed)
    print_note(
        f"trains on {len(watched.rest)} images, {len(watched.kept)} tell when to stop; {len(kept.kept)} are kept apart "
        f"to measure: {kept.how}"
    )
    options = TrainingOptions(seed=seed, steps=steps, minutes=minutes, rendered=rendered)
    run = FineTuning(out, kept, watched, options, resume=resume)
    if not run.finished:
        if rendered > 0.0:
            with progress("render") as report:
                run.render(report)
        with progress("look for false alarms") as report:
            run.mine(report)
        print_note(
            f"trains on the {'GPU' if best_device() == 'cuda' else 'CPU'}; Ctrl-C interrupts, --resume continues"
        )
        with progress("train") as report, _stop_between_steps() as stopped:
            whole = run.train(report, stopped)
        if not whole:
            print_note(f"interrupted; the same command with --resume continues the run in {out}")
            raise SystemExit(INTERRUPTED)
        run.finish()
    if run.best_step == 0:
        print_note(
            "no weights did better on the watched images than those of the bundled detector: it is kept as it was"
        )
    _compare(run, kept.kept)
    print_note(f"wrote {out / 'model.onnx'}; use it with [detector] model in a mission, or gcs eval-detector --model")


@contextlib.contextmanager
def _stop_between_steps() -> Iterator[Callable[[], bool]]:
    """Ctrl-C and a request to end are seen after the step that is being computed; a second Ctrl-C ends at once."""
    asked: list[int] = []

    def ask(number: int, frame: object) -> None:
        if asked:
            raise KeyboardInterrupt
        asked.append(number)

    before = {number: signal.signal(number, ask) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield lambda: bool(asked)
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _compare(run: FineTuning, images: tuple[LabelledImage, ...]) -> None:
    """Measure the new detector beside the bundled one on the images kept apart, as ``gcs eval-detector`` does."""
    from vision.evaluation import evaluate
    from vision.evaluation.comparison import Comparison, compare
    from vision.evaluation.report import as_json, comparison_tables

    truth, found = [image.truth for image in images], []
    for model in (run.out / "model.onnx", None):
        detector, native = open_model(model)
        found.append(detect_in_all(images, detector, None, native)[0])
    tuned, bundled = (plain_classes(evaluate(own, truth, score=SCORE)) for own in found)
    beside = Comparison(against=BUNDLED, other=bundled, differences=compare(found[0], found[1], truth, SCORE))
    for head, rows in comparison_tables(tuned, beside):
        print_table(head, rows, right=head[1:])
        print_lines("")
    run.add_result(json.loads(as_json(tuned, {"model": "model.onnx"}, beside)))
