"""Writes an annotated film's world as a session folder, without the film itself."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import tomli_w
from numpy.typing import NDArray

from infra.files.safe_open import read_small
from infra.session_format import DETECTIONS, FRAMES, LOG, METADATA, TRUTH
from sim.annotated.film_world import FilmWorld
from sim.annotated.tracks import AnnotatedTracks
from sim.session import new_session, session_toml, write_frames, write_tlog
from sim.world.scenario_file import save_scenario

FloatArray = NDArray[np.float64]

LABEL_SCORE = 0.9
"""Score of a label that takes a detection's place: that of a clear one."""
ATTRIBUTES = (
    "daylight",
    "night",
    "fog",
    "low-alt",
    "medium-alt",
    "high-alt",
    "front-view",
    "side-view",
    "bird-view",
    "long-term",
)
"""Attributes of a label, 0 or 1 each, in this order."""
MAX_BYTES = 1000
FOLDERS_UP = 3
"""Levels above the labels at which the folder M_attr is looked for."""


def write_film_session(
    film: FilmWorld, tracks: AnnotatedTracks, t: FloatArray, folder: Path, *, boxes_from_labels: bool
) -> None:
    """Write ``session.toml``, ``telemetry.tlog``, ``frames.csv``, ``truth.csv`` and ``scenario.toml``.

    ``truth.csv`` has every label whose centre is in the image and that is not mostly hidden. Of the scenario only
    camera, errors and seed tell how the session came about: the vehicles and the UAV moved as in the film.

    Args:
        tracks: labels.
        t: (T,) seconds of the images.
        folder: must not exist yet.
        boxes_from_labels: write the labels as ``detections.csv`` too, so that no detector looks at the film.

    Raises:
        SessionWriteError: if the folder exists or cannot be made.
    """
    scenario = film.world.scenario
    with new_session(folder) as made:
        save_scenario(scenario, made / "scenario.toml")
        (made / METADATA).write_bytes(tomli_w.dumps(session_toml(scenario, ())).encode())
        stamps_us = scenario.start_us + np.rint((t + scenario.timing.video_offset_s) * 1e6).astype(np.int64)
        write_frames(made / FRAMES.name, stamps_us)
        write_tlog(made / LOG, film.world)
        truth, detections = [TRUTH.header], [DETECTIONS.header]
        name = dict(zip((track.track for track in film.team), scenario.ugv_ids, strict=True))
        boxes = tracks.boxes()
        inside = ((boxes[:, :2] >= 0.0) & (boxes[:, :2] < (scenario.camera.width, scenario.camera.height))).all(axis=1)
        for row in np.flatnonzero(inside & ~tracks.hidden).tolist():
            cx, cy, w, h, angle = boxes[row].tolist()
            box = f"{tracks.frame[row]},{cx:.2f},{cy:.2f},{w:.2f},{h:.2f},{angle:.4f}"
            truth.append(f"{box},{name.get(int(tracks.track[row]), 0)}\n")
            detections.append(f"{box},{LABEL_SCORE},\n")
        (made / TRUTH.name).write_bytes("".join(truth).encode())
        if boxes_from_labels:
            (made / DETECTIONS.name).write_bytes("".join(detections).encode())


def read_attributes(labels: Path) -> tuple[str, ...]:
    """The attributes that hold of a film, empty where there is no such file.

    Args:
        labels: NAME_gt.txt or NAME_gt_whole.txt; NAME_attr.txt lies beside it, or in M_attr, M_attr/train or
            M_attr/test of a folder above.
    """
    name = labels.stem.removesuffix("_gt_whole").removesuffix("_gt") + "_attr.txt"
    folders = [labels.parent]
    for above in labels.resolve().parents[:FOLDERS_UP]:
        folders += [above / "M_attr", above / "M_attr" / "train", above / "M_attr" / "test"]
    for folder in folders:
        try:
            cells = read_small(folder / name, MAX_BYTES).decode("ascii", errors="replace").replace(",", " ").split()
        except (OSError, ValueError):
            continue
        return tuple(word for word, cell in zip(ATTRIBUTES, cells, strict=False) if cell == "1")
    return ()
