"""A chessboard before a known camera, drawn ray by ray and coded as H.264; tiles of a map; elevations."""

import sqlite3

import av
import cv2
import numpy as np
from PIL import Image, TiffImagePlugin

COLUMNS, ROWS, SQUARE_M = 9, 6, 0.025
"""Inner corners, and the side of a square."""
DETAIL = 24
"""Pixels a square of the flat board."""
FINE = 1
"""Rays a pixel along each side."""


def flat_board():
    """The board as printed, with a white margin of one square, on grey."""
    black = np.add.outer(np.arange(ROWS + 1), np.arange(COLUMNS + 1)) % 2 == 0
    squares = np.pad(np.where(black, 30, 225).astype(np.uint8), 1, constant_values=225)
    return np.kron(squares, np.ones((DETAIL, DETAIL), np.uint8))


class BoardCamera:
    """Draws the board as a camera with this matrix and lens sees it; pixels as OpenCV counts them."""

    def __init__(self, size, K, lens):
        self.size, self.K, self.lens = size, K, lens
        width, height = size
        steps = (np.arange(FINE) + 0.5) / FINE - 0.5
        u, v = np.meshgrid(*(np.add.outer(np.arange(side), steps).ravel() for side in (width, height)))
        criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 60, 1e-9)
        points = np.stack([u, v], axis=-1).reshape(-1, 1, 2)
        ideal = cv2.undistortPoints(points, K, lens, criteria=criteria)
        self.rays = np.concatenate([ideal[:, 0], np.ones((len(points), 1))], axis=1).reshape(*u.shape, 3)
        self.board = flat_board()

    def draw(self, R, t, rng):
        """Image (h, w, 3) of the board at this pose; t is where its middle is."""
        middle = np.array([(COLUMNS - 1) / 2, (ROWS - 1) / 2]) * SQUARE_M
        # the ray meets the plane where R₃ᵀ (s·ray − t) = 0
        s = (R[:, 2] @ t) / (self.rays @ R[:, 2])
        place = (self.rays * s[..., None] - t) @ R[:, :2] + middle
        # the first inner corner is two squares in, and the middle of a pixel is at its half
        grid = ((place / SQUARE_M + 2.0) * DETAIL - 0.5).astype(np.float32)
        seen = cv2.remap(self.board, grid, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=120)
        small = cv2.resize(seen, self.size, interpolation=cv2.INTER_AREA).astype(np.float64)
        noisy = np.clip(small + rng.normal(0.0, 1.5, small.shape), 0, 255).astype(np.uint8)
        return cv2.cvtColor(noisy, cv2.COLOR_GRAY2BGR)


def poses(n, rng, K, lens, size, *, tilt=0.6):
    """Boards as a careful hand shows them: whole, near and far, tilted, every third one pushed into a corner."""
    found = []
    for k in range(n):
        corner = np.array([1, 1, -1, -1])[k // 3 % 4], np.array([1, -1])[k // 3 % 2]
        tries = [_whole(rng, K, lens, size, tilt) for _ in range(30 if k % 3 == 0 else 1)]
        found.append(max(tries, key=lambda pose: (pose[2] @ corner).max())[:2])
    return found


def _whole(rng, K, lens, size, tilt):
    """A pose at which the image shows all squares, and where their corners are."""
    x, y = np.meshgrid((-1.3, COLUMNS + 0.3), (-1.3, ROWS + 0.3))
    rim = (np.stack([x, y, 0 * x], axis=-1).reshape(-1, 3) - ((COLUMNS - 1) / 2, (ROWS - 1) / 2, 0)) * SQUARE_M
    while True:
        turn, z, share = rng.uniform(-tilt, tilt, 3), rng.uniform(0.18, 0.5), rng.beta(0.5, 0.5, 2) - 0.5
        t = np.array([share[0] * size[0] / K[0, 0] * z, share[1] * size[1] / K[1, 1] * z, z])
        corners = cv2.projectPoints(rim, turn, t, K, lens)[0][:, 0]
        if (corners > 0).all() and (corners < size).all():
            return cv2.Rodrigues(turn)[0], t, corners


def write_video(path, frames, size):
    with av.open(str(path), "w") as file:
        stream = file.add_stream("libx264", rate=10, options={"crf": "20"})
        stream.width, stream.height, stream.pix_fmt = *size, "yuv420p"
        for image in frames:
            file.mux(stream.encode(av.VideoFrame.from_ndarray(image, format="bgr24")))
        file.mux(stream.encode(None))


def png(bgr, size=256):
    """A picture of one colour as the bytes of a file."""
    return cv2.imencode(".png", np.full((size, size, 3), bgr, dtype=np.uint8))[1].tobytes()


def make_tiles(path, tiles, kind="png"):
    """An MBTiles file.

    Args:
        path: of the new file.
        tiles: colour BGR, or bytes, by zoom, column and row from the north.
        kind: the format it states, none when empty.
    """
    with sqlite3.connect(path) as base:
        base.execute("CREATE TABLE metadata (name TEXT, value TEXT)")
        base.execute("CREATE TABLE tiles (zoom_level INT, tile_column INT, tile_row INT, tile_data BLOB)")
        notes = {"attribution": "<a href='http://x'>© Somebody</a>"} | ({"format": kind} if kind else {})
        base.executemany("INSERT INTO metadata VALUES (?, ?)", notes.items())
        rows = [
            (zoom, column, 2**zoom - 1 - row, each if isinstance(each, bytes) else png(each))
            for (zoom, column, row), each in tiles.items()
        ]
        base.executemany("INSERT INTO tiles VALUES (?, ?, ?, ?)", rows)
    base.close()
    return path


AREA, POINT = 1, 2
"""What the tie point of a grid of elevations is of."""


def write_geotiff(path, z, corner, cell, *, epsg=4326, raster=AREA, no_data=None, keys=(), **save):
    """A north-up grid.

    Args:
        path: of the file.
        z: (rows, columns) elevations, the north first.
        corner: x and y of the first cell's corner, or of its centre where ``raster`` is ``POINT``.
        cell: width and height of one.
        epsg: of its coordinates; degrees for 4326, else of a projection.
        raster: what the tie point is of.
        no_data: value of cells without an elevation.
        keys: more of its keys, (id, value).
    """
    kind = 2 if epsg == 4326 else 1
    place = [(1024, kind), (1025, raster), (2048 if kind == 2 else 3072, epsg), *keys]
    tags = TiffImagePlugin.ImageFileDirectory_v2()
    tags[33550] = (*cell, 0.0)
    tags.tagtype[33550] = 12
    tags[33922] = (0.0, 0.0, 0.0, *corner, 0.0)
    tags.tagtype[33922] = 12
    flat = [1, 1, 0, len(place)]
    for key, value in sorted(place):
        flat += [key, 0, 1, value]
    tags[34735] = tuple(flat)
    tags.tagtype[34735] = 3
    if no_data is not None:
        tags[42113] = str(no_data)
        tags.tagtype[42113] = 2
    Image.fromarray(np.asarray(z)).save(path, "TIFF", tiffinfo=tags, **save)
    return path
