"""Projection and topology masses (``assoc.methods``) of a single frame, computed with the known camera pose."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from assoc.geometry.ground import angles_to_places
from assoc.methods.belief import fuse, masses
from assoc.methods.topology import topology_angles, topology_cost
from assoc.records import CameraState, Observation

FloatArray = NDArray[np.float64]


def frame_masses(
    observation: Observation, camera: CameraState, p: FloatArray, heading: FloatArray, theta: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Masses of one frame: of the projection errors E, of the topology costs C, and both fused.

    E is the distance in pixels (angle over pixel angle) between each box and each report reprojected through the
    corrected pose; C is the topology cost as published, about the image centre, meaningful only for a camera that looks
    about straight down.

    Args:
        observation: m tracks.
        camera: The camera.
        p: (n, 2) reports extrapolated to the frame, NaN never received.
        heading: (n,) reported headings, NaN unknown.
        theta: (9,) pose correction.

    Returns:
        Three (m, n) matrices; vehicles that never reported have mass 0.
    """
    shape = (len(observation.track_id), len(p))
    reported = np.flatnonzero(np.isfinite(p[:, 0]))
    results = tuple(np.zeros(shape) for _ in range(3))
    if not len(reported) or not shape[0]:
        return results[0], results[1], results[2]
    E = (
        angles_to_places(observation.ray_cam, p[reported], camera.R_enu_cam, camera.p_enu, camera.ground_z, theta)
        / camera.px_rad
    )
    C = _topology(observation, camera, p[reported], heading[reported])
    first, second = masses(np.nan_to_num(E, nan=1e9, posinf=1e9)), masses(C)
    for result, part in zip(results, (first, second, fuse(first, second)), strict=True):
        result[:, reported] = part
    return results[0], results[1], results[2]


def _topology(observation: Observation, camera: CameraState, p: FloatArray, heading: FloatArray) -> FloatArray:
    """(m, n) topology cost of the frame."""
    centre = _right_up(observation.ray_cam)
    front = _right_up(observation.front_cam) - centre
    image = topology_angles(centre, np.arctan2(front[:, 0], front[:, 1]))
    right = camera.R_enu_cam[:2, 0]
    # the image's right axis is level; up in the image is a quarter turn to its left
    up = float(np.arctan2(-right[1], right[0]))
    return topology_cost(image, topology_angles(p - camera.p_enu[:2], heading, up))


def _right_up(ray: FloatArray) -> FloatArray:
    """(m, 2) normalised image coordinates, v upwards."""
    depth = np.where(ray[:, 2:] > 1e-6, ray[:, 2:], np.nan)
    return np.asarray(ray[:, :2] / depth * np.array([1.0, -1.0]))
