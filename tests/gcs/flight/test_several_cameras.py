"""Two cameras over one fleet in one flight: whose turn it is, what each tells beside the other, and the recording."""

import json
import threading
from dataclasses import replace
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest

from gcs.cli.identify import identify_into
from gcs.errors import SessionError
from gcs.flight.flight import Flight
from gcs.flight.plan import FlightPlan
from gcs.flight.video import FlightVideo
from gcs.flight.view import FlightView
from gcs.flight.views import OVERDUE_S, FlightViews, beside
from gcs.mission.mission import View, parse_mission
from gcs.report.vehicle_names import shown_names
from gcs.session.recorder import Recorder
from gcs.session.session import open_session
from gcs.snapshot import Alarm, Event
from mavlink.geodesy import LocalFrame
from sim import live
from sim.world.presets import nominal
from sim.world.scenario import ScenarioCamera
from tests.support.fake_station import make_snapshot
from tests.support.ports import free_port
from tests.support.waiting import until

MISSION = parse_mission(
    {"uav": {"system_id": 1}, "ugv": [{"system_id": i} for i in range(11, 18)], "view": [{"system_id": 2}]}, "here"
)
SMALL = ScenarioCamera(width=640, height=360, fx=400.0, fy=400.0, cx=320.0, cy=180.0)


def a_view(system_id, name, snapshot=None):
    view = FlightView.__new__(FlightView)
    mission = SimpleNamespace(uav=SimpleNamespace(system_id=system_id), name_of=lambda _: name, ugv_ids=MISSION.ugv_ids)
    view.pipeline = SimpleNamespace(mission=mission, naming=SimpleNamespace())
    view.loop, view.recorder = SimpleNamespace(latest=snapshot), SimpleNamespace(heard=None)
    return view


@pytest.mark.parametrize(
    ("looked_s", "last", "want"),
    [
        ({0: 9.9, 1: 9.9, 2: 9.8}, 0, [0, 2, 1]),  # nobody waits too long
        ({0: 9.9, 1: 9.5, 2: 9.8}, 0, [1, 0, 2]),  # one does
        ({0: 9.9, 1: 9.5, 2: 9.4}, 0, [2, 1, 0]),
        ({0: 9.5, 1: 9.9, 2: 9.4}, 1, [0, 2, 1]),  # after another one it is the focus's turn
    ],
)
def test_the_camera_in_focus_is_looked_at_most_often_and_no_other_one_is_forgotten(looked_s, last, want):
    assert 10.0 - 9.8 < OVERDUE_S < 10.0 - 9.5
    views = FlightViews(lambda place, snapshot: None)
    for place in looked_s:
        views.add(place, a_view(place + 1, f"UAV-{place + 1}"))
    views._looked_s, views._last = looked_s, last
    assert views.order(0, 10.0) == want
    assert [(views.show_next(), views.place)[1] for _ in range(3)] == [1, 2, 0]


def alarm(key, kind, system_id=0):
    return Alarm(key=key, level="alarm", kind=kind, text=key, advice="", since_us=1, system_id=system_id)


def test_what_another_camera_tells_stands_beside_what_this_one_does():
    base = make_snapshot(live=True)
    stopped, silent = alarm("video", "video"), alarm("silent 11", "vehicle", 11)
    lone, doubted = alarm("silent 2", "vehicle", 2), alarm("contradicted 12", "identity", 12)
    here = a_view(1, "UAV", replace(base, alarms=(stopped, silent, doubted)))
    there = a_view(2, "Mast", replace(base, alarms=(stopped, silent, lone)))
    shown = beside(here.loop.latest, here, [there])
    told = {(each.text, each.system_id) for each in shown.alarms}
    of_cameras = {("UAV: video", 1), ("Mast: video", 2), ("UAV: contradicted 12", 12)}
    assert told == of_cameras | {(each.text, each.system_id) for each in (silent, lone)}
    assert {here.own(each) for each in shown.alarms} == {None, stopped, silent, lone, doubted}
    (theirs,) = beside(replace(base, alarms=()), there, [a_view(3, "Pole", replace(base, alarms=(doubted,)))]).alarms
    assert theirs.text == "Pole: contradicted 12" and there.own(theirs) is not None, "seen once, seen of all"
    named = {row.system_id for row in base.vehicles if row.standing == "confirmed" and row.role == "ugv"}
    assert named <= {row.system_id for row in shown.vehicles if row.elsewhere == ("Mast",)}
    lapsed = replace(base, vehicles=tuple(replace(row, standing="no new frame") for row in base.vehicles))
    assert not any(row.elsewhere for row in beside(base, here, [a_view(2, "Mast", lapsed)]).vehicles)


def test_another_camera_s_aircraft_and_what_it_sees_are_in_the_place_of_this_one():
    base = replace(make_snapshot(live=True), origin=LocalFrame(48.1, 11.6, 550.0))
    moved = LocalFrame(base.origin.lat_deg, base.origin.lon_deg + 1e-3, base.origin.alt_m)
    uav, *rest = base.vehicles
    second = replace(base, origin=moved, vehicles=(replace(uav, system_id=2, name="Mast"), *rest))
    there = a_view(2, "Mast", second)
    shown = beside(base, a_view(1, "UAV", base), [there])
    assert [row.role for row in shown.vehicles[:3]] == ["uav", "uav", "ugv"]
    east_m = 1e-3 * 111_320 * np.cos(np.radians(base.origin.lat_deg))
    assert shown.vehicles[1].p_enu - base.vehicles[0].p_enu == pytest.approx([east_m, 0, 0], abs=0.5)
    assert shown.footprints_elsewhere[0] - base.footprint_enu == pytest.approx(np.tile([east_m, 0], (4, 1)), abs=0.5)
    assert {each.short for each in shown_names(shown, lambda _: True).values()} >= {"1", "2"}
    nowhere = a_view(2, "Mast", replace(base, origin=None))
    assert np.isnan(beside(base, a_view(1, "UAV", base), [nowhere]).vehicles[1].p_enu).all()


