"""The reliability diagram, drawn from ``reliability.csv``."""

from __future__ import annotations

import csv
import importlib
from pathlib import Path
from typing import Any

__all__ = ["MISSING", "draw_reliability"]

MISSING = "no figure: matplotlib is not installed; pip install 'rollcall-gcs[bench]' and run again, or draw the csv"


def draw_reliability(table: Path, picture: Path) -> bool:
    """Draw share right over confidence, the number of boxes below; False when matplotlib is missing."""
    try:
        matplotlib: Any = importlib.import_module("matplotlib")
        matplotlib.use("Agg")
        pyplot: Any = importlib.import_module("matplotlib.pyplot")
    except ImportError:
        return False
    with table.open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    figure, (upper, lower) = pyplot.subplots(2, 1, figsize=(5, 6), height_ratios=(3, 1), sharex=True)
    upper.plot([0.4, 1.0], [0.4, 1.0], color="0.7", linewidth=1)
    for version, marker in (("standard", "o"), ("hard", "s")):
        mine = [row for row in rows if row["version"] == version]
        confidence = [float(row["mean_confidence"]) for row in mine]
        upper.plot(confidence, [float(row["share_right"]) for row in mine], marker=marker, label=version)
        lower.plot(confidence, [int(row["boxes"]) for row in mine], marker=marker)
    upper.set(ylabel="share of names that are right", xlim=(0.45, 1.01), ylim=(0.0, 1.03))
    upper.legend()
    lower.set(xlabel="confidence said", ylabel="boxes", yscale="log")
    figure.tight_layout()
    figure.savefig(picture, dpi=110)
    pyplot.close(figure)
    return True
