"""UAVDT's notes about a film: weather, height and view, one file a film beside the labels."""

from __future__ import annotations

from pathlib import Path

from infra.files.safe_open import read_small

ATTRIBUTES = (
    "daylight",
    "night",
    "fog",
    "low-alt",
    "medium-alt",
    "high-alt",
    "front-view",
    "side-view",
    "bird-view",
    "long-term",
)
"""One 0 or 1 each, in this order."""
MOST_BYTES = 1000
FOLDERS_UP = 3
"""Levels above the labels at which the folder M_attr is looked for."""


def read_attributes(labels: Path) -> tuple[str, ...]:
    """The attributes that hold of a film, empty where there is no such file.

    Args:
        labels: NAME_gt.txt or NAME_gt_whole.txt; NAME_attr.txt lies beside it, or in M_attr, M_attr/train or
            M_attr/test of a folder above.
    """
    name = labels.stem.removesuffix("_gt_whole").removesuffix("_gt") + "_attr.txt"
    folders = [labels.parent]
    for above in labels.resolve().parents[:FOLDERS_UP]:
        folders += [above / "M_attr", above / "M_attr" / "train", above / "M_attr" / "test"]
    for folder in folders:
        try:
            cells = read_small(folder / name, MOST_BYTES).decode("ascii", errors="replace").replace(",", " ").split()
        except (OSError, ValueError):
            continue
        return tuple(word for word, cell in zip(ATTRIBUTES, cells, strict=False) if cell == "1")
    return ()
