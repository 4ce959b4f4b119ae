"""The ground as one large tiled picture: grass, soil, gravel, asphalt roads with marks. Drawn once, warped per frame.

The picture's rows run south, its columns east; it repeats at its edges, so any camera sees ground everywhere.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray

from sim.view import Road, Scene

__all__ = ["Ground", "GroundStyle", "build_ground"]

Image = NDArray[np.uint8]
FloatArray = NDArray[np.float64]

GRASS, SOIL, GRAVEL, ASPHALT, KERB, MARK, TAR = range(7)
MARGIN_M = 40.0
DETAIL_PX = 512


@dataclass(frozen=True, slots=True, kw_only=True)
class GroundStyle:
    """What the ground looks like; colours are BGR."""

    colors: tuple[tuple[int, int, int], ...] = (
        (62, 105, 92), (92, 122, 146), (136, 142, 146), (92, 90, 88), (150, 152, 154), (212, 216, 218), (56, 54, 54),
    )  # fmt: skip
    """Grass, soil, gravel, asphalt, kerb, lane mark, tar patch."""
    contrast: float = 0.35
    """Strength of the fine grain, 0 to 1."""
    blotches: float = 0.15
    """Strength of the change of brightness and hue over metres."""
    soil_share: float = 0.25
    """Share of open ground that is soil or gravel rather than grass, 0 to 1."""
    marks: bool = True
    """Lane marks on the roads."""
    wear: float = 0.3
    """How much of the marks is worn off, and how patched the asphalt is, 0 to 1."""
    m_per_px: float = 0.05
    """Size of a texture pixel in metres; coarser by itself where the roads reach far."""
    max_px: int = 4096
    """Largest side of the texture."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Ground:
    """The ground's picture, once per halving of its size, so that far ground does not sparkle."""

    levels: tuple[Image, ...]
    """Level k has pixels of m_per_px · 2ᵏ metres."""
    m_per_px: float
    """Metres per pixel of level 0."""
    west: float
    """ENU east of the picture's left edge, metres."""
    north: float
    """ENU north of the picture's upper edge, metres."""
    mean: tuple[float, float, float] = field(default=(90.0, 110.0, 100.0))
    """Mean colour, for what lies too far to be sampled."""

    def level_for(self, gsd_m: float) -> int:
        """The level whose pixels are nearest to, and not much larger than, gsd_m metres."""
        k = int(np.floor(np.log2(max(gsd_m / self.m_per_px, 1.0)) + 0.5))
        return min(k, len(self.levels) - 1)

    def texture_from_enu(self, level: int) -> FloatArray:
        """(3, 3) homogeneous map of ground points (east, north, 1) to pixels of a level."""
        s = 1.0 / (self.m_per_px * 2.0**level)
        # u = (x − west)/s' − ½,  v = (north − y)/s' − ½  (pixel centres at whole numbers)
        return np.array([[s, 0.0, -self.west * s - 0.5], [0.0, -s, self.north * s - 0.5], [0.0, 0.0, 1.0]])


def build_ground(scene: Scene, style: GroundStyle, rng: np.random.Generator) -> Ground:
    """Paint the ground of a scene.

    Args:
        scene: its roads, ENU metres.
        style: colours and roughness.
        rng: the source of all chance; the same state paints the same ground.
    """
    west, north, side_m = _extent(scene)
    side = int(np.clip(np.ceil(side_m / style.m_per_px / 64) * 64, 256, style.max_px))
    m_per_px = side_m / side
    materials = _open_ground(side, style, rng)
    for road in scene.roads:
        _draw_road(materials, road, style, rng, west, north, m_per_px)
    image = _paint(materials, style, rng)
    levels = [image]
    while levels[-1].shape[0] >= 256:
        levels.append(cv2.resize(levels[-1], None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA))
    b, g, r = (float(v) for v in levels[-1].reshape(-1, 3).mean(axis=0))
    return Ground(levels=tuple(levels), m_per_px=m_per_px, west=west, north=north, mean=(b, g, r))


def tile_noise(side: int, cells: int, rng: np.random.Generator) -> NDArray[np.float32]:
    """(side, side) smooth noise, mean 0, deviation 1, that repeats without a seam; features of side/cells px."""
    base = rng.standard_normal((cells, cells)).astype(np.float32)
    padded = np.pad(base, 2, mode="wrap")
    scale = side / cells
    wide = cv2.resize(padded, None, fx=scale, fy=scale, interpolation=cv2.INTER_CUBIC)
    start = round(2 * scale)
    noise = wide[start : start + side, start : start + side]
    return np.asarray(noise / max(float(noise.std()), 1e-6), dtype=np.float32)


def _extent(scene: Scene) -> tuple[float, float, float]:
    if not scene.roads:
        return -50.0, 50.0, 100.0
    points = np.concatenate([road.centre for road in scene.roads])
    low, high = points.min(axis=0) - MARGIN_M, points.max(axis=0) + MARGIN_M
    return float(low[0]), float(high[1]), float(np.max(high - low))


