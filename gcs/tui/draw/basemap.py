"""The ground's picture under the map, dim, so that what is drawn over it stays readable."""

from __future__ import annotations

import math
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from gcs.mission.tile_file import TILE_PX, TileFile
from gcs.tui.draw.ground_view import MapView
from mavlink.geodesy import LocalFrame

STRENGTH: Final = 0.4
"""Opacity of the picture over the background, 0..1."""
MAX_TILES: Final = 64
"""Most tiles for one picture; a view that needs more is drawn with coarser ones."""
FARTHEST_NORTH_DEG: Final = 85.0
"""Web Mercator has no poles."""
STEP: Final = 8
"""Step of brightness: neighbours of the same colour are sent to the terminal as one."""

Image = NDArray[np.uint8]


class Basemap:
    """Pictures for views; the last one is kept, since a view changes seldom."""

    def __init__(self, tiles: TileFile) -> None:
        self.tiles = tiles
        self._last: tuple[object, NDArray[np.int64] | None] = (None, None)

    def picture(self, view: MapView, origin: LocalFrame | None, paper: int) -> NDArray[np.int64] | None:
        """Ground under a view.

        Args:
            view: Which ground.
            origin: Of its metres.
            paper: 0xRRGGBB of the background, which shows where there are no tiles.

        Returns:
            (2 · rows, columns) 0xRRGGBB, two pixels a cell; None where the file has nothing.
        """
        wanted = (view, origin, paper)
        if self._last[0] != wanted:
            self._last = (wanted, None if origin is None else self._drawn(view, origin, paper))
        return self._last[1]

    def _drawn(self, view: MapView, origin: LocalFrame, paper: int) -> NDArray[np.int64] | None:
        bounds = _world_bounds(view, origin)
        if bounds is None:
            return None
        across = bounds[2] - bounds[0]
        # pixels of the world at zoom z: 256 · 2^z; the first zoom that is as fine as the cells
        fitting = math.log2(view.columns / (across * TILE_PX))
        finer = [zoom for zoom in self.tiles.zooms if zoom >= fitting]
        for zoom in (*finer[:1], *(each for each in reversed(self.tiles.zooms) if each < fitting)):
            pixels = tuple(edge * 2**zoom * TILE_PX for edge in bounds)
            mosaic = self._mosaic(zoom, pixels)
            if mosaic is not None:
                return _packed(_fitted(*mosaic, view), paper)
        return None

    def _mosaic(self, zoom: int, pixels: tuple[float, ...]) -> tuple[Image, NDArray[np.float64]] | None:
        """The tiles of a part of the world, (h, w, 4) with 255 where there are any, and where in it the view is."""
        left, top, right, bottom = (math.floor(edge / TILE_PX) for edge in pixels)
        columns, rows = right - left + 1, bottom - top + 1
        if columns * rows > MAX_TILES:
            return None
        mosaic = np.zeros((rows * TILE_PX, columns * TILE_PX, 4), dtype=np.uint8)
        for row in range(rows):
            for column in range(columns):
                if (tile := self.tiles.tile(zoom, left + column, top + row)) is not None:
                    window = mosaic[row * TILE_PX : (row + 1) * TILE_PX, column * TILE_PX : (column + 1) * TILE_PX]
                    window[..., :3], window[..., 3] = tile, 255
        if not mosaic[..., 3].any():
            return None
        return mosaic, np.array(pixels) - np.array([left, top, left, top]) * TILE_PX


def _world_bounds(view: MapView, origin: LocalFrame) -> tuple[float, float, float, float] | None:
    """West, north, east and south edge of a view in Web Mercator, 0..1 from the date line and from the north."""
    half = np.array([view.columns, 2 * view.rows]) * view.metres_per_dot
    west, east = view.east - half[0], view.east + half[0]
    north, south = view.north + half[1], view.north - half[1]
    lat_deg, lon_deg, _ = origin.to_geodetic([(west, north, 0.0), (east, south, 0.0)])
    if not (np.abs(lat_deg) < FARTHEST_NORTH_DEG).all() or not lon_deg[0] < lon_deg[1]:
        return None
    x = (lon_deg + 180.0) / 360.0
    # y = (1 − asinh(tan φ) / π) / 2
    y = (1.0 - np.arcsinh(np.tan(np.radians(lat_deg))) / math.pi) / 2.0
    return float(x[0]), float(y[0]), float(x[1]), float(y[1])


def _fitted(mosaic: Image, place: NDArray[np.float64], view: MapView) -> Image:
    """(2 · rows, columns, 4) of the part of a mosaic that the view shows."""
    size = view.columns, 2 * view.rows
    left, top, right, bottom = place
    if right - left > size[0]:
        first, last = np.floor(place[:2]).astype(int), np.ceil(place[2:]).astype(int)
        part = mosaic[first[1] : max(last[1], first[1] + 1), first[0] : max(last[0], first[0] + 1)]
        return np.asarray(cv2.resize(part, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)
    scale = np.array([(right - left) / size[0], (bottom - top) / size[1]])
    # the middle of pixel i is at i + 1/2 on both sides
    shift = np.array([left, top]) + 0.5 * scale - 0.5
    to_mosaic = np.array([[scale[0], 0.0, shift[0]], [0.0, scale[1], shift[1]]])
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    return np.asarray(cv2.warpAffine(mosaic, to_mosaic, size, flags=flags, borderMode=cv2.BORDER_REPLICATE), np.uint8)


def _packed(pixels: Image, paper: int) -> NDArray[np.int64]:
    """Blend the map over the background as strongly as it may be, in few colours."""
    behind = np.array([paper & 255, paper >> 8 & 255, paper >> 16 & 255], dtype=np.float64)
    share = STRENGTH * pixels[..., 3:].astype(np.float64) / 255.0
    mixed = behind + share * (pixels[..., :3] - behind)
    seen = pixels[..., 3] > 0
    bgr = np.where(seen[..., None], np.round(mixed / STEP) * STEP, behind).clip(0, 255).astype(np.int64)
    return np.asarray(bgr[..., 2] << 16 | bgr[..., 1] << 8 | bgr[..., 0], dtype=np.int64)
