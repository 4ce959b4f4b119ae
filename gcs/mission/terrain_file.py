"""Heights of the ground that the user has: a GeoTIFF with one band of elevations in metres.

GeoTIFF 1.1, OGC 19-008r4: a north-up grid in longitude and latitude or in a projection that has an EPSG code.
"""

from __future__ import annotations

import math
import warnings
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray
from PIL import Image
from pyproj import Transformer
from pyproj.exceptions import ProjError
from scipy.ndimage import map_coordinates

from gcs.errors import ConfigError
from infra.plain_text import plain

__all__ = ["TerrainFile"]

MOST_CELLS: Final = 36_000_000
"""144 MB as numbers: 6 km at 1 m, or a degree at 20 m."""
_SCALE, _TIE_POINTS, _TRANSFORMATION, _KEYS, _NO_DATA = 33550, 33922, 34264, 34735, 42113
_RASTER_TYPE, _GEOGRAPHIC, _PROJECTED, _VERTICAL_UNITS = 1025, 2048, 3072, 4099
_POINT = 2
"""RasterPixelIsPoint: tie points are of the cells' centres, not of their corners."""
_METRE = 9001
_USER_DEFINED = 32767


class TerrainFile:
    """Elevations of an area, held in memory."""

    def __init__(self, path: Path) -> None:
        """Read a file.

        Raises:
            ConfigError: no such file, not a GeoTIFF, larger than can be used, or in a form that is not read.
        """
        self.path = path
        if not path.is_file():
            raise ConfigError(f"{path}: no such file; [map] terrain needs a GeoTIFF of elevations")
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("error")
                with Image.open(path, formats=("TIFF",)) as image:
                    if image.width * image.height > MOST_CELLS:
                        raise ConfigError(
                            f"{path}: {image.width} × {image.height} cells are too many; cut the area out"
                        )
                    tags: dict[int, Any] = dict(image.tag_v2)  # type: ignore[attr-defined]
                    z = np.array(image, dtype=np.float32)
        except (OSError, ValueError, SyntaxError, Warning, Image.DecompressionBombError) as error:
            raise ConfigError(f"{path}: cannot be read as TIFF: {plain(str(error))}") from None
        if z.ndim != 2:
            raise ConfigError(f"{path}: has {z.shape[-1]} bands; elevations are one")
        self._z = _with_gaps(z, tags)
        self._place_grid(tags)

    def _place_grid(self, tags: dict[int, Any]) -> None:
        keys = _geo_keys(tags)
        if _TRANSFORMATION in tags or not {_SCALE, _TIE_POINTS} <= set(tags):
            raise ConfigError(f"{self.path}: has no place, or is a turned grid; gdalwarp makes one that is read")
        if keys.get(_VERTICAL_UNITS, _METRE) != _METRE:
            raise ConfigError(f"{self.path}: its elevations are not in metres")
        epsg = keys.get(_PROJECTED) or keys.get(_GEOGRAPHIC) or _USER_DEFINED
        if epsg == _USER_DEFINED:
            raise ConfigError(f"{self.path}: its coordinates have no EPSG code; gdalwarp -t_srs EPSG:4326 makes some")
        try:
            self._to_grid = Transformer.from_crs(4326, epsg, always_xy=True)
        except ProjError as error:
            raise ConfigError(f"{self.path}: EPSG:{epsg}: {plain(str(error))}") from None
        self._cell = np.array(tags[_SCALE][:2], dtype=np.float64)
        column, row, _, x, y, _ = tags[_TIE_POINTS][:6]
        middle = 0.0 if keys.get(_RASTER_TYPE) == _POINT else 0.5
        # x = x_0 + s_x column, y = y_0 − s_y row, for the centres of cells
        self._x0, self._y0 = x + (middle - column) * self._cell[0], y - (middle - row) * self._cell[1]
        if not (np.isfinite(self._cell).all() and (self._cell > 0.0).all()):
            raise ConfigError(f"{self.path}: has no size of its cells")

    def elevations(self, lat_deg: ArrayLike, lon_deg: ArrayLike) -> NDArray[np.float64]:
        """Elevations (k,) at places (k,), metres, in the file's own datum; NaN where it has none."""
        lon, lat = np.atleast_1d(np.asarray(lon_deg, np.float64)), np.atleast_1d(np.asarray(lat_deg, np.float64))
        x, y = self._to_grid.transform(lon, lat)
        at = np.stack([(self._y0 - np.asarray(y)) / self._cell[1], (np.asarray(x) - self._x0) / self._cell[0]])
        known = np.isfinite(at).all(axis=0)
        z = np.full(at.shape[1], np.nan)
        z[known] = map_coordinates(self._z, at[:, known], order=1, mode="constant", cval=math.nan, output=np.float64)
        return z


def _geo_keys(tags: dict[int, Any]) -> dict[int, int]:
    """Short values of the GeoKeyDirectory: a head of four numbers, then id, place, count and value of each key."""
    flat = [int(v) for v in tags.get(_KEYS, ())][4:]
    return {key: value for key, place, _, value in zip(*[iter(flat)] * 4, strict=False) if place == 0}


def _with_gaps(z: NDArray[np.float32], tags: dict[int, Any]) -> NDArray[np.float32]:
    """Elevations with NaN where the file has none."""
    try:
        none = float(str(tags.get(_NO_DATA, "nan")).strip("\0 "))
    except ValueError:
        none = math.nan
    return np.where(np.isfinite(z) & (z != np.float32(none)), z, np.float32(math.nan))
