"""A piece of a bundled flight, taken apart into what other programs would have recorded of it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gcs.session.frame_tables import read_times
from mavlink.tlog.log import Tlog
from tests.support.bundled import CURVED_ROAD, shortened
from tests.support.imports.srt_writers import Spot

FOV_DEG = 77.32
"""Of the bundled film."""
UGVS = (11, 12, 13, 14, 15, 16, 17)


@dataclass(frozen=True)
class Flown:
    """A recording of ours, and its parts."""

    session: Path
    fleet: Path
    """Telemetry of the ground vehicles alone."""

    @property
    def video(self) -> Path:
        return self.session / "video.mp4"

    @property
    def frames_us(self) -> np.ndarray:
        return read_times(self.session / "frames.csv").times_us

    @property
    def log(self) -> Tlog:
        return Tlog.open(self.session / "telemetry.tlog")

    def columns(self, message_id: int, system_id: int) -> tuple[np.ndarray, np.ndarray]:
        log = self.log
        rows, wire = log.columns(message_id, system_id)
        return log.index.t_us[rows], wire

    def spots(self, *, step: int = 1, dated: bool = True) -> list[tuple[float, Spot]]:
        """The UAV at frames, by its telemetry."""
        frames = self.frames_us[::step]
        t, wire = self.columns(33, 1)
        at, attitude = self.columns(30, 1)
        lat, lon, alt, height = (
            np.interp(frames, t, wire[name].astype(float)) for name in ("lat", "lon", "alt", "relative_alt")
        )
        yaw = np.degrees(np.interp(frames, at, np.unwrap(attitude["yaw"].astype(float))))
        return [
            (
                float(frames[k] - frames[0]) * 1e-6,
                Spot(
                    lat=lat[k] * 1e-7,
                    lon=lon[k] * 1e-7,
                    alt=alt[k] * 1e-3,
                    height=height[k] * 1e-3,
                    yaw=float((yaw[k] + 180.0) % 360.0 - 180.0),
                    unix_us=int(frames[k]) if dated else 0,
                ),
            )
            for k in range(len(frames))
        ]


def fly(folder: Path, frames: int) -> Flown:
    """So many frames of the bundled flight."""
    session = shortened(CURVED_ROAD, folder / "flown", frames)
    Tlog.open(session / "telemetry.tlog").cut(folder / "fleet.tlog", system_ids=UGVS)
    return Flown(session=session, fleet=folder / "fleet.tlog")
