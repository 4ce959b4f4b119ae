"""The ground: grass, soil, gravel, asphalt roads with marks and repairs, painted in windows about what the camera sees.

Open ground is one image that repeats without a seam; a window is that image, shifted to its place in the world,
with the roads drawn on it. So ground looks the same whenever and from wherever it is seen, and the world may be of any
size. A window's rows run south, its columns east.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from sim.world.view import Road, Scene

Image = NDArray[np.uint8]
FloatArray = NDArray[np.float64]

GRASS, SOIL, GRAVEL, ASPHALT, KERB, MARK, TAR = range(7)
"""Materials of the ground."""
GRAIN_PX = 512
"""Side of the tile of grain that repeats; divides the side of a window."""
KEPT_WINDOWS = 3
"""Painted windows of ground in memory, the oldest is dropped; a choice of memory against painting again."""


@dataclass(frozen=True, slots=True, kw_only=True)
class GroundStyle:
    """Appearance of the ground; colours are BGR."""

    colors: tuple[tuple[int, int, int], ...] = (
        (62, 105, 92), (92, 122, 146), (136, 142, 146), (92, 90, 88), (150, 152, 154), (212, 216, 218), (56, 54, 54),
    )  # fmt: skip
    """Grass, soil, gravel, asphalt, kerb, lane mark, tar."""
    contrast: float = 0.35
    """Strength of the fine grain, 0 to 1."""
    blotches: float = 0.15
    """Strength of the change of brightness and hue over metres."""
    soil_share: float = 0.25
    """Share of open ground that is soil or gravel rather than grass, 0 to 1."""
    marks: bool = True
    """Lane marks on the roads."""
    wear: float = 0.3
    """Share of patches in the asphalt, 0 to 1."""
    m_per_px: float = 0.05
    """Size of a texture pixel, metres; doubled until a window holds what the camera sees."""
    side_px: int = 4096
    """Side of a window, a multiple of 512."""


@dataclass(frozen=True, slots=True, kw_only=True)
class GroundWindow:
    """A square of ground, once per halving of its size, so that far ground does not sparkle."""

    levels: tuple[Image, ...]
    """Level k has pixels of m_per_px · 2ᵏ metres."""
    m_per_px: float
    west: float
    """ENU east of the left edge, metres."""
    north: float
    """ENU north of the upper edge, metres."""

    def level_for(self, gsd_m: float) -> int:
        """The level whose pixels are nearest to gsd_m metres."""
        k = int(np.floor(np.log2(max(gsd_m / self.m_per_px, 1.0)) + 0.5))
        return min(k, len(self.levels) - 1)

    def texture_from_enu(self, level: int) -> FloatArray:
        """(3, 3) homogeneous map of ground points (east, north, 1) to pixels of a level, whole at their middles."""
        s = 1.0 / (self.m_per_px * 2.0**level)
        # u = (x − west) s − ½,  v = (north − y) s − ½
        return np.array([[s, 0.0, -self.west * s - 0.5], [0.0, -s, self.north * s - 0.5], [0.0, 0.0, 1.0]])


@dataclass(frozen=True, slots=True, kw_only=True)
class _Stroke:
    """Lines of one colour and width, ENU metres."""

    color: int
    width_m: float
    lines: tuple[FloatArray, ...]


class Ground:
    """Paints windows of one scene's ground, and keeps the last few."""

    def __init__(self, scene: Scene, style: GroundStyle, rng: np.random.Generator) -> None:
        self.style = style
        self._open, self._grain = _open_ground(style, rng)
        self._strokes = [stroke for road in scene.roads for stroke in _strokes(road, style, rng)]
        self._windows: dict[tuple[float, int, int], GroundWindow] = {}

    @cached_property
    def mean(self) -> FloatArray:
        """(3,) mean colour, for what lies too far to be drawn."""
        return np.asarray(self._open[::16, ::16].mean(axis=(0, 1)), dtype=np.float64)

    def around(self, x: float, y: float, radius: float) -> GroundWindow:
        """The window that holds the square of ±radius about a point, metres; the same for points near each other."""
        m_per_px, side = self.style.m_per_px, self.style.side_px
        while side * m_per_px < 4.0 * radius:
            m_per_px *= 2.0
        # windows are half their side apart
        step = 0.5 * side * m_per_px
        key = (m_per_px, round(x / step), round(y / step))
        if key not in self._windows:
            while len(self._windows) >= KEPT_WINDOWS:
                del self._windows[next(iter(self._windows))]
            self._windows[key] = self._paint(*key)
        return self._windows[key]

    def _paint(self, m_per_px: float, column: int, row: int) -> GroundWindow:
        side = self.style.side_px
        half = side // 2
        west, north = (column - 1) * half * m_per_px, (row + 1) * half * m_per_px
        # windows lie at whole halves of the repeating image
        shift = (half * (row % 2), half * (column % 2))
        image = np.roll(self._open, shift, axis=(0, 1))
        road, mask = self._draw_roads(m_per_px, west, north)
        if mask.any():
            grain = cv2.merge([np.roll(self._grain, shift, axis=(0, 1))] * 3)
            cv2.copyTo(cv2.multiply(road, grain, scale=1.0 / 128.0), mask, image)
        return GroundWindow(levels=halvings(image), m_per_px=m_per_px, west=west, north=north)

    def _draw_roads(self, m_per_px: float, west: float, north: float) -> tuple[Image, Image]:
        side = self.style.side_px
        image, mask = np.zeros((side, side, 3), np.uint8), np.zeros((side, side), np.uint8)
        low, high = np.array([west, north - side * m_per_px]) - 20.0, np.array([west + side * m_per_px, north]) + 20.0
        for stroke in self._strokes:
            near = [p for p in stroke.lines if (p.max(axis=0) > low).all() and (p.min(axis=0) < high).all()]
            lines = [
                np.rint(((p - (west, north)) * (1.0, -1.0) / m_per_px - 0.5) * 16.0).astype(np.int32) for p in near
            ]
            thick = max(round(stroke.width_m / m_per_px), 1)
            cv2.polylines(image, lines, False, self.style.colors[stroke.color], thick, cv2.LINE_AA, 4)
            if stroke.color == KERB:
                cv2.polylines(mask, lines, False, 255, thick, cv2.LINE_8, 4)
        return image, mask


