"""Fine-tune the bundled detector on labelled images: a run in a folder, which can be interrupted and continued.

The folder holds ``run.json`` (what was asked for, with versions and hashes, and what came of it), ``rendered/`` (images
that keep fronts and boxes learnt while labels without them are learnt from), ``checkpoint.pt`` (all that is needed to
continue), ``best.pt``, ``loss.csv``, ``quality.csv`` (figures on the watched images), ``curves.png``, ``model.onnx``.
"""

from __future__ import annotations

import csv
import hashlib
import json
import os
import platform
import shutil
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import torch

from training.curves import draw_curves
from training.data import Mixture, Pool
from training.export import SCORE, export
from training.photographs import CAR_LENGTH_M, CAR_PX, MINING_SCORE, Photographs, open_photographs
from training.split import Split
from training.train import STATISTICS_IMAGES, Trainer, append_row, batches, best_device, render_crops
from vision.detect.detections import Detections
from vision.detect.detector import BUNDLED, open_detector
from vision.detect.onnx_model import metadata, open_session
from vision.errors import TrainingError
from vision.evaluation import LabelledImage, evaluate, match
from vision.evaluation.matching import ASIDE
from vision.evaluation.measures import FLOOR
from vision.evaluation.precision import balanced_score

NAME = "run.json"
SAME = ("options", "labels sha256", "begins with sha256", "trained on", "watched", "kept apart")
"""Settings that a run which is continued must share with its beginning."""
PACKAGES = ("rollcall-gcs", "torch", "onnx", "onnxruntime", "numpy", "opencv-python-headless")
"""Packages whose versions are recorded."""


def begin(kept: Split, watched: Split, options: dict[str, Any], start: Path) -> dict[str, Any]:
    """The record of a run that begins.

    Args:
        kept: its kept part is measured at the end.
        watched: of the rest, what is trained on and what is watched.
        start: model file that it begins with.
    """
    notes = metadata(open_session(start, ("CPUExecutionProvider",), 1))
    return {
        "options": options,
        "begins with": start.name,
        "begins with sha256": sha256(start),
        "version of the weights": f"{notes['rollcall']} fine-tuned",
        "labels sha256": _hash_of_labels((*kept.rest, *kept.kept)),
        "trained on": [image.name for image in watched.rest],
        "watched": [image.name for image in watched.kept],
        "kept apart": [image.name for image in kept.kept],
        "how they were split": kept.how,
        "versions": {"python": platform.python_version(), **{name: version(name) for name in PACKAGES}},
        "processor": platform.machine(),
        "steps": None,
    }


def continued(out: Path, asked: dict[str, Any]) -> dict[str, Any]:
    """The record of a run that goes on.

    Raises:
        TrainingError: there is none, or it began otherwise than ``asked``.
    """
    path = out / NAME
    try:
        record = json.loads(path.read_text(encoding="utf-8"))
        differs = [key for key in SAME if record[key] != asked[key]]
    except OSError as error:
        raise TrainingError(f"{path}: {error.strerror}; there is no run to continue, leave --resume out") from error
    except (ValueError, KeyError, TypeError) as error:
        raise TrainingError(f"{path}: is no record of a run: {error}; begin another in another folder") from error
    if differs:
        raise TrainingError(
            f"{path}: the run began with other {', '.join(differs)}; give the folder and options it began with"
        )
    return dict(record)


def finish(record: dict[str, Any], model: Path, *, best_step: int, steps: int, score: float) -> None:
    """Add what came of a run.

    Args:
        record: is changed.
        score: of the network that the file returns as 0.3.
    """
    record |= {"steps": steps, "best step": best_step, "score returned as 0.3": score, "model sha256": sha256(model)}


def write_record(out: Path, record: dict[str, Any]) -> None:
    """Write it whole, or not."""
    part = out / "run.part"
    part.write_text(json.dumps(record, indent=2, ensure_ascii=False) + "\n", encoding="utf-8")
    part.replace(out / NAME)


