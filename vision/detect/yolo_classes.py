"""Classes of a YOLO model that are vehicles: read from the names that the model carries."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping

import numpy as np
from numpy.typing import NDArray

from vision.detect.onnx_model import table

VEHICLE_WORDS = frozenset(
    (
        "ambulance",
        "automobile",
        "bus",
        "car",
        "jeep",
        "lorry",
        "minibus",
        "minivan",
        "pickup",
        "rover",
        "suv",
        "taxi",
        "tractor",
        "trailer",
        "truck",
        "ugv",
        "van",
        "vehicle",
    )
)
"""A class counts when one of these is a word of its name: DOTA's "small vehicle" and "large vehicle", COCO's car, bus
and truck, VisDrone's car, van, truck and bus, VEDAI's pick-up, camping car and tractor."""
MAX_SHOWN = 30
"""Classes that a message names."""
NOT_ON_ROADS = frozenset(("aerial", "maritime", "park", "parking", "plate", "railway", "space", "train"))
"""A class with one of these words in its name does not: a car park, a railway vehicle, a licence plate of a car."""


def class_names(metadata: Mapping[str, str]) -> dict[int, str]:
    """Class names from a model's metadata, ``{0: 'plane', …}`` as text; empty where there are none.

    Raises:
        ValueError: the text is there but is no such table.
    """
    try:
        return {int(str(k)): str(v) for k, v in table(metadata.get("names", "")).items()}
    except ValueError as error:
        raise ValueError(f"its class names cannot be read: {metadata['names'][:80]!r}") from error


def vehicle_classes(names: Mapping[int, str], classes: int, wanted: Collection[str] | None = None) -> NDArray[np.intp]:
    """Choose the classes that count.

    Args:
        names: of the model; empty when unknown.
        wanted: names to take, in any case, or class numbers as text; None takes those named like vehicles, and of
            a model with a single class or without names all.

    Returns:
        Class numbers (k,), at least one, rising.

    Raises:
        ValueError: a wanted class is not there, or none is named like a vehicle.
    """
    if wanted is not None:
        chosen = _named(names, classes, wanted)
    elif classes == 1 or not names:
        chosen = list(range(classes))
    else:
        chosen = [k for k in range(classes) if _on_wheels(names.get(k, ""))]
    if not chosen:
        raise ValueError(
            f"none of its classes sounds like a vehicle: {_class_list(names, classes)}; name those that count"
        )
    return np.array(chosen, dtype=np.intp)


def _named(names: Mapping[int, str], classes: int, wanted: Collection[str]) -> list[int]:
    chosen: set[int] = set()
    for name in wanted:
        sought = name.strip().lower()
        found = [k for k in range(classes) if sought in (names.get(k, "").lower(), str(k))]
        if not found:
            raise ValueError(f"none of its classes is called {name!r}: {_class_list(names, classes)}")
        chosen.update(found)
    return sorted(chosen)


def _class_list(names: Mapping[int, str], classes: int) -> str:
    if len(names) > MAX_SHOWN:
        return ", ".join([*list(names.values())[:MAX_SHOWN], f"and {len(names) - MAX_SHOWN} more"])
    return ", ".join(names.values()) if names else f"they have no names, only the numbers 0 to {classes - 1}"


def _on_wheels(name: str) -> bool:
    # "Pick-up" is one word, "Small-Vehicles" are two; a plural's s is taken off
    words = set(re.findall(r"[a-z]+", name.lower().replace("pick-up", "pickup").replace("pick up", "pickup")))
    words |= {w[:-1] for w in words if w.endswith("s")} | {w[:-2] for w in words if w.endswith("es")}
    return bool(words & VEHICLE_WORDS) and not words & NOT_ON_ROADS
