"""The names against the truth, where it is known: the score, and whether confidences came true."""

from __future__ import annotations

import itertools
from typing import Final

import numpy as np

from gcs.report.page.html import fixed, table
from gcs.report.score import Matched, score

SIDE, MARGIN = 320, 46
BINS: Final = np.array([0.0, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 0.99, 1.0])
"""Edges of the bins of confidence: finer where most names are."""


def score_parts(matched: Matched) -> str:
    """The score as a table, and the diagram."""
    s = score(matched)
    rows = [
        ("names that were right (precision)", fixed(100 * s.precision, 2, "%")),
        ("boxes of ours with the right name (right)", fixed(100 * s.right, 2, "%")),
        ("boxes of strangers that got no name", fixed(100 * s.fper, 2, "%")),
        ("wrong and sure (confidence 0.9 and more)", fixed(s.wrong_sure_s, 1, "s")),
        ("surely called strangers, and ours", fixed(100 * s.false_strangers, 2, "%")),
        ("names that changed", str(s.switches)),
        ("frames with true boxes in which none was seen", f"{s.frames_unlogged} of {s.frames}"),
        ("expected calibration error", fixed(s.ece, 4)),
        ("of all answers, none of ours among them", fixed(s.ece_all, 4)),
    ]
    return table(("what", "figure"), rows, right=("figure",), caption="Score against the truth") + _reliability(matched)


def _reliability(matched: Matched) -> str:
    """Share of right names over confidence: on the diagonal confidences come true."""
    named = (matched.named > 0) & np.isfinite(matched.confidence)
    confidence, right = matched.confidence[named], (matched.named == matched.truth)[named]
    points, rows = [], []
    for low, high in itertools.pairwise(BINS):
        inside = (confidence >= low) & ((confidence < high) | (high == 1.0))
        count = int(inside.sum())
        if not count:
            continue
        mean, share = float(confidence[inside].mean()), float(right[inside].mean())
        points.append((mean, share, count))
        rows.append((f"{low:g}–{high:g}", str(count), fixed(100 * mean, 1, "%"), fixed(100 * share, 1, "%")))
    if not points:
        return ""
    most = max(count for *_, count in points)
    marks = "".join(
        f'<circle class="c0" cx="{_x(mean):.1f}" cy="{_y(share):.1f}" r="{3 + 6 * (count / most) ** 0.5:.1f}" '
        'fill="currentColor" opacity="0.8"/>'
        for mean, share, count in points
    )
    ticks = "".join(
        f'<text class="ink" x="{_x(v):.1f}" y="{SIDE - MARGIN + 19}" text-anchor="middle">{v:g}</text>'
        f'<text class="ink" x="{MARGIN - 8}" y="{_y(v) + 4:.1f}" text-anchor="end">{v:g}</text>'
        for v in (0.0, 0.5, 1.0)
    )
    frame = f"M{_x(0):.1f} {_y(0):.1f}H{_x(1):.1f}V{_y(1):.1f}H{_x(0):.1f}z"
    drawing = (
        f'<svg viewBox="0 0 {SIDE} {SIDE}" role="img" class="small">'
        "<title>Share of right names over their confidence</title>"
        f'<path class="rule" d="{frame}" fill="none"/>'
        f'<path class="ink" d="M{_x(0):.1f} {_y(0):.1f}L{_x(1):.1f} {_y(1):.1f}" stroke="currentColor" '
        f'stroke-dasharray="4 4"/>{ticks}{marks}'
        f'<text class="ink" x="{SIDE / 2}" y="{SIDE - 5}" text-anchor="middle">confidence</text>'
        f'<text class="ink" x="20" y="{SIDE * 0.35:.0f}" transform="rotate(-90 20 {SIDE * 0.35:.0f})" '
        'text-anchor="middle">right</text>'
        "</svg>"
    )
    columns = ("confidence", "boxes", "mean confidence", "right")
    return drawing + table(columns, rows, right=columns, caption="Share of right names by confidence")


def _x(value: float) -> float:
    return MARGIN + value * (SIDE - 2 * MARGIN)


def _y(value: float) -> float:
    return SIDE - MARGIN - value * (SIDE - 2 * MARGIN)
