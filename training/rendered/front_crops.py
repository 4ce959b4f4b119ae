"""Images to learn fronts from: one vehicle in the middle of each, its oriented box and heading exactly known.

``python -m training.rendered.front_crops --out .train/fronts/pool --shards 24 --seed 0`` writes shards; one seed, one
shard, so that shards can be made in any order and by several processes.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from sim.render.open_scene import random_scene
from sim.render.randomise import SIZES, VEHICLES, random_style
from sim.render.render import Renderer
from sim.world.view import OCCLUDER, UGV, Bodies, CameraView, ray_ground
from training.rendered.crops import labels
from training.rendered.shards import write_missing

Image = NDArray[np.uint8]
FloatArray = NDArray[np.float64]
SIDE = 128
"""Side of a crop, px: holds the longest vehicle, 80 px, at any angle and some ground around it."""
MIN_LENGTH_PX, MAX_LENGTH_PX = 12.0, 80.0
"""Range of a vehicle's length in the crops; a choice."""
PER_GROUND = 50
"""Crops until the ground is drawn again: making it costs more than a crop."""
log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True, kw_only=True)
class FrontCrop:
    """One image and the vehicle in its middle."""

    image: Image
    """(SIDE, SIDE, 3) BGR."""
    box: FloatArray
    """(5,) cx, cy, length, width px, heading (rad, clockwise from image up)."""


def front_crop(renderer: Renderer, rng: np.random.Generator) -> FrontCrop:
    """One random vehicle on a renderer's ground, with random appearance, among a few other objects."""
    over = int(rng.choice([1, 1, 2]))
    kind = int(rng.choice((UGV, *VEHICLES)))
    length_m, length_px = rng.uniform(*SIZES[kind][0]), _random_length_px(rng)
    view = _random_view(rng, SIDE * over, length_m / (length_px * over))
    bodies = _random_bodies(view, kind, float(length_m), rng)
    renderer.style = random_style(rng)
    image = renderer.draw(view, bodies, int(rng.integers(1 << 30)))
    box = labels(view, bodies)[0]
    box[:4] /= over
    if over > 1:
        image = np.asarray(cv2.resize(image, (SIDE, SIDE), interpolation=cv2.INTER_AREA), np.uint8)
    return FrontCrop(image=_compressed(image, rng), box=box)


def write_shard(folder: Path, seed: int, count: int) -> Path:
    """Render a shard: images (count, SIDE, SIDE, 3) uint8 and boxes (count, 5) float32."""
    rng = np.random.default_rng([seed, 77])
    images, boxes = np.zeros((count, SIDE, SIDE, 3), np.uint8), np.zeros((count, 5), np.float32)
    renderer = Renderer(random_scene(rng), random_style(rng), seed=int(rng.integers(1 << 30)))
    for i in range(count):
        if i and i % PER_GROUND == 0:
            renderer = Renderer(random_scene(rng), random_style(rng), seed=int(rng.integers(1 << 30)))
        made = front_crop(renderer, rng)
        images[i], boxes[i] = made.image, made.box
    folder.mkdir(parents=True, exist_ok=True)
    path, part = folder / f"fronts_{seed:06d}.npz", folder / f"fronts_{seed:06d}.part"
    with part.open("wb") as file:
        np.savez(file, images=images, boxes=boxes)
    part.replace(path)
    log.info("%s: %d vehicles", path, count)
    return path


def _random_length_px(rng: np.random.Generator) -> float:
    # even in the logarithm: as many between 12 and 24 px as between 24 and 48
    return float(np.exp(rng.uniform(np.log(MIN_LENGTH_PX), np.log(MAX_LENGTH_PX))))


def _random_view(rng: np.random.Generator, side: int, gsd_m: float) -> CameraView:
    """A small image, ``side`` px square, with this many metres per pixel in its middle, mostly seen from above."""
    height, yaw = float(rng.uniform(15.0, 120.0)), float(rng.uniform(0.0, 2.0 * np.pi))
    # a vehicle at the edge of a wide image is seen aslant too
    pitch = -np.pi / 2.0 + min(abs(float(rng.normal(0.0, 0.18 if rng.random() < 0.8 else 0.45))), 1.0)
    forward = np.array([np.cos(pitch) * np.sin(yaw), np.cos(pitch) * np.cos(yaw), np.sin(pitch)])
    right = np.array([np.cos(yaw), -np.sin(yaw), 0.0])
    distance = height / np.sin(-pitch)
    middle = np.append(rng.uniform(-30.0, 30.0, 2), 0.0)
    return CameraView(
        width=side,
        height=side,
        fx=distance / gsd_m,
        fy=distance / gsd_m,
        cx=0.5 * side,
        cy=0.5 * side,
        distortion=np.zeros(5),
        R_enu_cam=np.column_stack([right, np.cross(forward, right), forward]),
        p_enu=middle - forward * distance,
    )


def _random_bodies(view: CameraView, kind: int, length_m: float, rng: np.random.Generator) -> Bodies:
    """The vehicle in the middle first, then others beside it."""
    at = _ground(view, 0.5 + rng.uniform(-0.02, 0.02, 2))
    rows = [_body(kind, at, float(rng.uniform(0.0, 2.0 * np.pi)), rng, length_m)]
    fleet = _random_color(rng)
    colors = [fleet]
    for _ in range(int(rng.poisson(2.0))):
        other = kind if rng.random() < 0.4 else int(rng.choice(list(SIZES)))
        body = _body(other, _ground(view, rng.uniform(-0.1, 1.1, 2)), float(rng.uniform(0.0, 2.0 * np.pi)), rng)
        reach = 0.5 * float(np.hypot(body[4], body[5])) * (1.2 if other == OCCLUDER else 1.0)
        gap = 0.5 * np.hypot(length_m, rows[0][5]) + reach
        # clear of the vehicle: parked beside, not on it
        if np.hypot(body[1] - at[0], body[2] - at[1]) > gap * rng.uniform(0.8, 1.0):
            rows.append(body)
            colors.append(fleet if other == kind and rng.random() < 0.7 else _random_color(rng))
    return Bodies.from_rows(rows, colors)


def _ground(view: CameraView, share: FloatArray) -> FloatArray:
    """(3,) ground under a place of the image, given as shares of its sides."""
    return np.asarray(ray_ground(view, share * (view.width, view.height)))


def _body(
    kind: int, at: FloatArray, heading: float, rng: np.random.Generator, length_m: float | None = None
) -> tuple[float, ...]:
    length, width, height = (float(rng.uniform(low, high)) for low, high in SIZES[kind])
    return kind, float(at[0]), float(at[1]), heading, length if length_m is None else length_m, width, height


def _random_color(rng: np.random.Generator) -> NDArray[np.int64]:
    if rng.random() < 0.4:  # most cars are white, grey or black
        return np.asarray(np.clip(rng.choice([235, 200, 150, 90, 45]) + rng.normal(0.0, 8.0, 3), 0, 255), np.int64)
    return rng.integers(10, 250, 3)


def _compressed(image: Image, rng: np.random.Generator) -> Image:
    """Image compressed as recorded video is."""
    if rng.random() < 0.4:
        return image
    packed = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, int(rng.integers(25, 95))])[1]
    return np.asarray(cv2.imdecode(packed, cv2.IMREAD_COLOR), np.uint8)


def main() -> None:
    """Write shards; those that exist are left as they are."""
    write_missing(
        "Render training images for the front classifier.",
        "fronts",
        write_shard,
        out=Path(".train/fronts/pool"),
        shards=24,
        per_shard=1000,
    )


if __name__ == "__main__":
    main()
