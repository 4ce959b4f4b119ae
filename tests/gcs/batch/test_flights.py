"""Which flights the words of a command line stand for."""

from __future__ import annotations

import os

import fsspec
import pytest

from gcs.batch.flights import fetch, find_flights
from gcs.errors import BatchError, StoreError


@pytest.fixture
def recordings(tmp_path, monkeypatch):
    for name in ("day 1/x", "day 1/y", "day 2/x"):
        (tmp_path / name).mkdir(parents=True)
        (tmp_path / name / "telemetry.tlog").write_bytes(b"")
    for view in ("two/view-2", "two/view-3"):
        (tmp_path / view).mkdir(parents=True)
    (tmp_path / "two" / "telemetry.tlog").write_bytes(b"")
    (tmp_path / "two" / "view-2" / "frames.csv").write_text("frame,time_us\n0,1\n")
    (tmp_path / "two" / "view-3" / "frames.csv").write_text("frame,time_us\n")
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
        # of two cameras
        (["two"], {"two": "two", "two.view-2": "two/view-2"}),
        (["mine=two"], {"mine": "two", "mine.view-2": "two/view-2"}),
        (["two/view-2"], {"two.view-2": "two/view-2"}),
        # what is not there is a broken flight of its own
        (["empty", "gone"], {"empty": "empty", "gone": "gone"}),
    ],
)
def test_words(words, expected, recordings):
    found = find_flights(words)
    assert {flight.name: flight.address for flight in found} == {
        name: str(recordings / path) for name, path in expected.items()
    }


def test_a_list_is_named_as_one(recordings):
    (recordings / "day 2" / "all.txt").write_text("# of May\n\n../day 1/y\nother=x\n")
    found = find_flights(["lone.tlog"], lists=[recordings / "day 2" / "all.txt"])
    assert {flight.name: flight.address for flight in found} == {
        "lone": str(recordings / "lone.tlog"),
        "y": str(recordings / "day 1" / "y"),
        "other": str(recordings / "day 2" / "x"),
    }


def test_nothing_else_is_obeyed_as_a_list(recordings):
    """A README among the flights, and a list that names itself."""
    notes = []
    (recordings / "day 1" / "README.txt").write_text("http://127.0.0.1:1/x\n")
    (recordings / "loop.txt").write_text("loop.txt\nlone.tlog\n")
    found = find_flights(["day 1/*"], notes.append, lists=[recordings / "loop.txt"])
    assert [flight.address.rpartition("/")[2] for flight in found] == ["x", "y"] or len(found) == 3
    assert all("--list" in note for note in notes) and len(notes) == 3


@pytest.mark.parametrize("kind", ["pipe", "device", "absent", "binary", "zero"])
def test_what_is_no_list(kind, recordings):
    path = recordings / "list.txt"
    if kind == "pipe":
        os.mkfifo(path)
    elif kind == "device":
        path.symlink_to("/dev/zero")
    elif kind == "binary":
        path.write_bytes(b"\xff\xfe")
    elif kind == "zero":
        path.write_bytes(b"a\0b")
    with pytest.raises(BatchError, match="cannot be read as a list"):
        find_flights([], lists=[path])


def test_a_file_address_is_a_path(recordings):
    (flight,) = find_flights([f"file://{recordings}/day 1/x"])
    assert flight.address == str(recordings / "day 1" / "x")


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["day 1", "day 2"], "two flights are called x"),
        (["none/*"], "not one flight found"),
        (["name=day 1"], "2 flights there"),
        (["a\nb"], "is no name"),
        (["a" * 300], "File name too long"),
        (["a" * 300 + "=b"], "File name too long"),
    ],
)
def test_words_that_cannot_be_used(words, told, recordings):
    with pytest.raises(BatchError, match=told):
        find_flights(words)


def test_what_is_left_out_is_told(recordings):
    notes = []
    find_flights(["day 1/*", "nothing*"], notes.append)
    assert [note.partition(":")[0].rpartition("/")[2] for note in notes] == ["notes.md", "nothing*"]


def test_a_flight_without_end_is_broken_off(tmp_path, monkeypatch):
    monkeypatch.setattr("gcs.batch.flights.MAX_FETCH_BYTES", 10_000_000)
    files = fsspec.filesystem("memory")
    files.pipe_file("/endless/flight.tlog", bytes(20_000_000))
    with pytest.raises(StoreError, match="for one flight"):
        fetch("memory://endless/flight.tlog", tmp_path / "flight.tlog")
    files.rm("/endless", recursive=True)
    assert (tmp_path / "flight.tlog").stat().st_size < 20_000_000


def test_a_link_to_itself_is_refused_in_a_line(tmp_path):
    (tmp_path / "flight").symlink_to("flight")
    with pytest.raises(BatchError, match=r"flight: (links that lead in a circle|Too many levels)"):
        find_flights([str(tmp_path / "flight")])
