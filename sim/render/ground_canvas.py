"""A sheet of ground to paint on, in metres: u to the east, v to the south, from its corner."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from sim.render.ground import grain
from sim.world.view import FloatArray

Image = NDArray[np.uint8]
Color = tuple[int, int, int]
SHIFT = 4
"""Fraction bits of OpenCV's drawing coordinates: 1/16 px."""


def near(color: Color, spread: float, rng: np.random.Generator) -> Color:
    """A colour about another: its brightness strays by ``spread``, its hue by a third of that."""
    shared = rng.normal(0.0, spread)
    b, g, r = (int(np.clip(c + shared + rng.normal(0.0, 0.33 * spread), 5, 250)) for c in color)
    return b, g, r


class Sheet:
    """The image while it is painted, and how rough the ground is at each place."""

    def __init__(self, side_px: int, m_per_px: float, color: Color, rough: float) -> None:
        self.side_px, self.m_per_px = side_px, m_per_px
        self.image = np.empty((side_px, side_px, 3), np.uint8)
        self.image[:] = color
        self.rough = np.full((side_px, side_px), round(255.0 * rough), np.uint8)

    @property
    def side_m(self) -> float:
        """Side of the sheet in metres."""
        return self.side_px * self.m_per_px

    @staticmethod
    def rectangle(centre: FloatArray, heading: float, length: float, width: float) -> FloatArray:
        """(4, 2) corners; the length lies along the heading, clockwise from up."""
        forward, right = np.array([np.sin(heading), -np.cos(heading)]), np.array([np.cos(heading), np.sin(heading)])
        ends = [(-0.5, -0.5), (-0.5, 0.5), (0.5, 0.5), (0.5, -0.5)]
        return np.array([centre + a * length * forward + b * width * right for a, b in ends])

    def fill(self, outline: FloatArray, color: Color, rough: float | None = None, hull: bool = False) -> None:
        """A polygon, or the convex hull of points; ``rough`` None leaves the roughness as it is."""
        points = self._fixed(outline)
        points = np.asarray(cv2.convexHull(points), np.int32) if hull else points
        cv2.fillPoly(self.image, [points], color, cv2.LINE_AA, SHIFT)
        if rough is not None:
            cv2.fillPoly(self.rough, [points], 255.0 * rough, cv2.LINE_8, SHIFT)

    def lines(
        self, lines: list[FloatArray], color: Color, width_m: float, closed: bool = False, rough: float | None = None
    ) -> None:
        """Polylines of a width."""
        points, thick = [self._fixed(p) for p in lines], max(round(width_m / self.m_per_px), 1)
        cv2.polylines(self.image, points, closed, color, thick, cv2.LINE_AA, SHIFT)
        if rough is not None:
            cv2.polylines(self.rough, points, closed, 255.0 * rough, thick, cv2.LINE_8, SHIFT)

    def dashes(self, line: FloatArray, on_m: float, off_m: float, color: Color, width_m: float) -> None:
        """Draw a broken line."""
        s = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
        at = np.arange(0.0, s[-1], on_m + off_m)[:, None] + np.linspace(0.0, on_m, 3)
        self.lines(list(np.stack([np.interp(at, s, line[:, k]) for k in (0, 1)], axis=-1)), color, width_m)

    def stripes(
        self, centre: FloatArray, heading: float, size: tuple[float, float], step: float, width_m: float, color: Color
    ) -> None:
        """Parallel stripes along the heading that fill a rectangle of (length, width) metres."""
        forward, right = np.array([np.sin(heading), -np.cos(heading)]), np.array([np.cos(heading), np.sin(heading)])
        offsets = np.arange(-0.5 * size[1] + 0.5 * step, 0.5 * size[1], step)
        ends = 0.5 * size[0] * np.array([[-1.0], [1.0]]) * forward
        self.lines([centre + d * right + ends for d in offsets], color, width_m)

    def text(self, letters: str, at: FloatArray, heading: float, height_m: float, color: Color) -> None:
        """Letters that are upright when seen along the heading."""
        tall = 40
        (width, _), _ = cv2.getTextSize(letters, cv2.FONT_HERSHEY_SIMPLEX, tall / 22.0, 7)
        mask = np.zeros((tall + 14, width + 10), np.uint8)
        cv2.putText(mask, letters, (5, tall + 5), cv2.FONT_HERSHEY_SIMPLEX, tall / 22.0, 255, 7, cv2.LINE_AA)
        forward, right = np.array([np.sin(heading), -np.cos(heading)]), np.array([np.cos(heading), np.sin(heading)])
        px = height_m / tall / self.m_per_px
        origin = at / self.m_per_px - 0.5 * px * (mask.shape[1] * right - mask.shape[0] * forward)
        turn = np.column_stack([px * right, -px * forward, origin])
        reach = int(np.ceil(px * max(mask.shape))) + 2
        u, v = (int(c) for c in at / self.m_per_px)
        rows = slice(max(v - reach, 0), min(v + reach, self.side_px))
        columns = slice(max(u - reach, 0), min(u + reach, self.side_px))
        part = self.image[rows, columns]
        if part.size == 0:
            return
        turn[:, 2] -= (columns.start, rows.start)
        alpha = cv2.warpAffine(mask, turn, (part.shape[1], part.shape[0]), flags=cv2.INTER_LINEAR)[..., None] / 255.0
        part[:] = part + alpha * (np.array(color) - part)

    def glyphs(
        self,
        count: int,
        at: FloatArray,
        heading: float,
        size: tuple[float, float],
        color: Color,
        rng: np.random.Generator,
    ) -> None:
        """Signs of an unknown script, strokes in a grid, (height, width) metres each, across the heading."""
        forward, right = np.array([np.sin(heading), -np.cos(heading)]), np.array([np.cos(heading), np.sin(heading)])
        lines = []
        for k in range(count):
            middle = at + 1.2 * (k - 0.5 * (count - 1)) * size[1] * right
            for _ in range(int(rng.integers(3, 7))):
                a = rng.integers(-1, 2, 2) * 0.45
                b = np.where(np.arange(2) == rng.integers(2), rng.integers(-1, 2, 2) * 0.45, a)
                lines.append(np.array([middle + p[0] * size[0] * forward + p[1] * size[1] * right for p in (a, b)]))
        self.lines(lines, color, 0.13 * min(size))

    def textured(self, light: Image, rng: np.random.Generator) -> Image:
        """The painting with grain on it, rough where the ground is, under an uneven light in 1/128."""
        coarse = grain(self.side_px, (4, 2), float(rng.uniform(0.1, 0.55)), rng)
        fine = grain(self.side_px, (1,), float(rng.uniform(0.02, 0.15)), rng)
        rough = cv2.GaussianBlur(self.rough, (5, 5), 1.5)
        ground, paved = (
            cv2.multiply(part, share, scale=1.0 / 255.0) for part, share in ((coarse, rough), (fine, 255 - rough))
        )
        mixed = cv2.add(ground, paved)
        image = cv2.multiply(cv2.GaussianBlur(self.image, (3, 3), 0.7), cv2.merge([mixed] * 3), scale=1.0 / 128.0)
        return np.asarray(cv2.multiply(image, light, scale=1.0 / 128.0), np.uint8)

    def _fixed(self, points: FloatArray) -> NDArray[np.int32]:
        return np.rint(np.clip(points / self.m_per_px - 0.5, -1e5, 1e5) * (1 << SHIFT)).astype(np.int32)
