"""A camera on a mast, whose place and rough direction the mission alone knows, names as one that flies does."""

import csv
from itertools import islice

from gcs.playback.analysis import Analysis
from gcs.session.session import open_session
from sim.session import write_session
from sim.world.scenario import Scenario, ScenarioGround

FLIGHT = Scenario(duration_s=3.5, fps=4.0, ground=ScenarioGround(kind="formation", vehicles=4, spacing_m=9.0))


def test_a_mast_names_what_it_sees(tmp_path):
    write_session(FLIGHT.filmed_by(2, masts=1), tmp_path / "flight")
    rows = csv.DictReader((tmp_path / "flight" / "view-2" / "truth.csv").read_text().splitlines())
    truth = {(int(row["frame"]), float(row["cx"]), float(row["cy"])): int(row["system_id"]) for row in rows}
    analysis = Analysis(open_session(tmp_path / "flight" / "view-2"))
    try:
        seen = list(islice(analysis.snapshots(images=False), 14))
    finally:
        analysis.close()
    boxes = [(box, truth[now.frame, box.cx, box.cy]) for now in seen[6:] for box in now.boxes if not box.coasting]
    named = {(box.system_id, who) for box, who in boxes if box.system_id}
    assert named == {(i, i) for i in (11, 12, 13, 14)}
    mast = seen[-1].vehicles[0]
    assert (mast.kind, mast.name, seen[-1].pose) == ("mast", "Mast-2", "known")
    assert not any(alarm.system_id == mast.system_id for now in seen for alarm in now.alarms)
