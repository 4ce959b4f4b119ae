"""Names, their confidence and alarms on one axis of time. SVG."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from gcs.certainty import CONFIRMED
from gcs.health.alarm_history import AlarmSpan
from gcs.report.page.flight_summary import FlightSummary, VehicleRecord
from gcs.report.page.html import CHART_WIDTH, chart, words
from gcs.report.page.style import COLOURS

LEFT, WIDTH, RIGHT = 160, CHART_WIDTH, 10
ROW, GAP = 34, 8
LOW_ROW, LOW_GAP = 18, 3
"""Rows of a fleet larger than ``MAX_ROWS``: on paper a drawing must not be longer than a sheet."""
MAX_ROWS: Final = 16
ALARM_ROW: Final = 22
NUMBER_WIDTH: Final = 30
"""Width that the number of an alarm takes."""
MAX_ALARM_ROWS: Final = 8
MAX_SOURCES: Final = 40
STEPS_S: Final = (1, 2, 5, 10, 15, 30, 60, 120, 300, 600, 900, 1800, 3600, 7200, 14400)
MAX_TICKS: Final = 9
MAX_LETTERS: Final = 15
"""Maximum number of letters of a name, as many as fit before the axis."""


def clock(seconds: float) -> str:
    """Time since the flight began, as ``m:ss.s``.

    Example:
        >>> clock(3.04), clock(75.0)
        ('0:03.0', '1:15.0')
    """
    tenths = max(round(seconds * 10), 0)
    return f"{tenths // 600}:{tenths % 600 // 10:02d}.{tenths % 10}"


def draw_timeline(record: FlightSummary) -> str:
    """Draw one row for each vehicle: its name's confidence as a curve over a band while it is in view; alarms below."""
    rows, y = [], 10.0
    height, gap = (ROW, GAP) if len(record.vehicles) <= MAX_ROWS else (LOW_ROW, LOW_GAP)
    for index, vehicle in enumerate(record.vehicles.values()):
        rows.append(_row(vehicle, y, height, f"c{index % COLOURS}"))
        y += height + gap
    # alarms that last at the same time stand below one another
    ends: list[float] = []
    for number, span in enumerate(record.alarms, 1):
        since, last = (_x(record, t_us) for t_us in (span.alarm.since_us, span.until_us))
        width = max(last - since, 3.0)
        line = next((k for k, end in enumerate(ends) if end < since), len(ends))
        if line >= MAX_ALARM_ROWS:
            continue
        ends[line : line + 1] = [since + width + (0 if width > NUMBER_WIDTH else NUMBER_WIDTH)]
        rows.append(_alarm(span, number, since, y + line * ALARM_ROW, width))
    if ends:
        rows.append(f'<text class="ink" x="0" y="{y + 15:.1f}">alarms</text>')
        y += len(ends) * ALARM_ROW + GAP
    label = "When each vehicle was named, how surely, and when alarms were raised"
    drawing = chart(y + 26, label, _axis(record, y) + "".join(rows))
    legend = (
        "Time since the flight began. Band: the vehicle reported to be in the picture. Curve: the least confidence of "
        f"its name then, from 0 at the bottom to 1 at the top; the line is {CONFIRMED:g}, from which on a name "
        "counts as confirmed. Where there is no curve it had no name. Alarms have their numbers in the list of alarms."
    )
    return f'{drawing}<p class="soft">{legend}</p>'


def draw_sources(sources: Sequence[tuple[str, Sequence[tuple[float, float]]]]) -> str:
    """Draw a bar for each vehicle over the time of which imported files tell of it; empty without any.

    Args:
        sources: who, and from and to which seconds of the film.
    """
    rows = [(whose, spans) for whose, spans in sources if spans][:MAX_SOURCES]
    ends = [end for _, spans in rows for span in spans for end in span]
    if not ends or min(ends) == max(ends):
        return ""
    first_s, last_s, bars, y = min(ends), max(ends), [], 10.0
    for index, (whose, spans) in enumerate(rows):
        bars.append(f'<g class="c{index % COLOURS}"><text x="0" y="{y + 15:.1f}">{words(whose[:MAX_LETTERS])}</text>')
        for since_s, until_s in spans:
            x, until = place(since_s, first_s, last_s), place(until_s, first_s, last_s)
            width = max(until - x, 1.0)
            bars.append(f'<rect x="{x:.1f}" y="{y:.1f}" width="{width:.1f}" height="{LOW_ROW}" fill="currentColor"/>')
        bars.append("</g>")
        y += LOW_ROW + LOW_GAP
    label = "From when to when each file tells of whom"
    legend = "Minutes and seconds since the film's first frame; where a bar is broken, nothing was logged."
    return chart(y + 26, label, axis(first_s, last_s, y) + "".join(bars)) + f'<p class="soft">{legend}</p>'


