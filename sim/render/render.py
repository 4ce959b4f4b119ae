"""Video frames of a simulated scene: textured ground, shaded vehicles and persons with shadows, trees over them.

The ground is one warp of a painted texture; bodies are stacks of blocks drawn far to near; trees come last and hide
what is below them. Pixel coordinates are continuous: the image spans 0..width and 0..height, and the first pixel's
middle is at 0.5.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from sim.render.exposure import Exposure, expose
from sim.render.foliage import Tree, draw_tree, tree_shadow
from sim.render.ground import Ground, GroundStyle, GroundWindow
from sim.render.training_ground import TrainingGround
from sim.world.bodies import Block, Model, car, person, rover
from sim.world.view import OTHER_VEHICLE, PERSON, UGV, Bodies, CameraView, Scene, project, ray_ground

Image = NDArray[np.uint8]
FloatArray = NDArray[np.float64]

DEFAULT_MODELS: Mapping[int, Model] = {UGV: rover(), OTHER_VEHICLE: car(), PERSON: person()}
"""Shape of each kind of body where a style names no others."""
FACES = np.array([[4, 5, 6, 7], [3, 2, 6, 7], [0, 1, 5, 4], [0, 3, 7, 4], [1, 2, 6, 5]])
"""Corners of a block's top, front, rear, left and right."""
ROUND_FACES = np.array([[12, 15, 18, 21], *([j, (j + 1) % 12, 12 + (j + 1) % 12, 12 + j] for j in range(12))])
"""Round faces of a block with round corners: four corners of its top, then its twelve walls."""
ROUND_SIDES = np.array([0, 3, 2, 2, 2, 4, 4, 4, 1, 1, 1, 3, 3])
"""Side of each: top, front, rear, left or right."""
_UNIT_BOX = Model.of(Block(x=(-0.5, 0.5), y=(-0.5, 0.5), z=(0.0, 1.0)))
"""A block of length, width and height 1, scaled to a body's size."""
SHIFT = 4
"""Fraction bits of OpenCV's drawing coordinates."""
SKY = (214, 190, 168)
"""BGR above the horizon: a pale blue."""
FAR = 6.0
"""Number of heights of the camera beyond which the ground is drawn wherever it comes from."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Style:
    """Appearance: all that does not depend on where bodies are."""

    sun_azimuth: float = 2.4
    """Direction to the sun, radians clockwise from north."""
    sun_elevation: float = 0.85
    """Radians above the horizon."""
    shadow: float = 0.5
    """Light lost in the shadow, 0 to 1."""
    ambient: float = 0.6
    """Light on faces turned away from the sun, 0 to 1."""
    penumbra_m: float = 0.0
    """Width of the edge of a shadow, metres; zero = a pixel or so."""
    contact: float = 0.0
    """Light lost close round a body, sun or no sun, 0 to 1."""
    in_shadow: float = 1.0
    """Light on bodies in the shadow of a taller one, 0 to 1."""
    leaf: tuple[int, int, int] | None = (48, 92, 66)
    """Colour of trees, BGR; None = each tree has its body's."""
    ground: GroundStyle = field(default_factory=GroundStyle)
    """The ground."""
    exposure: Exposure = field(default_factory=Exposure)
    """The camera."""
    models: Mapping[int, Model] = field(default_factory=lambda: DEFAULT_MODELS)
    """Model of each kind of body; a kind without a model is a tree."""

    def sun(self) -> FloatArray:
        """(3,) unit vector towards the sun, ENU."""
        c = np.cos(self.sun_elevation)
        return np.array([c * np.sin(self.sun_azimuth), c * np.cos(self.sun_azimuth), np.sin(self.sun_elevation)])


class Renderer:
    """Draws frames of one scene; the same arguments give the same pixels."""

    def __init__(
        self, scene: Scene, style: Style | None = None, seed: int = 0, ground: Ground | TrainingGround | None = None
    ) -> None:
        self.style = style or Style()
        self.seed = seed
        self.ground = ground or Ground(scene, self.style.ground, np.random.default_rng([seed, 0]))

    def draw(self, view: CameraView, bodies: Bodies, index: int = 0, exposure: Exposure | None = None) -> Image:
        """One frame.

        Args:
            index: number of the frame; it seeds the sensor noise.
            exposure: in place of the style's own, when the camera's motion blurs this frame.

        Returns:
            (height, width, 3) BGR.
        """
        image = draw_ground(self.ground, view)
        draw_bodies(image, view, bodies, self.style)
        return expose(image, exposure or self.style.exposure, np.random.default_rng([self.seed, 1, index]))


