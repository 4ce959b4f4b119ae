"""Images to train a detector on: small random scenes, every vehicle's oriented box, and much that is no vehicle.

``python -m training.rendered.crops --out .train/pool --shards 12 --per-shard 250 --seed 0`` writes shards of crops; one
seed, one shard, so that shards can be made in any order and by several processes.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from sim.render.exposure import expose
from sim.render.foliage import Tree, draw_tree
from sim.render.randomise import FIRST_KIND, ObjectKind, random_catalogue, random_style
from sim.render.render import Style, body_outline, draw_bodies, draw_ground
from sim.render.training_ground import TrainingGround, random_training_ground
from sim.world.bodies import Model
from sim.world.view import OCCLUDER, Bodies, CameraView, FloatArray, project
from training.rendered.footage import as_footage
from training.rendered.placing import random_bodies, slots_in_view
from training.rendered.shards import write_missing
from training.rendered.thermal import as_thermal, draw_traces, warmed

Image = NDArray[np.uint8]
Sorts = list[ObjectKind | None]
"""Kind of each body; None where it is a tree."""
SIDE = 384
"""Side of a crop, px: more than the 256 px that training cuts out of it, turned and scaled."""
MAX_BOXES = 80
"""Rows of a crop's table of boxes; vehicles beyond it have none."""
OVER = (0.55, 0.75, 1.0, 1.25, 1.6)
"""Images are drawn at this many times their size; smaller ones are enlarged, as the detector does from high up."""
PER_GROUND, PER_CATALOGUE = 15, 5
"""Crops until ground and catalogue are drawn again: making them costs more than a crop."""
MIN_PX = 8.0
"""Shorter vehicles count neither way."""
HEAVY_KINDS, URBAN_KINDS = 4, 7
"""Counts of a catalogue: kinds of heavy vehicles, and of what moves and stands in towns; a choice."""
LOW_FLIGHT = 4
"""Number of the kind of view in ``_random_view`` from 4 to 30 m up, to the horizon."""
CONTAINER_M = 5.5
"""A longer container looks like a trailer from above, and counts neither way."""
DEEP_SHADOW_SHARE = 0.2
"""Share of images with shadows as dark as beside high houses at noon; a choice."""
THERMAL_SHARE, NIGHT_SHARE = 0.15, 0.6
"""Shares of images: those of a thermal camera, and of these those without sun; a choice."""
TRACES_SHARE = 0.4
"""Share of bays on some thermal images, those in which a car stood; a choice."""
log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True, kw_only=True)
class Crop:
    """One image and what is on it."""

    image: Image
    """(SIDE, SIDE, 3) BGR."""
    boxes: FloatArray
    """(n, 6) cx, cy, length, width px, heading (rad, clockwise from image up), visible share (0 for what counts
    neither way: the tiny, containers like trailers, and vehicles whose middle is beyond the edge)."""
    about: FloatArray
    """(5,) tilt from straight down, rad; height, m; light lost in shadows, 0 to 1; exposure gain; 1 where there are
    streets or car parks, else 0."""


