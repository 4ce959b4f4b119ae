"""A camera on a mast, whose place and rough direction the mission alone knows, names as one that flies does."""

import pytest

from gcs.playback.identification import identify_session
from gcs.report.score import score_files
from gcs.session.session import open_session
from sim.session import write_session
from sim.world.scenario import Scenario, ScenarioGround

FLIGHT = Scenario(duration_s=2.0, fps=5.0, ground=ScenarioGround(kind="formation", vehicles=3, spacing_m=9.0))


@pytest.mark.slow
def test_a_uav_and_a_mast_name_what_they_see(tmp_path):
    write_session(FLIGHT.filmed_by(2, masts=1), tmp_path / "flight")
    told = []
    calls = identify_session(open_session(tmp_path / "flight"), tmp_path / "out", note=told.append)
    assert [each.uav_name for each in (calls, *calls.other_views)] == ["UAV", "Mast-2"]
    for view in (".", "view-2"):
        found = score_files(tmp_path / "flight" / view / "truth.csv", tmp_path / "out" / view / "identity.csv")
        assert (found.precision, found.coverage) == (1.0, 1.0)
    assert not any("alarm" in text or "UAV (system" in text for text in told)
