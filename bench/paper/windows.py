"""Windows of consecutive frames cut from a flight, with the noise of an experiment on the reports.

T frames, m boxes, n vehicles. The boxes of a window are shuffled, so that their order is arbitrary. Unit noise depends
on the window alone: every noise level and every method sees the same draws, scaled.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bench.paper.films import FilmedFlight

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

SLOWEST_MPS = 1.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Window(FilmedFlight):
    """T frames of a flight in which the same m boxes are seen; positions without white noise."""

    start: int
    """First frame in the flight."""
    unit: FloatArray
    """(T, n, 8) unit normal draws: three for the position, one for the heading, and another set of these four."""

    def positions(self, sigma_m: float, *, second: bool = False) -> FloatArray:
        """(T, n, 3) reports with white noise of σ metres per axis; ``second`` takes draws of their own."""
        first = 4 if second else 0
        return np.asarray(self.p_enu + sigma_m * self.unit[..., first : first + 3])

    def headings(self, sigma_deg: float) -> FloatArray:
        """(T, n) reported headings with white noise of σ degrees."""
        return np.asarray(self.heading + np.radians(sigma_deg) * self.unit[..., 3])


def windows(
    film: FilmedFlight,
    frames: int,
    seed: int,
    *,
    boxes: int,
    visible: int,
    wander: bool = False,
) -> list[Window]:
    """All windows of a flight that fit the experiment, one after the other.

    Args:
        film: The flight.
        frames: T.
        seed: Of the noise.
        boxes: m that must be seen, the same in every frame.
        visible: The first ``visible`` vehicles must be among them.
        wander: Add the receivers' own errors to the reports.

    Returns:
        Windows in which no visible vehicle drives slower than 1 m/s (walking robots of ``wander`` may).
    """
    found = []
    for start in range(0, len(film.uv) - frames + 1, frames):
        part = slice(start, start + frames)
        seen = film.seen[part]
        slow = not wander and bool(np.any(film.speed[part, :visible] <= SLOWEST_MPS))
        constant = bool(np.all(seen == seen[0])) and int(np.sum(seen[0])) == boxes and bool(np.all(seen[0, :visible]))
        if constant and not slow:
            found.append(_window(film, part, np.flatnonzero(seen[0]), seed, wander))
    return found


def _window(film: FilmedFlight, part: slice, rows: IntArray, seed: int, wander: bool) -> Window:
    rng = np.random.default_rng([seed, part.start, part.stop])
    order = rng.permutation(rows)
    p = film.p_enu[part].copy()
    if wander:
        p[..., :2] += film.report_error[part]
    boxes = {name: getattr(film, name)[part, order] for name in ("uv", "front", "length_px", "seen")}
    others = ("heading", "speed", "report_error", "uav_enu", "uav_yaw")
    return Window(
        start=part.start,
        fps=film.fps,
        vehicle=film.vehicle[order],
        p_enu=p,
        unit=rng.normal(0.0, 1.0, (*p.shape[:2], 8)),
        **boxes,
        **{name: getattr(film, name)[part] for name in others},
    )
