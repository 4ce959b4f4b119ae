import dataclasses

import pytest

from bench.field.product import identify
from bench.paper.rows import read, write
from bench.recorded.pairings import measure_pairings, pair_up, pairings_text
from bench.recorded.table import SessionScore, measure, score_session, sessions_in, text_of
from bench.recorded.true_tracks import OTHERS_FROM, tracked_by_truth
from gcs.session.frame_tables import read_times
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


def test_each_session_is_a_row_beside_what_it_was(folder, tmp_path):
    rows = measure([folder / "calm"])
    assert (rows[0].session, rows[0].frames, rows[0].precision) == ("calm", 30, 100.0)
    write(tmp_path / "recorded.csv", SessionScore, rows)
    worse = dataclasses.replace(read(tmp_path / "recorded.csv", SessionScore)[0], right=12.5, mismatch_s=3.0)
    text = text_of(rows, [worse])
    assert f"| 12.50 → {rows[0].right:.2f} |" in text
    assert "| 3.0 → – |" in text
    assert "→" not in text_of(rows, [dataclasses.replace(worse, session="another")])


def test_true_tracks_neither_break_nor_mix(folder, tmp_path):
    with tracked_by_truth(folder / "rough"):
        m = identify(folder / "rough", tmp_path / "out").matched
    seen = (m.truth >= 0) & (m.track > 0)
    assert ((m.track == m.truth) | (m.truth == 0))[seen].all()
    assert (m.track[seen & (m.truth == 0)] >= OTHERS_FROM).all()
    assert score_session(folder / "rough", true_tracks=True).swaps == 0


def test_without_asking_the_products_own_tracker_runs(folder, tmp_path):
    with tracked_by_truth(folder / "calm", asked=False):
        m = identify(folder / "calm", tmp_path / "out").matched
    assert m.track[m.track > 0].min() == 1


def test_a_film_begins_where_that_of_the_other_telemetry_does(folder, tmp_path):
    pair_up(folder / "rough", folder / "calm", tmp_path / "pair", late_s=2.0)
    paired, flown = (read_times(place / "frames.csv").times_us for place in (tmp_path / "pair", folder / "calm"))
    assert paired[0] == flown[0] + 2_000_000
    assert (tmp_path / "pair" / "truth.csv").read_bytes() == (folder / "rough" / "truth.csv").read_bytes()
    assert (tmp_path / "pair" / "telemetry.tlog").read_bytes() == (folder / "calm" / "telemetry.tlog").read_bytes()


def test_each_pairing_is_a_row(folder):
    rows = measure_pairings([folder / "calm"])
    assert [(row.film, row.telemetry, row.named) for row in rows] == [("calm", "calm", 0.0)]
    assert "| calm | calm |" in pairings_text(rows)
