"""Small fleets, snapshots of them, and boxes for a tracker."""

from __future__ import annotations

import re

import numpy as np

from gcs.mission.mission import Mission, MissionVehicle
from gcs.snapshot import Box, Health, Snapshot, VehicleRow
from vision.detect.detections import Detections

ONE_UGV = Mission(uav=MissionVehicle(system_id=1), ugv=(MissionVehicle(system_id=2, name="Alpha"),))
TWO_UGVS = Mission(
    uav=MissionVehicle(system_id=1), ugv=(MissionVehicle(system_id=2, name="Alpha"), MissionVehicle(system_id=3))
)


def box(track_id, system_id, **change):
    place = {"cx": 10.0 * track_id, "cy": 20.0, "w": 30.0, "h": 15.0, "angle": 0.5, "heading": 2.0, "score": 0.9}
    return Box(track_id=track_id, system_id=system_id, confidence=0.98, **place | change)


def snapshot(frame=0, *, boxes=(), image=None, events=()):
    rows = tuple(
        VehicleRow(system_id=i, name=TWO_UGVS.name_of(i), role="uav" if i == 1 else "ugv", in_view=i == 2)
        for i in (1, 2, 3)
    )
    t_us = 1_795_171_704_000_000 + 100_000 * frame
    return Snapshot(
        t_us=t_us,
        frame=frame,
        frame_us=t_us,
        seen_us=t_us,
        width=64,
        height=48,
        image=image,
        vehicles=rows,
        boxes=tuple(boxes),
        footprint_enu=None,
        uav_enu=np.zeros(3),
        uav_heading=0.0,
        health=Health(),
        events=tuple(events),
    )


STEP = 100_000
"""Microseconds between two frames."""


def boxes(centre, angle=0.0, score=0.9, heading=np.nan, w=40.0, h=20.0):
    """Detections at centres (n, 2) px; everything else one number, or one a box."""
    centre = np.asarray(centre, dtype=float).reshape(-1, 2)
    columns = {"w": w, "h": h, "angle": angle, "score": score, "heading": heading}
    return Detections(
        cx=centre[:, 0], cy=centre[:, 1], **{k: np.broadcast_to(v, len(centre)) for k, v in columns.items()}
    )


def misread(rows, texts, spare=0):
    """What is wrong with the labels on a picture in letters, by what can be read there and nothing else.

    Args:
        rows: the picture's rows as text.
        texts: for every vehicle that must be told apart there, all that may be written for it.
        spare: how many others may be in a count such as ``+3``.

    Returns:
        A line for each text that is no vehicle's, each vehicle written twice, and those neither written nor counted.
    """
    owner = {text: key for key, forms in texts.items() for text in forms}
    wrong, seen, more = [], [], 0
    for row in rows:
        for text in re.split(r"[^\w .,:;=+~?%()/<>\[\]\x27-]+|  +", row):
            word = text.strip(" ")
            bare = word.removeprefix("? ").removesuffix(" ?")
            if word in owner or bare in owner:
                seen.append(owner.get(word, owner.get(bare)))
            elif re.fullmatch(r"\+\d+( names)?", word):
                more += int(word.split()[0])
            elif word.strip("? ") and " = " not in word:
                wrong.append(f"{word!r} is no vehicle's")
    wrong += [f"{key} is written {seen.count(key)} times" for key in sorted(set(seen)) if seen.count(key) > 1]
    missing = sorted(set(texts) - set(seen))
    return wrong + ([f"{missing} are not written, {more} counted"] if not 0 <= more - len(missing) <= spare else [])
