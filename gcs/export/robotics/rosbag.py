"""The recording as a ROS 2 bag: detections with names, fixes of all vehicles, events, the film's pictures.

    /camera/detections                  vision_msgs/Detection2DArray     boxes of each frame, id: the track
    /camera/image/compressed            sensor_msgs/CompressedImage      JPEG
    /vehicles/system_ID/fix             sensor_msgs/NavSatFix            where each vehicle and the UAV reports to be
    /events                             rcl_interfaces/Log

A stranger's detection has no hypothesis. The pose of a hypothesis is where the box is on the ground, metres east, north
and up of the session's origin, NaN unknown. Altitudes are above sea level, as the vehicles report them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Final, cast

import cv2
import numpy as np
from rosbags.interfaces import Connection
from rosbags.rosbag2 import Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from gcs.export.job import ExportJob
from gcs.export.unfinished import Unfinished
from gcs.report.vehicle_names import text_with_sender
from gcs.snapshot import Box, Snapshot, VehicleRow
from infra.plain_text import plain
from vision.video.video import Frame, VideoFile

LEVELS: Final = {"info": 20, "warning": 30, "alarm": 40}
JPEG_QUALITY: Final = 90
LAST_US: Final = 1_000_000 * (2**31 - 1)
"""ROS counts seconds in 32 bits."""
UNKNOWN, APPROXIMATED = 0, 1
"""Values of ``position_covariance_type``."""
_VISION: Final = {
    "Point2D": "float64 x\nfloat64 y\n",
    "Pose2D": "vision_msgs/Point2D position\nfloat64 theta\n",
    "BoundingBox2D": "vision_msgs/Pose2D center\nfloat64 size_x\nfloat64 size_y\n",
    "ObjectHypothesis": "string class_id\nfloat64 score\n",
    "ObjectHypothesisWithPose": "vision_msgs/ObjectHypothesis hypothesis\ngeometry_msgs/PoseWithCovariance pose\n",
    "Detection2D": (
        "std_msgs/Header header\nvision_msgs/ObjectHypothesisWithPose[] results\n"
        "vision_msgs/BoundingBox2D bbox\nstring id\n"
    ),
    "Detection2DArray": "std_msgs/Header header\nvision_msgs/Detection2D[] detections\n",
}
"""Definitions of https://github.com/ros-perception/vision_msgs, branch ros2."""


def typestore() -> Typestore:
    """Return the store of message types by name."""
    store = get_typestore(Stores.ROS2_HUMBLE)
    for name, text in _VISION.items():
        store.register(get_types_from_msg(text, f"vision_msgs/msg/{name}"))
    return store


