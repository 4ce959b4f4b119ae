"""A camera that shakes: how it moved by the pixels is recorded, helps the names, and is folded again as it was."""

import csv
from dataclasses import replace

import numpy as np
import pytest

from bench.field.suite import write_motion
from gcs.cli.identify import identify_into
from gcs.playback.analysis import Analysis
from gcs.session.frame_tables import motion_row, read_motions
from gcs.session.session import open_session
from infra.session_format import MOTION
from sim.session import write_session
from sim.world.presets import nominal
from sim.world.scenario import (
    ScenarioAttitude,
    ScenarioCamera,
    ScenarioDeclared,
    ScenarioFlight,
    ScenarioGround,
)
from tests.support.scripted import InjectedFaults, fly
from vision.motion.image_motion import ImageMotion

pytestmark = pytest.mark.slow

# no attitude is reported, so that nothing but the pixels tells how the camera turns
SHAKING = replace(
    nominal(3),
    ground=ScenarioGround(kind="curved", vehicles=4, spacing_m=8.0),
    flight=ScenarioFlight(wobble_deg=6.0, wobble_tau_s=0.25),
    attitude=ScenarioAttitude(missing=True),
    camera=ScenarioCamera(mount="fixed"),
    duration_s=6.0,
)
SEEN = InjectedFaults(rendered=True, detector_fails=(2.5, 2.9), no_video=((3.5, 4.1),), resized_s=5.0)


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    return fly(tmp_path_factory.mktemp("flown"), SHAKING, SEEN)


def lines(path):
    return path.read_text().splitlines()


def test_a_flight_that_saw_its_motion_is_folded_again_as_it_was(flown, tmp_path):
    compared = {int(row["frame"]) for row in csv.DictReader(lines(flown / "motion.csv"))}
    looked = {int(row["frame"]) for row in csv.DictReader(lines(flown / "folds.csv")) if row["boxes"]}
    assert compared < looked and len(compared) > 0.8 * len(looked), "all but the first, and the first of another size"
    identify_into(open_session(flown), tmp_path / "again")
    for name in ("identity.csv", "identity.jsonl"):
        assert lines(tmp_path / "again" / name) == lines(flown / name)


def test_a_replay_shows_the_same(flown):
    told = [
        (snapshot.frame, box.track_id, box.system_id, box.cx)
        for _, snapshot in Analysis(open_session(flown)).moments()
        for box in snapshot.new_boxes
        if not box.coasting
    ]
    rows = list(csv.DictReader(lines(flown / "identity.csv")))
    assert {(frame, track) for frame, track, _, _ in told} == {(int(r["frame"]), int(r["track_id"])) for r in rows}


def test_more_is_named_where_pixels_tell_how_the_camera_turns(flown, tmp_path):
    blind = fly(tmp_path, SHAKING, replace(SEEN, rendered=False))
    boxes, named = [], []
    for folder in (flown, blind):
        rows = list(csv.DictReader(lines(folder / "identity.csv")))
        boxes.append(len(rows))
        named.append(sum(row["system_id"] != "" for row in rows))
    assert boxes[0] == boxes[1]
    assert named[0] > 1.1 * named[1]


def test_a_camera_mounted_backwards_is_found_where_pixels_tell_its_motion(tmp_path):
    """The UAV's own flight is told from the camera's turning by its velocity, which such a camera sees from behind."""
    ground = ScenarioGround(kind="curved", vehicles=6, spacing_m=8.0, speed_mps=5.0)
    backwards = replace(nominal(3), ground=ground, declared=ScenarioDeclared(yaw_deg=180.0), duration_s=7.0)
    write_session(backwards, tmp_path / "session")
    write_motion(backwards, tmp_path / "session")
    identify_into(open_session(tmp_path / "session"), tmp_path / "out")
    rows = list(csv.DictReader(lines(tmp_path / "out" / "identity.csv")))
    assert sum(row["system_id"] != "" for row in rows) > 0.7 * len(rows)


def test_a_recording_without_it_can_be_identified(flown, tmp_path, capsys):
    (old := tmp_path / "old").mkdir()
    for path in flown.iterdir():
        if path.is_file() and path.name != "motion.csv":
            (old / path.name).write_bytes(path.read_bytes())
    assert identify_into(open_session(old), tmp_path / "again").boxes
    (old / "motion.csv").write_text(MOTION.header + "3,1,0,nan,0,1,0,0,0,0.1,50,0.9\n4,1,0,1e9,0,1,0,0,0,0.1,50,0.9\n")
    identify_into(open_session(old), tmp_path / "damaged")
    assert lines(tmp_path / "damaged" / "identity.csv") == lines(tmp_path / "again" / "identity.csv")
    assert "motion.csv: 2 rows could not be read" in capsys.readouterr().err


def test_what_is_written_is_read_to_the_last_digit(tmp_path):
    rng = np.random.default_rng(1)
    H = np.append(rng.normal(size=8) * 10.0 ** np.arange(-5, 3), 1.0).reshape(3, 3)
    motion = ImageMotion(H=H, std_px=0.1 + 0.2, inliers=77, share=1 / 3)
    (tmp_path / "motion.csv").write_text(MOTION.header + motion_row(5, motion))
    again = read_motions(tmp_path / "motion.csv").at(5)
    np.testing.assert_array_equal(again.H, H)
    assert (again.std_px, again.inliers, again.share) == (motion.std_px, motion.inliers, motion.share)
