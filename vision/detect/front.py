"""Which end of an oriented box is the front: a classifier of rectified crops, after any detector.

Crops are stretched to a square with the box's longer side along +x; ``vision.detect.front_contract`` describes the
classifiers that are accepted. A class whose front is at a longer side counts only for boxes that are nearly square.

Reference:
    Chen, Du, Wu 2025, doi:10.3390/drones9090612, section 3.3 and figure 4: oriented detection, then a ResNet-18.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import onnxruntime as ort
from numpy.typing import ArrayLike, NDArray

from vision.detect.boxes import canonical, wrap
from vision.detect.detections import Detections
from vision.detect.detector import Detector
from vision.detect.front_contract import ACCEPTED, read_contract
from vision.detect.front_crops import rectify
from vision.detect.onnx_model import RUN_ERRORS, open_session, why
from vision.errors import ModelError

Image = NDArray[np.uint8]
Floats = NDArray[np.float64]

BUNDLED_FRONT = Path(__file__).parents[1] / "models" / "rollcall-front-resnet18.onnx"
"""Rollcall's own classifier of fronts."""
SQUARE = 1.3
"""Up to this ratio of its sides a box may have its front at a longer side."""
MOST_CROPS = 64
"""Crops in one run; more boxes take several."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Fronts:
    """Fronts of n boxes."""

    heading: Floats
    """(n,) clockwise from image up, rad in [0, 2π), NaN where the front is uncertain."""
    confidence: Floats
    """(n,) probability of the likeliest front, 0..1, also where that is too little to return it."""


class FrontClassifier:
    """A classifier of fronts."""

    def __init__(self, session: ort.InferenceSession, where: str, *, sure: float) -> None:
        self._session, self._where, self._sure = session, where, sure
        self._contract = read_contract(session, where)

    def classify(self, image: Image, boxes: ArrayLike) -> Fronts:
        """Fronts of boxes in an image.

        Args:
            image: (H, W, 3) BGR.
            boxes: (n, 5) cx, cy, w, h, angle; which of its sides is called the width makes no difference.

        Raises:
            ModelError: the model gave something of another shape than it promised.
        """
        rows = canonical(np.asarray(boxes, dtype=np.float64).reshape(-1, 5))
        front = self._contract.front
        logits = self._logits(image, rows)
        # the front is at a shorter side, unless the sides are too similar
        slim = rows[:, 2] > SQUARE * np.maximum(rows[:, 3], 1e-9)
        across = np.abs(np.sin(front)) > 0.5
        logits = np.where(slim[:, None] & across, -np.inf, logits)
        best = np.argmax(logits, axis=1)
        # p = 1 / Σ e^(z − z_best); NaN where there is no finite number to compare
        with np.errstate(invalid="ignore"):
            likely = 1.0 / np.exp(logits - logits.max(axis=1, keepdims=True)).sum(axis=1)
        confidence = np.where(np.isfinite(likely) & np.isfinite(front[best]), likely, 0.0)
        heading = np.mod(rows[:, 4] + front[best] + 0.5 * np.pi, 2.0 * np.pi)
        return Fronts(heading=np.where(confidence >= self._sure, heading, np.nan), confidence=confidence)

    def _logits(self, image: Image, rows: Floats) -> Floats:
        """(n, classes) of boxes (n, 5) in an image."""
        contract, fixed = self._contract, self._contract.batch
        # z = (rgb / 255 − mean) / std
        gain, bias = 1.0 / (255.0 * contract.std), contract.mean / contract.std
        logits = np.empty((len(rows), len(contract.front)))
        step = fixed or MOST_CROPS
        for start in range(0, len(rows), step):
            crops = rectify(image, rows[start : start + step], contract.side, contract.margin)
            part = (crops[..., ::-1] * gain - bias).transpose(0, 3, 1, 2).astype(contract.dtype)
            # a model that takes just so many crops gets some twice
            filled = part[np.arange(fixed) % len(part)] if fixed else part
            logits[start : start + step] = self._run(filled)[: len(part)]
        return logits

    def _run(self, planes: NDArray[np.floating]) -> NDArray[np.floating]:
        out: NDArray[np.floating]
        try:
            (out,) = self._session.run(None, {self._contract.name: np.ascontiguousarray(planes)})
        except RUN_ERRORS as error:
            raise ModelError(f"{self._where}: cannot be run on {len(planes)} crops: {why(error)}") from error
        wanted = (len(planes), len(self._contract.front))
        if out.shape != wanted:
            raise ModelError(
                f"{self._where}: gave an output of shape {list(out.shape)}, wanted {list(wanted)}; {ACCEPTED}"
            )
        return out


class FrontedDetector:
    """A detector whose boxes get their fronts from a classifier; fronts that the detector itself knows are kept.

    Args:
        score: boxes below stay without; each costs a run of a network, and what is hardly seen shows no front.
    """

    def __init__(self, detector: Detector, classifier: FrontClassifier, *, score: float = 0.0) -> None:
        self.detector = detector
        """Detector that finds the boxes."""
        self._classifier, self._score = classifier, score

    def detect(self, image: Image, *, gsd_m: float | None = None) -> Detections:
        """See ``vision.detect.detector.Detector``."""
        found = self.detector.detect(image, gsd_m=gsd_m)
        unknown = np.flatnonzero(np.isnan(found.heading) & (found.score >= self._score))
        if not len(unknown):
            return found
        heading = found.heading.copy()
        heading[unknown] = self._classifier.classify(image, found.boxes[unknown]).heading
        return _pointed(found, heading)


def open_front_classifier(
    path: Path | None = None, *, sure: float = 0.8, providers: Sequence[str] | None = None, threads: int = 1
) -> FrontClassifier:
    """Load a classifier.

    Args:
        path: an ONNX file; None = the bundled model.
        sure: least probability of a front that is returned: raise → fewer fronts turned about, lower → fewer unknown.
        providers: onnxruntime execution providers in order of preference; None = the CPU.

    Raises:
        ModelError: no such file, not an ONNX model, not a shape that is known, or metadata that make no sense.
    """
    chosen = path or BUNDLED_FRONT
    session = open_session(chosen, tuple(providers or ("CPUExecutionProvider",)), threads)
    return FrontClassifier(session, str(chosen), sure=sure)


def _pointed(found: Detections, heading: Floats) -> Detections:
    """Boxes whose width axis points to the heading where that is known: w and h change places if it lies across."""
    known = np.isfinite(heading)
    angle = np.where(known, wrap(heading - 0.5 * np.pi), found.angle)
    across = known & (np.abs(np.sin(angle - found.angle)) > np.sqrt(0.5))
    w, h = np.where(across, found.h, found.w), np.where(across, found.w, found.h)
    return replace(found, w=w, h=h, angle=angle, heading=heading)
