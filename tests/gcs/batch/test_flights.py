"""Which flights the words of a command line stand for."""

from __future__ import annotations

import pytest

from gcs.batch.flights import find_flights
from gcs.errors import BatchError


@pytest.fixture
def recordings(tmp_path, monkeypatch):
    for name in ("day 1/x", "day 1/y", "day 2/x"):
        (tmp_path / name).mkdir(parents=True)
        (tmp_path / name / "telemetry.tlog").write_bytes(b"")
    (tmp_path / "day 1" / "notes.md").write_text("windy")
    (tmp_path / "lone.tlog").write_bytes(b"")
    (tmp_path / "empty").mkdir()
    monkeypatch.chdir(tmp_path)
    return tmp_path.resolve()


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["day 1/x"], {"x": "day 1/x"}),
        # a folder of sessions, with something else in it
        (["day 1"], {"x": "day 1/x", "y": "day 1/y"}),
        (["day 1/*"], {"x": "day 1/x", "y": "day 1/y"}),
        (["*/y", "lone.tlog"], {"y": "day 1/y", "lone": "lone.tlog"}),
        # the same flight twice
        (["day 1/x", "day 1/../day 1/x/"], {"x": "day 1/x"}),
        (["day 1", "second x=day 2/x"], {"x": "day 1/x", "y": "day 1/y", "second x": "day 2/x"}),
        # what is not there is a broken flight of its own
        (["empty", "gone"], {"empty": "empty", "gone": "gone"}),
        (["all.txt"], {"y": "day 1/y", "other": "day 2/x"}),
    ],
)
def test_words(words, expected, recordings):
    (recordings / "all.txt").write_text("# of May\n\nday 1/y\nother=day 2/x\n")
    found = find_flights(words)
    assert {flight.name: flight.address for flight in found} == {
        name: str(recordings / path) for name, path in expected.items()
    }


def test_a_file_address_is_a_path(recordings):
    (flight,) = find_flights([f"file://{recordings}/day 1/x"])
    assert flight.address == str(recordings / "day 1" / "x")


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["day 1", "day 2"], "two flights are called x"),
        (["none/*"], "not one flight found"),
        (["missing.txt"], "cannot be read as a list"),
        (["name=day 1"], "2 flights there"),
        (["a\nb"], "is no name"),
    ],
)
def test_words_that_cannot_be_used(words, told, recordings):
    with pytest.raises(BatchError, match=told):
        find_flights(words)


def test_what_is_left_out_is_told(recordings):
    notes = []
    find_flights(["day 1/*", "nothing*"], notes.append)
    assert [note.partition(":")[0].rpartition("/")[2] for note in notes] == ["notes.md", "nothing*"]
