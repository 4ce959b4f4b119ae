"""Identification as programs call it: files and a roll call, and not a word printed."""

import pytest

from gcs.errors import SessionError
from gcs.playback.identification import identify_session
from gcs.session.session import open_session
from tests.support.bundled import CURVED_ROAD, shortened


def test_it_writes_what_the_command_writes_and_prints_nothing(tmp_path, capfd):
    session = open_session(shortened(CURVED_ROAD, tmp_path / "flown", 20))
    done, notes = [], []
    calls = identify_session(
        session, tmp_path / "out", report=lambda now, total: done.append((now, total)), note=notes.append
    )
    assert capfd.readouterr() == ("", "")
    assert done == [(k + 1, 20) for k in range(20)]
    assert calls.named >= 5
    assert all("\n" not in text for text in notes)
    assert {path.name for path in (tmp_path / "out").iterdir()} == {"identity.csv", "identity.jsonl", "events.jsonl"}


def test_it_overwrites_nothing(tmp_path):
    session = open_session(shortened(CURVED_ROAD, tmp_path / "flown", 5))
    identify_session(session, tmp_path / "out")
    before = (tmp_path / "out" / "identity.csv").read_bytes()
    with pytest.raises(SessionError, match=r"identity\.csv"):
        identify_session(session, tmp_path / "out")
    assert (tmp_path / "out" / "identity.csv").read_bytes() == before


def test_what_is_broken_off_leaves_nothing(tmp_path):
    session = open_session(shortened(CURVED_ROAD, tmp_path / "flown", 5))

    def fail(now, total):
        assert not (tmp_path / "out" / "identity.csv").exists()
        raise RuntimeError(f"{now} of {total}")

    with pytest.raises(RuntimeError, match="1 of 5"):
        identify_session(session, tmp_path / "out", report=fail)
    assert list((tmp_path / "out").iterdir()) == []


def test_a_file_that_appears_meanwhile_is_not_overwritten(tmp_path):
    session = open_session(shortened(CURVED_ROAD, tmp_path / "flown", 5))
    other = tmp_path / "out" / "identity.jsonl"
    with pytest.raises(SessionError, match=r"identity\.jsonl: exists already"):
        identify_session(session, tmp_path / "out", report=lambda *_: other.write_text("another's"))
    assert other.read_text() == "another's"
    assert not (tmp_path / "out" / "identity.csv").exists()
