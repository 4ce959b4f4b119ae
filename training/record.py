"""The record of a training run: what was asked for, with versions and hashes, and what came of it."""

from __future__ import annotations

import hashlib
import json
import platform
from collections.abc import Iterable
from importlib.metadata import version
from pathlib import Path
from typing import Any

from training.split import Split
from vision.detect.onnx_model import metadata, open_session
from vision.errors import TrainingError
from vision.evaluation import LabelledImage

NAME = "run.json"
SAME = ("options", "labels sha256", "begins with sha256", "trained on", "watched", "kept apart")
"""Settings that a run which is continued must share with its beginning."""
PACKAGES = ("rollcall-gcs", "torch", "onnx", "onnxruntime", "numpy", "opencv-python-headless")
"""Whose versions are recorded."""


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
