"""Our boxes beside those of Ultralytics' own predictor, for every layout in which YOLO-OBB models are exported.

    python -m bench.video.yolo_parity [--out FILE] [--pictures FOLDER] [--trained MODEL.onnx --boxes REFERENCE.json]

Needs ``pip install ultralytics torch torchvision onnx onnxslim`` beside the project, in an environment of its own. The
models are of random weights (``bench.video.yolo_models``), the images are made here; ``--pictures`` adds a folder's. A
trained export and the boxes that the predictor gave for it are compared with ``--trained`` and ``--boxes``.

Both sides run the same file on the same image. A pair counts as the same box when no number differs by more than half
a pixel or a tenth of a degree. Left out on both sides are boxes that we never return: those centred off the image and
those with a side of zero or less. In float16 many scores are equal, and which of two equal boxes stays is left to how
each side sorts.
"""

from __future__ import annotations

import argparse
import importlib
import json
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from bench.video.yolo_models import DOTA, LAYOUTS, Layout, export, random_model
from vision.detect.detector import open_detector
from vision.detect.letterbox import letterbox

__all__ = ["ParityLine", "compared", "main"]

FAMILIES = ("yolov8n-obb", "yolo11n-obb", "yolo26n-obb")
SIZES = ((1280, 720), (640, 640), (1920, 1080), (1277, 733), (333, 517))
SIDE = 640
TWO_CLASSES = ("raw", "raw, turned", "nms", "end to end")
"""Layouts that a model of two classes is compared in: its 4 + 2 + 1 rows could be taken for seven columns."""
SCORE, OVERLAP = 0.25, 0.45
SAME_PX, SAME_DEG = 0.5, 0.1

Floats = NDArray[np.float64]
Image = NDArray[np.uint8]


@dataclass(frozen=True, slots=True, kw_only=True)
class ParityLine:
    """One model on one image."""

    model: str
    layout: str
    image: str
    theirs: int
    ours: int
    same: int
    worst_px: float
    """Of pairs whose centres lie within 8 px; NaN without any."""
    worst_deg: float

    @property
    def parity(self) -> bool:
        """Every box has its like."""
        return self.theirs == self.ours == self.same

    def __str__(self) -> str:
        numbers = f"{self.theirs} | {self.ours} | {self.same} | {self.worst_px:.3f} | {self.worst_deg:.3f}"
        return f"| {self.model} | {self.layout} | {self.image} | {numbers} |"


def compared(model: str, layout: str, image: str, theirs: Floats, ours: Floats) -> ParityLine:
    """Pair two sets of boxes (m, 5) and (k, 5), cx cy w h angle."""
    px, degrees = _differences(theirs, ours)
    i, j = linear_sum_assignment(np.minimum(px, 8.0) + np.minimum(degrees, 8.0))
    near = np.hypot(*(theirs[i, :2] - ours[j, :2]).T) < 8.0
    px, degrees = px[i, j][near], degrees[i, j][near]
    return ParityLine(
        model=model,
        layout=layout,
        image=image,
        theirs=len(theirs),
        ours=len(ours),
        same=int(((px <= SAME_PX) & (degrees <= SAME_DEG)).sum()),
        worst_px=float(px.max(initial=-np.inf)) if len(px) else np.nan,
        worst_deg=float(degrees.max(initial=-np.inf)) if len(px) else np.nan,
    )


def _differences(a: Floats, b: Floats) -> tuple[Floats, Floats]:
    """(m, k) greatest difference of centre and sides, px, and of the angle, deg; a box turned by 90° is the same."""
    c, d = a[:, None], b[None]
    centre = np.abs(c[..., :2] - d[..., :2]).max(axis=-1)
    ways = []
    for sides, turn in (((2, 3), 0.0), ((3, 2), np.pi / 2)):
        px = np.maximum(centre, np.abs(c[..., 2:4] - d[..., sides]).max(axis=-1))
        # the angle of a box is known modulo half a turn
        degrees = np.degrees(np.abs((c[..., 4] - d[..., 4] - turn + np.pi / 2) % np.pi - np.pi / 2))
        ways.append((px, degrees))
    (px, degrees), (px_turned, degrees_turned) = ways
    turned = px_turned + degrees_turned < px + degrees
    return np.where(turned, px_turned, px), np.where(turned, degrees_turned, degrees)


def _with_centre_inside(boxes: Floats, image: Image) -> Floats:
    """Of boxes (m, 5) those that our detector returns: with sides, and a centre inside the image."""
    cx, cy, w, h, _ = boxes.T
    inside = (cx >= 0) & (cx <= image.shape[1]) & (cy >= 0) & (cy <= image.shape[0])
    return np.asarray(boxes[inside & (w > 0) & (h > 0)])


def drawn_image(width: int, height: int, seed: int) -> Image:
    """Ground with soft spots, and boxes of any colour and angle on it; on the canvas all sizes look alike."""
    rng = np.random.default_rng(seed)
    unit = max(width, height) / SIDE
    soft = rng.uniform(60, 180, (round(height / unit / 24), round(width / unit / 24), 3)).astype(np.float32)
    image = cv2.resize(soft, (width, height), interpolation=cv2.INTER_CUBIC).clip(0, 255).astype(np.uint8)
    for _ in range(40):
        at = (float(rng.uniform(0, width)), float(rng.uniform(0, height)))
        size = (float(rng.uniform(10, 60)) * unit, float(rng.uniform(6, 30)) * unit)
        corners = cv2.boxPoints((at, size, float(rng.uniform(0, 180))))
        cv2.fillPoly(image, [corners.astype(np.int32)], rng.integers(0, 256, 3).tolist())
    return np.asarray(cv2.GaussianBlur(image, (0, 0), 0.8 * unit))


