"""Exposure: what the camera does to the light: motion blur, vignetting, exposure, white balance, sensor noise."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

Image = NDArray[np.uint8]
NOISE_ROOM = 64
"""px by which the noise is larger than the image in each direction, so that every frame is given another part of it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Exposure:
    """One camera's habits; hashable, so that what depends on it alone is computed once."""

    gain: float = 1.0
    """Brightness factor."""
    balance: tuple[float, float, float] = (1.0, 1.0, 1.0)
    """Factors of blue, green and red."""
    vignette: float = 0.12
    """Loss of light in the corners, 0 to 1."""
    noise: float = 3.0
    """Standard deviation of the sensor noise, of 255."""
    blur_px: float = 0.0
    """Length of the motion blur, pixels."""
    blur_direction: float = 0.0
    """Direction of the motion blur, radians from image right to down."""
    softness_px: float = 0.0
    """Standard deviation of the lens blur, pixels."""


def expose(image: Image, exposure: Exposure, rng: np.random.Generator) -> Image:
    """The image the camera makes of a scene.

    Returns:
        (H, W, 3) BGR, a new array.
    """
    height, width = image.shape[:2]
    if exposure.blur_px >= 1.0:
        image = np.asarray(cv2.filter2D(image, -1, _motion_kernel(exposure.blur_px, exposure.blur_direction)), np.uint8)
    if exposure.softness_px > 0.2:
        image = np.asarray(cv2.GaussianBlur(image, (0, 0), exposure.softness_px), np.uint8)
    factors = tuple(exposure.gain * b for b in exposure.balance)
    if exposure.vignette == 0.0 and factors != (1.0, 1.0, 1.0):
        # the stubs know no scalar per channel
        image = np.asarray(cv2.multiply(image, (*factors, 1.0)), np.uint8)  # type: ignore[call-overload]
    elif exposure.vignette > 0.0:
        image = np.asarray(
            cv2.multiply(image, _light(height, width, factors, exposure.vignette), scale=1.0 / 128.0), np.uint8
        )
    if exposure.noise > 0.0:
        dv, du = rng.integers(0, NOISE_ROOM, size=2)
        grain = _noise(height + NOISE_ROOM, width + NOISE_ROOM, exposure.noise)[dv : dv + height, du : du + width]
        image = np.asarray(cv2.add(image, grain, dtype=cv2.CV_8U), np.uint8)
    return image


def _motion_kernel(length_px: float, direction: float) -> NDArray[np.float32]:
    side = 2 * int(np.ceil(length_px / 2.0)) + 1
    kernel = np.zeros((side, side), np.float32)
    middle = (side - 1) / 2.0
    reach = 0.5 * length_px * np.array([np.cos(direction), np.sin(direction)])
    for t in np.linspace(-1.0, 1.0, 4 * side):
        u, v = middle + t * reach
        kernel[round(v), round(u)] += 1.0
    return np.asarray(kernel / kernel.sum(), dtype=np.float32)


@lru_cache(maxsize=4)
def _light(height: int, width: int, factors: tuple[float, ...], vignette: float) -> Image:
    """(H, W, 3) brightness per pixel in 1/128."""
    v = (np.arange(height, dtype=np.float32) / (height - 1) * 2.0 - 1.0)[:, None]
    u = (np.arange(width, dtype=np.float32) / (width - 1) * 2.0 - 1.0)[None, :]
    # light falls with the square of the distance from the middle: 1 − a r²/2
    fall = 1.0 - vignette * 0.5 * (u * u + v * v)
    return np.clip(128.0 * fall[..., None] * np.array(factors, np.float32), 0, 255).astype(np.uint8)


@lru_cache(maxsize=16)
def _noise(height: int, width: int, deviation: float) -> NDArray[np.int8]:
    """(H, W, 3) noise, part grey and part coloured; frames take different parts of it."""
    rng = np.random.default_rng(0)
    grey = rng.standard_normal((height, width, 1), dtype=np.float32)
    colored = rng.standard_normal((height, width, 3), dtype=np.float32)
    return np.clip(np.rint(deviation * (0.85 * grey + 0.53 * colored)), -127, 127).astype(np.int8)
