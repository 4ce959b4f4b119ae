"""The reliability diagram, drawn from ``reliability.csv``."""

from __future__ import annotations

from pathlib import Path

from bench.drawing import pyplot, read_rows

__all__ = ["draw_reliability"]


def draw_reliability(table: Path, out: Path) -> bool:
    """Draw share right over confidence, the number of boxes below; False when matplotlib is missing."""
    plot = pyplot()
    if plot is None:
        return False
    rows = read_rows(table)
    figure, (upper, lower) = plot.subplots(2, 1, figsize=(5, 6), height_ratios=(3, 1), sharex=True)
    upper.plot([0.4, 1.0], [0.4, 1.0], color="0.7", linewidth=1)
    for version, marker in (("standard", "o"), ("hard", "s")):
        mine = [row for row in rows if row["version"] == version]
        confidence = [float(row["mean_confidence"]) for row in mine]
        upper.plot(confidence, [float(row["share_right"]) for row in mine], marker=marker, label=version)
        lower.plot(confidence, [int(row["boxes"]) for row in mine], marker=marker)
    upper.set(ylabel="share of names that are right", xlim=(0.45, 1.01), ylim=(0.0, 1.03))
    upper.legend()
    lower.set(xlabel="confidence given", ylabel="boxes", yscale="log")
    figure.tight_layout()
    figure.savefig(out, dpi=110)
    plot.close(figure)
    return True