class RosbagExport:
    """Export to a ROS 2 bag: a folder with a database and its description, as ``ros2 bag`` and rosbags read it."""

    def __init__(self, job: ExportJob) -> None:
        self._unfinished = Unfinished(job.path, "recording")
        self._store = typestore()
        self._bag = Writer(self._unfinished.path, version=8)
        self._bag.set_custom_data("recording", plain(job.name))
        self._bag.open()
        self._topics: dict[str, Connection] = {}
        self._film = VideoFile.open(job.video) if job.video is not None else None
        self._pictures: Iterator[Frame] = self._film.frames() if self._film else iter(())
        self._picture: Frame | None = None

    def write(self, snapshot: Snapshot) -> None:
        """Append one frame."""
        t_us = snapshot.t_us
        if not snapshot.held:
            found = [self._detection(snapshot, box) for box in snapshot.new_boxes if not box.coasting]
            self._put(
                "/camera/detections",
                t_us,
                self._new("vision_msgs/msg/Detection2DArray", header=self._header(t_us, "camera"), detections=found),
            )
        self._show(snapshot)
        for row in snapshot.vehicles:
            if snapshot.origin is not None and np.isfinite(row.p_enu).all():
                self._put(f"/vehicles/system_{row.system_id}/fix", t_us, self._fix(snapshot, row))
        for event in snapshot.events:
            message = self._new(
                "rcl_interfaces/msg/Log",
                stamp=self._time(event.t_us),
                level=LEVELS[event.level],
                name=event.kind,
                msg=plain(text_with_sender(event, snapshot.name_of)),
                file="",
                function="",
                line=0,
            )
            self._put("/events", t_us, message)

    def close(self) -> None:
        """Finish the bag and put it into its place."""
        self._bag.close()
        if self._film is not None:
            self._film.close()
        self._unfinished.finish()

    def _show(self, snapshot: Snapshot) -> None:
        """Write the picture of the frame, if there is one."""
        while self._picture is None or self._picture.index < snapshot.frame:
            self._picture = next(self._pictures, None)
            if self._picture is None:
                return
        if self._picture.index == snapshot.frame:
            coded = cv2.imencode(".jpg", self._picture.image, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])[1]
            header = self._header(snapshot.t_us, "camera")
            data = np.asarray(coded, dtype=np.uint8).reshape(-1)
            image = self._new("sensor_msgs/msg/CompressedImage", header=header, format="jpeg", data=data)
            self._put("/camera/image/compressed", snapshot.t_us, image)

    def _detection(self, snapshot: Snapshot, box: Box) -> object:
        named = []
        if box.system_id:
            pose = self._new(
                "geometry_msgs/msg/PoseWithCovariance",
                pose=self._new(
                    "geometry_msgs/msg/Pose",
                    position=self._new(
                        "geometry_msgs/msg/Point", **dict(zip("xyz", map(float, box.p_enu), strict=True))
                    ),
                    orientation=self._new("geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=0.0, w=1.0),
                ),
                covariance=_covariance(box.place_std_m, 6),
            )
            who = self._new(
                "vision_msgs/msg/ObjectHypothesis",
                class_id=plain(snapshot.name_of(box.system_id)),
                score=float(box.confidence),
            )
            named.append(self._new("vision_msgs/msg/ObjectHypothesisWithPose", hypothesis=who, pose=pose))
        centre = self._new(
            "vision_msgs/msg/Pose2D",
            position=self._new("vision_msgs/msg/Point2D", x=float(box.cx), y=float(box.cy)),
            theta=float(box.angle),
        )
        outline = self._new("vision_msgs/msg/BoundingBox2D", center=centre, size_x=float(box.w), size_y=float(box.h))
        return self._new(
            "vision_msgs/msg/Detection2D",
            header=self._header(snapshot.t_us, "camera"),
            results=named,
            bbox=outline,
            id=str(box.track_id) if box.track_id else "",
        )

    def _fix(self, snapshot: Snapshot, row: VehicleRow) -> object:
        assert snapshot.origin is not None
        lat, lon, alt = (float(value) for value in snapshot.origin.to_geodetic(row.p_enu))
        return self._new(
            "sensor_msgs/msg/NavSatFix",
            header=self._header(snapshot.t_us, f"system_{row.system_id}"),
            status=self._new("sensor_msgs/msg/NavSatStatus", status=0, service=1),
            latitude=lat,
            longitude=lon,
            altitude=alt,
            position_covariance=_covariance(row.std_m, 3),
            position_covariance_type=APPROXIMATED if math.isfinite(row.std_m) else UNKNOWN,
        )

    def _put(self, topic: str, t_us: int, message: object) -> None:
        kind = str(getattr(message, "__msgtype__", ""))
        if topic not in self._topics:
            self._topics[topic] = self._bag.add_connection(topic, kind, typestore=self._store)
        self._bag.write(self._topics[topic], 1000 * t_us, self._store.serialize_cdr(message, kind))

    def _new(self, kind: str, **fields: object) -> object:
        made = cast(Callable[..., object], self._store.types[kind])
        return made(**fields)

    def _header(self, t_us: int, frame: str) -> object:
        return self._new("std_msgs/msg/Header", stamp=self._time(t_us), frame_id=frame)

    def _time(self, t_us: int) -> object:
        seconds, microseconds = divmod(min(max(t_us, 0), LAST_US), 1_000_000)
        return self._new("builtin_interfaces/msg/Time", sec=seconds, nanosec=1000 * microseconds)


def _covariance(std_m: float, n: int) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """(n²,) of a place whose 1σ is the same along each axis; 0 where that is unknown."""
    places = np.zeros((n, n))
    if math.isfinite(std_m):
        places[:3, :3] = np.eye(3) * std_m**2
    return places.reshape(-1)
