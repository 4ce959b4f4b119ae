"""One page over all flights: failures with their errors, the worst flights first with the reason, words as words."""

from __future__ import annotations

import re
from html.parser import HTMLParser

import fsspec
import pytest

from gcs.batch.jobs import DONE, FlightRecord, ScoreRecord, VehicleCall
from gcs.batch.report.overview import batch_page, judge
from tests.support.batches.short_flights import broken_flights, short_flights
from tests.support.bundled import SWARM, shortened
from tests.support.command_line import run_gcs

HOSTILE = "<script>alert(1)</script>"


class Seen(HTMLParser):
    """What a browser would make of a page."""

    def __init__(self, page):
        super().__init__()
        self.tags, self.attributes, self.words, self.rows, self.open = set(), [], "", [], []
        self.feed(page)
        assert not self.open

    def handle_starttag(self, tag, attrs):
        self.tags.add(tag)
        self.attributes += attrs
        if tag not in ("meta", "br"):
            self.open.append(tag)
        if tag == "tr":
            self.rows.append([])
        if tag in ("td", "th"):
            self.rows[-1].append("")

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.words += data
        if self.open and self.open[-1] in ("td", "th"):
            self.rows[-1][-1] += data

    def row(self, first):
        (found,) = (row for row in self.rows if row[0] == first)
        return found


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """Of flights with a truth that has others' names, with hostile words, without truth, and of broken ones."""
    folder = tmp_path_factory.mktemp("report")
    wrong, hostile, plain = short_flights(folder / "flights", 3)
    shortened(SWARM, wrong, 40)  # names are sure by then
    header, *rows = (wrong / "truth.csv").read_text().splitlines()
    turned = [re.sub(r"[2-7]$", lambda found: str((int(found[0]) - 1) % 6 + 2), row) for row in rows]
    (wrong / "truth.csv").write_text("\n".join([header, *turned]))
    toml = hostile / "session.toml"
    toml.write_text(toml.read_text().replace('"UGV-2"', f'"{HOSTILE}"'))
    (plain / "truth.csv").unlink()
    broken = broken_flights(folder)
    flights = (wrong, hostile, plain, broken["mission"], broken["gone"])
    code, _, _ = run_gcs("batch", "run", *flights, "-o", folder / "out", "-j", 1)
    assert code == 6
    return folder / "out"


@pytest.mark.slow
def test_the_page_of_a_batch(results):
    code, stdout, stderr = run_gcs("batch", "report", results)
    assert (code, stdout, stderr) == (0, f"wrote {results}/report.html\n", "")
    page = (results / "report.html").read_text()
    seen = Seen(page)
    assert not seen.tags & {"script", "link", "img", "iframe", "object", "form", "b"}
    assert ("http-equiv", "Content-Security-Policy") in seen.attributes
    assert not [value for name, value in seen.attributes if name in ("src", "action", "style")]
    anchors = {f"#{value}" for name, value in seen.attributes if name == "id"}
    assert {value for name, value in seen.attributes if name == "href"} == anchors
    assert HOSTILE in seen.words
    assert "<b>one</b>" in seen.row("broken mission")[1]
    assert "no such session folder" in seen.row("gone")[1]
    assert seen.row("gone")[-1] == "none"
    firsts = [row[0] for row in seen.rows]
    assert firsts.index("broken mission") < firsts.index("a") < min(firsts.index("b"), firsts.index("c"))
    assert seen.row("a")[1].startswith("wrong and sure for ")
    assert seen.row("c")[-1] == "–"
    assert seen.row("flights failed")[1] == "2"
    assert seen.row("flights with known truth")[1] == "2"
    (columns,) = (row for row in seen.rows if row[:2] == ["flight", "reason"])
    assert {"alarms", "right", "precision", "name changes", "calibration error"} <= set(columns)
    assert float(seen.row("b")[columns.index("precision")].rstrip("%")) > 90.0
    assert seen.row(HOSTILE)[2] == "1 of 1"
    assert run_gcs("batch", "report", results)[0] == 0, "a batch goes on, and so does its page"


@pytest.mark.slow
def test_another_place_for_the_page(results, tmp_path):
    assert run_gcs("batch", "report", results, "-o", tmp_path / "page.html")[0] == 0
    kept = (tmp_path / "page.html").read_bytes()
    code, _, stderr = run_gcs("batch", "report", results, "-o", tmp_path / "page.html")
    assert code != 0
    assert "exists already" in stderr
    assert (tmp_path / "page.html").read_bytes() == kept
    code, _, stderr = run_gcs("batch", "report", results, "-o", tmp_path / "page.html" / "below.html")
    assert code != 0
    assert "cannot be written" in stderr


@pytest.mark.slow
def test_the_page_of_a_store(results):
    memory = fsspec.filesystem("memory")
    memory.pipe_file("/reported/flights.parquet", (results / "flights.parquet").read_bytes())
    assert run_gcs("batch", "report", "memory://reported")[0] == 0
    assert memory.cat_file("/reported/report.html").startswith(b"<!DOCTYPE html>")
    memory.rm("/reported", recursive=True)


