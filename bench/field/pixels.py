"""Camera motion from rendered frames, for sessions that have boxes and no video."""

from __future__ import annotations

from pathlib import Path

from gcs.session.frame_tables import motion_row, read_detections
from infra.session_format import DETECTIONS, MOTION
from sim.render.film import Film
from sim.session import frame_times
from sim.world.scenario import Scenario
from sim.world.world import World
from vision.motion.estimator import MotionEstimator


def write_motion(scenario: Scenario, session: Path) -> None:
    """Write ``motion.csv`` beside the detections of a session, as a flight does that sees the frames.

    Frames are drawn and looked at one by one; none is kept.
    """
    film, estimator, boxes = Film(World(scenario)), MotionEstimator(), read_detections(session / DETECTIONS.name)
    rows = [MOTION.header]
    for frame, t in enumerate(frame_times(scenario)[0].tolist()):
        motion = estimator.update(film.image(t, frame), boxes.at(frame))
        if motion is not None:
            rows.append(motion_row(frame, motion))
    (session / MOTION.name).write_text("".join(rows), encoding="utf-8")