def draw_ground(ground: Ground | TrainingGround, view: CameraView) -> Image:
    """The ground as the camera sees it, sky above the horizon: (height, width, 3)."""
    x, y, radius = _footprint(view)
    window: GroundWindow = ground.around(x, y, radius)
    level = window.level_for(_ground_gsd(view))
    texture, flags = window.levels[level], cv2.INTER_LINEAR
    # ground point (e, n, 1) → camera: Rᵀ [e_x e_y −c]
    C = view.R_enu_cam.T
    cam_ground = np.column_stack([C[:, 0], C[:, 1], -C @ view.p_enu])
    texture_from_cam = window.texture_from_enu(level) @ np.linalg.inv(cam_ground)
    if view.distortion.any():
        lens = (view.fx, view.fy, view.cx - 0.5, view.cy - 0.5, *(float(k) for k in view.distortion))
        rays = _undistorted(view.width, view.height, lens)
        maps = cv2.perspectiveTransform(rays, texture_from_cam).reshape(view.height, view.width, 2)
        # the stubs want a second map, which one of two channels makes needless
        image = cv2.remap(texture, maps, None, flags, borderMode=cv2.BORDER_WRAP)  # type: ignore[call-overload]
    else:
        K = np.array([[view.fx, 0.0, view.cx - 0.5], [0.0, view.fy, view.cy - 0.5], [0.0, 0.0, 1.0]])
        size = (view.width, view.height)
        image = cv2.warpPerspective(
            texture,
            texture_from_cam @ np.linalg.inv(K),
            size,
            flags=flags | cv2.WARP_INVERSE_MAP,
            borderMode=cv2.BORDER_WRAP,
        )
    _draw_sky(image, view, ground)
    return np.asarray(image, dtype=np.uint8)


def draw_bodies(image: Image, view: CameraView, bodies: Bodies, style: Style) -> None:
    """Draw shadows, then bodies far to near, then trees, into the image."""
    order = _far_to_near(view, bodies)
    trees = {i: _tree(bodies, i) for i in order if int(bodies.kind[i]) not in style.models}
    solid = [i for i in order if i not in trees]
    shapes = {i: _world_corners(bodies, i, style.models[int(bodies.kind[i])]) for i in solid}
    _draw_contact(image, view, list(shapes.values()), style)
    shade = _draw_shadows(image, view, [c.reshape(-1, 3) for c in shapes.values()], list(trees.values()), style)
    for i in solid:
        light = style.in_shadow if style.in_shadow < 1.0 and _shaded(shade, view, bodies, i, style) else 1.0
        _draw_solid(image, view, shapes[i], style.models[int(bodies.kind[i])], light * bodies.color[i], style, light)
    for i, tree in trees.items():
        leaf = style.leaf or (int(bodies.color[i, 0]), int(bodies.color[i, 1]), int(bodies.color[i, 2]))
        draw_tree(image, view, tree, leaf, style.sun(), style.ambient)


def _footprint(view: CameraView) -> tuple[float, float, float]:
    """Middle and half side, metres, of a square of ground that holds what is seen of it, as far as FAR heights away."""
    u, v = np.meshgrid(np.linspace(0.0, view.width, 5), np.linspace(0.0, view.height, 5))
    at = ray_ground(view, np.stack([u, v], axis=-1)).reshape(-1, 3)[:, :2]
    at = at[np.isfinite(at).all(axis=1)]
    if not len(at):
        return float(view.p_enu[0]), float(view.p_enu[1]), 1.0
    offset = at - view.p_enu[:2]
    reach = np.linalg.norm(offset, axis=1, keepdims=True)
    at = view.p_enu[:2] + offset * np.minimum(1.0, FAR * view.p_enu[2] / np.maximum(reach, 1e-9))
    low, high = at.min(axis=0), at.max(axis=0)
    x, y = 0.5 * (low + high)
    return float(x), float(y), float(0.5 * (high - low).max())


def _ground_gsd(view: CameraView) -> float:
    """Metres per pixel at the ground below the middle of the image's lower half."""
    at = ray_ground(view, [view.cx, 0.5 * (view.cy + view.height)])
    distance = np.linalg.norm(at - view.p_enu) if np.isfinite(at).all() else view.p_enu[2]
    return float(distance / abs(view.fx))


