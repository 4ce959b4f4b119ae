"""The report of a flight: one file that asks for nothing, whatever the flight was and whatever its vehicles say."""

import dataclasses
import itertools
import re
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest

from gcs.mission.mission import Mission, MissionVehicle
from gcs.playback.as_flown import FlownReports
from gcs.report.page.flight_report import Provenance, flight_report
from gcs.report.page.flight_summary import FlightSummary
from gcs.report.page.html import card, whole_words
from gcs.report.page.map_drawing import draw_map
from gcs.report.page.stills import MAX_STILLS, Stills
from gcs.report.page.timeline import draw_sources
from gcs.report.score import Matched
from gcs.snapshot import Alarm, Event
from tests.support.bundled import CURVED_ROAD, shortened, swarm_session
from tests.support.command_line import run_gcs
from tests.support.snapshots import STEP, TWO_UGVS, box, snapshot

HOSTILE = "<script>alert(1)</script>\"'>&\u202e\n\0=1+1"
VOID = {"meta", "img", "br"}


class Page(HTMLParser):
    """Checks that elements are closed in order; collects tags, links and words."""

    def __init__(self, text):
        super().__init__()
        self.open, self.tags, self.links, self.words = [], set(), [], []
        self.feed(text)
        assert not self.open

    def handle_starttag(self, tag, attrs):
        self.tags.add(tag)
        self.links += [value for name, value in attrs if name in ("src", "href", "action", "data", "srcset")]
        assert not [name for name, _ in attrs if name.startswith("on")]
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.handle_starttag(tag, attrs)
        self.handle_endtag(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if self.open and self.open[-1] != "style":
            self.words.append(data)

    @property
    def text(self):
        return " ".join(" ".join(self.words).split())


def report(snapshots, matched=None, name="x"):
    snapshots = list(snapshots)
    start_us, stop_us = (snapshots[0].t_us, snapshots[-1].t_us) if snapshots else (0, 0)
    record, stills = FlightSummary(TWO_UGVS, start_us, stop_us, 0.1), Stills()
    told = FlownReports((), start_us, stop_us)
    for each in snapshots:
        record.add(each.t_us, each)
        told.add(each.t_us, each.events, each.alarms)
        stills.add(each)
    record.set_reports(told.spans(), told.events())
    about = Provenance(name=name, lacks=(name,), settings={name: name}, files={name: name}, imported=((name, name),))
    return flight_report(record, stills, matched, about)


def check_alone(text):
    """It names nothing outside of itself, runs nothing, and is well formed."""
    page = Page(text)
    assert "content=\"default-src 'none'; style-src 'unsafe-inline'; img-src data:\"" in text
    assert not page.tags & {"script", "iframe", "object", "embed", "link", "form", "base"}
    anchors = set(re.findall(r'<section id="([^"]+)"', text))
    assert all(link.startswith("data:image/jpeg;base64,") or link[1:] in anchors for link in page.links)
    assert not re.search(r"url\(|@import|https?://", text)
    assert "nan" not in re.findall(r"[a-z]+", page.text.lower())
    return page


def test_sources_of_an_import_are_on_one_time_line():
    spans = [("video", [(0.0, 20.0)]), ("ugv <11>", [(-40.0, 3.0), (8.0, 140.0)]), ("silent", [])]
    drawing = draw_sources(spans)
    assert drawing.count("<rect") == 3 and "ugv &lt;11&gt;" in drawing and "silent" not in drawing
    assert re.findall(r">(−?\d+:\d\d)<", drawing) == ["−0:30", *(f"{k // 2}:{k % 2 * 30:02}" for k in range(5))]
    film, tick = (float(re.search(rf'<{what}="([\d.]+)', drawing)[1]) for what in ("rect x", 'text class="ink" x'))
    assert film > tick  # which is half a minute earlier
    assert draw_sources([]) == draw_sources([("a", [(1.0, 1.0)])]) == ""


@pytest.mark.slow_but_first
@pytest.mark.parametrize("frames", [24, 320])
def test_the_bundled_flight(frames, tmp_path):
    flight = shortened(CURVED_ROAD, tmp_path / "flight", frames)
    code, _, told = run_gcs("report", flight, "-o", tmp_path / "report.html")
    assert code == 0, told
    text = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert len(text.encode()) < 2_000_000
    page = check_alone(text)
    assert "6 of 7 vehicles were named" in page.text
    assert page.text.count("UGV-17") >= 2
    assert {"svg", "img", "table", "h1", "h2", "h3"} <= page.tags
    # the file that was read can be told from any other
    assert re.search(r"telemetry\.tlog\s+[0-9a-f]{64}", page.text)
    code, _, told = run_gcs("report", flight, "-o", tmp_path / "report.html")
    assert code == 2
    assert "never overwritten" in told


@pytest.mark.slow
def test_a_recording_without_video_and_truth(tmp_path):
    folder = swarm_session(tmp_path, frames=60, without=("truth.csv",))
    code, _, told = run_gcs("report", folder, "-o", tmp_path / "report.html")
    assert code == 0, told
    page = check_alone((tmp_path / "report.html").read_text(encoding="utf-8"))
    assert "no video" in page.text
    assert "no truth (truth.csv)" in page.text
    assert "img" not in page.tags


@pytest.mark.parametrize("count", [0, 1, 2])
def test_flights_of_hardly_any_frame(count):
    page = check_alone(report(snapshot(k, boxes=[box(1, 2)]) for k in range(count)))
    assert f"{min(count, 1)} of 2 vehicles were named" in page.text
    assert "No vehicle told where it was" in page.text


def test_words_from_the_air_and_of_files_stay_words():
    alarm = Alarm(key="a", level="alarm", kind="link", text=HOSTILE, advice=HOSTILE, since_us=0)
    event = Event(t_us=1, level="warning", kind="identity", text=HOSTILE)
    image = np.zeros((48, 64, 3), np.uint8)
    flown = [snapshot(k, boxes=[box(1, 2)], image=image, events=[event]) for k in range(3)]
    flown = [type(each)(**{f: getattr(each, f) for f in each.__slots__} | {"alarms": (alarm,)}) for each in flown]
    text = report(flown, name=HOSTILE)
    page = check_alone(text)
    assert text.count("<script") == 0
    assert page.text.count("<script>alert(1)</script>") >= 6
    assert not set(text) & {"\u202e", "\0"}


def test_a_warning_about_a_vehicle_names_it():
    event = Event(t_us=1, level="warning", kind="vehicle", text="position not used: no fix (0/0)", system_id=11)
    page = check_alone(report([replace(snapshot(0), events=(event,))]))
    assert f"{TWO_UGVS.name_of(11)}: position not used: no fix (0/0)" in page.text


def test_a_box_without_a_name_gets_none_here():
    image = np.zeros((48, 64, 3), np.uint8)
    likely = box(1, 0, runner_up=2, runner_up_confidence=0.6)
    page = check_alone(report(snapshot(k, boxes=[likely], image=image) for k in range(80)))
    assert "0 of 2 vehicles were named" in page.text
    assert "confirmed first:" not in page.text
    assert "nobody" in page.text


def test_pictures_are_few_whatever_happens():
    image = np.random.default_rng(1).integers(0, 255, (1080, 1920, 3), dtype=np.uint8)
    stills, record = Stills(), FlightSummary(TWO_UGVS, 0, 1200 * STEP, 0.1)
    for k in range(60):
        event = Event(t_us=1, level="warning", kind="identity", text="a name changed")
        stills.add(snapshot(20 * k, boxes=[box(k + 1, 2)], image=image, events=[event]))
    drawn = stills.drawn(record)
    assert 1 <= drawn.count("<img") <= sum(MAX_STILLS.values())
    assert len(drawn) < 2_000_000


def test_means_are_of_every_box_however_long_the_flight():
    near_and_far = (snapshot(k, boxes=[box(1, 2, residual_m=1.0 if k % 4 else 5.0)]) for k in range(4000))
    assert "mean 2.00 m, most 5.00 m" in check_alone(report(near_and_far)).text


def test_times_of_first_names_are_counted_as_all_others_from_the_begin_of_the_flight():
    before = (replace(snapshot(k), seen_us=0) for k in range(30))
    named = (
        snapshot(30 + k, boxes=[replace(box(1, 2), confidence=0.7 if k < 5 else 0.95)] * (k >= 2)) for k in range(9)
    )
    text = check_alone(report((*before, *named))).text
    assert "first named 0:03.2" in text and "first confirmed 0:03.5" in text


def test_names_on_the_map_stand_apart_where_tracks_end_together():
    fleet = tuple(MissionVehicle(system_id=k, name=f"UGV-{k}") for k in range(2, 10))
    record = FlightSummary(Mission(uav=MissionVehicle(system_id=1), ugv=fleet), 0, 7 * STEP, 0.1)
    for k, vehicle in enumerate(record.vehicles.values()):
        vehicle.reported[:] = [(-300.0, 60.0), (2.0 * k, -60.0)]
    names = re.findall(r'<text class="c\d halo" x="(\d+)" y="(\d+)">(.*?)</text>', draw_map(record))
    assert sorted(name for *_, name in names) == [f"UGV-{k}" for k in range(2, 10)]
    places = [(int(x), int(y), 9 * len(name)) for x, y, name in names]
    for (x, y, width), (other_x, other_y, other_width) in itertools.combinations(places, 2):
        assert abs(y - other_y) >= 16 or x + width <= other_x or other_x + other_width <= x


def test_alarms_of_the_time_line_have_their_numbers_in_the_list():
    alarms = [Alarm(key=k, level="alarm", kind="link", text=f"link {k}", advice="x", since_us=0) for k in "ab"]
    flown = [dataclasses.replace(snapshot(k), alarms=tuple(alarms[: 1 + (k > 20)])) for k in range(40)]
    text = report(flown)
    drawn = re.findall(r"<title>(link \w)</title></rect><text [^>]*>(\d)</text>", text)
    listed = re.findall(r"(\d)\s+0:\d\d\.\d\s+0:\d\d\.\d\s+alarm\s+(link \w)", check_alone(text).text)
    assert drawn == [(what, number) for number, what in listed] == [("link a", "1"), ("link b", "2")]


def first_screen(page):
    return page.text.partition("Parts of this page")[0].partition("Roll call")[0]


DOUBT = Alarm(
    key="d", level="alarm", kind="vehicle", text="jumped", advice="x", since_us=0, system_id=2, doubts_name=True
)
MARK = Event(t_us=1, level="info", kind="mark", text="behind the barn", system_id=2)
ASKED_FIRST = [  # of nine frames, what is said, and what besides
    ({"boxes": [box(1, 2)]}, "confirmed: Alpha", "nothing that is known of"),
    ({"boxes": [replace(box(1, 2), confidence=0.6)]}, "tentative: Alpha", "60% sure, on average"),
    ({"boxes": []}, "0 of 2 vehicles were named", "never named: UGV-3 (never heard)"),
    ({"boxes": [box(1, 0), box(2, 2)]}, "50.0% of the boxes have no name", "no truth"),
    ({"alarms": (DOUBT,)}, "1 alarm, 0 warnings", "jumped ("),
    ({"alarms": (DOUBT,)}, "its name in doubt for", "Alpha"),
    ({"events": (MARK,)}, "marked: Alpha: behind the barn", "0 alarms, 0 warnings, 9 marks"),
]


@pytest.mark.parametrize(("seen", "told", "besides"), ASKED_FIRST)
def test_what_is_asked_first_is_said_first(seen, told, besides):
    flown = [dataclasses.replace(snapshot(k), **seen) for k in range(9)]
    first = first_screen(check_alone(report(flown, name="no truth")))
    assert told in first and besides in first


def test_two_alarms_at_once_doubt_a_name_no_longer_than_one():
    first, second = (replace(DOUBT, key=key, since_us=snapshot(k).t_us) for key, k in (("a", 1), ("b", 4)))
    flown = [replace(snapshot(k), alarms=(first,) * (1 <= k <= 6) + (second,) * (4 <= k <= 8)) for k in range(9)]
    assert "Alpha: its name in doubt for 0:00.7" in first_screen(check_alone(report(flown)))


def test_a_name_with_a_hyphen_is_never_broken_at_it():
    assert card("Who", ("1", "named"), [("confirmed: UGV-2, <UGV>-11", "")]).count('<span class="whole">') == 2
    assert whole_words("a – b, c") == "a – b, c"
    assert '<span class="whole">&lt;UGV&gt;-11</span>' in whole_words("of <UGV>-11")
    assert "span" not in whole_words("a-" * 20), "it may be wider than a phone"


def test_a_name_holds_until_the_next_look_and_a_second_at_most():
    flown = [snapshot(k, boxes=[box(1, 2)]) for k in (0, 1, 2, 60)]
    record = FlightSummary(TWO_UGVS, flown[0].t_us, flown[-1].t_us, 0.1)
    for each in flown:
        record.add(each.t_us, each)
    assert record.vehicles[2].named_us == 2 * STEP + 1_000_000


def test_confidences_that_come_true_lie_on_the_diagonal():
    n = 1000
    right = np.arange(n) % 10 > 0
    matched = Matched(
        frame=np.arange(n),
        time_us=np.arange(n) * 1e5,
        truth=np.full(n, 2),
        named=np.where(right, 2, 3),
        track=np.ones(n, np.int64),
        confidence=np.full(n, 0.9),
    )
    page = check_alone(report([snapshot(0)], matched))
    assert re.search(r"0\.9–0\.95\s+1000\s+90\.0%\s+90\.0%", page.text)
    assert "90.00%" in page.text