def _photograph(path: Path) -> Image:
    image = cv2.imread(str(path))
    if image is None:
        sys.exit(f"{path}: no image that can be read")
    return np.asarray(image, dtype=np.uint8)


def _predicted(predictor: Any, image: Image, batch: int, *, agnostic: bool) -> Floats:  # noqa: ANN401
    (first, *_) = predictor.predict(
        [image] * batch, conf=SCORE, iou=OVERLAP, imgsz=SIDE, agnostic_nms=agnostic, verbose=False, device="cpu"
    )
    return np.asarray(first.obb.xywhr.cpu().numpy(), dtype=np.float64).reshape(-1, 5)


def random_lines(names: Sequence[str], family: str, images: Mapping[str, Image], folder: Path) -> Iterator[ParityLine]:
    """A family in all its layouts on all images; the raw layout also with one box for each vehicle."""
    ultralytics = importlib.import_module("ultralytics")
    canvases = [letterbox(image, (SIDE, SIDE))[0] for image in images.values()]
    model = random_model(family, names, canvases, seed=7)
    plain = export(model, LAYOUTS[0], folder / "plain.onnx", SIDE)
    title = f"{family}, {len(names)} classes"
    for layout in LAYOUTS:
        if (layout.end_to_end and "yolo26" not in family) or (len(names) == 2 and layout.name not in TWO_CLASSES):
            continue
        path = export(model, layout, folder / "layout.onnx", SIDE)
        for agnostic in (False, True) if layout.name == "raw" else (False,):
            # as their predictor does it: the whole image at once
            detector = open_detector(
                path, score=SCORE, classes=names, per_class=not agnostic, imgsz=SIDE, tiled=False, threads=2
            )
            # their predictor cannot read a turned output: the plain file is used in its place
            predictor = ultralytics.YOLO(str(plain if layout.turned else path), task="obb")
            for name, image in images.items():
                theirs = _with_centre_inside(_predicted(predictor, image, _batch(layout), agnostic=agnostic), image)
                ours = detector.detect(image).boxes
                yield compared(title, layout.name + ", agnostic" * agnostic, name, theirs, ours)


def _batch(layout: Layout) -> int:
    return 2 if layout.options.get("batch") == 2 and "dynamic" not in layout.options else 1


def trained_lines(model: Path, reference: Path, images: Path) -> Iterator[ParityLine]:
    """A trained export against boxes recorded from their predictor."""
    detector = open_detector(model, score=SCORE, tiled=False)
    for name, recorded in json.loads(reference.read_text())["images"].items():
        image = _photograph(images / name)
        theirs = np.array([box["xywhr"] for box in recorded["dets"]]).reshape(-1, 5)
        yield compared(model.name, "raw, recorded boxes", name, theirs, detector.detect(image).boxes)


def report(lines: Sequence[ParityLine]) -> str:
    """A page with the table."""
    whole = sum(line.parity for line in lines)
    boxes, same = sum(line.theirs for line in lines), sum(line.same for line in lines)
    px, degrees = (
        [getattr(line, f) for line in lines if line.parity and line.theirs] for f in ("worst_px", "worst_deg")
    )
    head = (__doc__ or "").split("\n\n")
    version = importlib.import_module("ultralytics").__version__
    return "\n".join(
        [
            "# Parity with Ultralytics' predictor",
            "",
            head[0],
            "",
            head[3].strip(),
            "",
            f"With ultralytics {version} the boxes are the same in {whole} of {len(lines)} comparisons, and {same} of "
            f"{boxes} boxes; where all are the same the worst is {max(px):.3f} px, {max(degrees):.3f}°.",
            "",
            "| model | layout | image | theirs | ours | same | worst px | worst deg |",
            "|---" * 8 + "|",
            *map(str, lines),
            "",
        ]
    )


def main() -> int:
    """Compare and write the table."""
    parser = argparse.ArgumentParser(description="Compare YOLO-OBB boxes with Ultralytics' own predictor.")
    parser.add_argument("--out", type=Path, default=Path("bench-results/yolo_parity.md"))
    parser.add_argument("--families", nargs="*", default=FAMILIES)
    parser.add_argument("--pictures", type=Path, help="folder of photographs to compare on too")
    parser.add_argument("--trained", type=Path, help="a trained export")
    parser.add_argument("--boxes", type=Path, help="boxes that their predictor gave for it, on the photographs")
    chosen = parser.parse_args()
    try:
        for name in ("ultralytics", "torch", "onnx"):
            importlib.import_module(name)
    except ImportError as error:
        sys.exit(f"{error}; install with: pip install ultralytics torch torchvision onnx onnxslim")
    images = {f"drawn {w}x{h}": drawn_image(w, h, 10 + k) for k, (w, h) in enumerate(SIZES)}
    lines: list[ParityLine] = []
    if chosen.trained and chosen.boxes and chosen.pictures:
        lines += trained_lines(chosen.trained, chosen.boxes, chosen.pictures)
        images |= {path.name: _photograph(path) for path in sorted(chosen.pictures.glob("Site?_*.jpg"))}
    with tempfile.TemporaryDirectory() as folder:
        for family in chosen.families:
            for names in (DOTA, ("van", "lorry")):
                for line in random_lines(names, family, images, Path(folder)):
                    print(line, flush=True)
                    lines.append(line)
    chosen.out.write_text(report(lines))
    print(chosen.out)
    return 0 if all(line.parity for line in lines) else 1


if __name__ == "__main__":
    sys.exit(main())
