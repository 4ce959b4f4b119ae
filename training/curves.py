"""Learning curves as an image: the loss by step, and the figures on the held-out images."""

from __future__ import annotations

import csv
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
WIDTH, HEIGHT, MARGIN = 560, 320, 44
"""Sizes of one plot and of the margin around it, px."""
INK, GRID = (60, 60, 60), (225, 225, 225)
"""BGR of text and of grid lines."""
COLORS = ((180, 110, 30), (40, 140, 40), (40, 60, 200))
"""BGR of the curves, in order."""


def draw_curves(folder: Path) -> Path:
    """Draw ``curves.png`` from a training folder's loss.csv and quality.csv."""
    loss, quality = read_columns(folder / "loss.csv"), read_columns(folder / "quality.csv")
    left = plot("loss", loss["step"], {"total": _smooth(loss["total"])}, (0.0, float(loss["total"][:3].max())))
    shown = {name: quality[name] for name in ("ap50", "recall", "precision")}
    least = min(0.5, *(float(np.min(values, initial=1.0, where=np.isfinite(values))) for values in shown.values()))
    right = plot("held-out images", quality["step"], shown, (least, 1.0))
    path = folder / "curves.png"
    cv2.imwrite(str(path), np.hstack([left, right]))
    return path


def read_columns(path: Path) -> dict[str, FloatArray]:
    """The columns of a csv of numbers with at least one row, by name."""
    with path.open(newline="") as file:
        rows = list(csv.DictReader(file))
    return {name: np.array([float(row[name]) for row in rows]) for name in rows[0]}


def _smooth(values: FloatArray, window: int = 9) -> FloatArray:
    padded = np.pad(values, window // 2, mode="edge")
    return np.convolve(padded, np.full(window, 1.0 / window), mode="valid")


def plot(title: str, x: FloatArray, lines: dict[str, FloatArray], span: tuple[float, float]) -> NDArray[np.uint8]:
    """An image (HEIGHT, WIDTH, 3) of up to three lines over x, from span's low to its high."""
    image = np.full((HEIGHT, WIDTH, 3), 255, np.uint8)
    low, high = span

    def place(px: FloatArray, py: FloatArray) -> NDArray[np.int32]:
        u = MARGIN + px / max(float(x[-1]), 1.0) * (WIDTH - 2 * MARGIN)
        v = HEIGHT - MARGIN - (np.clip(py, low, high) - low) / (high - low) * (HEIGHT - 2 * MARGIN)
        return np.rint(np.stack([u, v], axis=-1)).astype(np.int32)

    for value in np.linspace(low, high, 6):
        ends = place(np.array([0.0, x[-1]]), np.array([value, value]))
        cv2.line(image, ends[0].tolist(), ends[1].tolist(), GRID, 1)
        _write(image, f"{value:.2g}", (6, int(ends[0, 1]) + 4), INK)
    for k, (name, values) in enumerate(lines.items()):
        known = np.isfinite(values)  # without a detection there is no precision
        cv2.polylines(image, [place(x[known], values[known])], False, COLORS[k], 2, cv2.LINE_AA)
        _write(image, f"{name} {values[-1]:.3f}", (MARGIN + 150 * k, HEIGHT - 8), COLORS[k])
    _write(image, f"{title}, steps 0 to {int(x[-1])}", (MARGIN, 24), INK)
    return image


def _write(image: NDArray[np.uint8], text: str, at: tuple[int, int], color: tuple[int, int, int]) -> None:
    cv2.putText(image, text, at, cv2.FONT_HERSHEY_SIMPLEX, 0.45, color, 1, cv2.LINE_AA)