def halvings(image: Image) -> tuple[Image, ...]:
    """An image, and its halvings down to 128 px or so."""
    levels = [image]
    while levels[-1].shape[0] >= 256:
        levels.append(np.asarray(cv2.resize(levels[-1], None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA), np.uint8))
    return tuple(levels)


def tile_noise(side: int, cells: int, rng: np.random.Generator) -> NDArray[np.float32]:
    """(side, side) smooth noise, mean 0, deviation 1, that repeats without a seam; features of side/cells px."""
    base = rng.standard_normal((cells, cells)).astype(np.float32)
    padded = np.pad(base, 2, mode="wrap")
    scale = side / cells
    wide = cv2.resize(padded, None, fx=scale, fy=scale, interpolation=cv2.INTER_CUBIC)
    start = round(2 * scale)
    noise = wide[start : start + side, start : start + side]
    return np.asarray(noise / max(float(noise.std()), 1e-6), dtype=np.float32)


def _open_ground(style: GroundStyle, rng: np.random.Generator) -> tuple[Image, Image]:
    """The repeating image (side, side, 3), and the grain of paved ground (side, side) in 1/128."""
    side = style.side_px
    small = side // 8
    roughness = tile_noise(small, 5, rng) + 0.35 * tile_noise(small, small // 8, rng)
    threshold = float(np.quantile(roughness, 1.0 - style.soil_share)) if style.soil_share > 0.0 else np.inf
    wide = cv2.resize(roughness, (side, side), interpolation=cv2.INTER_LINEAR)
    # GRASS, SOIL, GRAVEL follow each other
    materials = (wide > threshold).astype(np.uint8) + (wide > threshold + 0.7).astype(np.uint8)
    lut = np.zeros((256, 1, 3), np.uint8)
    lut[: len(style.colors), 0] = style.colors
    image = cv2.GaussianBlur(cv2.LUT(cv2.merge([materials] * 3), lut), (3, 3), 0.8)
    blotch = blotches(side, style.blotches, rng)
    rough, fine = grain(side, (4, 2), style.contrast, rng), grain(side, (1,), 0.35 * style.contrast, rng)
    image = cv2.multiply(image, cv2.multiply(blotch, cv2.merge([rough] * 3), scale=1.0 / 128.0), scale=1.0 / 128.0)
    paved = cv2.multiply(fine, np.ascontiguousarray(blotch[..., 1]), scale=1.0 / 128.0)
    return np.asarray(image, dtype=np.uint8), np.asarray(paved, dtype=np.uint8)


def blotches(side: int, strength: float, rng: np.random.Generator) -> Image:
    """(side, side, 3) slow changes of brightness and hue, in 1/128."""
    small = max(side // 16, 64)
    shared = tile_noise(small, max(small // 12, 4), rng) + tile_noise(small, 6, rng)
    channels = [shared + 0.5 * tile_noise(small, max(small // 16, 4), rng) for _ in range(3)]
    blotch = np.clip(128.0 * (1.0 + 0.5 * strength * np.stack(channels, axis=-1)), 40, 255).astype(np.uint8)
    return np.asarray(cv2.resize(blotch, (side, side), interpolation=cv2.INTER_LINEAR), dtype=np.uint8)


def grain(side: int, scales: tuple[int, ...], strength: float, rng: np.random.Generator) -> Image:
    """(side, side) grain in 1/128, one tile repeated; ``scales`` are feature sizes in pixels."""
    tile = np.zeros((GRAIN_PX, GRAIN_PX), np.float32)
    for size in scales:
        tile += tile_noise(GRAIN_PX, GRAIN_PX // size, rng)
    tile += 0.7 * tile_noise(GRAIN_PX, GRAIN_PX // 16, rng)
    tiles = np.clip(128.0 * (1.0 + 0.5 * strength * tile / np.sqrt(len(scales) + 0.5)), 20, 255).astype(np.uint8)
    return np.ascontiguousarray(np.tile(tiles, (side // GRAIN_PX, side // GRAIN_PX)))


def _strokes(road: Road, style: GroundStyle, rng: np.random.Generator) -> list[_Stroke]:
    """Layers of a road, in order: kerb, asphalt, repairs, marks."""
    strokes = [
        _Stroke(color=KERB, width_m=road.width + 0.5, lines=(road.centre,)),
        _Stroke(color=ASPHALT, width_m=road.width, lines=(road.centre,)),
    ]
    length = len(road.centre)
    for _ in range(int(style.wear * length / 6)):
        start = int(rng.integers(0, max(length - 4, 1)))
        repair = _beside(road.centre, float(rng.uniform(-0.45, 0.45)) * road.width)[
            start : start + int(rng.integers(2, 8))
        ]
        strokes.append(_Stroke(color=TAR, width_m=float(rng.uniform(0.1, 1.2)), lines=(repair,)))
    if style.marks:
        edges = tuple(_beside(road.centre, side * (0.5 * road.width - 0.25)) for side in (-1.0, 1.0))
        strokes.append(_Stroke(color=MARK, width_m=0.14, lines=edges))
        for lane in range(1, road.lanes):
            middle = _beside(road.centre, (lane / road.lanes - 0.5) * road.width)
            strokes.append(_Stroke(color=MARK, width_m=0.14, lines=_dashes(middle, 3.0, 4.0)))
    return strokes


def _beside(line: FloatArray, offset_m: float) -> FloatArray:
    tangent = np.gradient(line, axis=0)
    tangent /= np.maximum(np.linalg.norm(tangent, axis=1, keepdims=True), 1e-9)
    right = np.stack([tangent[:, 1], -tangent[:, 0]], axis=1)
    return line + offset_m * right


def _dashes(line: FloatArray, on_m: float, off_m: float) -> tuple[FloatArray, ...]:
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
    samples = np.arange(0.0, along[-1], on_m + off_m)[:, None] + np.linspace(0.0, on_m, 4)
    return tuple(np.stack([np.interp(samples, along, line[:, 0]), np.interp(samples, along, line[:, 1])], axis=-1))