def _open_ground(side: int, style: GroundStyle, rng: np.random.Generator) -> Image:
    small = side // 8
    roughness = tile_noise(small, 5, rng) + 0.35 * tile_noise(small, small // 8, rng)
    threshold = float(np.quantile(roughness, 1.0 - style.soil_share)) if style.soil_share > 0.0 else np.inf
    wide = cv2.resize(roughness, (side, side), interpolation=cv2.INTER_LINEAR)
    # GRASS, SOIL, GRAVEL follow each other
    return np.asarray((wide > threshold).astype(np.uint8) + (wide > threshold + 0.7).astype(np.uint8), dtype=np.uint8)


def _draw_road(
    materials: Image,
    road: Road,
    style: GroundStyle,
    rng: np.random.Generator,
    west: float,
    north: float,
    m_per_px: float,
) -> None:
    """Paints into the material map, which the caller has just made."""

    def stroke(offset_m: float, width_m: float, material: int, dash_m: tuple[float, float] | None = None) -> None:
        line = _offset(road.centre, offset_m)
        pieces = [line] if dash_m is None else _dashes(line, *dash_m)
        pixels = [np.rint((p - (west, north)) * (1.0, -1.0) / m_per_px * 16 - 8).astype(np.int32) for p in pieces]
        cv2.polylines(materials, pixels, False, material, max(round(width_m / m_per_px), 1), cv2.LINE_8, 4)

    stroke(0.0, road.width + 0.5, KERB)
    stroke(0.0, road.width, ASPHALT)
    length = len(road.centre)
    for _ in range(int(style.wear * length / 6)):  # repairs
        i = int(rng.integers(0, max(length - 4, 1)))
        patch = _offset(road.centre, float(rng.uniform(-0.45, 0.45)) * road.width)[i : i + int(rng.integers(2, 8))]
        pixels = np.rint((patch - (west, north)) * (1.0, -1.0) / m_per_px).astype(np.int32)
        cv2.polylines(materials, [pixels], False, TAR, max(round(rng.uniform(0.1, 1.2) / m_per_px), 1))
    if style.marks:
        for edge in (-0.5, 0.5):
            stroke(edge * road.width - np.sign(edge) * 0.25, 0.14, MARK)
        for lane in range(1, road.lanes):
            stroke((lane / road.lanes - 0.5) * road.width, 0.14, MARK, (3.0, 4.0))


def _offset(line: FloatArray, offset_m: float) -> FloatArray:
    tangent = np.gradient(line, axis=0)
    tangent /= np.maximum(np.linalg.norm(tangent, axis=1, keepdims=True), 1e-9)
    right = np.stack([tangent[:, 1], -tangent[:, 0]], axis=1)
    return line + offset_m * right


def _dashes(line: FloatArray, on_m: float, off_m: float) -> list[FloatArray]:
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
    starts = np.arange(0.0, along[-1], on_m + off_m)
    samples = starts[:, None] + np.linspace(0.0, on_m, 4)
    points = np.stack([np.interp(samples, along, line[:, 0]), np.interp(samples, along, line[:, 1])], axis=-1)
    return list(points)


def _paint(materials: Image, style: GroundStyle, rng: np.random.Generator) -> Image:
    side = materials.shape[0]
    lut = np.zeros((256, 1, 3), np.uint8)
    lut[: len(style.colors), 0] = style.colors
    image = cv2.LUT(cv2.merge([materials] * 3), lut)
    image = cv2.GaussianBlur(image, (3, 3), 0.8)
    return np.asarray(cv2.multiply(image, _gain(materials, side, style, rng), scale=1.0 / 128.0), dtype=np.uint8)


def _gain(materials: Image, side: int, style: GroundStyle, rng: np.random.Generator) -> Image:
    """(side, side, 3) brightness per pixel in 1/128: grain by material, blotches by place."""
    rough = _detail(side, (4, 2), style.contrast, rng)
    fine = _detail(side, (1,), 0.35 * style.contrast, rng)
    paved = (materials >= ASPHALT).astype(np.uint8)
    grain = cv2.copyTo(fine, paved, rough)
    small = max(side // 16, 64)
    shared = tile_noise(small, max(small // 12, 4), rng) + tile_noise(small, 6, rng)
    channels = [shared + 0.5 * tile_noise(small, max(small // 16, 4), rng) for _ in range(3)]
    blotch = np.clip(128.0 * (1.0 + 0.5 * style.blotches * np.stack(channels, axis=-1)), 40, 255).astype(np.uint8)
    wide = cv2.resize(blotch, (side, side), interpolation=cv2.INTER_LINEAR)
    worn = cv2.merge([grain] * 3)
    return np.asarray(cv2.multiply(wide, worn, scale=1.0 / 128.0), dtype=np.uint8)


def _detail(side: int, scales: tuple[int, ...], strength: float, rng: np.random.Generator) -> Image:
    """(side, side) grain in 1/128, one tile repeated; ``scales`` are feature sizes in pixels."""
    tile = sum(
        (tile_noise(DETAIL_PX, DETAIL_PX // s, rng) for s in scales), np.zeros((DETAIL_PX, DETAIL_PX), np.float32)
    )
    tile += 0.7 * tile_noise(DETAIL_PX, DETAIL_PX // 16, rng)
    grain = np.clip(128.0 * (1.0 + 0.5 * strength * tile / np.sqrt(len(scales) + 0.5)), 20, 255).astype(np.uint8)
    repeats = -(-side // DETAIL_PX)
    return np.ascontiguousarray(np.tile(grain, (repeats, repeats))[:side, :side])
