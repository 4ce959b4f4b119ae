"""Places where boxes stand on the ground: the middle of a box is that of a body, half its height above its place."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gcs.fold.camera.frame_camera import FrameCamera

FloatArray = NDArray[np.float64]

HALF_HEIGHT = 0.25
"""Height of a body's middle over √(length · width) of its box: 0.26 for small UGVs, 0.27 for cars."""
HIGHEST_M = 1.5
"""Greatest height of a vehicle's middle, whatever its box says."""
MIN_SINE = 0.17
"""Sine of the depression, 10°, below which a place is so uncertain that nothing is gained."""
STEEP_SINE = 0.8
"""Sine of the depression, 53°, from which a box is as long as its vehicle: further from the side it is as long as the
vehicle happens to be turned."""


def contact_rays(rays: FloatArray, size_px: FloatArray, view: FrameCamera) -> FloatArray:
    """Rays to the places below the middles of bodies.

    Seen at a depression δ, a body of height h looks as if its middle lay h / (2 tan δ) further away on the ground.

    Args:
        rays: (k, 3) through the middles of boxes, camera frame.
        size_px: (k,) √(w h) of the boxes.
        view: the camera.

    Returns:
        (k, 3) camera frame; those that do not come down clearly are left as they are.
    """
    unit, sine = _depressions(rays, view)
    above = view.pose.p_enu[2] - view.ground_z
    range_m = _ranges(sine, view)
    half_m = np.minimum(HALF_HEIGHT * size_px * range_m / view.intrinsics.fx, min(HIGHEST_M, 0.5 * max(above, 0.0)))
    # the middle is at s d with s d_z = h/2 − above; its place is h/2 lower
    down = range_m * (1.0 - half_m / max(above, 1e-9))
    lowered = unit * down[:, None] - half_m[:, None] * view.pose.R_enu_cam[2]
    return np.where((sine > MIN_SINE)[:, None], lowered, rays)


def box_lengths(rays: FloatArray, long_px: FloatArray, view: FrameCamera) -> FloatArray:
    """(k,) metres, how long boxes are at their depth in the picture; NaN where they are not seen from steeply above.

    Args:
        rays: (k, 3) through the middles of boxes, camera frame.
        long_px: (k,) their longer sides.
        view: the camera.
    """
    unit, sine = _depressions(rays, view)
    depth_m = unit[:, 2] * (view.pose.p_enu[2] - view.ground_z) / np.maximum(sine, STEEP_SINE)
    return np.asarray(np.where((sine > STEEP_SINE) & (depth_m > 0.0), long_px * depth_m / view.intrinsics.fx, np.nan))


def ground_places(rays: FloatArray, size_px: FloatArray, view: FrameCamera) -> tuple[FloatArray, FloatArray]:
    """Places of boxes on the ground, metres, and ln of their sizes there.

    Args:
        rays: (k, 3) through the middles of boxes, camera frame.
        size_px: (k,) √(w h) of the boxes.
        view: the camera.

    Returns:
        (k, 2) east and north of the camera, metres; (k,) ln of √(w h) at their distance, metres.
    """
    unit, sine = _depressions(rays, view)
    range_m = _ranges(sine, view)
    places = (unit @ view.pose.R_enu_cam.T)[:, :2] * range_m[:, None]
    return places, np.log(np.maximum(size_px * range_m / view.intrinsics.fx, 1e-6))


def pixels_on_ground(rays: FloatArray, view: FrameCamera) -> FloatArray:
    """Steps of a pixel right and down as they are on the ground, metres.

    R/f across the line of sight, R/(f sin δ) along it, R the range and δ the depression: seen from aside a vehicle that
    drives away from the camera is shorter in the picture than one that drives across.

    Args:
        rays: (k, 3) through the pixels, camera frame.
        view: the camera.

    Returns:
        (k, 2, 2) A, so that a step d in the picture is ‖A d‖ on the ground.
    """
    unit, sine = _depressions(rays, view)
    # e, the way in the picture in which the ground comes nearest: straight down, less what of it is along the ray
    down = -view.pose.R_enu_cam[2] - sine[:, None] * unit
    nearer = down[:, :2] * unit[:, 2:] - unit[:, :2] * down[:, 2:]
    nearer /= np.maximum(np.hypot(*nearer.T), np.finfo(float).tiny)[:, None]
    stretch = 1.0 / np.maximum(sine, MIN_SINE) - 1.0
    A = np.eye(2) + (stretch[:, None] * nearer)[:, :, None] * nearer[:, None]
    return np.asarray((_ranges(sine, view) / view.intrinsics.fx)[:, None, None] * A)


def _ranges(sine: FloatArray, view: FrameCamera) -> FloatArray:
    """(k,) metres along rays to the ground, by the sines of how far they point below the horizon."""
    return np.asarray((view.pose.p_enu[2] - view.ground_z) / np.maximum(sine, MIN_SINE))


def _depressions(rays: FloatArray, view: FrameCamera) -> tuple[FloatArray, FloatArray]:
    """(k, 3) the rays at unit length; (k,) sines of how far they point below the horizon."""
    unit = rays / np.sqrt(np.sum(rays * rays, axis=1))[:, None]
    return unit, -(unit @ view.pose.R_enu_cam[2])
