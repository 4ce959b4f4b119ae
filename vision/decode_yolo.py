"""From a YOLO-OBB export's raw output to boxes: for each anchor cx, cy, w, h in pixels, a score per class, an angle.

The layout is that of Ultralytics' oriented models exported to ONNX without suppression: output [1, 4 + classes + 1, N].
"""

from __future__ import annotations

import ast
import re
from collections.abc import Collection, Mapping

import numpy as np
from numpy.typing import NDArray

from vision.boxes import canonical, nms
from vision.detections import Detections

__all__ = ["class_names", "decode", "vehicle_classes"]

VEHICLE_WORDS = frozenset(
    ("automobile", "bus", "car", "jeep", "lorry", "pickup", "rover", "suv", "truck", "ugv", "van", "vehicle")
)
MAX_ANCHORS = 1000


def class_names(metadata: Mapping[str, str]) -> dict[int, str]:
    """Class names from a model's metadata, ``{0: 'plane', …}`` as text; empty where there are none.

    Raises:
        ValueError: the text is there but is no such table.
    """
    text = metadata.get("names", "")
    if not text:
        return {}
    try:
        table = ast.literal_eval(text)
        pairs = table.items() if isinstance(table, dict) else enumerate(table)
        return {int(k): str(v) for k, v in pairs}
    except (SyntaxError, TypeError, ValueError) as error:
        raise ValueError(f"its class names cannot be read: {text[:80]!r}") from error


def vehicle_classes(names: Mapping[int, str], classes: int, wanted: Collection[str] | None = None) -> NDArray[np.intp]:
    """Which classes count.

    Args:
        names: of the model; empty when it does not tell.
        classes: how many the model has.
        wanted: names to take; None takes those with a word for a vehicle in them, and of a model with a single class or
            without names all.

    Returns:
        Class numbers (k,), at least one.

    Raises:
        ValueError: no class is wanted.
    """
    if wanted is not None:
        chosen = [k for k in range(classes) if names.get(k) in wanted]
    elif classes == 1 or not names:
        chosen = list(range(classes))
    else:
        chosen = [k for k in range(classes) if VEHICLE_WORDS & set(_words(names.get(k, "")))]
    if not chosen:
        sought = "vehicles" if wanted is None else ", ".join(sorted(wanted))
        raise ValueError(f"none of its classes is of {sought}: {', '.join(names.values()) or 'they have no names'}")
    return np.array(chosen, dtype=np.intp)


def decode(rows: NDArray[np.float32], classes: NDArray[np.intp], score: float, overlap: float = 0.45) -> Detections:
    """Boxes in pixels of the model's input, best first; heading NaN, as the model does not know fronts.

    Args:
        rows: (4 + all classes + 1, N), the model's output without its first axis.
        classes: (k,) the classes that count; a box is one vehicle, whatever its kind.
        score: smallest score that counts, 0 to 1.
        overlap: of two boxes that overlap more (probabilistic IoU), the one of lower score is dropped.
    """
    best = rows[4 + classes].max(axis=0)
    chosen = np.flatnonzero(best >= score)
    chosen = chosen[np.argsort(-best[chosen], kind="stable")[:MAX_ANCHORS]]
    table = rows[:, chosen].astype(np.float64)
    finite = np.isfinite(table).all(axis=0) & (table[2] > 0.0) & (table[3] > 0.0)
    table, value = table[:, finite], best[chosen][finite].astype(np.float64)
    if not table.shape[1]:
        return Detections.empty()
    boxes = canonical(np.column_stack([table[0], table[1], table[2], table[3], table[-1]]))
    cx, cy, w, h, angle = boxes.T
    heading = np.full(len(cx), np.nan)
    found = Detections(cx=cx, cy=cy, w=w, h=h, angle=angle, score=np.clip(value, 0.0, 1.0), heading=heading)
    return found.take(nms(boxes, value, overlap))


def _words(name: str) -> list[str]:
    """Lower-case words of a class name, a plural's s taken off: "Small-Vehicles" → small, vehicle."""
    words = re.findall(r"[a-z]+", name.lower())
    return words + [w[:-1] for w in words if w.endswith("s")]
