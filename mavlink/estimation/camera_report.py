"""Reports of a UAV about its camera: field of view, image size, rotation and zoom.

The field of view, by order of preference:

    CAMERA_FOV_STATUS          the field of view now
    VIDEO_STREAM_INFORMATION   that of the stream, in whole degrees
    CAMERA_INFORMATION         2 atan(sensor size / 2 focal length)
    its vendor and model       that of a known camera, at the widest

The size of the image is the stream's, else the camera's; that of a decoded frame goes before both. Numbers that no
camera has are rejected, with the reason reported once.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from infra.reporting import ReportOnce
from mavlink.estimation.camera_models import camera_model
from mavlink.protocol.messages import CameraFov, CameraInformation, CameraSettings, VideoStreamInformation
from mavlink.state import CameraReport

NARROWEST, WIDEST = math.radians(0.5), math.radians(175.0)
"""Fields of view of cameras, rad."""
SIZES_PX = (16, 16384)
"""Smallest and greatest side of an image; anything else is not a camera's."""

_NAMES: dict[type, str] = {
    CameraFov: "CAMERA_FOV_STATUS",
    VideoStreamInformation: "VIDEO_STREAM_INFORMATION",
    CameraInformation: "CAMERA_INFORMATION",
    CameraSettings: "CAMERA_SETTINGS",
}
"""Reports by rank, highest first."""

CameraSample = CameraInformation | CameraFov | VideoStreamInformation | CameraSettings


class CameraReports:
    """Combines what several messages report of a camera.

    Args:
        chosen: the camera to use, by device id 1-6 or component id; 0: the first that reports its field of view.
    """

    def __init__(self, chosen: int = 0) -> None:
        self._cameras: dict[int, _ReportedCamera] = {}
        self._used = chosen
        self._reports = ReportOnce()
        self.report: CameraReport | None = None
        """Report of the camera in use, None as long as its field of view is unknown."""

    @property
    def stream(self) -> VideoStreamInformation | None:
        """The video stream of the camera in use, or of the first that has one; None while none has."""
        used = self._cameras.get(self._used)
        cameras = [used] if used and used.stream else self._cameras.values()
        return next((camera.stream for camera in cameras if camera.stream and camera.stream.uri), None)

    @property
    def gimbal_id(self) -> int:
        """Id of the gimbal that carries the camera, 0 unknown."""
        camera = self._cameras.get(self._used) or next(iter(self._cameras.values()), None)
        return camera.information.gimbal_id if camera and camera.information else 0

    def add(self, sample: CameraSample) -> list[str]:
        """Add any of the four messages; return what is rejected and why, and which camera is not used. Each once."""
        device = sample.device_id or sample.component_id
        camera = self._cameras.setdefault(device, _ReportedCamera())
        texts = [f"{name} not used: {reason}" for name, reason in camera.add(sample)]
        if camera.report is not None and device != self._used:
            if self._used:
                texts.append(f"camera {device} reports too and is not used: [camera] device chooses")
            else:
                self._used = device
        used = self._cameras.get(self._used)
        self.report = used.report if used else None
        return self._reports.new(texts)


@dataclass(slots=True)
class _ReportedCamera:
    """Values that one camera reported; a rejected value leaves the one before in place."""

    information: CameraInformation | None = None
    stream: VideoStreamInformation | None = None
    angles: dict[str, tuple[float, float]] = field(default_factory=dict)
    """Horizontal and vertical field of view by message, one of them may be NaN."""
    size: dict[str, tuple[int, int]] = field(default_factory=dict)
    rotation_deg: int = 0
    zoom_percent: float = math.nan
    report: CameraReport | None = None

    def add(self, sample: CameraSample) -> list[tuple[str, str]]:
        """Add a message; return (message, reason) for each value that is rejected."""
        rejected: list[str] = []
        name = _NAMES[type(sample)]
        if isinstance(sample, CameraSettings):
            self._set_zoom(sample.zoom_percent, rejected)
        elif isinstance(sample, CameraFov):
            self._set_angles(name, (sample.hfov, sample.vfov), rejected)
        elif isinstance(sample, CameraInformation):
            self.information = sample
            self._set_angles(name, _lens_angles(sample), rejected)
            self._set_size(name, (sample.width_px, sample.height_px), rejected)
        elif self.stream is None or sample.stream_id <= self.stream.stream_id:
            self.stream = sample
            self._set_angles(name, (sample.hfov, math.nan), rejected)
            self._set_size(name, (sample.width_px, sample.height_px), rejected)
            self._set_rotation(sample.rotation_deg, rejected)
        self.report = self._combined()
        return [(name, reason) for reason in rejected]

    def _set_angles(self, name: str, angles: tuple[float, float], rejected: list[str]) -> None:
        known = [angle if NARROWEST < angle < WIDEST else math.nan for angle in angles]
        rejected += (
            f"a field of view of {math.degrees(angle):.4g}°"
            for angle, kept in zip(angles, known, strict=True)
            if math.isnan(kept) and not math.isnan(angle)
        )
        if not all(map(math.isnan, known)):
            self.angles[name] = known[0], known[1]

    def _set_size(self, name: str, size: tuple[int, int], rejected: list[str]) -> None:
        if all(SIZES_PX[0] <= side <= SIZES_PX[1] for side in size):
            self.size[name] = size
        elif all(size):
            rejected.append(f"an image of {size[0]}×{size[1]}")

    def _set_rotation(self, rotation_deg: int, rejected: list[str]) -> None:
        if rotation_deg in (0, 90, 180, 270):
            self.rotation_deg = rotation_deg
        else:
            rejected.append(f"a rotation of {rotation_deg}°")

    def _set_zoom(self, percent: float, rejected: list[str]) -> None:
        if 0.0 <= percent <= 100.0:
            self.zoom_percent = percent
        elif not math.isnan(percent):
            rejected.append(f"a zoom of {percent:g} % of the range")

    def _combined(self) -> CameraReport | None:
        width, height = next((self.size[name] for name in _NAMES.values() if name in self.size), (0, 0))
        source = next((name for name in _NAMES.values() if name in self.angles), "")
        angles, zoom_max = self.angles.get(source), 1.0
        if angles is None and self.information is not None:
            known = camera_model(self.information.vendor, self.information.model)
            if known is not None and known.shows_all(width, height):
                source, angles = f"{known.name} by {known.source}", (math.radians(known.hfov_deg), math.nan)
                zoom_max = known.zoom_max
        if angles is None:
            return None
        return CameraReport(
            width=width,
            height=height,
            hfov=angles[0],
            vfov=angles[1],
            source=source,
            zoom_max=zoom_max,
            rotation_deg=self.rotation_deg,
            zoom_percent=self.zoom_percent,
            model=self.information.model if self.information else "",
            uri=self.stream.uri if self.stream else "",
        )


def _lens_angles(lens: CameraInformation) -> tuple[float, float]:
    """Horizontal and vertical field of view of a lens and a sensor, NaN unknown."""

    def angle(side: float) -> float:
        # tan(fov / 2) = sensor size / 2 focal length; a focal length of 0 and a sensor of 0 mean unknown
        known = side and lens.focal_length_m
        return 2.0 * math.atan2(side, 2.0 * lens.focal_length_m) if known else math.nan

    return angle(lens.sensor_width_m), angle(lens.sensor_height_m)
