"""Views of one frame that Foxglove draws: boxes on the picture, vehicles in space, fixes on the map. Pure.

Colours are those of the film that ``gcs export -o film.mp4`` makes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np
from foxglove.messages import (
    Color,
    CubePrimitive,
    Duration,
    ImageAnnotations,
    KeyValuePair,
    LocationFix,
    LocationFixPositionCovarianceType,
    Point2,
    PointsAnnotation,
    PointsAnnotationType,
    Pose,
    Quaternion,
    SceneEntity,
    SceneEntityDeletion,
    SceneEntityDeletionType,
    SceneUpdate,
    TextAnnotation,
    TextPrimitive,
    Timestamp,
    Vector3,
)

from gcs.report.box_shapes import box_bounds, box_corners, drawable
from gcs.report.overlay import DARK, STANDING_RGB, label_of, rgb_of
from gcs.snapshot import Box, Snapshot, VehicleRow
from infra.plain_text import plain

USUAL_M: Final = (2.0, 1.2)
"""Length and width of a vehicle of which the picture does not tell them."""
HEIGHT_M: Final = 1.0


def annotations_of(snapshot: Snapshot, boxes: Sequence[Box]) -> ImageAnnotations:
    """Outlines and names."""
    stamp = stamp_of(snapshot.t_us)
    outlines, names = [], []
    for box in filter(drawable, boxes):
        colour = _colour(rgb_of(snapshot, box))
        corners = [Point2(x=x, y=y) for x, y in box_corners(box).tolist()]
        outlines.append(
            PointsAnnotation(
                timestamp=stamp,
                type=PointsAnnotationType.LineLoop,
                points=corners,
                outline_color=colour,
                thickness=3.0,
            )
        )
        left, top, _, _ = box_bounds(box)
        names.append(
            TextAnnotation(
                timestamp=stamp,
                position=Point2(x=left, y=top),
                text=plain(label_of(snapshot, box)),
                font_size=max(14.0, snapshot.height / 45),
                text_color=colour,
                background_color=_colour(DARK, 0.75),
            )
        )
    return ImageAnnotations(timestamp=stamp, points=outlines, texts=names)


def scene_of(snapshot: Snapshot, boxes: Sequence[Box], before: frozenset[str]) -> tuple[SceneUpdate, frozenset[str]]:
    """Vehicles where they stand, in metres about the snapshot's origin.

    Args:
        before: ids of what was in the scene: what is no longer seen is taken away.

    Returns:
        The update, and the ids of what is in the scene now.
    """
    stamp = stamp_of(snapshot.t_us)
    entities = {_id(box): _entity(snapshot, box, stamp) for box in boxes if np.isfinite(box.p_enu).all() and _id(box)}
    gone = [
        SceneEntityDeletion(timestamp=stamp, type=SceneEntityDeletionType.MatchingId, id=one)
        for one in sorted(before - set(entities))
    ]
    return SceneUpdate(deletions=gone, entities=list(entities.values())), frozenset(entities)


def fix_of(snapshot: Snapshot, row: VehicleRow) -> LocationFix | None:
    """Reported position of a vehicle; None unknown."""
    if snapshot.origin is None or not np.isfinite(row.p_enu).all():
        return None
    lat, lon, alt = (float(value) for value in snapshot.origin.to_geodetic(row.p_enu))
    known = math.isfinite(row.std_m)
    kinds = LocationFixPositionCovarianceType
    return LocationFix(
        timestamp=stamp_of(snapshot.t_us),
        frame_id=f"vehicle-{row.system_id}",
        latitude=lat,
        longitude=lon,
        altitude=alt,
        # the height's error is not known: as large as the level ones
        position_covariance=(np.eye(3).ravel() * row.std_m**2).tolist() if known else None,
        position_covariance_type=kinds.Approximated if known else kinds.Unknown,
        heading=row.heading if math.isfinite(row.heading) else None,
        color=_colour(STANDING_RGB[row.standing]),
        metadata=[KeyValuePair(key="name", value=plain(row.name)), KeyValuePair(key="role", value=row.role)],
    )


def _id(box: Box) -> str:
    """Return an id that a vehicle has all through a flight; empty for what no track took."""
    if box.system_id:
        return f"vehicle-{box.system_id}"
    return f"track-{box.known_as}" if box.track_id else ""


def _entity(snapshot: Snapshot, box: Box, stamp: Timestamp) -> SceneEntity:
    east, north, up = box.p_enu.tolist()
    length, width = _size_m(snapshot, box)
    row = next((row for row in snapshot.vehicles if box.system_id and row.system_id == box.system_id), None)
    # ENU yaw counts from east, anticlockwise
    yaw = math.pi / 2 - row.heading if row is not None and math.isfinite(row.heading) else 0.0
    turned = Quaternion(x=0.0, y=0.0, z=math.sin(yaw / 2), w=math.cos(yaw / 2))
    rgb = rgb_of(snapshot, box)
    metadata = [KeyValuePair(key="track_id", value=str(box.track_id))]
    if box.system_id:
        metadata += [
            KeyValuePair(key="name", value=plain(snapshot.name_of(box.system_id))),
            KeyValuePair(key="system_id", value=str(box.system_id)),
        ]
    if math.isfinite(box.confidence):
        metadata.append(KeyValuePair(key="confidence", value=f"{box.confidence:.4f}"))
    return SceneEntity(
        timestamp=stamp,
        frame_id="enu",
        id=_id(box),
        lifetime=Duration(0, 0),
        metadata=metadata,
        cubes=[
            CubePrimitive(
                pose=Pose(position=Vector3(x=east, y=north, z=up + HEIGHT_M / 2), orientation=turned),
                size=Vector3(x=length, y=width, z=HEIGHT_M),
                color=_colour(rgb, 0.8),
            )
        ],
        texts=[
            TextPrimitive(
                pose=Pose(
                    position=Vector3(x=east, y=north, z=up + 2 * HEIGHT_M), orientation=Quaternion(x=0, y=0, z=0, w=1)
                ),
                billboard=True,
                font_size=14.0,
                scale_invariant=True,
                color=_colour(rgb),
                text=plain(label_of(snapshot, box)),
            )
        ],
    )


def _size_m(snapshot: Snapshot, box: Box) -> tuple[float, float]:
    """Length and width by the box's sides and its distance; as usual where that is not known."""
    camera = snapshot.camera
    if camera is None or snapshot.pose != "known" or not snapshot.width or not np.isfinite(snapshot.uav_enu).all():
        return USUAL_M
    # s = w · d · 2 tan(hfov / 2) / width
    scale = np.linalg.norm(box.p_enu - snapshot.uav_enu) * 2.0 * math.tan(camera.hfov / 2) / snapshot.width
    sides = sorted((float(scale * box.w), float(scale * box.h)))
    return sides[1], sides[0]


def _colour(rgb: tuple[int, int, int], alpha: float = 1.0) -> Color:
    red, green, blue = (value / 255 for value in rgb)
    return Color(r=red, g=green, b=blue, a=alpha)


def stamp_of(t_us: int) -> Timestamp:
    """A time in Unix µs; none is before 1970."""
    seconds, microseconds = divmod(max(0, t_us), 1_000_000)
    return Timestamp(seconds, 1000 * microseconds)
