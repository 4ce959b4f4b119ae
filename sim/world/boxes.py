"""True boxes in the image, and how much of each body is hidden."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim.world.view import OCCLUDER, Bodies, CameraView, project

FloatArray = NDArray[np.float64]

_CORNERS: FloatArray = np.array([(u, v, w) for w in (0.0, 1.0) for u in (-0.5, 0.5) for v in (-0.5, 0.5)])
"""Corners of a body of length, width and height 1."""
_ROOF: FloatArray = np.array([(u, v, 1.0) for u in (-0.4, -0.2, 0.0, 0.2, 0.4) for v in (-0.35, 0.0, 0.35)])
"""Points of its top, inside the edge, at which it is judged how much of it is seen."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Boxes:
    """n oriented boxes in pixels; NaN where a body is not before the camera."""

    cx: FloatArray
    cy: FloatArray
    w: FloatArray
    """(n,) along the body's length as it appears."""
    h: FloatArray
    angle: FloatArray
    """(n,) radians from image +x to the front, clockwise on screen."""


def true_boxes(view: CameraView, bodies: Bodies) -> Boxes:
    """The tightest box along each body's apparent axis that holds the whole body."""
    uv, front = project(view, _points(bodies, _CORNERS))
    axis_uv, axis_front = project(view, _points(bodies, np.array([[-0.5, 0.0, 0.5], [0.5, 0.0, 0.5]])))
    axis = axis_uv[:, 1] - axis_uv[:, 0]
    angle = np.arctan2(axis[:, 1], axis[:, 0])
    along = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    across = np.stack([-np.sin(angle), np.cos(angle)], axis=-1)
    a, b = np.einsum("nkc,nc->nk", uv, along), np.einsum("nkc,nc->nk", uv, across)
    middle = 0.5 * ((a.max(1) + a.min(1))[:, None] * along + (b.max(1) + b.min(1))[:, None] * across)
    bad = ~(front.all(axis=1) & axis_front.all(axis=1))
    values = np.stack([middle[:, 0], middle[:, 1], np.ptp(a, axis=1), np.ptp(b, axis=1), angle])
    values[:, bad] = np.nan
    return Boxes(cx=values[0], cy=values[1], w=values[2], h=values[3], angle=values[4])


def in_image(view: CameraView, boxes: Boxes) -> NDArray[np.bool_]:
    """(n,) True where the box's centre is in the image."""
    with np.errstate(invalid="ignore"):
        inside = (boxes.cx >= 0.0) & (boxes.cx < view.width) & (boxes.cy >= 0.0) & (boxes.cy < view.height)
    return np.asarray(inside)


def visible_share(view: CameraView, bodies: Bodies) -> FloatArray:
    """(n,) share of each body's roof that is in the image and not below an occluder; 1 for occluders themselves."""
    points = _points(bodies, _ROOF)
    uv, front = project(view, points)
    with np.errstate(invalid="ignore"):
        seen = front & (uv >= 0.0).all(axis=-1) & (uv < (view.width, view.height)).all(axis=-1)
    for k in np.flatnonzero(bodies.kind == OCCLUDER):
        seen &= ~_below(points, view.p_enu, bodies, int(k))
    share = seen.mean(axis=1)
    return np.asarray(np.where(bodies.kind == OCCLUDER, 1.0, share))


def _below(points: FloatArray, eye: FloatArray, bodies: Bodies, k: int) -> NDArray[np.bool_]:
    """Tell whether the line from each point to the eye passes through the top of occluder k."""
    top = bodies.height[k]
    rise = eye[2] - points[..., 2]
    part = (top - points[..., 2]) / np.where(rise == 0.0, np.inf, rise)
    crossing = points[..., :2] + (eye[:2] - points[..., :2]) * part[..., None] - (bodies.x[k], bodies.y[k])
    ahead = crossing @ (np.sin(bodies.heading[k]), np.cos(bodies.heading[k]))
    right = crossing @ (np.cos(bodies.heading[k]), -np.sin(bodies.heading[k]))
    inside = (np.abs(ahead) <= bodies.length[k] / 2.0) & (np.abs(right) <= bodies.width[k] / 2.0)
    return np.asarray(inside & (part > 0.0) & (part < 1.0))


def _points(bodies: Bodies, shape: FloatArray) -> FloatArray:
    """(n, k, 3) points given in shares of each body's length, width (rightwards) and height."""
    ahead = np.stack([np.sin(bodies.heading), np.cos(bodies.heading)], axis=-1)
    right = np.stack([np.cos(bodies.heading), -np.sin(bodies.heading)], axis=-1)
    u, v, w = (shape[:, i] for i in range(3))
    centre = np.stack([bodies.x, bodies.y], axis=-1)[:, None]
    xy = (
        centre
        + (bodies.length[:, None] * u)[..., None] * ahead[:, None]
        + (bodies.width[:, None] * v)[..., None] * right[:, None]
    )
    z = np.reshape(bodies.z, (-1, 1)) + bodies.height[:, None] * w
    return np.concatenate([xy, z[..., None]], axis=-1)
