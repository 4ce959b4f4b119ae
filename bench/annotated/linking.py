"""Labelled pictures taken one after the other: their labels linked into tracks, and pictures in between."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from vision.detect.boxes import corners
from vision.detect.detections import Detections
from vision.evaluation import LabelledImage
from vision.motion.estimator import MotionEstimator

__all__ = ["LinkedPicture", "fill_in", "link"]

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
Image = NDArray[np.uint8]

REACH = 1.6
"""Of a vehicle's longer side: how far it may be from where it is expected."""
FIRST_REACH = 3.0
"""The same of one whose speed is not known yet."""
GROUND_PICTURES = 5
"""So many pictures before and after one show the ground below its vehicles: most have driven on by then."""
CUT_OUT = 1.25
"""A vehicle is cut out with its shadow: its box so much larger."""
SOFT_PX = 1.5
"""Over which a cut-out's edge fades."""
EDGE_PX = 6
"""Round a cut-out: what fades, and a pixel for the shift."""
STANDS_PX = 1.5
"""A vehicle that moved less from one picture to the next is left where it is."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LinkedPicture:
    """One picture with n labels."""

    image: Image
    """(H, W, 3) BGR."""
    boxes: FloatArray
    """(n, 5) cx, cy, w, h, angle."""
    track: IntArray
    """(n,) the same number in all pictures that show the same vehicle."""
    kind: tuple[str, ...]
    H: FloatArray
    """(3, 3) from the picture before, by the ground; the identity where the pixels do not tell."""

    def rows(self, frame: int) -> list[str]:
        """The labels as rows of a CSV with corners."""
        named = zip(self.track.tolist(), corners(self.boxes), self.kind, strict=True)
        return [
            f"{frame},{track},{','.join(f'{x:.2f}' for x in points.ravel())},{kind}" for track, points, kind in named
        ]


def link(images: Sequence[LabelledImage]) -> list[LinkedPicture]:
    """Link labels from picture to picture, nearest first, where the ground and a vehicle's speed would have it."""
    estimator, pictures = MotionEstimator(), list[LinkedPicture]()
    places, speeds, ids = np.empty((0, 2)), np.empty((0, 2)), np.empty(0, np.int64)
    next_id = 0
    for labelled in images:
        whole = np.asarray(labelled.read())
        # video has whole blocks of two by two pixels
        image = np.ascontiguousarray(whole[: whole.shape[0] // 2 * 2, : whole.shape[1] // 2 * 2])
        boxes, fill = labelled.truth.boxes, np.ones(len(labelled.truth.boxes))
        sides = dict(zip(("cx", "cy", "w", "h", "angle"), boxes.T, strict=True))
        motion = estimator.update(image, Detections(**sides, score=fill, heading=np.nan * fill))
        H = np.eye(3) if motion is None else motion.H
        carried, known = mapped(H, places), np.isfinite(speeds.sum(axis=1))
        expected = carried + np.where(known[:, None], speeds, 0.0)
        distance = np.linalg.norm(expected[:, None] - boxes[:, :2], axis=2)
        reach = boxes[:, 2:4].max(axis=1) * np.where(known, REACH, FIRST_REACH)[:, None]
        a, b = linear_sum_assignment(np.where(distance < reach, distance, 1e6))
        a, b = a[distance[a, b] < reach[a, b]], b[distance[a, b] < reach[a, b]]
        track, speed = np.full(len(boxes), -1, np.int64), np.full((len(boxes), 2), np.nan)
        track[b], speed[b] = ids[a], boxes[b, :2] - carried[a]
        fresh = np.flatnonzero(track < 0)
        track[fresh] = next_id + np.arange(len(fresh))
        next_id += len(fresh)
        places, speeds, ids = boxes[:, :2], speed, track
        kind = tuple(labelled.truth.name.tolist())
        pictures.append(LinkedPicture(image=image, boxes=boxes, track=track, kind=kind, H=H))
    return pictures


def fill_in(pictures: Sequence[LinkedPicture], steps: int) -> list[LinkedPicture]:
    """Pictures in between, so that vehicles move as at a video's rate: every pixel of them is one of the pictures'.

    Vehicles that move are cut out of a picture and put down further on; below them appears the ground that the pictures
    before and after show there. The camera moves evenly from one picture to the next.

    Args:
        pictures: linked.
        steps: pictures for each one but the last.
    """
    filled: list[LinkedPicture] = []
    before = np.eye(3)
    for index, (picture, following) in enumerate(pairwise(pictures)):
        ground = _ground(pictures, index)
        back = mapped(np.asarray(np.linalg.inv(following.H)), following.boxes[:, :2])
        ahead = {track: place for track, place in zip(following.track.tolist(), back, strict=True)}
        shift = np.array(
            [ahead.get(k, box[:2]) - box[:2] for k, box in zip(picture.track.tolist(), picture.boxes, strict=True)]
        )
        shift = shift.reshape(-1, 2)
        moving = np.flatnonzero(np.linalg.norm(shift, axis=1) > STANDS_PX)
        height, width = picture.image.shape[:2]
        for step in range(steps):
            part = step / steps
            # the way of the camera so far: 1 + w (H − 1)
            G = np.eye(3) + part * (following.H / following.H[2, 2] - np.eye(3))
            image = _driven(picture, ground, moving, part * shift) if step else picture.image
            image = np.asarray(cv2.warpPerspective(image, G, (width, height), borderMode=cv2.BORDER_REFLECT), np.uint8)
            boxes = picture.boxes.copy()
            boxes[:, :2] = mapped(G, boxes[:, :2] + part * shift)
            H = G @ np.linalg.inv(before)
            filled.append(LinkedPicture(image=image, boxes=boxes, track=picture.track, kind=picture.kind, H=H))
            before = G
        before = before @ np.linalg.inv(following.H)
    return [*filled, pictures[-1]]


def _driven(picture: LinkedPicture, ground: Image, moving: IntArray, shift: FloatArray) -> Image:
    """The picture with its moving vehicles (k,) shifted by (n, 2) px."""
    size = np.array(picture.image.shape[1::-1])
    image, driven = picture.image.astype(np.float32), picture.image.astype(np.float32)
    outlines = corners(picture.boxes * (1.0, 1.0, CUT_OUT, CUT_OUT, 1.0))
    places = []
    for k in moving.tolist():
        first = np.clip(np.floor(outlines[k].min(axis=0)) - EDGE_PX, 0, size).astype(int)
        last = np.clip(np.ceil(outlines[k].max(axis=0)) + EDGE_PX, 0, size).astype(int)
        mask = np.zeros((last - first)[::-1], np.float32)
        cv2.fillConvexPoly(mask, np.rint(outlines[k] - first).astype(np.int32), (1.0,))
        mask = np.asarray(cv2.GaussianBlur(mask, (0, 0), SOFT_PX), np.float32)[..., None]
        own = (slice(first[1], last[1]), slice(first[0], last[0]))
        driven[own] = driven[own] * (1.0 - mask) + ground[own] * mask
        places.append((first, own, mask))
    for k, (first, own, mask) in zip(moving.tolist(), places, strict=True):
        whole = np.floor(shift[k]).astype(int)
        M = np.column_stack([np.eye(2), shift[k] - whole])
        at, extent = first + whole, np.array(mask.shape[1::-1])
        low, high = np.maximum(-at, 0), np.minimum(size - at, extent)
        if (high <= low).any():
            continue  # out of the picture
        part = (slice(low[1], high[1]), slice(low[0], high[0]))
        cut, soft = (cv2.warpAffine(layer, M, extent.tolist()) for layer in (image[own], mask))
        there = (slice(at[1] + low[1], at[1] + high[1]), slice(at[0] + low[0], at[0] + high[0]))
        driven[there] = driven[there] * (1.0 - soft[part][..., None]) + cut[part] * soft[part][..., None]
    return np.asarray(np.clip(driven + 0.5, 0, 255), np.uint8)


def _ground(pictures: Sequence[LinkedPicture], index: int) -> Image:
    """The median of the pictures about one, laid onto it."""
    height, width = pictures[index].image.shape[:2]
    layers = [pictures[index].image]
    for way in (1, -1):
        G, at = np.eye(3), index
        for _ in range(GROUND_PICTURES):
            if not 0 <= at + way < len(pictures):
                break
            # from the next picture back to this one, or from the one before on
            G = G @ (np.linalg.inv(pictures[at + 1].H) if way > 0 else pictures[at].H)
            at += way
            layers.append(np.asarray(cv2.warpPerspective(pictures[at].image, G, (width, height)), np.uint8))
    return np.asarray(np.median(np.stack(layers), axis=0), np.uint8)


def mapped(H: FloatArray, points: FloatArray) -> FloatArray:
    """Points (n, 2) through a homography."""
    homogeneous = np.column_stack([points, np.ones(len(points))]) @ H.T
    return np.asarray(homogeneous[:, :2] / homogeneous[:, 2:])