def _x(record: FlightSummary, t_us: int) -> float:
    return place(t_us, record.start_us, record.stop_us)


def _row(vehicle: VehicleRecord, top: float, height: float, kind: str) -> str:
    step = (WIDTH - LEFT - RIGHT) / len(vehicle.confidence)
    bands = [
        f"M{LEFT + low * step:.1f} {top:.1f}h{(high - low) * step:.1f}v{height:g}h-{(high - low) * step:.1f}z"
        for low, high in _runs(vehicle.in_view)
    ]
    curves = []
    for low, high in _runs(np.isfinite(vehicle.confidence)):
        heights = top + height * (1.0 - vehicle.confidence[low:high])
        points = [f"{LEFT + (low + k + 0.5) * step:.1f} {y:.1f}" for k, y in enumerate(heights)]
        curves.append(f"M{points[0]}" + (f"L{' '.join(points[1:])}" if points[1:] else "h1"))
    sure = top + height * (1.0 - CONFIRMED)
    return (
        f'<g class="{kind}"><text x="0" y="{top + height / 2 + 6:.1f}">{words(vehicle.name[:MAX_LETTERS])}</text>'
        f'<path d="{"".join(bands)}" fill="currentColor" opacity="0.15"/>'
        f'<path d="M{LEFT} {sure:.1f}H{WIDTH - RIGHT}" stroke="currentColor" stroke-width="0.5" '
        'stroke-dasharray="2 4"/>'
        f'<path d="{"".join(curves)}" fill="none" stroke="currentColor" stroke-width="2"/></g>'
    )


def _alarm(span: AlarmSpan, number: int, x: float, top: float, width: float) -> str:
    """A bar with its number, which stands behind a bar that is too short for it."""
    inside = width > NUMBER_WIDTH
    kind = "bad" if span.alarm.level == "alarm" else "warn"
    return (
        f'<g class="{kind}"><rect x="{x:.1f}" y="{top:.1f}" width="{width:.1f}" height="{ALARM_ROW - 3}" '
        f'fill="currentColor"><title>{words(span.alarm.text)}</title></rect>'
        f'<text class="{"on" if inside else "ink"}" x="{x + (3 if inside else width + 3):.1f}" y="{top + 15:.1f}">'
        f"{number}</text></g>"
    )


def _runs(flags: np.ndarray) -> list[tuple[int, int]]:
    """Return from where to where flags are set."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(np.int8)))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))


def _axis(record: FlightSummary, y: float) -> str:
    return axis(0.0, record.span_s, y)


def axis(first_s: float, last_s: float, y: float) -> str:
    """Lines at round times down to ``y``, and these times below it."""
    span_s = last_s - first_s
    step_s = next((step for step in STEPS_S if span_s / step <= MAX_TICKS), 86_400 * math.ceil(span_s / 86_400 / 9))
    ticks = []
    for k in range(math.ceil(first_s / step_s), int(last_s // step_s) + 1):
        x = place(k * step_s, first_s, last_s)
        minutes, seconds = divmod(abs(k) * step_s, 60)
        anchor = "end" if x > WIDTH - 30 else "middle"
        ticks.append(f'<path class="rule" d="M{x:.1f} 4V{y:.1f}"/>')
        ticks.append(
            f'<text class="ink" x="{x:.1f}" y="{y + 19:.1f}" text-anchor="{anchor}">'
            f"{'−' * (k < 0)}{minutes}:{seconds:02d}</text>"
        )
    return "".join(ticks)


def place(t_s: float, first_s: float, last_s: float) -> float:
    """Place of a time on an axis from the first to the last."""
    share = min(max((t_s - first_s) / (last_s - first_s), 0.0), 1.0)
    return LEFT + share * (WIDTH - LEFT - RIGHT)
