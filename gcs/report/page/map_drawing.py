"""The flight from above: where vehicles reported to be, and where their boxes were seen. SVG, north up."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gcs.report.label_grid import Cells, Grid
from gcs.report.labels import Label, leader_of, place_labels
from gcs.report.page.flight_summary import FlightSummary, VehicleRecord
from gcs.report.page.html import CHART_WIDTH, DASHES, chart, empty, words
from gcs.report.page.style import COLOURS
from infra.plain_text import plain

WIDTH: Final = CHART_WIDTH
MARGIN: Final = 60
HEIGHTS: Final = (300, 800)
MIN_M: Final = 10.0
"""Across: a fleet that stands still is not magnified without end."""
FARTHEST_M: Final = 5_000.0
"""Places farther from the middle are jumps of a receiver."""
SQUARE, LETTER, LINE, DOT = 4, 9.6, 20, 4
"""Side of the squares in which names are placed, width of a letter, height of a line, radius of a dot."""
MAX_LETTERS: Final = 20
"""Most letters of a name; the roll call has all of it."""
JOIN_PARTS: Final = 6
"""Places farther apart in time than this many parts are not joined."""


def colour_of(index: int) -> str:
    """Attributes of the lines of the vehicle of this number: colour and dash; no other of 32 has both."""
    dash = DASHES[(index + index // COLOURS) % len(DASHES)]
    return f'class="c{index % COLOURS}" stroke="currentColor"' + (f' stroke-dasharray="{dash}"' if dash else "")


def draw_map(record: FlightSummary) -> str:
    """The map, with scale and north, or a sentence why there is none."""
    everybody = [*record.vehicles.values(), *([record.uav] if record.uav else [])]
    places = np.concatenate([np.zeros((0, 2)), *(v.reported for v in everybody), *(v.seen for v in everybody)])
    places = places[np.isfinite(places).all(axis=1)]
    if not len(places):
        return empty("No vehicle told where it was: there is no map.")
    places = places[np.linalg.norm(places - np.median(places, axis=0), axis=1) < FARTHEST_M]
    low, high = places.min(axis=0), places.max(axis=0)
    middle, across = (low + high) / 2, np.maximum(high - low, MIN_M)
    height = min(max(int(across[1] / across[0] * WIDTH), HEIGHTS[0]), HEIGHTS[1])
    scale = float(min((WIDTH - 2 * MARGIN) / across[0], (height - 2 * MARGIN) / across[1]))

    def to_px(p: NDArray[np.float64]) -> NDArray[np.float64]:
        # x = W/2 + s (E − E_m), y = H/2 − s (N − N_m)
        return np.asarray((p - middle) * (scale, -scale) + (WIDTH / 2, height / 2))

    parts: list[str] = []
    ends: list[tuple[str, str, float, float]] = []
    if record.uav is not None:
        parts.append(f'<g class="ink" opacity="0.7">{_path(to_px(record.uav.reported), "2 4", 1.0)}</g>')
        ends += _end(record.uav, to_px(record.uav.reported), "ink")
    for index, vehicle in enumerate(record.vehicles.values()):
        reported, seen = to_px(vehicle.reported), to_px(vehicle.seen)
        parts.append(f"<g {colour_of(index)}>{_path(reported, '', 1.0)}{_path(seen, '', 3.5)}</g>")
        ends += _end(vehicle, reported if np.isfinite(reported).any() else seen, f"c{index % COLOURS}")
    parts += [_names(ends, height), _scale_bar(scale, height), _north()]
    label = f"Map of the flight: reported and seen tracks of {len(record.vehicles)} vehicles, north up"
    drawing = chart(height, label, "".join(parts))
    legend = (
        "Thick: where its box was seen. Thin: where it reported to be. Each vehicle has its colour and dash, the UAV "
        "is dotted. Names stand at the ends."
    )
    return f'{drawing}<p class="soft">{legend}</p>'


def _path(points: NDArray[np.float64], dash: str, width: float) -> str:
    """A line through points (n, 2) px; interrupted where many in a row are unknown."""
    known = np.flatnonzero(np.isfinite(points).all(axis=1))
    if not len(known):
        return ""
    steps = []
    for place, before in zip(known, [-JOIN_PARTS - 1, *known[:-1]], strict=True):
        x, y = points[place]
        steps.append(f"{'M' if place - before > JOIN_PARTS else 'L'}{x:.1f} {y:.1f}")
    dashed = f' stroke-dasharray="{dash}"' if dash else ""
    return (
        f'<path d="{"".join(steps)}" fill="none" stroke="currentColor" stroke-width="{width}"{dashed} '
        'stroke-linejoin="round"/>'
    )


def _end(vehicle: VehicleRecord, points: NDArray[np.float64], kind: str) -> list[tuple[str, str, float, float]]:
    """Name, class and place of the end of a track (n, 2) px; nothing of one that is nowhere."""
    known = points[np.isfinite(points).all(axis=1)]
    return [(vehicle.name, kind, *known[-1].tolist())] if len(known) else []


def _names(ends: Sequence[tuple[str, str, float, float]], height: int) -> str:
    """A dot at the end of each track, and its name beside it where it is on no other name or dot.

    Args:
        ends: name, class and place, px.
        height: of the map, px.
    """
    labels = [
        Label(key=k, anchor=_squares(x - DOT, y - DOT, 2 * DOT, 2 * DOT), texts=(plain(name)[:MAX_LETTERS],))
        for k, (name, _, x, y) in enumerate(ends)
    ]
    grid = Grid(
        columns=WIDTH // SQUARE,
        rows=height // SQUARE,
        measure=lambda text: (math.ceil(len(text) * LETTER / SQUARE), LINE // SQUARE),
        step=(LINE // SQUARE, LINE // SQUARE),
        # the scale bar and the arrow
        blocked=(_squares(0, height - 40, WIDTH / 3, 40), _squares(WIDTH - 50, 0, 50, 75)),
    )
    dots, names = [], []
    for _, kind, x, y in ends:
        dots.append(f'<circle class="{kind}" cx="{x:.1f}" cy="{y:.1f}" r="{DOT}" fill="currentColor"/>')
    for place in place_labels(labels, grid).texts:
        # a count of names that found no place belongs to nobody
        kind = ends[place.key][1] if place.key >= 0 else "ink"
        if place.leader:
            x, y, to_x, to_y = (SQUARE * value for value in leader_of(place))
            line = f"M{x:.1f} {y:.1f}L{to_x:.1f} {to_y:.1f}"
            dots.append(f'<path class="{kind}" d="{line}" stroke="currentColor"/>')
        left, top, _, rows = (SQUARE * value for value in place.rect)
        names.append(f'<text class="{kind} halo" x="{left}" y="{top + rows - 5}">{words(place.text)}</text>')
    return "".join((*dots, *names))


def _squares(x: float, y: float, width: float, height: float) -> Cells:
    left, top = math.floor(x / SQUARE), math.floor(y / SQUARE)
    return left, top, math.ceil((x + width) / SQUARE) - left, math.ceil((y + height) / SQUARE) - top


def _scale_bar(scale: float, height: int) -> str:
    """A round number of metres, about a sixth of the width."""
    rough = WIDTH / 6 / scale
    decade = 10.0 ** math.floor(math.log10(rough))
    length = max(step * decade for step in (1, 2, 5) if step * decade <= rough)
    y, x = height - 20, 20
    return (
        f'<g class="ink"><path d="M{x} {y - 5}V{y}H{x + length * scale:.1f}V{y - 5}" fill="none" '
        'stroke="currentColor"/>'
        f'<text x="{x + length * scale + 8:.1f}" y="{y + 2}">{length:g} m</text></g>'
    )


def _north() -> str:
    x = WIDTH - 30
    return (
        f'<g class="ink"><path d="M{x} 50V18M{x - 6} 28L{x} 16L{x + 6} 28" fill="none" stroke="currentColor" '
        f'stroke-width="1.5"/><text x="{x}" y="66" text-anchor="middle">N</text></g>'
    )
