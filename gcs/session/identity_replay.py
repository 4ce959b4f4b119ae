"""An identity log read back into snapshots: the names that were given then, not those that would be given now."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gcs.certainty import CONFIRMED
from gcs.errors import SessionError
from gcs.mission.mission import Mission
from gcs.session.identity_log import read_identity
from gcs.session.tables import Table
from gcs.snapshot import NAN, Box, Health, Snapshot, VehicleRow
from vision.video.video import VideoFile

_SAME_US = 1_000_000
"""Most, µs, by which the times of two records of the same frames may shift against each other."""


def read_snapshots(
    identity: Path,
    mission: Mission,
    video: VideoFile | None,
    warn: Callable[[str], None] = lambda text: None,
    times_us: NDArray[np.int64] | None = None,
) -> Iterator[Snapshot]:
    """Go through an identity log frame by frame.

    Args:
        identity: path of ``identity.csv``.
        video: gives the images, None: there are none.
        warn: called with a line if rows could not be used.
        times_us: (n,) of the recording's frames, None: not known.

    Raises:
        SessionError: the file is no identity log, or that of another recording.
    """
    table = read_identity(identity)
    if table.skipped:
        warn(f"{identity}: {table.skipped} rows could not be used")
    order = np.argsort(table["frame"], kind="stable")
    frames = table["frame"][order].astype(np.int64)
    if times_us is not None and not _is_of(frames, table["time_us"][order], times_us):
        raise SessionError(f"{identity}: its frames are not those of this recording; give the one that was made of it")
    camera = mission.camera.intrinsics if mission.camera else None
    size = (camera.width, camera.height) if camera else (1920, 1080)
    for index, t_us, image in _frames(frames, table["time_us"][order], video):
        rows = order[slice(*np.searchsorted(frames, (index, index + 1)))]
        boxes = tuple(_box(table, int(row)) for row in rows)
        sure = {box.system_id for box in boxes if box.confidence >= CONFIRMED}
        yield Snapshot(
            t_us=t_us,
            frame=index,
            width=image.shape[1] if image is not None else size[0],
            height=image.shape[0] if image is not None else size[1],
            image=image,
            vehicles=tuple(_name_row(mission, i, sure) for i in (mission.uav.system_id, *mission.ugv_ids)),
            boxes=boxes,
            footprint_enu=None,
            uav_enu=np.full(3, np.nan),
            uav_heading=NAN,
            health=Health(),
        )


def _is_of(frames: NDArray[np.int64], at_us: NDArray[np.float64], times_us: NDArray[np.int64]) -> bool:
    """Tell whether frames with these times are some of a recording's, whichever clock either is of."""
    if not len(frames) or not len(times_us):
        return True
    return bool(0 <= frames[0] <= frames[-1] < len(times_us) and np.ptp(at_us - times_us[frames]) < _SAME_US)


def _frames(
    frames: np.ndarray, time_us: np.ndarray, video: VideoFile | None
) -> Iterator[tuple[int, int, np.ndarray | None]]:
    if video is not None:
        for frame in video.frames():
            yield frame.index, frame.t_us, frame.image
        return
    for index in np.unique(frames):
        yield int(index), int(time_us[np.searchsorted(frames, index)]), None


def _box(table: Table, row: int) -> Box:
    value = {name: float(column[row]) for name, column in table.columns.items()}
    return Box(
        track_id=_whole(value["track_id"]),
        cx=value["cx"],
        cy=value["cy"],
        w=value["w"],
        h=value["h"],
        angle=value["angle"],
        heading=value["heading"],
        score=NAN,
        system_id=_whole(value["system_id"]),
        confidence=value["confidence"],
        lat_deg=value["lat"],
        lon_deg=value["lon"],
    )


def _whole(value: float) -> int:
    return 0 if np.isnan(value) else int(value)


def _name_row(mission: Mission, system_id: int, sure: Collection[int]) -> VehicleRow:
    """A table row that knows the name, and whether that is sure, and nothing else."""
    return VehicleRow(
        system_id=system_id,
        name=mission.name_of(system_id),
        role="uav" if system_id == mission.uav.system_id else "ugv",
        standing="confirmed" if system_id in sure else "no position",
    )
