"""Pictures to train a detector on: small random scenes, every vehicle's oriented box, and much that is no vehicle.

``python -m sim.crops --out .train/pool --shards 12 --per-shard 500 --seed 0`` writes shards of crops; one seed,
one shard, so that shards can be made in any order and by several processes.
"""

from __future__ import annotations

import argparse
import logging
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from sim.foliage import Tree, draw_tree
from sim.randomise import SIZES, VEHICLES, random_scene, random_style
from sim.render import Renderer, Style
from sim.view import OCCLUDER, Bodies, CameraView, project, ray_ground

__all__ = ["Crop", "crop", "labels", "write_shard"]

Image = NDArray[np.uint8]
FloatArray = NDArray[np.float64]
SIDE = 256
MAX_BOXES = 24
PER_GROUND = 25
log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True, kw_only=True)
class Crop:
    """One picture and what is on it."""

    image: Image
    """(SIDE, SIDE, 3) BGR."""
    boxes: FloatArray
    """(n, 6) cx, cy, length, width px, heading (rad, clockwise from image up), weight (0 = mostly hidden)."""


def labels(view: CameraView, bodies: Bodies) -> FloatArray:
    """Oriented boxes of vehicles: the rectangle nearest to the outline of the body at half its height.

    Args:
        view: the camera.
        bodies: n bodies.

    Returns:
        (n, 5) cx, cy, length, width px, heading clockwise from image up; NaN where a body is not imaged.
    """
    forward = np.stack([np.sin(bodies.heading), np.cos(bodies.heading)], axis=-1) * bodies.length[:, None] / 2.0
    right = np.stack([np.cos(bodies.heading), -np.sin(bodies.heading)], axis=-1) * bodies.width[:, None] / 2.0
    middle = np.stack([bodies.x, bodies.y], axis=-1)
    ends = np.stack([middle, middle + forward, middle - forward, middle + right, middle - right], axis=1)
    z = np.broadcast_to(0.5 * bodies.height[:, None, None], (*ends.shape[:2], 1))
    uv, _ = project(view, np.concatenate([ends, z], axis=-1))
    along, across = uv[:, 1] - uv[:, 2], uv[:, 3] - uv[:, 4]
    length = np.hypot(along[:, 0], along[:, 1])
    # the width is measured square to the length: |along × across| / |along|
    with np.errstate(invalid="ignore", divide="ignore"):
        width = np.abs(along[:, 0] * across[:, 1] - along[:, 1] * across[:, 0]) / length
    heading = np.mod(np.arctan2(along[:, 0], -along[:, 1]), 2.0 * np.pi)
    return np.column_stack([uv[:, 0], length, width, heading])


def crop(renderer: Renderer, style: Style, rng: np.random.Generator) -> Crop:
    """One random picture over a renderer's ground."""
    over = float(rng.choice([1.0, 1.5, 2.0, 2.5]))
    view = _random_view(rng, round(SIDE * over))
    bodies = _random_bodies(view, rng)
    renderer.style = style
    image = renderer.draw(view, bodies, int(rng.integers(1 << 30)))
    image = _as_video(image, rng)
    boxes = labels(view, bodies)
    weight = _visible(view, bodies, boxes)
    boxes[:, :4] /= over
    vehicle = np.isin(bodies.kind, VEHICLES) & np.isfinite(boxes).all(axis=1)
    inside = ((boxes[:, :2] > 0.0) & (boxes[:, :2] < SIDE)).all(axis=1)
    keep = np.flatnonzero(vehicle & inside)[:MAX_BOXES]
    small = cv2.resize(image, (SIDE, SIDE), interpolation=cv2.INTER_AREA) if over > 1.0 else image
    return Crop(image=np.asarray(small, np.uint8), boxes=np.column_stack([boxes, weight])[keep])


