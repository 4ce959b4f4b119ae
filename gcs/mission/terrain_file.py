"""Heights of the ground that the user has: a GeoTIFF with one band of elevations in metres.

GeoTIFF 1.1, OGC 19-008r4: a north-up grid in longitude and latitude or in a projection that has an EPSG code.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pyproj import Transformer
from pyproj.exceptions import ProjError

from gcs.errors import ConfigError
from gcs.mission.tiff_grid import read_tiff
from infra.plain_text import plain
from infra.processes.bounded import UnreadError

MAX_CELLS: Final = 36_000_000
"""144 MB as numbers: 6 km at 1 m, or a degree at 20 m."""
_SCALE, _TIE_POINTS, _TRANSFORMATION, _KEYS, _NO_DATA = 33550, 33922, 34264, 34735, 42113
_RASTER_TYPE, _GEOGRAPHIC, _PROJECTED, _VERTICAL_UNITS = 1025, 2048, 3072, 4099
_POINT = 2
"""RasterPixelIsPoint: tie points are of the cells' centres, not of their corners."""
_METRE = 9001
_USER_DEFINED = 32767
_SHORTS = 65536


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
            found = read_tiff(path, MAX_CELLS, [_SCALE, _TIE_POINTS, _TRANSFORMATION, _KEYS, _NO_DATA])
        except (UnreadError, OSError) as error:
            raise ConfigError(f"{path}: cannot be read as TIFF: {error}") from None
        if found.bands != 1:
            raise ConfigError(f"{path}: has {found.bands} bands; elevations are one")
        self._z = _with_gaps(found.grid(), found.words.get(_NO_DATA, ""))
        self._place_grid(found.numbers)

    def _place_grid(self, tags: Mapping[int, Sequence[float]]) -> None:
        keys = _geo_keys(tags.get(_KEYS, ()))
        scale, ties = tags.get(_SCALE, ())[:2], tags.get(_TIE_POINTS, ())[:6]
        if _TRANSFORMATION in tags or (len(scale), len(ties)) != (2, 6):
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
        self._cell = np.array(scale, dtype=np.float64)
        column, row, _, x, y, _ = ties
        middle = 0.0 if keys.get(_RASTER_TYPE) == _POINT else 0.5
        # x = x_0 + s_x column, y = y_0 − s_y row, for the centres of cells
        self._x0, self._y0 = x + (middle - column) * self._cell[0], y - (middle - row) * self._cell[1]
        if not (np.isfinite([*scale, *ties]).all() and (self._cell > 0.0).all()):
            raise ConfigError(f"{self.path}: has no size or place of its cells")

    def elevations(self, lat_deg: ArrayLike, lon_deg: ArrayLike) -> NDArray[np.float64]:
        """Elevations (k,) at places (k,), metres, in the file's own datum; NaN where it has none."""
        from scipy.ndimage import map_coordinates  # a tenth of the start of a flight, and few have such a file

        lon, lat = np.atleast_1d(np.asarray(lon_deg, np.float64)), np.atleast_1d(np.asarray(lat_deg, np.float64))
        x, y = self._to_grid.transform(lon, lat)
        at = np.stack([(self._y0 - np.asarray(y)) / self._cell[1], (np.asarray(x) - self._x0) / self._cell[0]])
        known = np.isfinite(at).all(axis=0)
        z = np.full(at.shape[1], np.nan)
        z[known] = map_coordinates(self._z, at[:, known], order=1, mode="constant", cval=math.nan, output=np.float64)
        return z


def _geo_keys(values: Sequence[float]) -> dict[int, int]:
    """Short values of the GeoKeyDirectory: a head of four numbers, then id, place, count and value of each key."""
    flat = [int(v) for v in values if 0 <= v < _SHORTS][4:]
    return {key: value for key, place, _, value in zip(*[iter(flat)] * 4, strict=False) if place == 0}


def _with_gaps(z: NDArray[np.float32], no_data: str) -> NDArray[np.float32]:
    """Elevations with NaN where the file has none."""
    try:
        none = float(no_data.strip("\0 "))
    except ValueError:
        none = math.nan
    with np.errstate(over="ignore"):
        missing = z == np.float32(none)
    return np.where(np.isfinite(z) & ~missing, z, np.float32(math.nan))
