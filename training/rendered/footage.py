"""Changes to an image between the lens and the screen: haze, grading, rescaling, sharpening, compression."""

from __future__ import annotations

from fractions import Fraction

import av
import cv2
import numpy as np
from numpy.typing import NDArray

Image = NDArray[np.uint8]


def as_footage(image: Image, rng: np.random.Generator) -> Image:
    """An image as recorded footage shows it, the treatment drawn at random.

    Args:
        image: (H, W, 3) BGR, H and W even.
    """
    if rng.random() < 0.25:
        image = _under_shadows(image, rng)
    image = _graded(image, rng)
    if rng.random() < 0.35:
        image = _rescaled(image, float(rng.uniform(0.6, 0.95)), rng)
    if rng.random() < 0.5:
        image = _sharpened(image, float(rng.uniform(0.3, 1.6)), float(rng.uniform(0.7, 1.8)))
    kind = rng.random()
    if kind < 0.45:
        return _as_jpeg(image, int(rng.integers(30, 95)))
    return _as_h264(image, int(rng.integers(18, 33))) if kind < 0.65 else image


def _under_shadows(image: Image, rng: np.random.Generator) -> Image:
    """Shadows of roofs, poles and crowns beyond the image."""
    height, width = image.shape[:2]
    mask = np.zeros((height, width), np.uint8)
    for _ in range(int(rng.integers(1, 5))):
        at = rng.uniform(-0.1, 1.1, 2) * (width, height)
        kind = rng.random()
        if kind < 0.4:
            shape = at + rng.normal(0.0, 0.3 * width, (4, 2))
            cv2.fillConvexPoly(mask, cv2.convexHull(shape.astype(np.int32)), 255, cv2.LINE_AA)
        elif kind < 0.6:
            to = at + rng.normal(0.0, 0.5 * width, 2)
            cv2.line(mask, at.astype(int).tolist(), to.astype(int).tolist(), 255, int(rng.integers(1, 9)), cv2.LINE_AA)
        else:
            reach = rng.uniform(0.03, 0.2) * width
            for du, dv in rng.normal(0.0, 0.5 * reach, (40, 2)):
                middle = (int(at[0] + du), int(at[1] + dv))
                cv2.circle(mask, middle, int(reach * rng.uniform(0.1, 0.35)) + 1, 255, -1, cv2.LINE_AA)
    soft = cv2.GaussianBlur(mask, (0, 0), float(rng.uniform(0.5, 3.0)))
    light = 255.0 - soft.astype(np.float32) * float(rng.uniform(0.2, 0.6))
    return np.asarray(cv2.multiply(image, cv2.merge([light.astype(np.uint8)] * 3), scale=1.0 / 255.0), np.uint8)


def _graded(image: Image, rng: np.random.Generator) -> Image:
    """Uneven light, haze, contrast, colourfulness."""
    values = image.astype(np.float32) / 255.0
    if rng.random() < 0.6:
        base = rng.normal(1.0, float(rng.uniform(0.02, 0.1)), (5, 5, 1)).astype(np.float32)
        values *= cv2.resize(base, image.shape[1::-1], interpolation=cv2.INTER_CUBIC)[..., None]
    if rng.random() < 0.25:
        veil, air = float(rng.uniform(0.05, 0.25)), rng.uniform(0.55, 0.95) * rng.uniform(0.93, 1.07, 3)
        values = values * (1.0 - veil) + (veil * air).astype(np.float32)
    if rng.random() < 0.6:
        grey = values.mean(axis=2, keepdims=True)
        values = grey + float(rng.uniform(0.3, 1.25)) * (values - grey)
    if rng.random() < 0.4:
        values = np.clip(values, 0.0, 1.0) ** float(rng.uniform(0.75, 1.35))
    if rng.random() < 0.4:
        values = 0.5 + float(rng.uniform(0.7, 1.25)) * (values - 0.5)
    return np.asarray(np.clip(255.0 * values + 0.5, 0, 255), np.uint8)


def _rescaled(image: Image, factor: float, rng: np.random.Generator) -> Image:
    small = cv2.resize(image, None, fx=factor, fy=factor, interpolation=cv2.INTER_AREA)
    back = (cv2.INTER_LINEAR, cv2.INTER_CUBIC, cv2.INTER_LANCZOS4)[int(rng.integers(3))]
    return np.asarray(cv2.resize(small, image.shape[1::-1], interpolation=back), np.uint8)


def _sharpened(image: Image, amount: float, sigma_px: float) -> Image:
    # unsharp mask: I + a (I − G_σ I)
    blurred = cv2.GaussianBlur(image, (0, 0), sigma_px)
    return np.asarray(cv2.addWeighted(image, 1.0 + amount, blurred, -amount, 0.0), np.uint8)


def _as_jpeg(image: Image, quality: int) -> Image:
    packed = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, quality])[1]
    return np.asarray(cv2.imdecode(packed, cv2.IMREAD_COLOR), np.uint8)


def _as_h264(image: Image, crf: int) -> Image:
    """One key frame there and back."""
    encoder = av.CodecContext.create("libx264", "w")
    encoder.width, encoder.height = image.shape[1], image.shape[0]
    encoder.pix_fmt, encoder.time_base = "yuv420p", Fraction(1, 25)
    encoder.options = {"crf": str(crf), "preset": "veryfast", "threads": "1"}
    frame = av.VideoFrame.from_ndarray(image, format="bgr24").reformat(format="yuv420p")
    frame.pts = 0
    decoder = av.CodecContext.create("h264", "r")
    packets = [*encoder.encode(frame), *encoder.encode(None)]
    decoded = [f for packet in packets for f in decoder.decode(packet)] + decoder.decode(None)
    return np.asarray(decoded[0].to_ndarray(format="bgr24"), np.uint8)