@lru_cache(maxsize=2)
def _undistorted(width: int, height: int, lens: tuple[float, ...], step: int = 16) -> NDArray[np.float32]:
    """(height · width, 1, 2) normalised undistorted image points, solved on a coarse grid and filled in between."""
    fx, fy, cx, cy = lens[:4]
    u = np.arange(-step, width + 2 * step, step, dtype=np.float64)
    v = np.arange(-step, height + 2 * step, step, dtype=np.float64)
    points = np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 1, 2)
    camera = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
    xy = cv2.undistortPoints(points, camera, np.array(lens[4:])).reshape(len(v), len(u), 2).astype(np.float32)
    column, row = (np.arange(n, dtype=np.float32) / step + 1.0 for n in (width, height))
    at = np.meshgrid(column, row)
    return np.asarray(cv2.remap(xy, at[0], at[1], cv2.INTER_LINEAR), dtype=np.float32).reshape(-1, 1, 2)


def _draw_sky(image: Image, view: CameraView, ground: Ground | TrainingGround) -> None:
    """Cover what lies above, or too near below, the horizon."""
    v, u = np.mgrid[-1 : view.height + 8 : 8, -1 : view.width + 8 : 8].astype(np.float64)
    rays = np.stack([(u - view.cx) / view.fx, (v - view.cy) / view.fy, np.ones_like(u)], axis=-1)
    down = -(rays @ view.R_enu_cam[2]) / np.linalg.norm(rays, axis=-1)
    if down.min() > 0.02:
        return
    fine = cv2.resize(down.astype(np.float32), None, fx=8, fy=8, interpolation=cv2.INTER_LINEAR)
    fine = fine[5 : 5 + view.height, 5 : 5 + view.width]
    image[fine <= 0.02] = ground.mean.astype(np.uint8)
    image[fine <= 0.0] = SKY


def _far_to_near(view: CameraView, bodies: Bodies) -> list[int]:
    base = np.stack([bodies.x, bodies.y, np.zeros(len(bodies.x))], axis=-1)
    distance = np.linalg.norm(base - view.p_enu, axis=-1)
    reach = np.hypot(bodies.length, bodies.width) + bodies.height
    p_cam = (base - view.p_enu) @ view.R_enu_cam
    ahead = np.maximum(p_cam[:, 2], 0.1)
    # from the optical axis to the image's middle, half its diagonal, and the body's reach with its shadow
    aside = np.hypot((0.5 * view.width - view.cx) / view.fx, (0.5 * view.height - view.cy) / view.fy)
    field_m = (aside + 0.7 * np.hypot(view.width / view.fx, view.height / view.fy)) * ahead + 4.0 * reach
    seen = (p_cam[:, 2] > 0.5 * reach) & (np.hypot(p_cam[:, 0], p_cam[:, 1]) < field_m)
    return [int(i) for i in np.argsort(-distance, kind="stable") if seen[i]]


def _tree(bodies: Bodies, i: int) -> Tree:
    return Tree(
        x=float(bodies.x[i]),
        y=float(bodies.y[i]),
        heading=float(bodies.heading[i]),
        length=float(bodies.length[i]),
        width=float(bodies.width[i]),
        height=float(bodies.height[i]),
    )


def body_outline(view: CameraView, bodies: Bodies, i: int, model: Model | None = None) -> NDArray[np.float32] | None:
    """(p, 2) convex outline of a body in the image, that of its box without a model; None where it is not imaged."""
    uv, ok = project(view, _world_corners(bodies, i, model or _UNIT_BOX).reshape(-1, 3))
    return np.asarray(cv2.convexHull(uv.astype(np.float32)).reshape(-1, 2), np.float32) if ok.all() else None


def _world_corners(bodies: Bodies, i: int, model: Model) -> FloatArray:
    """(b, 2 k, 3) ENU corners of a body's blocks."""
    h = bodies.heading[i]
    forward, right = np.array([np.sin(h), np.cos(h), 0.0]), np.array([np.cos(h), -np.sin(h), 0.0])
    axes = np.stack([forward * bodies.length[i], right * bodies.width[i], np.array([0.0, 0.0, bodies.height[i]])])
    return np.asarray(model.corners @ axes + np.array([bodies.x[i], bodies.y[i], 0.0]), dtype=np.float64)


def _draw_shadows(image: Image, view: CameraView, solids: list[FloatArray], trees: list[Tree], style: Style) -> Image:
    """Darken the ground where the sun does not reach; returns where, (H, W) 0 to 255."""
    done = np.zeros(image.shape[:2], np.uint8)
    if style.shadow <= 0.0:
        return done
    sun = style.sun()
    for points in solids:
        # along the light to the ground: p − (p_z / s_z) s
        _fill_outline(done, view, points - points[:, 2:] / sun[2] * sun)
    for tree in trees:
        tree_shadow(done, view, tree, sun)
    _darken(image, done, style.shadow, max(round(style.penumbra_m / _ground_gsd(view)), 3))
    return done


