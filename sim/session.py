"""Writes a scenario as a session folder, as if it had been flown and recorded."""

from __future__ import annotations

import contextlib
import struct
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w
from numpy.typing import NDArray

from infra.files.aside import make_aside, remove_aside
from infra.session_format import DETECTIONS, FRAMES, LOG, METADATA, TRUTH, VIEW_FOLDER
from sim.errors import ScenarioError, SessionWriteError
from sim.telemetry.detections import DetectorModel, truth_rows
from sim.telemetry.vehicle_telemetry import fleet_telemetry
from sim.world.earth import to_geodetic
from sim.world.scenario import UAV_ID, Scenario
from sim.world.scenario_file import save_scenario
from sim.world.world import World, random_stream

FloatArray = NDArray[np.float64]

NO_DISTORTION = (0.0,) * 5


def write_session(
    scenario: Scenario,
    folder: Path,
    *,
    video: bool = False,
    film: Scenario | None = None,
    report: Callable[[int, int], None] | None = None,
) -> World:
    """Write a session: ``session.toml``, ``telemetry.tlog``, ``frames.csv``, ``truth.csv`` and ``scenario.toml``.

    Without video, ``detections.csv`` is written, and ``truth.csv`` has its rows with the true system ids. With
    video, ``video.mp4`` is written, and ``truth.csv`` has the true boxes of what is visible. What a second camera sees
    is in the folder ``view-2``, and so on. Equal scenarios give equal bytes.

    Args:
        folder: must not exist yet.
        video: render and encode the video instead of modelling a detector.
        film: what is filmed instead, a flight of the same length and frame rate: telemetry and film do not belong
            together, and in the truth nothing that is seen is ours.
        report: called with the numbers of rendered frames and of all frames.

    Returns:
        the world that was recorded.

    Raises:
        SessionWriteError: if the folder exists or cannot be made.
        ScenarioError: if the scenario cannot be simulated.
    """
    if video and (film or scenario).ground.waves_m > 0.0:
        raise ScenarioError("scenario: [ground]: waves_m cannot be drawn; give 0, or write the session without video")
    world = World(scenario)
    views = world.views
    filmed = world if film is None else World(film)
    with new_session(folder) as made:
        save_scenario(scenario, made / "scenario.toml")
        (made / METADATA).write_bytes(tomli_w.dumps(session_toml(scenario, views)).encode())
        write_tlog(made / LOG, world, views)
        _write_seen(made, filmed, scenario, video=video, ours=film is None, report=report)
        for number, view in enumerate(views, 2):
            (made / VIEW_FOLDER.format(number)).mkdir()
            _write_seen(made / VIEW_FOLDER.format(number), view, view.scenario, video=video, ours=True, report=report)
    return world


def _write_seen(
    folder: Path,
    filmed: World,
    scenario: Scenario,
    *,
    video: bool,
    ours: bool,
    report: Callable[[int, int], None] | None,
) -> None:
    """Write what one camera saw."""
    t, stamps_us = frame_times(scenario)
    write_frames(folder / FRAMES.name, stamps_us)
    if not video:
        _write_detections(folder, filmed, t, ours=ours)
        return
    # renderer and encoder are imported only where they are needed: that takes time
    from sim.render.film import write_video

    write_visible_truth(folder / TRUTH.name, filmed, t, ours=ours)
    write_video(filmed, t, folder / "video.mp4", report)


@contextlib.contextmanager
def new_session(folder: Path) -> Iterator[Path]:
    """A folder to be filled that becomes the session's once this is over; what breaks off leaves nothing.

    Raises:
        SessionWriteError: if it exists or cannot be made.
    """
    exists = f"{folder}: exists already; recordings are never overwritten, give another name"
    if folder.exists() or folder.is_symlink():
        raise SessionWriteError(exists)
    try:
        hidden = make_aside(folder.parent)
    except OSError as error:
        raise SessionWriteError(
            f"{folder}: cannot be made: {error.strerror}; give a folder that can be written"
        ) from error
    try:
        made = hidden / folder.name
        made.mkdir()
        yield made
        try:
            folder.mkdir()
        except FileExistsError as error:
            raise SessionWriteError(exists) from error
        made.rename(folder)  # over the empty folder that was made just now, never over another
    finally:
        remove_aside(hidden)


def frame_times(scenario: Scenario) -> tuple[FloatArray, NDArray[np.int64]]:
    """True exposure of each frame (k,) in seconds, and the Unix µs of its stamp (video offset included)."""
    jitter = random_stream(scenario, "frames").normal(0.0, scenario.timing.frame_jitter_s, scenario.frame_count)
    room = 0.4 / scenario.fps
    t = np.arange(scenario.frame_count) / scenario.fps + np.clip(jitter, -room, room)
    if scenario.timing.frame_loss > 0.0:
        t = t[random_stream(scenario, "lost frames").random(len(t)) >= scenario.timing.frame_loss]
    stamps = scenario.start_us + np.rint((t + scenario.timing.video_offset_s) * 1e6).astype(np.int64)
    return t, stamps


