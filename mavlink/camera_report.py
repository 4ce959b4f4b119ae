"""What a UAV says about its camera: how wide it sees, how large its picture is, how far it has zoomed.

The field of view, by order of preference:

    CAMERA_FOV_STATUS          the field of view now
    VIDEO_STREAM_INFORMATION   that of the stream, in whole degrees
    CAMERA_INFORMATION         2 atan(sensor size / 2 focal length)

The size of the picture is the stream's, else the camera's; a picture that was seen knows better. Numbers that no camera
has are refused, and it is said once why.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from mavlink.once import Once
from mavlink.samples import CameraFov, CameraInformation, CameraSettings, VideoStreamInformation
from mavlink.state import CameraReport

__all__ = ["NARROWEST", "WIDEST", "CameraReports", "CameraSample"]

NARROWEST, WIDEST = math.radians(0.5), math.radians(175.0)
"""Fields of view of cameras, rad."""
SIZES_PX = (16, 16384)

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
        self._once = Once()

    @property
    def report(self) -> CameraReport | None:
        """The camera, None as long as its field of view is unknown."""
        camera = self._cameras.get(self._used)
        return camera.report if camera else None

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
        return self._once.new(texts)


@dataclass(slots=True)
class _Camera:
    """The newest of each message from one camera."""

    information: CameraInformation | None = None
    fov: CameraFov | None = None
    stream: VideoStreamInformation | None = None
    zoom_percent: float = math.nan
    report: CameraReport | None = None

    def take(self, sample: CameraSample) -> list[tuple[str, str]]:
        """Keeps a message; returns (message, reason) for what is refused."""
        refused: list[tuple[str, str]] = []
        if isinstance(sample, CameraInformation):
            self.information = sample
        elif isinstance(sample, CameraFov):
            self.fov = sample
        elif isinstance(sample, CameraSettings):
            self._take_zoom(sample.zoom_percent, refused)
        elif self.stream is None or sample.stream_id <= self.stream.stream_id:
            self.stream = sample
        self.report = self._put_together(refused)
        return refused

    def _take_zoom(self, percent: float, refused: list[tuple[str, str]]) -> None:
        if 0.0 <= percent <= 100.0:
            self.zoom_percent = percent
        elif not math.isnan(percent):
            refused.append(("CAMERA_SETTINGS", f"a zoom of {percent:g} % of the range"))

    def _put_together(self, refused: list[tuple[str, str]]) -> CameraReport | None:
        source, hfov, vfov = self._field_of_view(refused)
        if not source:
            return None
        width, height = self._size(refused)
        rotation = self.stream.rotation_deg if self.stream else 0
        if rotation not in (0, 90, 180, 270):
            refused.append(("VIDEO_STREAM_INFORMATION", f"a rotation of {rotation}°"))
            rotation = 0
        return CameraReport(
            width=width,
            height=height,
            hfov=hfov,
            vfov=vfov,
            source=source,
            rotation_deg=rotation,
            zoom_percent=self.zoom_percent,
            model=self.information.model if self.information else "",
            uri=self.stream.uri if self.stream else "",
        )

    def _field_of_view(self, refused: list[tuple[str, str]]) -> tuple[str, float, float]:
        """Message that tells, horizontal and vertical angle, one of which may be NaN; no message: none tells."""
        for name, angles in (
            ("CAMERA_FOV_STATUS", (self.fov.hfov, self.fov.vfov) if self.fov else ()),
            ("VIDEO_STREAM_INFORMATION", (self.stream.hfov, math.nan) if self.stream else ()),
            ("CAMERA_INFORMATION", _lens_angles(self.information)),
        ):
            known = [_bounded(angle, name, refused) for angle in angles]
            if not all(map(math.isnan, known)):
                return name, known[0], known[1]
        return "", math.nan, math.nan

    def _size(self, refused: list[tuple[str, str]]) -> tuple[int, int]:
        """Of the picture, px; 0, 0 unknown."""
        for name, source in (("VIDEO_STREAM_INFORMATION", self.stream), ("CAMERA_INFORMATION", self.information)):
            if source is None or not (source.width_px and source.height_px):
                continue
            if all(SIZES_PX[0] <= side <= SIZES_PX[1] for side in (source.width_px, source.height_px)):
                return source.width_px, source.height_px
            refused.append((name, f"a picture of {source.width_px}×{source.height_px}"))
        return 0, 0


def _lens_angles(lens: CameraInformation | None) -> tuple[float, ...]:
    """Angles (2,) that a lens and a sensor make, NaN unknown."""
    if lens is None:
        return ()
    # tan(fov / 2) = sensor size / 2 focal length; a focal length of 0 and a sensor of 0 stand for unknown
    return tuple(
        2.0 * math.atan2(side, 2.0 * lens.focal_length_m) if side and lens.focal_length_m else math.nan
        for side in (lens.sensor_width_m, lens.sensor_height_m)
    )


def _bounded(angle: float, name: str, refused: list[tuple[str, str]]) -> float:
    """An angle that a camera can have, else NaN."""
    if math.isnan(angle) or NARROWEST < angle < WIDEST:
        return angle
    refused.append((name, f"a field of view of {math.degrees(angle):.4g}°"))
    return math.nan