def sha256(path: Path) -> str:
    """SHA-256 of a file's content, in hexadecimal."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


def _hash_of_labels(images: Iterable[LabelledImage]) -> str:
    """Hash of names, boxes, classes and scale of all images."""
    total = hashlib.sha256()
    for image in sorted(images, key=lambda image: image.name):
        truth = image.truth
        words = (image.name, f"{image.gsd_m:g}", *truth.name.tolist())
        total.update("\n".join(words).encode())
        for values in (truth.boxes, truth.heading, truth.counts):
            total.update(values.tobytes())
    return total.hexdigest()


Report = Callable[[int, int], None]
"""Is told how much is done, and of how much."""
RENDERED_CROPS, RENDERED_SHARD = 500, 50
"""Rendered images of a run, and those in one file; as many as are rendered in two minutes."""
RENDERED_SEED, SEEDS = 700_000, 1000
"""Seed of the first shard of a run of seed 0, and how many runs have crops of their own."""
MAX_PROCESSES = 4
"""Most processes that render; each needs 300 MB."""
MEASURED_STEPS = 20
"""Steps by which the time that a run takes is estimated."""
MIN_STEPS = 100
"""Steps of a run on a computer that is too slow for more in the given time."""
CHECKS = 12
"""Looks at the watched images in a run ..."""
PATIENCE, EARLIEST = 4, 0.5
"""... of which this many without a better figure end it, though not before this share of its steps: while the learning
rate is high, figures are worse than they become."""
LOSS_EVERY = 10
"""Steps between rows of loss.csv."""
WARM_UP_SHARE, AVERAGE_SHARE = 0.1, 0.1
"""Shares of a run's steps: those in which the learning rate rises, and those over which weights are averaged."""
MIN_OBJECTS = 30
"""Fewer watched vehicles do not tell which score is best: one of them would move recall by 3 %."""
F1_SLACK = 0.02
"""Loss of F1 on watched images that is given for recall: other places are harder than those next to trained ones."""
SCORES = (0.1, 0.5)
"""Operating scores that a network is believed to have. Higher ones were best on watched images alone: on other places
of the same flights a third of the vehicles was lost by them."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TrainingOptions:
    """Options that a user may choose."""

    seed: int = 0
    steps: int = 3000
    """At most."""
    minutes: float = 60.0
    """At most, about."""
    rate: float = 3e-4
    """Highest learning rate: raise → learns more of the new, forgets more of the old."""
    rendered: float = 0.4
    """Share of rendered images in each step."""


class FineTuning:
    """A run.

    Args:
        kept: images apart from which it may learn; they are only named in the record.
        watched: of the rest, the images to learn from, and those that decide when to stop and which weights are best.

    Raises:
        TrainingError: the folder cannot be made, exists (without ``resume``), or holds no run that began like this one
            (with it).
    """

    def __init__(self, out: Path, kept: Split, watched: Split, options: TrainingOptions, *, resume: bool) -> None:
        self.out = out
        self._options = options
        self._watched = watched.kept
        self._images = watched.rest
        asked = begin(kept, watched, asdict(options), BUNDLED)
        self._record = continued(out, asked) if resume else asked
        self._source: Photographs | None = None
        for what, images in (("to learn from", self._images), ("to watch", self._watched)):
            if not any(image.truth.counts.any() for image in images):
                raise TrainingError(f"no vehicle is labelled on the {len(images)} images {what}; give more images")
        if not resume:
            try:
                out.mkdir(parents=True)
            except FileExistsError as error:
                raise TrainingError(f"{out}: exists already; name another folder, or give --resume") from error
            except OSError as error:
                raise TrainingError(f"{out}: cannot be made: {error.strerror}; name another folder") from error
            write_record(out, self._record)

    @property
    def finished(self) -> bool:
        """True if ``model.onnx`` is there."""
        return (self.out / "model.onnx").exists()

    def render(self, report: Report) -> None:
        """Render the images that are missing.

        Raises:
            TrainingError: rendering failed.
        """
        folder, shards = self.out / "rendered", RENDERED_CROPS // RENDERED_SHARD
        processes = min(os.cpu_count() or 1, MAX_PROCESSES)
        first = RENDERED_SEED + shards * (self._options.seed % SEEDS)
        spans = np.array_split(np.arange(first, first + shards), processes)
        with (self.out / "rendered.log").open("ab") as words:
            makers = [render_crops(folder, int(s[0]), len(s), RENDERED_SHARD, words) for s in spans]
            try:
                while any(maker.poll() is None for maker in makers):
                    report(len(list(folder.glob("crops_*.npz"))), shards)
                    time.sleep(0.5)
            finally:
                for maker in makers:
                    maker.terminate()
                    maker.wait()
        if len(list(folder.glob("crops_*.npz"))) < shards:
            raise TrainingError(f"{folder}: images were not rendered; see {self.out / 'rendered.log'}")
        report(shards, shards)

    def mine(self, report: Report) -> None:
        """Read every image once, and find the false alarms of the bundled detector on it."""
        detector = open_detector(None, score=MINING_SCORE, threads=torch.get_num_threads())
        self._source = open_photographs(self._images, detector, self._options.seed, report)

    def train(self, report: Report, stopped: Callable[[], bool]) -> bool:
        """Train, or continue to.

        Args:
            stopped: whether to stop; looked at after each step.

        Returns:
            False where it was stopped: ``resume`` continues with the next step.
        """
        cv2.setNumThreads(1)
        mixture, trainer = self._mixture(), Trainer(self._options.seed, best_device(), self._options.rate)
        checkpoint = self.out / "checkpoint.pt"
        if checkpoint.exists():
            trainer.load(checkpoint)
        else:
            trainer.start_from(BUNDLED, mixture.batch(0, STATISTICS_IMAGES).values())
        for name in ("loss.csv", "quality.csv"):
            _drop_rows_after(self.out / name, trainer.step_count)
        self._plan(trainer, self._record["steps"])
        if trainer.step_count == 0:
            self._check(trainer)
        began, before = time.monotonic(), trainer.step_count
        for batch in batches(mixture, range(before, self._options.steps)):
            if trainer.step_count >= self._steps or self._no_better():
                break
            row = trainer.step(batch, trainer.step_count / self._steps)
            now = trainer.step_count
            if now % LOSS_EVERY == 0:
                append_row(self.out / "loss.csv", row)
            if self._record["steps"] is None and now - before == MEASURED_STEPS:
                self._plan(trainer, self._fit((time.monotonic() - began) / MEASURED_STEPS))
            if now % max(self._steps // CHECKS, 1) == 0 and self._record["steps"] is not None:
                self._check(trainer)
            report(now, self._steps)
            if stopped():
                trainer.save(checkpoint)
                return False
        self._check(trainer)
        return True

    def finish(self) -> None:
        """Write the best weights as ``model.onnx``, with scores of which 0.3 is a good threshold on watched images."""
        part, score = self.out / "model.part", SCORE
        if self.best_step:
            self._export(self.out / "best.pt", part, SCORE)
            score = _operating_score(part, self._watched)
            self._export(self.out / "best.pt", part, score)
        else:
            shutil.copyfile(BUNDLED, part)
        if (self.out / "loss.csv").exists():
            draw_curves(self.out)
        finish(self._record, part, best_step=self.best_step, steps=self._steps, score=score)
        write_record(self.out, self._record)
        part.replace(self.out / "model.onnx")

    def add_result(self, figures: dict[str, Any]) -> None:
        """Write what was measured on the images kept apart into the record."""
        self._record["measured"] = figures
        write_record(self.out, self._record)

    @property
    def best_step(self) -> int:
        """Step of the best weights; 0: those of the bundled detector."""
        return int(self._rows()[self._best()]["step"])

    def _mixture(self) -> Mixture:
        if self._source is None:
            raise RuntimeError("mine() comes before train()")
        pool = Pool(folder=self.out / "rendered")
        pool.refresh()
        shares = [(self._source, 1.0 - self._options.rendered)]
        return Mixture(rendered=pool, photographs=shares, seed=self._options.seed)

    def _fit(self, step_s: float) -> int:
        return int(np.clip(60.0 * self._options.minutes / step_s, MIN_STEPS, self._options.steps))

    def _plan(self, trainer: Trainer, steps: int | None) -> None:
        self._steps = min(steps or self._options.steps, self._options.steps)
        trainer.warm_up_steps = max(round(WARM_UP_SHARE * self._steps), 1)
        trainer.average_steps = max(round(AVERAGE_SHARE * self._steps), 1)
        if steps != self._record["steps"]:
            self._record["steps"] = steps
            write_record(self.out, self._record)

    def _check(self, trainer: Trainer) -> None:
        """Measure the averaged weights on the watched images, keep them where they are the best, save all."""
        if any(int(row["step"]) == trainer.step_count for row in self._rows()):
            return
        checkpoint, candidate = self.out / "checkpoint.pt", self.out / "candidate.onnx"
        trainer.save(checkpoint.with_name("next.pt"))
        self._export(checkpoint.with_name("next.pt"), candidate, SCORE)
        result = evaluate(detect(candidate, self._watched), [i.truth for i in self._watched])
        candidate.unlink()
        row = {
            "step": trainer.step_count,
            "ap50": result.ap50,
            "recall": result.recall,
            "precision": result.precision,
            "centre_ap": result.centres.ap,
        }
        append_row(self.out / "quality.csv", row)
        if self._best() == len(self._rows()) - 1:
            shutil.copyfile(checkpoint.with_name("next.pt"), self.out / "best.pt")
        checkpoint.with_name("next.pt").replace(checkpoint)

    def _export(self, checkpoint: Path, path: Path, score: float) -> None:
        export(checkpoint, path, version=self._record["version of the weights"], score=score)

    def _rows(self) -> list[dict[str, str]]:
        return _read_rows(self.out / "quality.csv")

    def _best(self) -> int:
        """Index of the row with the best mean of AP by boxes and by centres; of equals the last.

        Upright labels teach centres alone; boxes are to stay as good.
        """
        values = [float(row["ap50"]) + float(row["centre_ap"]) for row in self._rows()]
        return max(range(len(values)), key=lambda k: (values[k], k))

    def _no_better(self) -> bool:
        rows = self._rows()
        late = float(rows[-1]["step"]) >= EARLIEST * self._steps
        return late and len(rows) - 1 - self._best() >= PATIENCE


def detect(model: Path, images: Sequence[LabelledImage]) -> list[Detections]:
    """Boxes that a model file finds on each image."""
    detector = open_detector(model, score=FLOOR, threads=torch.get_num_threads())
    native_m = CAR_LENGTH_M / CAR_PX
    return [detector.detect(image.read(), gsd_m=image.ground_resolution_m(native_m)) for image in images]


def _operating_score(model: Path, images: Sequence[LabelledImage]) -> float:
    """The best operating score on some images, SCORE where they hold too few vehicles to tell."""
    found, objects = detect(model, images), sum(int(image.truth.counts.sum()) for image in images)
    if objects < MIN_OBJECTS:
        return SCORE
    pairs = list(zip(found, images, strict=True))
    number = np.concatenate([match(d, image.truth).truth[0] for d, image in pairs])
    scores = np.concatenate([d.score for d in found])
    best = balanced_score(scores[number != ASIDE], number[number != ASIDE] >= 0, objects, F1_SLACK)
    return float(np.clip(best, *SCORES)) if np.isfinite(best) else SCORE


def _read_rows(path: Path) -> list[dict[str, str]]:
    if not path.exists():
        return []
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def _drop_rows_after(path: Path, step: int) -> None:
    """Rows that a run which was killed wrote after its last checkpoint: they come again."""
    rows = _read_rows(path)
    kept = [row for row in rows if int(float(row["step"])) <= step]
    if len(kept) < len(rows):
        path.unlink()
        for row in kept:
            append_row(path, {name: float(value) for name, value in row.items()})
