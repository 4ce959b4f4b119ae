"""A plausible camera for a film whose camera is unknown, by how large its vehicles are.

Where a camera h above level ground looks down by θ, a length L across the line of sight at row v measures

    s(v) = L (f sin θ + (v − c_y) cos θ) / h        px,

which is a line over v: s = a + b (v − c_y) gives tan θ = a / (b f) and h = L f sin θ / a. The focal length f cannot
be told from sizes; it follows from an assumed field of view.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim.annotated.tracks import AnnotatedTracks
from sim.errors import AnnotationError

FloatArray = NDArray[np.float64]

FOV_DEG = 65.0
"""Horizontal field of view where none is given: 28 mm in terms of 35 mm film, as most camera drones have."""
CAR_M = (4.5, 1.8, 1.5)
"""Length, width and height of an ordinary car."""
SHALLOWEST_DEG, STRAIGHT_DOWN_DEG = 12.0, 85.0
"""Least pitch downwards of a camera that is guessed, and the one from which on it looks straight down."""
LOWEST_M, HIGHEST_M = 3.0, 500.0
"""Heights that the simulator takes."""
MAX_LABELS = 200
"""Number of labels looked at, the first ones: five cars for some seconds, within which a camera climbs little."""
ROUNDS = 4
"""Rounds of the guess, each with the sizes that a car has at the tilt of the one before."""


@dataclass(frozen=True, slots=True, kw_only=True)
class GuessedCamera:
    """A camera over level ground."""

    height_m: float
    fov_deg: float
    pitch_deg: float
    """Pitch of the optical axis, −90 straight down."""
    focal_px: float
    sources: tuple[str, ...]


def guess_camera(
    tracks: AnnotatedTracks,
    size: tuple[int, int],
    *,
    height_m: float | None = None,
    fov_deg: float | None = None,
    pitch_deg: float | None = None,
) -> GuessedCamera:
    """Fill in what is not given.

    Args:
        tracks: labels of cars; of vehicles whose kind is unknown where no car is among them.
        size: width and height of the images, px.
        height_m: of the camera above the ground.

    Raises:
        AnnotationError: the labels are too small or too large for any height of a camera drone.
    """
    fov = FOV_DEG if fov_deg is None else fov_deg
    focal = 0.5 * size[0] / np.tan(0.5 * np.radians(fov))
    row, measured = _sizes(tracks, size)
    pitch = -90.0 if pitch_deg is None else pitch_deg
    for _ in range(ROUNDS if pitch_deg is None else 0):
        pitch = _pitch(row, measured, focal, 0.5 * size[1], pitch)
    down = np.radians(-pitch)
    # h = L (f sin θ + (v − c_y) cos θ) / s
    heights = _apparent_m(down) * (focal * np.sin(down) + (row - 0.5 * size[1]) * np.cos(down)) / measured
    height = float(np.median(heights)) if height_m is None else height_m
    if not LOWEST_M <= height <= HIGHEST_M:
        raise AnnotationError(
            f"by its vehicles' sizes the film was taken from {height:.0f} m, which no camera drone flies at; "
            "give --height, --fov and --pitch"
        )
    sources = (
        f"height {height:.1f} m, {'from the size of vehicles' if height_m is None else 'as given'}",
        f"field of view {fov:g}°, {'assumed' if fov_deg is None else 'as given'}",
        f"pitch {pitch:.1f}°, {'from how sizes change down the picture' if pitch_deg is None else 'as given'}",
    )
    return GuessedCamera(height_m=height, fov_deg=fov, pitch_deg=pitch, focal_px=float(focal), sources=sources)


def _sizes(tracks: AnnotatedTracks, size: tuple[int, int]) -> tuple[FloatArray, FloatArray]:
    """Row (k,) and the longer side of the upright hull (k,), px, of whole cars."""
    hull = np.ptp(tracks.corners, axis=1)
    room = np.minimum(tracks.corners, np.array(size) - tracks.corners).min(axis=(1, 2))
    kinds = tracks.kind.tolist()
    kind = next((kind for kind in ("car", "vehicle") if kind in kinds), kinds[0])
    chosen = np.flatnonzero(np.array([other == kind for other in kinds]) & ~tracks.hidden)
    whole = chosen[room[chosen] > 1.0]
    chosen = whole if len(whole) else chosen if len(chosen) else np.arange(len(tracks))
    # labels are in the order of images, and the camera is wanted as it was at the first
    chosen = chosen[:MAX_LABELS]
    return tracks.centre[chosen, 1], hull[chosen].max(axis=1)


def _pitch(row: FloatArray, measured: FloatArray, focal: float, middle: float, pitch_deg: float) -> float:
    """Pitch, degrees, by the line of sizes over rows; straight down where sizes do not grow downwards."""
    if len(row) < 3 or np.ptp(row) < 1.0:
        return -90.0
    from scipy.stats import theilslopes  # here: loading scipy.stats takes half a second

    slope, intercept, _, _ = theilslopes(measured / _apparent_m(np.radians(-pitch_deg)), row - middle)
    if slope <= 0.0 or intercept <= 0.0:
        return -90.0
    # tan θ = a / (b f)
    down = float(np.degrees(np.arctan2(intercept, slope * focal)))
    return -90.0 if down > STRAIGHT_DOWN_DEG else -max(down, SHALLOWEST_DEG)


def _apparent_m(down: float) -> float:
    """Longer side, metres, of the upright hull of a car seen under an angle of depression, the mean over headings."""
    length, width, height = CAR_M
    turned = np.linspace(0.0, 0.5 * np.pi, 19)
    across = length * np.sin(turned) + width * np.cos(turned)
    upward = (length * np.cos(turned) + width * np.sin(turned)) * np.sin(down) + height * np.cos(down)
    return float(np.maximum(across, upward).mean())
