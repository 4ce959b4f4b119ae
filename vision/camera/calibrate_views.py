"""Views of a chessboard in a video: found, sharp, and different from each other.

Corners are found in a small image and refined in the full one; pixels here are OpenCV's, counted from the middle of
the first one.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.errors import CameraError
from vision.video.video import Frame, VideoFile

Floats = NDArray[np.float64]

LOOKS = 400
"""Frames of a video that are searched, spread evenly: finding a board takes much longer than decoding."""
SMALL_PX = 800
"""Longer side of the image in which boards are found."""
BLURRED_PX = 4.0
"""Width of an edge beyond which a view is not used, px of the small image."""
APART = 0.06
"""Least difference between two views, as :func:`_difference` counts it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Board:
    """A chessboard, counted by its inner corners, where four squares meet.

    Raises:
        CameraError: too few corners, or a square without a size.
    """

    columns: int
    rows: int
    square_m: float

    def __post_init__(self) -> None:
        if min(self.columns, self.rows) < 3 or max(self.columns, self.rows) > 50:
            raise CameraError(f"a board of {self.columns}x{self.rows} inner corners; 3 to 50 each way can be found")
        if not 0.0 < self.square_m < 10.0:
            raise CameraError(f"squares of {self.square_m:g} m; give the side of one square in metres")

    @property
    def points(self) -> NDArray[np.float32]:
        """(columns · rows, 3) corners on the board, m, row by row."""
        column, row = np.meshgrid(np.arange(self.columns), np.arange(self.rows))
        return (np.stack([column, row, 0 * row], axis=-1).reshape(-1, 3) * self.square_m).astype(np.float32)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BoardView:
    """The board in one frame."""

    frame: int
    corners: NDArray[np.float32]
    """(columns · rows, 2) px, in the order of :attr:`Board.points`."""
    blur_px: float
    """Width of the squares' edges, px of the small image."""
    pose: Floats
    """(5,) place, size and slant in the image, as shares of it: what makes views different."""


def find_views(
    video: VideoFile, board: Board, report: Callable[[int, int], None] = lambda done, total: None
) -> tuple[list[BoardView], int]:
    """Sharp views of the whole board, and how many frames were searched.

    Args:
        report: called with the frames that were read so far, and all there are.
    """
    step = max(1, -(-video.n // LOOKS))
    views = []
    for frame in video.frames():
        report(frame.index + 1, video.n)
        view = find_view(frame, board) if frame.index % step == 0 else None
        if view is not None and view.blur_px <= BLURRED_PX:
            views.append(view)
    return views, len(range(0, video.n, step))


def find_view(frame: Frame, board: Board) -> BoardView | None:
    """The board in one frame, None where it is not whole."""
    grey = cv2.cvtColor(frame.image, cv2.COLOR_BGR2GRAY)
    height, width = grey.shape
    scale = min(1.0, SMALL_PX / max(width, height))
    small = cv2.resize(grey, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA) if scale < 1.0 else grey
    pattern = (board.columns, board.rows)
    found, corners = cv2.findChessboardCornersSB(small, pattern, flags=0)
    if not found:
        return None
    # motion blurs the edges of one direction and leaves the other sharp
    sharpness = (cv2.estimateChessboardSharpness(small, pattern, corners, 0.8, across)[0] for across in (False, True))
    blur_px = max(float(np.ravel(edge)[0]) for edge in sharpness)
    # middles of pixels stay in the middle: (x + 1/2) / scale − 1/2
    full = ((corners.reshape(-1, 1, 2) + 0.5) / scale - 0.5).astype(np.float32)
    refined = _refined(np.asarray(grey, np.uint8), full, board).reshape(-1, 2)
    return BoardView(frame=frame.index, corners=refined, blur_px=blur_px, pose=_pose(refined, board, (width, height)))


def chosen(views: Iterable[BoardView], most: int) -> list[BoardView]:
    """Choose at most this many views that differ from each other, the sharper one of two that do not; in order of the
    video."""
    sharpest_first = sorted(views, key=lambda view: view.blur_px)
    apart = APART
    while True:
        kept: list[BoardView] = []
        for view in sharpest_first:
            if all(np.linalg.norm(view.pose - other.pose) >= apart for other in kept):
                kept.append(view)
        if len(kept) <= most:
            return sorted(kept, key=lambda view: view.frame)
        apart *= 1.1


def _refined(grey: NDArray[np.uint8], corners: NDArray[np.float32], board: Board) -> NDArray[np.float32]:
    """Refine corners to fractions of a pixel, each in a window that no other corner can reach into."""
    grid = corners.reshape(board.rows, board.columns, 2)
    nearest = min(float(np.linalg.norm(np.diff(grid, axis=axis), axis=-1).min()) for axis in (0, 1))
    half = int(np.clip(nearest * 0.3, 2, 11))
    until = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 50, 1e-3)
    return np.asarray(cv2.cornerSubPix(grey, corners.copy(), (half, half), (-1, -1), until), dtype=np.float32)


def _pose(corners: NDArray[np.float32], board: Board, size: tuple[int, int]) -> Floats:
    """Middle, size, and how much longer one edge is than the opposite one, all about 0 to 1."""
    grid = corners.reshape(board.rows, board.columns, 2).astype(np.float64)
    a, b, c, d = grid[0, 0], grid[0, -1], grid[-1, -1], grid[-1, 0]
    top, right, bottom, left = (float(np.linalg.norm(q - p)) for p, q in ((a, b), (b, c), (c, d), (d, a)))
    middle = corners.mean(axis=0) / size
    extent = np.sqrt(abs(float(cv2.contourArea(np.array([a, b, c, d], dtype=np.float32)))) / (size[0] * size[1]))
    return np.array([*middle, extent, np.log(top / bottom) / 2.0, np.log(left / right) / 2.0])
