import dataclasses

import pytest

from bench.recorded import measure, sessions_in, text_of
from sim.session import write_session
from sim.world.presets import nominal
from sim.world.scenario import ScenarioDetector, ScenarioFlight, Targets

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Two sessions with truth, and a folder without."""
    path = tmp_path_factory.mktemp("recorded")
    calm = dataclasses.replace(nominal(3), duration_s=3.0, targets=Targets(still=1))
    misses = ScenarioDetector(miss=0.3, miss_run_s=0.6)
    write_session(calm, path / "calm")
    write_session(
        dataclasses.replace(calm, seed=4, flight=ScenarioFlight(wobble_deg=4.0), detector=misses), path / "rough"
    )
    (path / "notes").mkdir()
    return path


def test_sessions_are_found_below_a_folder_and_given_alone(folder):
    assert [p.name for p in sessions_in([folder])] == ["calm", "rough"]
    assert sessions_in([folder / "rough"]) == [folder / "rough"]


def test_each_session_is_a_row(folder):
    rows = measure([folder / "calm"])
    assert (rows[0].session, rows[0].frames, rows[0].precision) == ("calm", 30, 100.0)
    text = text_of([*rows, dataclasses.replace(rows[0], session="worse", right=12.5, mismatch_s=3.0)])
    assert f"| calm | 100.00 | {rows[0].right:.2f} |" in text and "| worse | 100.00 | 12.50 |" in text
    calm, worse = text.splitlines()[-2:]
    assert "| – | " in calm and "| 3.0 | " in worse
