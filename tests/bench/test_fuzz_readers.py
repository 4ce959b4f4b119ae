"""Every reader on damaged files and in hostile places; ``python -m bench.fuzz readers`` runs more."""

import pytest

from bench.fuzz.readers import PLACES, READERS, ReaderScore, fuzz_places, fuzz_readers
from tests.support.bundled import ROOT

pytestmark = pytest.mark.slow

GOOD = ROOT / "tests" / "corpus" / "readers"
SEEDS = range(2)


def total(scores):
    whole = ReaderScore()
    for score in scores:
        whole.add(score)
    return whole


@pytest.mark.parametrize("kind", READERS)
def test_damaged_files_are_read_or_refused(kind):
    score = total(fuzz_readers(GOOD, SEEDS, only=kind))
    assert score.failures == []
    assert score.read + score.refused == len(SEEDS) * len([path for path in (GOOD / kind).rglob("*") if path.is_file()])


@pytest.mark.parametrize("kind", READERS)
def test_nothing_in_the_place_of_a_file_stops_or_hangs(kind):
    score = total(fuzz_places(GOOD, only=kind))
    assert score.failures == []
    assert score.refused >= len(PLACES) - 2


def test_what_goes_wrong_is_found(monkeypatch):
    def fails(path):
        raise LookupError(path)

    monkeypatch.setitem(READERS, "lists", fails)
    score = total(fuzz_readers(GOOD, range(1), only="lists"))
    assert score.read == score.refused == 0 and "LookupError" in score.failures[0]