def labels(view: CameraView, bodies: Bodies) -> FloatArray:
    """Oriented boxes of vehicles: the rectangle nearest to the outline of the body at half its height.

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


def seen_sides(view: CameraView, bodies: Bodies, models: Mapping[int, Model], boxes: FloatArray) -> FloatArray:
    """Reach of what is seen of each body along and across its heading in the image.

    Straight down these are the sides of ``labels``; seen from the side, the height of the body adds to them.

    Args:
        boxes: (n, 5) of ``labels``.

    Returns:
        (n, 2) length, width px; NaN where a body is not imaged, or is of no kind in ``models``.
    """
    sides = np.full((len(boxes), 2), np.nan)
    for i in np.flatnonzero(np.isfinite(boxes).all(axis=1)).tolist():
        model = models.get(int(bodies.kind[i]))
        outline = body_outline(view, bodies, i, model) if model is not None else None
        if outline is not None:
            sin, cos = np.sin(boxes[i, 4]), np.cos(boxes[i, 4])
            sides[i] = np.ptp(outline @ np.array([[sin, cos], [-cos, sin]]), axis=0)
    return sides


def crop(ground: TrainingGround, catalogue: tuple[ObjectKind, ...], rng: np.random.Generator) -> Crop:
    """One random image of a ground with objects of some kinds."""
    over = float(rng.choice(OVER))
    view = _random_view(ground, rng, 2 * round(0.5 * SIDE * over))
    bodies = random_bodies(view, ground, catalogue, rng)
    style = random_style(rng, catalogue)
    if rng.random() < DEEP_SHADOW_SHARE:
        lost = float(rng.uniform(0.7, 0.88))
        # a tall body in the shadow still sees more of the sky than the ground does
        style = replace(style, shadow=lost, in_shadow=1.1 - lost, ambient=float(rng.uniform(0.3, 0.5)))
    sorts: Sorts = [catalogue[k - FIRST_KIND] if k >= FIRST_KIND else None for k in bodies.kind]
    if rng.random() < THERMAL_SHARE:
        image = _thermal(view, ground, bodies, sorts, style, rng)
    else:
        image = _daylight(view, ground, bodies, style, rng)
    boxes = labels(view, bodies)
    boxes[:, 2:4] = seen_sides(view, bodies, style.models, boxes)
    weight = _visible(view, bodies)
    boxes[:, :4] *= SIDE / view.width
    vehicle = np.array([s is not None and s.group != "clutter" for s in sorts], dtype=bool)
    unclear = np.array([s is not None and s.name == "container" and s.size[0] > CONTAINER_M for s in sorts], dtype=bool)
    with np.errstate(invalid="ignore"):
        middle_inside = ((boxes[:, :2] > 0.0) & (boxes[:, :2] < SIDE)).all(axis=1)
        reach = 0.5 * boxes[:, 2:3]
        inside = ((boxes[:, :2] > -reach) & (boxes[:, :2] < SIDE + reach)).all(axis=1) & (boxes[:, 2] > 3.0)
        weight[unclear | ~(boxes[:, 2] >= MIN_PX) | ~middle_inside] = 0.0
    keep = np.flatnonzero((vehicle | unclear) & inside)[:MAX_BOXES]
    if over != 1.0:
        image = np.asarray(
            cv2.resize(image, (SIDE, SIDE), interpolation=cv2.INTER_AREA if over > 1.0 else cv2.INTER_LINEAR), np.uint8
        )
    tilt = float(np.arccos(np.clip(-view.R_enu_cam[2, 2], -1.0, 1.0)))
    return Crop(
        image=image,
        boxes=np.column_stack([boxes, weight])[keep],
        about=np.array([tilt, view.p_enu[2], style.shadow, style.exposure.gain, len(ground.slots.x) > 0]),
    )


def _daylight(
    view: CameraView, ground: TrainingGround, bodies: Bodies, style: Style, rng: np.random.Generator
) -> Image:
    image = draw_ground(ground, view)
    draw_bodies(image, view, bodies, style)
    return as_footage(expose(image, style.exposure, rng), rng)


def _thermal(
    view: CameraView, ground: TrainingGround, bodies: Bodies, sorts: Sorts, style: Style, rng: np.random.Generator
) -> Image:
    """Temperatures for colours; by night there are no shadows, and all sides of a thing are about as warm."""
    if rng.random() < NIGHT_SHARE:
        style = replace(style, shadow=0.0, ambient=float(rng.uniform(0.85, 1.0)), in_shadow=1.0)
    image = draw_ground(ground, view)
    places = slots_in_view(view, ground)
    if rng.random() < 0.6:
        draw_traces(image, view, places[rng.random(len(places)) < TRACES_SHARE * rng.random()], rng)
    vehicle = np.array([s is not None and s.group != "clutter" for s in sorts], dtype=bool)
    alive = np.array([s is not None and s.name in ("person", "animal") for s in sorts], dtype=bool)
    draw_bodies(image, view, warmed(bodies, vehicle, alive, rng), style)
    return as_thermal(image, rng)


def write_shard(folder: Path, seed: int, count: int) -> Path:
    """Render a shard: images (count, SIDE, SIDE, 3) uint8, boxes (count, MAX_BOXES, 6) float32, n (count,),
    about (count, 5) float32; the columns are those of ``Crop``."""
    rng = np.random.default_rng(seed)
    images = np.zeros((count, SIDE, SIDE, 3), np.uint8)
    boxes = np.zeros((count, MAX_BOXES, 6), np.float32)
    about = np.zeros((count, 5), np.float32)
    n = np.zeros(count, np.int64)
    ground, catalogue = random_training_ground(rng), _catalogue(rng)
    for i in range(count):
        ground = random_training_ground(rng) if i % PER_GROUND == PER_GROUND - 1 else ground
        catalogue = _catalogue(rng) if i % PER_CATALOGUE == PER_CATALOGUE - 1 else catalogue
        made = crop(ground, catalogue, rng)
        images[i], about[i], n[i] = made.image, made.about, len(made.boxes)
        boxes[i, : n[i]] = made.boxes
    folder.mkdir(parents=True, exist_ok=True)
    path, part = folder / f"crops_{seed:06d}.npz", folder / f"crops_{seed:06d}.part"
    with part.open("wb") as file:
        np.savez(file, images=images, boxes=boxes, n=n, about=about)
    part.replace(path)
    log.info("%s: %d crops, %d vehicles", path, count, int(n.sum()))
    return path


def _catalogue(rng: np.random.Generator) -> tuple[ObjectKind, ...]:
    return random_catalogue(rng, heavy=HEAVY_KINDS, urban=URBAN_KINDS)


def _random_view(ground: TrainingGround, rng: np.random.Generator, side: int) -> CameraView:
    """A camera whose image shows 2.5 m at 6 to 44 px per SIDE, 60 in low flights; one in four looks straight down."""
    kind = int(rng.choice(5, p=[0.26, 0.16, 0.2, 0.16, 0.22]))
    # nearby vehicles of low flights are far larger than the middle one
    most = 60.0 if kind == LOW_FLIGHT else 44.0
    gsd = 2.5 / float(np.clip(np.exp(rng.normal(np.log(0.45 * most), 0.5)), 6.0, most)) * SIDE / side
    ranges = ((0.0, 0.0), (0.0, 0.5), (0.5, 1.08), (1.08, 1.34), (0.9, 1.45))
    tilt = rng.uniform(*ranges[kind]) if kind else abs(rng.normal(0.0, 0.1))
    # the last kind are low flights that see vehicles from the side
    height = float(np.exp(rng.uniform(*np.log((4.0, 30.0) if kind == LOW_FLIGHT else (15.0, 250.0)))))
    pitch, yaw = float(tilt) - np.pi / 2.0, float(rng.uniform(0.0, 2.0 * np.pi))
    distance = height / np.sin(-pitch)
    focal = distance / gsd
    forward = np.array([np.cos(pitch) * np.sin(yaw), np.cos(pitch) * np.cos(yaw), np.sin(pitch)])
    right = np.array([np.cos(yaw), -np.sin(yaw), 0.0])
    # the crop is a part of a wider image: its principal point lies off the crop by up to a frame
    cx, cy = 0.5 * side + rng.uniform(-1.0, 1.0, 2) * np.array([1.0, 0.6]) * 0.35 * focal
    aim = (0.5 * side - cx) / focal * right + (0.5 * side - cy) / focal * np.cross(forward, right) + forward
    p_enu = _aim_point(ground, gsd * side, rng) - aim * (height / max(-aim[2], 0.3))
    p_enu[2] = height
    return CameraView(
        width=side,
        height=side,
        fx=focal,
        fy=focal,
        cx=cx,
        cy=cy,
        distortion=np.zeros(5),
        R_enu_cam=np.column_stack([right, np.cross(forward, right), forward]),
        p_enu=p_enu,
    )


def _aim_point(ground: TrainingGround, reach_m: float, rng: np.random.Generator) -> FloatArray:
    """A place on the ground, near a bay or a lane more often than not."""
    if len(ground.slots.x) and rng.random() < 0.7:
        k = int(rng.integers(len(ground.slots.x)))
        x, y = np.array([ground.slots.x[k], ground.slots.y[k]]) + rng.uniform(-0.35, 0.35, 2) * reach_m
    else:
        x, y = rng.uniform(0.0, 1.0, 2) * ground.period_m
    return np.array([x, y, 0.0])


def _visible(view: CameraView, bodies: Bodies, step: int = 2) -> FloatArray:
    """(n,) share of each body's outline that neither the image's edge nor a nearer body hides."""
    rows, columns = view.height // step, view.width // step
    top = np.full((rows, columns), -1, np.int16)
    area = np.zeros(len(bodies.x))
    distance = np.linalg.norm(np.stack([bodies.x, bodies.y, 0.0 * bodies.x], axis=-1) - view.p_enu, axis=-1)
    for i in np.argsort(-distance, kind="stable"):
        outline = body_outline(view, bodies, int(i))
        if bodies.kind[i] == OCCLUDER or outline is None:
            continue
        shape = np.rint(outline / step * 16.0).astype(np.int32)
        area[i] = abs(cv2.contourArea(outline / step))
        cv2.fillConvexPoly(top, shape, int(i), cv2.LINE_8, 4)
    leaves = np.zeros((view.height, view.width, 3), np.uint8)
    for k in np.flatnonzero(bodies.kind == OCCLUDER):
        tree = Tree(**{f: float(getattr(bodies, f)[k]) for f in ("x", "y", "heading", "length", "width", "height")})
        draw_tree(leaves, view, tree, (255, 255, 255), np.array([0.0, 0.0, 1.0]), 1.0)
    top[leaves[step // 2 :: step, step // 2 :: step, 0][:rows, :columns] > 0] = -1
    seen = np.bincount(top[top >= 0].astype(np.int64), minlength=len(bodies.x))
    return np.asarray(np.minimum(seen / np.maximum(area, 1.0), 1.0))


def main() -> None:
    """Write shards; those that exist are left as they are."""
    write_missing(
        "Render training images for the oriented detector.",
        "crops",
        write_shard,
        out=Path(".train/pool"),
        shards=12,
        per_shard=250,
    )


if __name__ == "__main__":
    main()
