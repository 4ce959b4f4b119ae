"""Plot of the share of identified vehicles over the camera's height, from ``apriltag.csv``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from bench.apriltag.flight import CAMERAS, SIDES_M
from bench.drawing import pyplot, read_rows

__all__ = ["draw_heights"]

TAG_COLORS = ("#d95f02", "#7570b3")


def draw_heights(table: Path, out: Path) -> bool:
    """Draw one panel a camera; returns False if matplotlib is missing."""
    plot = pyplot()
    if plot is None:
        return False
    rows = read_rows(table)
    figure, panels = plot.subplots(1, len(CAMERAS), figsize=(10, 4.6), sharey=True)
    for panel, camera in zip(panels, CAMERAS, strict=True):
        mine = sorted((row for row in rows if row["camera"] == camera), key=lambda row: float(row["height_m"]))
        _draw(panel, mine)
        panel.set(title=camera, xlabel="height above ground, m", ylim=(-3, 103))
        panel.grid(color="0.92")
    panels[0].set(ylabel="vehicles in view identified, %")
    figure.legend(*panels[0].get_legend_handles_labels(), fontsize=8, loc="lower center", ncols=4)
    figure.tight_layout(rect=(0.0, 0.1, 1.0, 1.0))
    figure.savefig(out, dpi=110)
    plot.close(figure)
    return True


def _draw(panel: Any, rows: list[dict[str, str]]) -> None:  # noqa: ANN401  (axes of a library without types)
    height = [float(row["height_m"]) for row in rows]

    def line(name: str, **style: Any) -> None:  # noqa: ANN401  (matplotlib's own keywords)
        panel.plot(height, [100.0 * float(row[name]) for row in rows], label=name, **style)

    line("product", color="#1b9e77", marker="o", linewidth=2.2)
    for side, color in zip(SIDES_M, TAG_COLORS, strict=True):
        line(f"tag {side:g} m, plain", color=color, linestyle="--", marker="v", markersize=4)
        line(f"tag {side:g} m", color=color, marker="s", markersize=4)
        line(f"tag {side:g} m, remembered", color=color, linestyle=":")
