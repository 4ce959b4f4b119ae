"""A camera's intrinsics from views of a chessboard, how sure they are, and whether they will do.

Reference:
    Z. Zhang, "A flexible new technique for camera calibration", IEEE TPAMI 22(11), 2000, in the form of OpenCV's
    ``calibrateCamera`` with the five coefficients k1 k2 p1 p2 k3.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.camera.calibrate_views import Board, BoardView
from vision.camera.intrinsics import Intrinsics
from vision.camera.lens_file import CORNER_PX
from vision.errors import CameraError

Floats = NDArray[np.float64]

PARAMETERS = ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3")
FEWEST_VIEWS, MAX_VIEWS = 12, 60
"""Views that a calibration needs, and most that it uses: more change little and take long."""
OUTLIER = 2.5
"""A view whose error is this many times the middle one's was disturbed: the board bent, or moved while it was taken."""
WORST_RMS = 1.0 / 1920
"""Largest error, as a share of the image's longer side."""
WORST_PIXEL = 3.0 / 1920
"""1σ of the pixel of a ray, as the same share."""
MIN_COVERAGE = 0.6
"""Share of the image in which the board must have been seen."""
WORST_FOCAL = 0.005
"""1σ of a focal length, as a share of it."""
MIN_TILT = np.deg2rad(15.0)
"""Tilt that a quarter of the views reach; boards that face the camera leave focal length and distance undetermined."""
CELLS = (24, 18)
"""Columns and rows in which coverage is counted."""
PLACES = (
    ("upper left", "upper", "upper right"),
    ("left", "middle", "right"),
    ("lower left", "lower", "lower right"),
)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Calibration:
    """A calibrated camera and the quality of its calibration."""

    intrinsics: Intrinsics
    std: Floats
    """(9,) 1σ of :data:`PARAMETERS`, px for the first four, from the scatter of the corners."""
    rms_px: float
    """Root mean square distance of a corner from where the camera would show it."""
    pixel_px: float
    """1σ of the pixel of a ray where it is least sure, which is a corner of the image."""
    tilt: float
    """Angle between board and image that a quarter of the views reach, rad."""
    views: tuple[BoardView, ...]
    """Views that were used."""
    covered: NDArray[np.bool_]
    """(rows, columns) cells of the image in which a board was seen."""

    @property
    def coverage(self) -> float:
        """Share of the image in which a board was seen."""
        return float(self.covered.mean())


def calibrate(views: Sequence[BoardView], board: Board, size: tuple[int, int]) -> Calibration:
    """Fit a camera to views, leave out those that do not fit, and fit again.

    Args:
        size: width and height of the image, px.

    Raises:
        CameraError: too few views to fit anything.
    """
    if len(views) < 4:
        raise CameraError(f"{len(views)} views of a {board.columns}x{board.rows} board; {_more_views()}")
    errors = _fit(views, board, size).errors
    kept = [view for view, error in zip(views, errors, strict=True) if error <= OUTLIER * np.median(errors)]
    fit = _fit(kept, board, size)
    covariance = _covariance(fit, kept, board)
    camera = Intrinsics(
        width=size[0],
        height=size[1],
        fx=float(fit.K[0, 0]),
        fy=float(fit.K[1, 1]),
        cx=float(fit.K[0, 2]) + CORNER_PX,
        cy=float(fit.K[1, 2]) + CORNER_PX,
        distortion=fit.lens,
    )
    tilts = [np.arccos(min(1.0, abs(cv2.Rodrigues(turn)[0][2, 2]))) for turn, _ in fit.poses]
    return Calibration(
        intrinsics=camera,
        std=np.sqrt(np.diag(covariance)),
        rms_px=fit.rms_px,
        pixel_px=_pixel_std(camera, fit, covariance),
        tilt=float(np.quantile(tilts, 0.75)),
        views=tuple(kept),
        covered=_covered(kept, board, size),
    )


def doubts(calibration: Calibration) -> Iterator[str]:
    """Return why a calibration should not be used, and what to do about it; nothing when it is good."""
    camera = calibration.intrinsics
    if len(calibration.views) < FEWEST_VIEWS:
        yield f"only {len(calibration.views)} different sharp views of the whole board fit; {_more_views()}"
    if calibration.coverage < MIN_COVERAGE:
        yield (
            f"the board was seen in {calibration.coverage:.0%} of the image, {MIN_COVERAGE:.0%} are needed: "
            f"hold it also {_emptiest(calibration.covered)}, and nearer"
        )
    if calibration.rms_px > WORST_RMS * max(camera.width, camera.height):
        yield (
            f"corners are {calibration.rms_px:.2f} px off: glue the board on something flat and stiff, hold it still, "
            f"switch off the camera's stabilisation and autofocus"
        )
    focal = max(calibration.std[0] / camera.fx, calibration.std[1] / camera.fy)
    if focal > WORST_FOCAL or calibration.tilt < MIN_TILT:
        yield "the focal length is unsure: tilt the board by 30° to 45° to all sides"
    if calibration.pixel_px > WORST_PIXEL * max(camera.width, camera.height):
        yield (
            f"pixels are unsure by {calibration.pixel_px:.2f} px in the image's corners: "
            f"show the board there and along the sides"
        )
    if not np.isfinite(camera.rays(camera.corners)).all():
        yield "the lens model breaks down in the image's corners: show the board there; a fisheye does not fit it"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Fit:
    """Calibration that OpenCV finds."""

    rms_px: float
    K: Floats
    lens: Floats
    poses: tuple[tuple[Floats, Floats], ...]
    """Poses of the board in each view: rotation vector and translation."""
    errors: Floats
    """(n,) RMS of each view, px."""


