"""The bench of batches: what it cuts and kills, and that it sees when something lacks."""

from __future__ import annotations

from bench.batch.cut_flights import cut_flights
from bench.batch.killed_batch import kill_and_go_on
from bench.batch.paired_runs import compare
from gcs.playback.identification import identify_session
from gcs.session.session import open_session


def test_flights_that_are_killed_and_gone_on_with(tmp_path, capsys):
    broken = {path.name for path in cut_flights(tmp_path / "flights", 6, 24, 2)}
    names = {path.name for path in (tmp_path / "flights").iterdir()}
    good = names - broken
    assert broken == {"0001", "0004"}
    assert len({(tmp_path / "flights" / name / "detections.csv").read_bytes() for name in good}) == 4
    for name in good:
        identify_session(open_session(tmp_path / "flights" / name), tmp_path / "alone" / name)
    assert kill_and_go_on(tmp_path, names, broken, tmp_path / "alone")
    said = capsys.readouterr().out
    assert "- yes: 4 of 4 tables have the bytes of what gcs identify wrote alone" in said
    assert "NO" not in said


def test_a_batch_beside_a_loop(tmp_path, capsys):
    cut_flights(tmp_path / "flights", 1, 12, 0)
    singles = compare(tmp_path, 1, 1, 1)
    assert (singles / "0000" / "identity.csv").is_file()
    assert "Flights per core hour: loop " in capsys.readouterr().out