def write_shard(folder: Path, seed: int, count: int) -> Path:
    """Render a shard: images (count, SIDE, SIDE, 3) uint8, boxes (count, MAX_BOXES, 6) float32, n (count,)."""
    rng = np.random.default_rng(seed)
    images = np.zeros((count, SIDE, SIDE, 3), np.uint8)
    boxes = np.zeros((count, MAX_BOXES, 6), np.float32)
    n = np.zeros(count, np.int64)
    renderer = Renderer(random_scene(rng), random_style(rng), seed=int(rng.integers(1 << 30)))
    for i in range(count):
        if i % PER_GROUND == 0:
            renderer = Renderer(random_scene(rng), random_style(rng), seed=int(rng.integers(1 << 30)))
        made = crop(renderer, random_style(rng), rng)
        images[i], n[i] = made.image, len(made.boxes)
        boxes[i, : n[i]] = made.boxes
    folder.mkdir(parents=True, exist_ok=True)
    path, part = folder / f"crops_{seed:06d}.npz", folder / f"crops_{seed:06d}.part"
    with part.open("wb") as file:
        np.savez(file, images=images, boxes=boxes, n=n)
    part.replace(path)
    log.info("%s: %d crops, %d vehicles", path, count, int(n.sum()))
    return path


def _random_view(rng: np.random.Generator, side: int) -> CameraView:
    """A camera whose picture shows 2.5 m at 14 to 44 px per SIDE: mostly straight down, sometimes oblique."""
    gsd = 2.5 / float(np.clip(np.exp(rng.normal(np.log(29.0), 0.28)), 13.0, 46.0)) * SIDE / side
    height = float(rng.uniform(20.0, 120.0))
    pitch = -np.pi / 2.0 + abs(float(rng.normal(0.0, 0.12 if rng.random() < 0.8 else 0.45)))
    pitch = min(pitch, -0.5)
    yaw = float(rng.uniform(0.0, 2.0 * np.pi))
    distance = height / np.sin(-pitch)
    focal = distance / gsd
    forward = np.array([np.cos(pitch) * np.sin(yaw), np.cos(pitch) * np.cos(yaw), np.sin(pitch)])
    right = np.array([np.cos(yaw), -np.sin(yaw), 0.0])
    at = rng.uniform(-30.0, 30.0, 2)
    # the crop is a part of a wider picture: its principal point lies off the crop by up to a frame
    cx, cy = 0.5 * side + rng.uniform(-1.0, 1.0, 2) * np.array([1.0, 0.6]) * 0.35 * focal
    aim = (0.5 * side - cx) / focal * right + (0.5 * side - cy) / focal * np.cross(forward, right) + forward
    p_enu = np.array([at[0], at[1], 0.0]) - aim * (height / max(-aim[2], 0.3))
    p_enu[2] = height
    return CameraView(
        width=side, height=side, fx=focal, fy=focal, cx=cx, cy=cy, distortion=np.zeros(5),
        R_enu_cam=np.column_stack([right, np.cross(forward, right), forward]), p_enu=p_enu,
    )  # fmt: skip


def _random_bodies(view: CameraView, rng: np.random.Generator) -> Bodies:
    """Vehicles, and a clutter of other things, apart from each other, on what the camera sees."""
    fleet = int(rng.choice(VEHICLES)) if rng.random() < 0.75 else -1
    wanted = [
        fleet if fleet >= 0 and rng.random() < 0.7 else int(rng.choice(VEHICLES)) for _ in range(rng.poisson(10.0))
    ]
    wanted += [int(rng.choice(list(SIZES), p=_CLUTTER)) for _ in range(rng.poisson(5.0))]
    fleet_color = rng.integers(10, 250, 3)
    street = float(rng.uniform(0.0, 2.0 * np.pi))
    rows: list[tuple[float, ...]] = []
    colors: list[NDArray[np.int64]] = []
    for kind in wanted:
        length, width, height = (float(rng.uniform(low, high)) for low, high in SIZES[kind])
        for _ in range(6):
            uv = rng.uniform(-0.08, 1.08, 2) * (view.width, view.height)
            x, y, _ = ray_ground(view, uv)
            reach = 0.5 * float(np.hypot(length, width)) * (0.8 if kind == OCCLUDER else 1.0)
            if all(
                np.hypot(x - r[1], y - r[2]) > (reach + r[7]) * rng.uniform(0.7, 1.0) or kind == OCCLUDER for r in rows
            ):
                aligned = street + rng.choice([0.0, np.pi]) + rng.normal(0.0, 0.1)
                heading = aligned if rng.random() < 0.4 else rng.uniform(0.0, 2.0 * np.pi)
                rows.append((kind, float(x), float(y), float(heading), length, width, height, reach))
                colors.append(fleet_color if kind == fleet else _random_color(rng))
                break
    table = np.array(rows).reshape(-1, 8).T
    return Bodies(
        kind=table[0].astype(np.int8), x=table[1], y=table[2], heading=table[3], length=table[4], width=table[5],
        height=table[6], color=np.array(colors, np.uint8).reshape(-1, 3),
    )  # fmt: skip