def _draw_contact(image: Image, view: CameraView, solids: list[FloatArray], style: Style) -> None:
    """Darken the ground under and close round bodies, where they hide much of the sky."""
    if style.contact <= 0.0:
        return
    done = np.zeros(image.shape[:2], np.uint8)
    for corners in solids:
        foot = corners.reshape(-1, 3) * (1.0, 1.0, 0.0)
        middle = foot.mean(axis=0)
        _fill_outline(done, view, middle + 1.08 * (foot - middle))
    _darken(image, done, style.contact, max(round(0.7 / _ground_gsd(view)), 3))


def _fill_outline(mask: Image, view: CameraView, points: FloatArray) -> None:
    uv, ok = project(view, points)
    if ok.all():
        hull = np.asarray(cv2.convexHull(uv.astype(np.float32)), np.float32).reshape(-1, 2)
        cv2.fillConvexPoly(mask, _fixed(hull), 255, cv2.LINE_AA, SHIFT)


def _darken(image: Image, mask: Image, strength: float, blur_px: int) -> None:
    left, top, width, height = cv2.boundingRect(mask)
    if width:
        room = blur_px - 3
        part = slice(max(top - room, 0), top + height + room), slice(max(left - room, 0), left + width + room)
        light = 255 - cv2.blur(mask[part], (blur_px, blur_px)) * strength
        image[part] = cv2.multiply(image[part], cv2.merge([light.astype(np.uint8)] * 3), scale=1.0 / 255.0)


def _shaded(shade: Image, view: CameraView, bodies: Bodies, i: int, style: Style) -> bool:
    """Tell whether the ground to the sun's side of a body, just beyond it, lies in shadow."""
    sun = style.sun()[:2] / max(float(np.linalg.norm(style.sun()[:2])), 1e-9)
    reach = 0.6 * float(np.hypot(bodies.length[i], bodies.width[i]))
    uv, ok = project(view, [bodies.x[i] + reach * sun[0], bodies.y[i] + reach * sun[1], 0.0])
    u, v = np.floor(np.where(ok, uv, -1.0)).astype(int)
    return bool(0 <= v < shade.shape[0] and 0 <= u < shade.shape[1] and shade[v, u] > 127)


def _draw_solid(
    image: Image,
    view: CameraView,
    corners: FloatArray,
    model: Model,
    color: NDArray[np.floating],
    style: Style,
    light: float,
) -> None:
    uv, ok = project(view, corners)
    if not ok.all():
        return
    ring = corners.shape[1] // 2
    table, sides = (FACES, np.arange(5)) if ring == 4 else (ROUND_FACES, ROUND_SIDES)
    faces = corners[:, table]  # (b, f, 4, 3)
    middle = faces.mean(axis=2)
    normal = np.cross(faces[:, :, 2] - faces[:, :, 0], faces[:, :, 3] - faces[:, :, 1])
    outward = np.sum(normal * (middle - corners.mean(axis=1)[:, None]), axis=-1, keepdims=True)
    normal *= np.sign(outward) / np.maximum(np.linalg.norm(normal, axis=-1, keepdims=True), 1e-12)
    visible = np.sum(normal * (view.p_enu - middle), axis=-1) > 0.0
    # light = ambient + (1 − ambient) max(n·s, 0), brought to 1 for level faces in full sun
    lit = style.ambient + (1.0 - style.ambient) * np.maximum(normal @ style.sun(), 0.0)
    lit /= style.ambient + (1.0 - style.ambient) * max(float(style.sun()[2]), 0.3)
    paint = np.where(model.colors < 0.0, -model.colors * color, light * model.colors)[:, sides]
    shaded = np.clip(paint * lit[..., None], 0, 255)
    walls, tops = _fixed(uv[:, table]), _fixed(uv[:, ring:])
    distance = np.linalg.norm(corners.mean(axis=1) - view.p_enu, axis=-1)
    for b in np.lexsort((-distance, model.layers)):
        for f in np.flatnonzero(visible[b])[::-1]:
            cv2.fillConvexPoly(image, walls[b, f] if f else tops[b], shaded[b, f].tolist(), cv2.LINE_AA, SHIFT)


def _fixed(uv: NDArray[np.floating]) -> NDArray[np.int32]:
    """OpenCV's drawing coordinates, which count from the middle of the first pixel."""
    return np.ascontiguousarray(np.rint(np.clip(uv - 0.5, -1e5, 1e5) * (1 << SHIFT)), dtype=np.int32)