def _fit(views: Sequence[BoardView], board: Board, size: tuple[int, int]) -> _Fit:
    until = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 100, 1e-9)
    corners = [view.corners.reshape(-1, 1, 2) for view in views]
    # the stubs want a first guess of camera and lens, which flags=0 does not use
    rms_px, K, lens, turns, places, _, _, errors = cv2.calibrateCameraExtended(  # type: ignore[call-overload]
        [board.points] * len(views), corners, size, None, None, flags=0, criteria=until
    )
    return _Fit(
        rms_px=float(rms_px),
        K=K,
        lens=lens.ravel()[:5],
        poses=tuple(zip(turns, places, strict=True)),
        errors=errors.ravel(),
    )


def _covariance(fit: _Fit, views: Sequence[BoardView], board: Board) -> Floats:
    """(9, 9) of :data:`PARAMETERS`, with the boards' poses unknown as well.

    With A_i, B_i the derivatives of the corners of view i by the camera and by its pose,
    C⁻¹ = Σ (A_iᵀ A_i − A_iᵀ B_i (B_iᵀ B_i)⁻¹ B_iᵀ A_i) / σ².
    """
    N = np.zeros((len(PARAMETERS), len(PARAMETERS)))
    squares = 0.0
    for view, pose in zip(views, fit.poses, strict=True):
        uv, derivatives = _project(board.points.astype(np.float64), *pose, fit)
        B, A = derivatives[:, :6], derivatives[:, 6:]
        AtB = A.T @ B
        N += A.T @ A - AtB @ np.linalg.solve(B.T @ B, AtB.T)
        squares += float(((uv - view.corners) ** 2).sum())
    numbers = 2 * len(board.points) * len(views)
    variance = squares / (numbers - len(PARAMETERS) - 6 * len(views))
    return np.asarray(variance * np.linalg.pinv(N, hermitian=True))


def _pixel_std(camera: Intrinsics, fit: _Fit, covariance: Floats) -> float:
    """1σ of a ray's pixel, the largest over the image; inf where the lens shows no ray."""
    u, v = np.meshgrid(np.linspace(0, camera.width, 17), np.linspace(0, camera.height, 10))
    rays = camera.rays(np.stack([u, v], axis=-1)).reshape(-1, 3)
    if not np.isfinite(rays).all():
        return float("inf")
    _, derivatives = _project(rays, np.zeros(3), np.zeros(3), fit)
    J = derivatives[:, 6:].reshape(len(rays), 2, len(PARAMETERS))
    # σ² = trace(J C Jᵀ)
    return float(np.sqrt(np.einsum("nip,pq,niq->n", J, covariance, J).max()))


def _project(points: Floats, turn: Floats, place: Floats, fit: _Fit) -> tuple[Floats, Floats]:
    """Pixels (n, 2), and (2n, 6 + 9) their derivatives by rotation, translation and :data:`PARAMETERS`."""
    uv, derivatives = cv2.projectPoints(points, turn, place, fit.K, fit.lens)
    return np.asarray(uv[:, 0], np.float64), np.asarray(derivatives[:, : 6 + len(PARAMETERS)], np.float64)


def _covered(views: Sequence[BoardView], board: Board, size: tuple[int, int]) -> NDArray[np.bool_]:
    """Cells of the image that lie on a board, which is seen half a square beyond its corners."""
    seen = np.zeros((CELLS[1], CELLS[0]), np.uint8)
    scale = np.array(CELLS) / size
    for view in views:
        grid = view.corners.reshape(board.rows, board.columns, 2)
        outline = np.concatenate([grid[0], grid[1:, -1], grid[-1, -2::-1], grid[-2:0:-1, 0]])
        middle = outline.mean(axis=0)
        wider = middle + (outline - middle) * (1.0 + 1.0 / (min(board.rows, board.columns) - 1))
        cv2.fillPoly(seen, [np.floor(wider * scale).astype(np.int32)], 1)
    return seen.astype(np.bool_)


def _emptiest(covered: NDArray[np.bool_]) -> str:
    """The ninth of the image that saw least of the board."""
    rows, columns = covered.shape
    ninths = covered.reshape(3, rows // 3, 3, columns // 3).mean(axis=(1, 3))
    row, column = np.unravel_index(np.argmin(ninths), ninths.shape)
    place = PLACES[int(row)][int(column)]
    return "in the middle" if place == "middle" else f"to the {place}"


def _more_views() -> str:
    return (
        f"{FEWEST_VIEWS} are needed: film for a minute, slowly, in good light, the whole board at many places, "
        f"distances and tilts; --board counts the inner corners, where four squares meet"
    )