_CLUTTER = np.array([0.0 if k in VEHICLES else 3.0 if k == 2 else 1.5 if k == OCCLUDER else 1.0 for k in SIZES])
_CLUTTER = _CLUTTER / _CLUTTER.sum()


def _random_color(rng: np.random.Generator) -> NDArray[np.int64]:
    if rng.random() < 0.5:  # most cars are white, grey or black
        grey = rng.choice([235, 200, 150, 90, 45]) + rng.normal(0.0, 8.0, 3)
        return np.asarray(np.clip(grey, 0, 255), dtype=np.int64)
    return rng.integers(10, 250, 3)


def _visible(view: CameraView, bodies: Bodies, boxes: FloatArray) -> FloatArray:
    """(n,) 1 for bodies of which most is seen, 0 for those that trees hide or the edge cuts."""
    hidden = np.zeros((view.height, view.width, 3), np.uint8)
    for k in np.flatnonzero(bodies.kind == OCCLUDER):
        tree = Tree(**{f: float(getattr(bodies, f)[k]) for f in ("x", "y", "heading", "length", "width", "height")})
        draw_tree(hidden, view, tree, (255, 255, 255), np.array([0.0, 0.0, 1.0]), 1.0)
    seen = np.zeros(len(boxes))
    for i, (cx, cy, length, width, heading) in enumerate(boxes):
        if not np.isfinite([cx, cy]).all():
            continue
        a, c = np.meshgrid(np.linspace(-0.45, 0.45, 11), np.linspace(-0.45, 0.45, 7))
        u = np.floor(cx + a * length * np.sin(heading) + c * width * np.cos(heading)).astype(int)
        v = np.floor(cy - a * length * np.cos(heading) + c * width * np.sin(heading)).astype(int)
        inside = (u >= 0) & (v >= 0) & (u < view.width) & (v < view.height)
        clear = hidden[np.clip(v, 0, view.height - 1), np.clip(u, 0, view.width - 1), 0] == 0
        seen[i] = float((inside & clear).mean())
    return (seen > 0.6).astype(np.float64)


def _as_video(image: Image, rng: np.random.Generator) -> Image:
    """Contrast and compression as recorded video has them."""
    if rng.random() < 0.3:
        gamma = float(rng.uniform(0.7, 1.4))
        lut = np.clip(255.0 * (np.arange(256) / 255.0) ** gamma, 0, 255).astype(np.uint8)
        image = np.asarray(cv2.LUT(image, lut), np.uint8)
    if rng.random() < 0.6:
        quality = int(rng.integers(25, 95))
        packed = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, quality])[1]
        image = np.asarray(cv2.imdecode(packed, cv2.IMREAD_COLOR), np.uint8)
    return image


def main() -> None:
    """Write shards; those that exist are left as they are."""
    parser = argparse.ArgumentParser(description="Render training pictures for the oriented detector.")
    parser.add_argument("--out", type=Path, default=Path(".train/pool"))
    parser.add_argument("--shards", type=int, default=12)
    parser.add_argument("--per-shard", type=int, default=500)
    parser.add_argument("--seed", type=int, default=0, help="number of the first shard")
    args = parser.parse_args()
    logging.basicConfig(level=logging.INFO, format="%(message)s")
    cv2.setNumThreads(1)
    for seed in range(args.seed, args.seed + args.shards):
        if not (args.out / f"crops_{seed:06d}.npz").exists():
            write_shard(args.out, seed, args.per_shard)


if __name__ == "__main__":
    main()
