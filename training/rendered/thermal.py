"""The look of a thermal camera: one channel that tells how warm things are, soft and noisy, warm light or warm dark.

A scene is drawn with temperatures for colours: ``warmed`` gives bodies theirs, ``draw_traces`` the ground where cars
stood, and ``as_thermal`` turns the image into what such a camera records.
"""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from sim.world.view import OCCLUDER, Bodies, CameraView, project

Image = NDArray[np.uint8]
FloatArray = NDArray[np.float64]
WARM_SHARE = 0.2
"""Share of vehicles that have just been driven."""


def warmed(bodies: Bodies, vehicle: NDArray[np.bool_], alive: NDArray[np.bool_], rng: np.random.Generator) -> Bodies:
    """Bodies with grey levels of their temperatures for colours.

    Args:
        vehicle: (n,) which are vehicles: their roofs mirror a cold sky, or have taken up the sun; some are driven.
        alive: (n,) which are persons and animals, warmer than all else.
    """
    count = len(bodies.x)
    level = rng.normal(rng.uniform(60.0, 190.0), 25.0, count)
    roof, spread = (rng.uniform(10.0, 70.0) if rng.random() < 0.65 else rng.uniform(190.0, 245.0)), rng.uniform(4, 25)
    level = np.where(vehicle, rng.normal(roof, spread, count), level)
    level = np.where(vehicle & (rng.random(count) < WARM_SHARE), rng.uniform(150.0, 250.0, count), level)
    level = np.where(alive, rng.uniform(200.0, 255.0, count), level)
    level = np.where(bodies.kind == OCCLUDER, rng.normal(rng.uniform(50.0, 170.0), 12.0, count), level)
    grey = np.clip(level, 5.0, 252.0).astype(np.uint8)
    return replace(bodies, color=np.repeat(grey[:, None], 3, axis=1))


def draw_traces(image: Image, view: CameraView, places: FloatArray, rng: np.random.Generator) -> None:
    """Darken or lighten the ground where cars stood, into the image: patches without a sharp edge.

    Args:
        places: (n, 4) x, y, heading, length of bays.
        rng: draws how large they are, and how strong.
    """
    mask = np.zeros(image.shape[:2], np.uint8)
    pixels = 4.0
    for x, y, heading, _ in places:
        half = 0.5 * np.array([rng.uniform(3.6, 4.8), rng.uniform(1.5, 2.0)])
        forward, right = np.array([np.sin(heading), np.cos(heading)]), np.array([np.cos(heading), -np.sin(heading)])
        ring = np.array([(1, 1), (1, -1), (-1, -1), (-1, 1)]) * half
        uv, ok = project(view, np.column_stack([np.array([x, y]) + ring @ np.stack([forward, right]), np.zeros(4)]))
        if ok.all() and np.abs(uv).max() < 4.0 * max(image.shape):
            cv2.fillConvexPoly(mask, np.rint(uv).astype(np.int32), int(rng.uniform(60, 255)), cv2.LINE_AA)
            pixels = float(np.hypot(*(uv[0] - uv[1])))
    soft = cv2.GaussianBlur(mask, (0, 0), max(rng.uniform(0.08, 0.3) * pixels, 0.8)).astype(np.float32)[..., None]
    strength = float(rng.uniform(0.15, 0.5) * (1.0 if rng.random() < 0.3 else -1.0))
    image[:] = np.clip(image * (1.0 + strength * soft / 255.0), 0, 255).astype(np.uint8)


def as_thermal(image: Image, rng: np.random.Generator) -> Image:
    """Image that a thermal camera records of a scene whose colours are temperatures.

    Args:
        image: (H, W, 3) BGR.
    """
    height, width = image.shape[:2]
    grey = image.astype(np.float32) @ rng.dirichlet((3.0, 3.0, 3.0)).astype(np.float32)
    grey = np.asarray(cv2.GaussianBlur(grey, (0, 0), float(rng.uniform(0.5, 1.4))), np.float32)
    if rng.random() < 0.3:  # what the lens and the housing add
        grey += cv2.resize(
            rng.normal(0.0, 14.0, (4, 4)).astype(np.float32), (width, height), interpolation=cv2.INTER_CUBIC
        )
    # contrast by the image's own span, as the camera's gain control has it
    low, high = np.percentile(grey, (1.0, 99.0))
    middle, span = rng.uniform(95.0, 165.0), rng.uniform(60.0, 230.0)
    grey = middle + span * ((grey - low) / max(float(high - low), 20.0) - 0.5)
    if rng.random() < 0.35:
        grey = 255.0 - grey
    grey += rng.normal(0.0, float(rng.uniform(0.5, 5.0)), (height, width)).astype(np.float32)
    grey += rng.normal(0.0, float(rng.uniform(0.0, 2.0)), (1, width)).astype(np.float32)
    flat = np.clip(grey, 0, 255).astype(np.uint8)
    if rng.random() < 0.5:
        amount, blurred = float(rng.uniform(0.3, 2.0)), cv2.GaussianBlur(flat, (0, 0), float(rng.uniform(0.8, 2.0)))
        flat = np.asarray(cv2.addWeighted(flat, 1.0 + amount, blurred, -amount, 0.0), np.uint8)
    packed = cv2.imencode(".jpg", flat, [cv2.IMWRITE_JPEG_QUALITY, int(rng.integers(40, 96))])[1]
    return np.asarray(cv2.imdecode(packed, cv2.IMREAD_COLOR), np.uint8)
