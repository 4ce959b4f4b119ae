"""Front ends of oriented boxes: a classifier of rectified crops, after any detector.

Crops are stretched to a square with the box's longer side along +x. A class whose front is at a longer side counts only
for boxes that are nearly square.

A classifier is an ONNX file with one input [N, 3, S, S] float32 or float16, RGB normalised, and one output
[N, classes], logits: what any framework exports for an image classifier. Its metadata has the rest, with these
defaults:

    front_deg   where the front of each class is, degrees clockwise on the crop from +x, or ``nan`` for a class that
                has no front; "0 180" of two classes, "0 90 180 270" of four; other counts must give it
    margin      how much more than the box is on the crop, a share of its sides: "0"
    mean, std   of the normalisation, of values in 0..1: ImageNet's
    size        side S where the input's is open: "224"

Reference:
    Chen, Du, Wu 2025, doi:10.3390/drones9090612, section 3.3 and figure 4: oriented detection, then a ResNet-18.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import onnxruntime as ort
from numpy.typing import ArrayLike, DTypeLike, NDArray

from vision.detect.boxes import canonical, wrap
from vision.detect.detections import Detections
from vision.detect.detector import Detector
from vision.detect.front_crops import rectify
from vision.detect.onnx_model import RUN_ERRORS, described, metadata, open_session, why
from vision.errors import ModelError

Image = NDArray[np.uint8]
Floats = NDArray[np.float64]

FRONTS_DEG = {2: (0.0, 180.0), 4: (0.0, 90.0, 180.0, 270.0)}
"""Default directions of the front, from the crop's +x, by number of classes."""
ACCEPTED = (
    "accepted are image classifiers (one input [N, 3, S, S] float32 or float16 → one output [N, classes] of logits; "
    "metadata 'front_deg' unless there are 2 or 4 classes)"
)
MAX_BATCH, MAX_SIDE, MAX_CLASSES = 64, 1024, 360
"""A run is 800 MB at the most; more classes than degrees make no sense."""
_DTYPES: dict[str, DTypeLike] = {"tensor(float)": np.float32, "tensor(float16)": np.float16}
_DEFAULTS = {"margin": "0", "mean": "0.485 0.456 0.406", "std": "0.229 0.224 0.225", "size": "224"}
_COUNTS = {"margin": 1, "mean": 3, "std": 3, "size": 1}
"""Numbers in each entry of the metadata."""
_RANGES = {"margin": (0.0, 4.0), "mean": (-1e3, 1e3), "std": (1e-6, 1e3), "size": (8.0, MAX_SIDE)}
"""Least and largest value of each."""
BUNDLED_FRONT = Path(__file__).parents[1] / "models" / "rollcall-front-resnet18.onnx"
"""Rollcall's own classifier of fronts."""
SQUARE = 1.3
"""Ratio of its sides up to which a box may have its front at a longer side."""
MAX_CROPS = 64
"""Crops in one run; more boxes take several."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Contract:
    """Contract of a classifier: how its crops are made and what its classes mean."""

    name: str
    """Name of the input."""
    dtype: DTypeLike
    batch: int | None
    """Crops in every run; None: any number."""
    side: int
    """Side of a crop, px."""
    margin: float
    mean: NDArray[np.float32]
    """(3,) RGB."""
    std: NDArray[np.float32]
    """(3,) RGB."""
    front: NDArray[np.float64]
    """(classes,) rad clockwise on the crop from +x, NaN of a class without front."""


def read_contract(session: ort.InferenceSession, where: str) -> Contract:
    """Read a classifier's contract from its file.

    Raises:
        ModelError: its inputs or outputs are not of a classifier, or its metadata make no sense.
    """
    image, classes = _ends(session, where)
    notes = metadata(session)
    front = _fronts(notes, classes, where)
    values = {key: _in_range(key, _numbers(notes, key, text, where), where) for key, text in _DEFAULTS.items()}
    batch, _, side, _ = image.shape
    fixed = batch if isinstance(batch, int) else None
    side = side if isinstance(side, int) else int(values["size"][0])
    if not (1 <= (fixed or 1) <= MAX_BATCH and 8 <= side <= MAX_SIDE and len(front) <= MAX_CLASSES):
        raise ModelError(
            f"{where}: it takes {fixed or 'any number of'} crops of {side} × {side} px and has {len(front)} classes; "
            f"at most {MAX_BATCH} crops of {MAX_SIDE} px and {MAX_CLASSES} classes are accepted"
        )
    return Contract(
        name=image.name,
        dtype=_DTYPES[image.type],
        batch=fixed,
        side=side,
        margin=values["margin"][0],
        mean=np.array(values["mean"], np.float32),
        std=np.array(values["std"], np.float32),
        front=front,
    )


def _ends(session: ort.InferenceSession, where: str) -> tuple[ort.NodeArg, object]:
    """The input, and the number of classes if it is fixed."""
    inputs, outputs = session.get_inputs(), session.get_outputs()
    if len(inputs) == len(outputs) == 1:
        (image,), (out,) = inputs, outputs
        fits = image.type in _DTYPES and out.type in _DTYPES and len(image.shape) == 4 and len(out.shape) == 2
        if fits and image.shape[1] == 3 and _square(image.shape[2], image.shape[3]):
            return image, out.shape[1]
    raise ModelError(f"{where}: not a front classifier of a known shape: {described(session)}; {ACCEPTED}")


def _square(height: object, width: object) -> bool:
    fixed = [isinstance(side, int) for side in (height, width)]
    return height == width if any(fixed) else True


def _fronts(notes: Mapping[str, str], classes: object, where: str) -> NDArray[np.float64]:
    default = FRONTS_DEG.get(classes, ()) if isinstance(classes, int) else ()
    degrees = np.array(_numbers(notes, "front_deg", " ".join(map(str, default)), where))
    if not len(degrees) or (isinstance(classes, int) and len(degrees) != classes):
        raise ModelError(
            f"{where}: it has {classes} classes and its metadata 'front_deg' gives {len(degrees)} fronts; one is "
            "needed for each class, degrees clockwise on the crop from +x, such as '0 180', or nan for no front"
        )
    front = np.radians(np.where(np.isfinite(degrees), degrees, np.nan))
    if (np.abs(np.sin(2.0 * front)) > 1e-6).any():
        raise ModelError(
            f"{where}: its metadata 'front_deg' is {notes['front_deg']!r}; a front is at a side of the crop: 0, 90, "
            "180 or 270"
        )
    return front


def _numbers(notes: Mapping[str, str], key: str, default: str, where: str) -> list[float]:
    text = notes.get(key, default)
    try:
        return [float(part) for part in text.strip("[]() ").replace(",", " ").split()]
    except ValueError:
        raise ModelError(f"{where}: its metadata {key!r} is {text!r}; numbers are needed") from None


def _in_range(key: str, values: list[float], where: str) -> list[float]:
    least, most = _RANGES[key]
    if len(values) != _COUNTS[key] or not all(least <= value <= most for value in values):
        raise ModelError(
            f"{where}: its metadata {key!r} is {values}; {_COUNTS[key]} between {least:g} and {most:g} must be there"
        )
    return values


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
        step = fixed or MAX_CROPS
        for start in range(0, len(rows), step):
            crops = rectify(image, rows[start : start + step], contract.side, contract.margin)
            part = (crops[..., ::-1] * gain - bias).transpose(0, 3, 1, 2).astype(contract.dtype)
            # a model that takes just this many crops gets some twice
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
