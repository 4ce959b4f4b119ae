"""Trees: a crown of leaf clumps on a trunk, in true perspective, and its shadow."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from sim.world.view import CameraView, project

Image = NDArray[np.uint8]
FloatArray = NDArray[np.float64]
SHIFT = 4
"""Fraction bits of OpenCV's drawing coordinates: 1/16 px."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Tree:
    """One occluder: a roof of leaves, length × width, its top at a height; metres and radians as in ``Bodies``."""

    x: float
    y: float
    heading: float
    length: float
    width: float
    height: float


def draw_tree(
    image: Image, view: CameraView, tree: Tree, leaf: tuple[int, int, int], sun: FloatArray, ambient: float
) -> None:
    """Draw a tree into the image, trunk first, low clumps before high ones."""
    clumps = _clumps(tree)
    uv, ok = project(view, clumps[:, :3])
    foot, foot_ok = project(view, [[tree.x, tree.y, 0.0], [tree.x, tree.y, 0.5 * tree.height]])
    if not (ok.all() and foot_ok.all()):
        return
    depth = (clumps[:, :3] - view.p_enu) @ view.R_enu_cam[:, 2]
    radius = clumps[:, 3] * abs(view.fx) / depth
    trunk = max(round(0.06 * float(np.hypot(tree.length, tree.width)) * abs(view.fx) / float(depth.mean())), 1)
    a, b = np.floor(foot).astype(int).tolist()
    cv2.line(image, a, b, (46, 60, 72), trunk, cv2.LINE_AA)
    middle = np.array([tree.x, tree.y, 0.75 * tree.height])
    outward = (clumps[:, :3] - middle) / max(0.4 * (tree.length + tree.width), 0.1)
    light = np.clip(ambient + 0.15 + (1.0 - ambient) * (outward @ sun) + clumps[:, 4], 0.3, 1.6)
    for k in np.argsort(clumps[:, 2], kind="stable"):
        color = np.clip(np.array(leaf) * light[k], 0, 255).tolist()
        cv2.circle(image, _fixed(uv[k]), max(round(radius[k] * (1 << SHIFT)), 8), color, -1, cv2.LINE_AA, SHIFT)


def tree_shadow(mask: Image, view: CameraView, tree: Tree, sun: FloatArray) -> None:
    """Draw a tree's shadow into the mask with 255."""
    clumps = _clumps(tree)
    on_ground = clumps[:, :3] - clumps[:, 2:3] / sun[2] * sun
    uv, ok = project(view, on_ground)
    depth = np.maximum((on_ground - view.p_enu) @ view.R_enu_cam[:, 2], 0.1)
    for k in np.flatnonzero(ok):
        radius = round(float(clumps[k, 3] * abs(view.fx) / depth[k]) * (1 << SHIFT))
        cv2.circle(mask, _fixed(uv[k]), max(radius, 8), 255, -1, cv2.LINE_8, SHIFT)


@lru_cache(maxsize=512)
def _clumps(tree: Tree) -> FloatArray:
    """(c, 5) east, north, up, radius, brightness offset over the whole crown; the same for the same tree."""
    rng = np.random.default_rng([int(abs(tree.x) * 100), int(abs(tree.y) * 100), int(tree.height * 100)])
    step = float(np.clip(0.13 * np.sqrt(tree.length * tree.width), 0.2, 0.9))
    a, b = (np.linspace(-1.0, 1.0, max(round(side / step), 3)) for side in (tree.length, tree.width))
    grid = np.stack(np.meshgrid(a, b), axis=-1).reshape(-1, 2)
    radius = step * rng.uniform(0.7, 1.05, len(grid))
    # clumps lie inside the crown's outline and stray by a quarter of their distance; rims hang lower than the middle
    inner = 0.5 * np.array([tree.length, tree.width]) - 0.85 * step
    offset = grid * inner + rng.uniform(-0.25, 0.25, grid.shape) * step
    rim = np.max(np.abs(grid), axis=1)
    up = tree.height * (1.0 - 0.15 * rim**2 - 0.08 * rng.uniform(0.0, 1.0, len(grid)))
    c, s = np.cos(tree.heading), np.sin(tree.heading)
    east, north = tree.x + offset[:, 0] * s + offset[:, 1] * c, tree.y + offset[:, 0] * c - offset[:, 1] * s
    return np.stack([east, north, up, radius, rng.normal(0.0, 0.12, len(grid))], axis=-1)


def _fixed(uv: FloatArray) -> list[int]:
    return [int(v) for v in np.rint(np.clip(uv - 0.5, -1e5, 1e5) * (1 << SHIFT))]