def two_views():
    views = FlightViews(lambda place, snapshot: None)
    for place, view in enumerate((a_view(1, "UAV"), a_view(2, "Mast"))):
        views.add(place, view)
    return views


def test_events_of_a_camera_say_which_one_and_those_of_the_fleet_come_once():
    views = two_views()
    events = [
        Event(t_us=1, level="info", kind=kind, text=kind, system_id=who, alarm=key)
        for kind, who, key in (("video", 0, ""), ("vehicle", 11, ""), ("vehicle", 2, ""), ("operator", 11, "silent"))
    ]
    for view in views.all.values():
        views.take(view, replace(make_snapshot(live=True), events=tuple(events)))
    first = ["UAV: video", "vehicle", "vehicle", "operator"]
    assert [each.text for each in views.events()] == [*first, "Mast: video", "vehicle"]


def test_what_became_of_a_name_stated_in_another_camera_is_told():
    views = two_views()
    stated = Event(t_us=1, level="warning", kind="operator", text="stated: track 3 is Bus", system_id=11)
    for view in views.all.values():
        views.take(view, replace(make_snapshot(live=True), events=(stated,)))
    assert [each.text for each in views.events()] == [stated.text, f"Mast: {stated.text}"]


def test_a_camera_whose_turn_fails_costs_no_other_one_its_turn():
    views, turned = two_views(), []
    for place, view in views.all.items():
        view.video, view.turned_s = SimpleNamespace(stream=None, latest=lambda _: None), 0.0
        view.newest = lambda: None
        view.loop = SimpleNamespace(frames_wait=False, run_once=partial(fail_or_note, turned, place))
    with pytest.raises(ZeroDivisionError):
        views.turn(lambda _: False)
    assert sorted(turned) == [0, 1]


def fail_or_note(turned, place, frame):
    turned.append(place)
    if place == 0:
        raise ZeroDivisionError


@pytest.mark.parametrize("trouble", ["", "no space left on device"])
def test_whether_another_camera_s_video_is_recorded_is_told(trouble):
    video = FlightVideo("", None)
    video._reported = ("", "" if trouble else "gone", 0)
    stream = SimpleNamespace(error="", recording_error=trouble, restarts=0, exposure="", sender=None, strangers=0)
    (event,) = video._changes(stream)
    assert "recorded" in event.text and event.is_of(2)


def test_a_further_camera_has_a_folder_of_its_own(tmp_path, caplog):
    caplog.set_level("INFO")
    recorder = Recorder(tmp_path, MISSION, video=True, views=[2])
    (further,) = recorder.further
    of_the_fleet = Event(t_us=1, level="warning", kind="vehicle", text="UGV-11 is silent", system_id=11)
    for each in (recorder, further):
        each.events((Event(t_us=1, level="info", kind="video", text="video ok"), of_the_fleet))
    assert [record.message for record in caplog.records] == [
        "video: video ok",
        "vehicle: UGV-11 is silent",
        "view-2: video: video ok",
    ]
    further.frame_time(0, 5)
    assert "view-2/frames.csv" in recorder.states() and recorder.bytes > 0
    (recorder.folder / "view-3").write_text("")
    with pytest.raises(SessionError, match="view-3: cannot be made"):
        recorder._view_folder(3)
    recorder.close()
    assert (recorder.folder / "view-2" / "frames.csv").read_text().endswith("\n0,5\n")
    further.folder.rename(tmp_path / "moved")
    assert recorder.bytes > 0


@pytest.mark.slow
def test_both_cameras_of_a_flight_are_recorded_and_named_again_alike(tmp_path, monkeypatch):
    scenario = replace(nominal(3), camera=SMALL, fps=5.0, duration_s=60.0).filmed_by(2)
    urls = [f"udp://127.0.0.1:{free_port()}" for _ in range(2)]
    monkeypatch.setattr(live, "_nth_url", lambda _, k: urls[k])
    port, stop = free_port(), threading.Event()
    mission = replace(MISSION, view=(View(system_id=2, video="auto"),))
    plan = FlightPlan(mission=mission, links=(f"udpin:127.0.0.1:{port}",), video="auto", sessions=tmp_path)
    seen = {0: set(), 1: set()}
    flight = Flight(plan, lambda place, now: seen[place].update(box.system_id for box in now.boxes))
    fleet = threading.Thread(
        target=live.play,
        args=(scenario, f"udpout:127.0.0.1:{port}", urls[0]),
        kwargs={"stop": stop, "tells_camera": True},
    )
    fleet.start()
    try:
        assert until(lambda: all(len(ids - {0}) >= 3 for ids in seen.values()))
        assert until(lambda: any(row.elsewhere == ("UAV-2",) for row in flight.latest().vehicles))
        assert flight.title.endswith("from UAV") and flight.next_view() is flight
        assert until(lambda: flight.title.endswith("from UAV-2") and flight.latest().vehicles[0].system_id == 2)
    finally:
        stop.set()
        fleet.join()
        flight.stop()
    identify_into(open_session(flight.folder), tmp_path / "again")
    for folder in ("", "view-2"):
        live_rows, again = (
            (path / folder / "identity.jsonl").read_text().splitlines() for path in (flight.folder, tmp_path / "again")
        )
        assert live_rows == again
        assert any(json.loads(row)["system_id"] for row in live_rows)
    heard = [path for path in flight.folder.rglob("elsewhere.csv") if len(path.read_text().splitlines()) > 1]
    assert heard, "who is looked at later has heard of the other one"
