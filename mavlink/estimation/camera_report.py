"""What a UAV says about its camera: how wide it sees, how large its image is, how far it has zoomed.

The field of view, by order of preference:

    CAMERA_FOV_STATUS          the field of view now
    VIDEO_STREAM_INFORMATION   that of the stream, in whole degrees
    CAMERA_INFORMATION         2 atan(sensor size / 2 focal length)

The size of the image is the stream's, else the camera's; an image that was seen knows better. Numbers that no camera
has are refused, and it is said once why.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from infra.reporting import ReportOnce
from mavlink.protocol.messages import CameraFov, CameraInformation, CameraSettings, VideoStreamInformation
from mavlink.state import CameraReport

__all__ = ["NARROWEST", "WIDEST", "CameraReports", "CameraSample"]

NARROWEST, WIDEST = math.radians(0.5), math.radians(175.0)
"""Fields of view of cameras, rad."""
SIZES_PX = (16, 16384)

_NAMES: dict[type, str] = {
    CameraFov: "CAMERA_FOV_STATUS",
    VideoStreamInformation: "VIDEO_STREAM_INFORMATION",
    CameraInformation: "CAMERA_INFORMATION",
    CameraSettings: "CAMERA_SETTINGS",
}
"""Best first."""

CameraSample = CameraInformation | CameraFov | VideoStreamInformation | CameraSettings


class CameraReports:
    """Puts together what several messages say about a camera.

    Args:
        chosen: the camera to listen to, by device id 1-6 or component id; 0: the first that tells its field of view.
    """

    def __init__(self, chosen: int = 0) -> None:
        self._chosen = chosen
        self._cameras: dict[int, _Camera] = {}
        self._used = chosen
        self._reports = ReportOnce()

    @property
    def report(self) -> CameraReport | None:
        """The camera, None as long as its field of view is unknown."""
        camera = self._cameras.get(self._used)
        return camera.report if camera else None

    @property
    def stream(self) -> VideoStreamInformation | None:
        """The video that the camera in use offers, or the first that offers one; None while none does."""
        used = self._cameras.get(self._used)
        cameras = [used] if used and used.stream else self._cameras.values()
        return next((camera.stream for camera in cameras if camera.stream and camera.stream.uri), None)

    @property
    def gimbal_id(self) -> int:
        """Of the gimbal that the camera says it hangs on, 0 unknown."""
        camera = self._cameras.get(self._used) or next(iter(self._cameras.values()), None)
        return camera.information.gimbal_id if camera and camera.information else 0

    def take(self, sample: CameraSample) -> list[str]:
        """Takes any of the four messages; returns what is refused and why, and which camera is not used. Each once."""
        device = sample.device_id or sample.component_id
        camera = self._cameras.setdefault(device, _Camera())
        texts = [f"{name} not used: {reason}" for name, reason in camera.take(sample)]
        if camera.report is not None and device != self._used:
            if self._used:
                texts.append(f"camera {device} reports too and is not used: [camera] device chooses")
            else:
                self._used = device
        return self._reports.new(texts)


@dataclass(slots=True)
class _Camera:
    """What one camera said; what is refused leaves standing what it said before."""

    information: CameraInformation | None = None
    stream: VideoStreamInformation | None = None
    angles: dict[str, tuple[float, float]] = field(default_factory=dict)
    """Horizontal and vertical field of view by message, one of them may be NaN."""
    size: dict[str, tuple[int, int]] = field(default_factory=dict)
    rotation_deg: int = 0
    zoom_percent: float = math.nan
    report: CameraReport | None = None

    def take(self, sample: CameraSample) -> list[tuple[str, str]]:
        """Keeps a message; returns (message, reason) for what is refused."""
        refused: list[str] = []
        name = _NAMES[type(sample)]
        if isinstance(sample, CameraSettings):
            self._take_zoom(sample.zoom_percent, refused)
        elif isinstance(sample, CameraFov):
            self._take_angles(name, (sample.hfov, sample.vfov), refused)
        elif isinstance(sample, CameraInformation):
            self.information = sample
            self._take_angles(name, _lens_angles(sample), refused)
            self._take_size(name, (sample.width_px, sample.height_px), refused)
        elif self.stream is None or sample.stream_id <= self.stream.stream_id:
            self.stream = sample
            self._take_angles(name, (sample.hfov, math.nan), refused)
            self._take_size(name, (sample.width_px, sample.height_px), refused)
            self._take_rotation(sample.rotation_deg, refused)
        self.report = self._put_together()
        return [(name, reason) for reason in refused]

    def _take_angles(self, name: str, angles: tuple[float, float], refused: list[str]) -> None:
        known = [angle if NARROWEST < angle < WIDEST else math.nan for angle in angles]
        refused += (
            f"a field of view of {math.degrees(angle):.4g}°"
            for angle, kept in zip(angles, known, strict=True)
            if math.isnan(kept) and not math.isnan(angle)
        )
        if not all(map(math.isnan, known)):
            self.angles[name] = known[0], known[1]

    def _take_size(self, name: str, size: tuple[int, int], refused: list[str]) -> None:
        if all(SIZES_PX[0] <= side <= SIZES_PX[1] for side in size):
            self.size[name] = size
        elif all(size):
            refused.append(f"an image of {size[0]}×{size[1]}")

    def _take_rotation(self, rotation_deg: int, refused: list[str]) -> None:
        if rotation_deg in (0, 90, 180, 270):
            self.rotation_deg = rotation_deg
        else:
            refused.append(f"a rotation of {rotation_deg}°")

    def _take_zoom(self, percent: float, refused: list[str]) -> None:
        if 0.0 <= percent <= 100.0:
            self.zoom_percent = percent
        elif not math.isnan(percent):
            refused.append(f"a zoom of {percent:g} % of the range")

    def _put_together(self) -> CameraReport | None:
        source = next((name for name in _NAMES.values() if name in self.angles), "")
        if not source:
            return None
        width, height = next((self.size[name] for name in _NAMES.values() if name in self.size), (0, 0))
        return CameraReport(
            width=width,
            height=height,
            hfov=self.angles[source][0],
            vfov=self.angles[source][1],
            source=source,
            rotation_deg=self.rotation_deg,
            zoom_percent=self.zoom_percent,
            model=self.information.model if self.information else "",
            uri=self.stream.uri if self.stream else "",
        )


def _lens_angles(lens: CameraInformation) -> tuple[float, float]:
    """Angles that a lens and a sensor make, NaN unknown."""

    def angle(side: float) -> float:
        # tan(fov / 2) = sensor size / 2 focal length; a focal length of 0 and a sensor of 0 stand for unknown
        known = side and lens.focal_length_m
        return 2.0 * math.atan2(side, 2.0 * lens.focal_length_m) if known else math.nan

    return angle(lens.sensor_width_m), angle(lens.sensor_height_m)
