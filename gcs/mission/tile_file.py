"""Pictures of the ground that the user has: an MBTiles file of raster tiles, read as they are needed.

MBTiles 1.3 (https://github.com/mapbox/mbtiles-spec): an SQLite file with a table ``tiles`` of PNG, JPEG or WebP in Web
Mercator; zoom z has 2^z × 2^z tiles.
"""

from __future__ import annotations

import re
import sqlite3
import time
from collections import OrderedDict
from pathlib import Path
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from gcs.errors import ConfigError
from infra.plain_text import plain
from vision.video.image_file import decoded

TILE_PX: Final = 256
"""Side of a tile, px; those of other sizes are scaled to it."""
MAX_KEPT: Final = 96
"""Decoded tiles in memory, 19 MB: more than two screens of them."""
MAX_TILE_BYTES: Final = 4_000_000
"""Most bytes of a tile: usual ones have some ten thousand."""
MAX_SIDE_PX: Final = 4096
"""Maximum side of a tile's picture: larger ones would take hundreds of megabytes once decoded."""
MAX_OPEN_S: Final = 10.0
MAX_READ_S: Final = 1.0
MAX_SLOW: Final = 3
"""Tiles that were given up for taking longer, after which the file is left alone."""
FAULTS = (sqlite3.Error, UnicodeDecodeError)
"""Exceptions that SQLite raises; the second where it quotes a file's words that are no text."""
MAX_HEAP_BYTES: Final = 256 << 20
STEPS: Final = 10_000
"""Steps of SQLite's machine between two looks at the clock."""
MAX_ZOOM: Final = 30
LONGEST_CREDIT: Final = 80
RASTER: Final = frozenset({"png", "jpg", "jpeg", "webp"})
GZIP: Final = b"\x1f\x8b"
"""Beginning of gzip, in which vector tiles are compressed."""

Image = NDArray[np.uint8]


class TileFile:
    """An open file of tiles; used by one thread."""

    def __init__(self, path: Path) -> None:
        """Open a file.

        Raises:
            ConfigError: no such file, not MBTiles, vector tiles, or no tiles in it.
        """
        self.path = path
        self._kept: OrderedDict[tuple[int, int, int], Image | None] = OrderedDict()
        if not path.is_file():
            raise ConfigError(f"{path}: no such file; [map] tiles needs an MBTiles file")
        try:
            # immutable: nothing is written beside the file, also where it was not closed
            self._base = sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro&immutable=1", uri=True)
            self._bound()
        except FAULTS as error:
            raise ConfigError(f"{path}: cannot be opened: {plain(str(error))}") from None
        try:
            self._check()
        except ConfigError:
            self._base.close()
            raise
        except FAULTS as error:
            self._base.close()
            raise ConfigError(f"{path}: cannot be read as MBTiles: {plain(str(error))}") from None

    def _bound(self) -> None:
        """Bound time and memory of queries: whoever made the file wrote its views, which may ask for any work."""
        self._until_s = time.monotonic() + MAX_OPEN_S
        self._slow = 0
        self._base.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, MAX_TILE_BYTES)
        self._base.execute(f"PRAGMA hard_heap_limit = {MAX_HEAP_BYTES}")
        self._base.set_progress_handler(lambda: time.monotonic() > self._until_s, STEPS)

    def _check(self) -> None:
        notes = dict(self._base.execute("SELECT name, value FROM metadata LIMIT 1000").fetchall())
        first = self._base.execute("SELECT tile_data FROM tiles LIMIT 1").fetchone()
        if first is None or not isinstance(first[0], bytes):
            raise ConfigError(f"{self.path}: it has no tiles")
        kind = str(notes.get("format", "")).lower()
        if kind == "pbf" or first[0].startswith(GZIP):
            raise ConfigError(f"{self.path}: it has vector tiles; raster tiles (PNG, JPEG, WebP) are needed")
        if kind and kind not in RASTER:
            raise ConfigError(f"{self.path}: tiles of format {plain(kind)[:20]!r}; PNG, JPEG or WebP are needed")
        zooms = self._base.execute("SELECT DISTINCT zoom_level FROM tiles ORDER BY zoom_level LIMIT 100").fetchall()
        self.zooms = tuple(zoom for (zoom,) in zooms if isinstance(zoom, int) and 0 <= zoom <= MAX_ZOOM)
        """Zoom levels in the file, the coarsest first."""
        if not self.zooms:
            raise ConfigError(f"{self.path}: it has no tiles at a zoom of 0 to {MAX_ZOOM}")
        credit = re.sub(r"<[^>]*>", "", str(notes.get("attribution", "")))
        self.credit = plain(credit.strip())[:LONGEST_CREDIT]
        """Attribution of the pictures, empty where the file has none."""

    def tile(self, zoom: int, column: int, row: int) -> Image | None:
        """(256, 256, 3) BGR of a tile; None where the file has none that can be decoded.

        Args:
            zoom: one of ``zooms``.
            column: from the date line eastward.
            row: from the north southward.
        """
        key = (zoom, column, row)
        if key in self._kept:
            self._kept.move_to_end(key)
        else:
            self._kept[key] = self._read(zoom, column, row)
            if len(self._kept) > MAX_KEPT:
                self._kept.popitem(last=False)
        return self._kept[key]

    def _read(self, zoom: int, column: int, row: int) -> Image | None:
        if self._slow >= MAX_SLOW:
            return None
        began_s = time.monotonic()
        self._until_s = began_s + MAX_READ_S
        # rows are counted from the south in the file
        where = (zoom, column, 2**zoom - 1 - row)
        query = "SELECT tile_data FROM tiles WHERE zoom_level = ? AND tile_column = ? AND tile_row = ?"
        try:
            found = self._base.execute(query, where).fetchone()
        except (*FAULTS, MemoryError):
            self._slow += time.monotonic() - began_s > MAX_READ_S
            return None
        if found is None or not isinstance(found[0], bytes) or not 0 < len(found[0]) <= MAX_TILE_BYTES:
            return None
        image = decoded(found[0], MAX_SIDE_PX)
        if image is None or image.shape[:2] == (TILE_PX, TILE_PX):
            return image
        return np.asarray(cv2.resize(image, (TILE_PX, TILE_PX), interpolation=cv2.INTER_AREA), dtype=np.uint8)

    def close(self) -> None:
        """Close the file."""
        self._base.close()