def session_toml(scenario: Scenario, views: Sequence[World]) -> dict[str, Any]:
    """The flight's ``session.toml``."""
    further = [
        {**(_mast_table(each) if view.mast else {"system_id": UAV_ID + k}), **_camera_tables(each.scenario)}
        for k, (view, each) in enumerate(zip(scenario.views, views, strict=True), 1)
    ]
    return {
        "uav": {"system_id": UAV_ID},
        "ugv": [{"system_id": i, "name": f"UGV-{i}"} for i in scenario.ugv_ids],
        **_camera_tables(scenario),
        **({"view": further} if further else {}),
    }


def _mast_table(world: World) -> dict[str, Any]:
    """Table in which the mission has the place of a camera on a mast, and how well it knows the direction."""
    scenario, stand = world.scenario, world.at(0.0).uav
    lat, lon, _ = to_geodetic(stand.p_enu, scenario.latitude_deg, scenario.longitude_deg, scenario.altitude_m)
    return {
        "mast": {
            "latitude_deg": round(float(lat), 7),
            "longitude_deg": round(float(lon), 7),
            "height_m": round(float(stand.p_enu[2]), 1),
            "heading_deg": round(float(np.degrees(stand.yaw)) % 360.0, 1),
            "heading_std_deg": max(abs(scenario.declared.yaw_deg), 1.0),
            "pitch_std_deg": max(abs(scenario.declared.pitch_deg), 0.5),
        }
    }


def _camera_tables(scenario: Scenario) -> dict[str, Any]:
    """Tables in which the mission describes a camera and its clock."""
    camera, declared = scenario.camera, scenario.declared
    offset: dict[str, Any] = {
        "exact": scenario.timing.video_offset_s + declared.offset_s,
        "zero": 0.0,
        "auto": "auto",
    }
    described = {
        "camera": {
            "width": camera.width,
            "height": camera.height,
            "fx": camera.fx * declared.focal_share,
            "fy": camera.fy * declared.focal_share,
            "cx": camera.cx,
            "cy": camera.cy,
            "distortion": list(camera.distortion if declared.distortion else NO_DISTORTION),
            "mount": camera.mount,
            "roll_deg": camera.roll_deg,
            "pitch_deg": camera.pitch_deg + declared.pitch_deg,
            "yaw_deg": camera.yaw_deg + declared.yaw_deg,
        }
    }
    return {
        **(described if declared.camera else {}),
        "clock": {"video_offset_s": offset[scenario.timing.declared_offset]},
    }


def write_frames(path: Path, stamps_us: NDArray[np.int64]) -> None:
    """Write ``frames.csv`` from the stamps (k,) of the frames, Unix µs."""
    rows = "".join(f"{index},{stamp}\n" for index, stamp in enumerate(stamps_us.tolist()))
    path.write_bytes((FRAMES.header + rows).encode())


def write_tlog(path: Path, world: World, views: Sequence[World] = ()) -> None:
    """Write what all vehicles send, and the aircraft of further cameras, as a telemetry log."""
    packets = fleet_telemetry(world, views=views)
    path.write_bytes(b"".join(struct.pack(">Q", packet.t_us) + packet.raw for packet in packets))


def _write_detections(folder: Path, world: World, t: FloatArray, *, ours: bool) -> None:
    model = DetectorModel(world)
    detections = [DETECTIONS.header]
    truth = [TRUTH.header]
    for frame, now in enumerate(t.tolist()):
        rows = model.detect(now)
        for (cx, cy, w, h, angle, score, heading), system_id in zip(
            rows.values.tolist(), rows.system_id.tolist(), strict=True
        ):
            box = f"{frame},{cx:.2f},{cy:.2f},{w:.2f},{h:.2f},{angle:.4f}"
            detections.append(f"{box},{score:.3f},{heading:.4f}\n")
            truth.append(f"{box},{system_id if ours else 0}\n")
    (folder / DETECTIONS.name).write_bytes("".join(detections).encode())
    (folder / TRUTH.name).write_bytes("".join(truth).encode())


def write_visible_truth(path: Path, world: World, t: FloatArray, *, ours: bool = True) -> None:
    """Write the true boxes of what is visible at the frame times t (k,), seconds; without system ids if not ours."""
    rows = "".join(
        f"{frame},{row}\n" for frame, now in enumerate(t.tolist()) for row in truth_rows(world, now, ours=ours)
    )
    path.write_bytes((TRUTH.header + rows).encode())