@pytest.mark.parametrize("table", [None, b"no table"])
def test_what_is_no_batch(table, tmp_path):
    if table:
        (tmp_path / "flights.parquet").write_bytes(table)
    code, _, stderr = run_gcs("batch", "report", tmp_path)
    assert code == 2
    assert "flights.parquet" in stderr
    assert "Traceback" not in stderr


def call(name, boxes=90, frames_in_view=100, first_named_s=1.0, confidence=0.99, outcome="named", silent_s=0.2):
    known = (first_named_s, confidence) if boxes else (None, None)
    return VehicleCall(
        system_id=1,
        name=name,
        first_named_s=known[0],
        boxes=boxes,
        frames_in_view=frames_in_view,
        confidence=known[1],
        outcome=outcome,
        longest_silence_s=silent_s,
    )


def record(flight, *calls, right=1.0, wrong_sure_s=0.0, strangers=0.0, alarms=0, boxes=200, unnamed=10):
    score = ScoreRecord(
        precision=right,
        coverage=1.0,
        right=right,
        fper=1.0,
        switches=0,
        idf1=right,
        track_idf1=1.0,
        ece=0.0,
        wrong_sure_s=wrong_sure_s,
        false_strangers=strangers,
    )
    return FlightRecord(
        flight=flight,
        status=DONE,
        source=f"/{flight}",
        version="1",
        versions={},
        options="{}",
        frames=100,
        span_s=10.0,
        boxes=boxes,
        unnamed=unnamed,
        vehicles=len(calls),
        named=sum(each.boxes > 0 for each in calls),
        alarms=alarms,
        warnings=0,
        marks=0,
        roll_call=calls,
        score=score,
    )


WORST_FIRST = [
    (record("much wrong", call("A"), wrong_sure_s=9.0), "wrong and sure for 9.0 s"),
    (record("wrong", call("A"), wrong_sure_s=0.5), "wrong and sure for 0.5 s"),
    (record("ours are strangers", call("A"), strangers=0.12), "12.0% of boxes surely called strangers are ours"),
    (record("alarmed", call("A"), alarms=3), "3 alarms"),
    (record("lost", call("A", silent_s=34.0), call("B", silent_s=30.0)), "up to 34 s: the whole fleet (2 vehicles)"),
    (record("one lost", call("A", silent_s=34.0), call("B")), "no position for up to 34 s: A"),
    (record("nothing seen", call("A", boxes=0), boxes=0, unnamed=0), "not one vehicle was detected"),
    (record("nobody", call("A", boxes=0)), "nobody was named"),
    (record("two never", call("A"), call("B", boxes=0), call("C", boxes=0, frames_in_view=3)), "B, C (100 frames)"),
    (record("one never", call("A"), call("B", boxes=0, frames_in_view=7)), "in view, never named: B (7 frames)"),
    (record("few right", call("A"), right=0.5), "50.0% of boxes with the right name"),
    (record("many unnamed", call("A"), unnamed=150), "75% of boxes without a name"),
    (record("late", call("A", first_named_s=42.0), call("B", first_named_s=12.0)), "A named after 42 s and 1 more"),
    (record("unsure", call("A", confidence=0.6)), "mean confidence 0.60"),
    (
        record(
            "away",
            call("A"),
            call("B", boxes=0, frames_in_view=0, outcome="never where the camera looked"),
            call("C", boxes=0, frames_in_view=0, outcome="never heard", silent_s=60.0),
        ),
        "never where the camera looked: B; never heard: C",
    ),
    (record("well", call("A")), ""),
]


def test_the_worst_flight_comes_first_with_the_reason():
    judged = sorted(map(judge, (each for each, _ in reversed(WORST_FIRST))), key=lambda each: each.order)
    assert [each.record.flight for each in judged] == [each.flight for each, _ in WORST_FIRST]
    for each, (_, reason) in zip(judged, WORST_FIRST, strict=True):
        assert reason in "; ".join(each.reasons)


def test_the_worst_is_said_first():
    page = Seen(batch_page([each for each, _ in WORST_FIRST], "here")).words
    first, _, _ = page.partition("Flights, the worst first")
    assert "17 of 24 vehicles were named" in first
    assert "much wrong: wrong and sure for 9.0 s" in first and "and 10 more, below" in first
    assert "unsure" not in first


def test_what_does_not_fit_on_the_page_is_counted(monkeypatch):
    monkeypatch.setattr("gcs.batch.report.overview.MAX_FLIGHTS", 3)
    seen = Seen(batch_page([each for each, _ in WORST_FIRST], "here"))
    assert [row[0] for row in seen.rows if row[0] in {each.flight for each, _ in WORST_FIRST}] == [
        each.flight for each, _ in WORST_FIRST[:3]
    ]
    assert "13 more better flights are in flights.parquet." in seen.words
