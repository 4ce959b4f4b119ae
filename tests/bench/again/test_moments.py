"""A replay shows what the flight showed, also where no frame came, over all that was recorded."""

import tracemalloc
from dataclasses import replace
from datetime import UTC, datetime
from itertools import pairwise

import numpy as np
import pytest

from gcs.playback.analysis import Analysis
from gcs.playback.moments import moments_between
from gcs.playback.snapshot_store import SnapshotStore
from gcs.session.session import open_session
from sim.world.presets import nominal
from sim.world.scenario import ScenarioGround
from tests.support.fake_station import START_US, make_snapshot
from tests.support.scripted import CAMERA, InjectedFaults, fly

S = 1_000_000
SCENARIO = replace(nominal(3), ground=ScenarioGround(kind="curved", vehicles=4, spacing_m=8.0), duration_s=14.0)
HOLE = InjectedFaults(no_video=((5.0, 11.0),), no_telemetry=(6.5, 10.5))
SIZE = (CAMERA.width, CAMERA.height)


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    """A session folder, and every snapshot that was on the screen."""
    shown = []
    return fly(tmp_path_factory.mktemp("flown"), SCENARIO, HOLE, shown.append), shown


def by_time(folder, tmp_path):
    """The same without the order of the flight's fold."""
    copy = tmp_path / "by time"
    copy.mkdir()
    for path in folder.iterdir():
        if path.is_file() and path.name != "folds.csv":
            (copy / path.name).write_bytes(path.read_bytes())
    return Analysis(open_session(copy, frame_size=SIZE))


def told(snapshot):
    """What a screen shows of vehicles, names and alarms; whether the video stalls is no part of a scripted flight."""
    rows = [
        (row.system_id, row.standing, row.track_id, row.confidence, row.position_state, row.heartbeat_age_s)
        for row in snapshot.vehicles
    ]
    boxes = [(box.track_id, box.system_id, box.cx, box.cy) for box in snapshot.boxes]
    alarms = [(alarm.key, alarm.since_us) for alarm in snapshot.alarms if alarm.key != "video"]
    moment = (snapshot.t_us, snapshot.frame, snapshot.seen_us, snapshot.frame_us, snapshot.now_us)
    return moment, repr(rows), boxes, alarms


@pytest.mark.slow
def test_a_replay_is_the_flight_snapshot_by_snapshot(flown):
    folder, shown = flown
    again = [snapshot for _, snapshot in Analysis(open_session(folder)).moments()]
    assert len(again) >= len(shown) > 60
    for live, replayed in zip(shown, again, strict=False):
        assert told(replayed) == told(live)
    assert all(snapshot.t_us > shown[-1].t_us for snapshot in again[len(shown) :])
    hole = [snapshot for snapshot in again if any(row.standing == "no new frame" for row in snapshot.vehicles)]
    assert len(hole) > 10 and all(not snapshot.boxes for snapshot in hole)
    assert any("silent" in alarm.key for snapshot in hole for alarm in snapshot.alarms)


@pytest.mark.slow
def test_without_the_flights_order_the_hole_is_one_too(flown, tmp_path):
    analysis = by_time(flown[0], tmp_path)
    moments = list(analysis.moments())
    times = [at_us for at_us, _ in moments]
    assert all(before < now <= before + 0.21 * S for before, now in pairwise(times))
    first, last = analysis.opened.packets_us.min(), max(analysis.opened.packets_us.max(), analysis.times_us[-1])
    assert times[0] <= first + 0.2 * S and times[-1] == last
    middle = next(snapshot for at_us, snapshot in moments if at_us > SCENARIO.start_us + 10 * S)
    assert {row.standing for row in middle.vehicles[1:]} <= {"no new frame", "no position", "out of view"}
    assert middle.health.video == "stalled" and {"video", "silent 1"} <= {alarm.key for alarm in middle.alarms}
    assert middle.frame_us == int(analysis.times_us[middle.frame]) < SCENARIO.start_us + 5 * S


@pytest.mark.slow
def test_moments_between_change_no_name(flown, tmp_path):
    analysis = by_time(flown[0], tmp_path)
    names = {
        (s.t_us, s.frame): [(b.track_id, b.system_id, b.confidence) for b in s.new_boxes] for s in analysis.snapshots()
    }
    shown = {
        (s.t_us, s.frame): [(b.track_id, b.system_id, b.confidence) for b in s.new_boxes]
        for _, s in analysis.moments()
        if s.frame_us == s.t_us
    }
    assert repr(shown) == repr(names) and any(names.values())


@pytest.mark.slow
def test_provisional_names_are_told_as_such_and_come_at_once(flown, tmp_path):
    for analysis in (Analysis(open_session(flown[0])), by_time(flown[0], tmp_path)):
        final = dict(analysis.moments())
        goal_us = SCENARIO.start_us + 13 * S
        found = [(at_us, s) for at_us, s in analysis.moments(provisional_from_us=goal_us) if at_us >= goal_us]
        assert found and all(s.provisional and not s.alarms and not s.events for _, s in found)
        at_us, last = found[-1]
        assert {row.standing for row in last.vehicles[1:]} >= {"confirmed"}
        assert {box.system_id for box in last.boxes} == {box.system_id for box in final[at_us].boxes}


def test_silence_takes_few_moments_however_long():
    year_us = 365 * 86_400 * S
    received = np.array([0, 10 * S, year_us])
    times = list(moments_between(0, year_us + S, received))
    assert len(times) < 2000 and all(before < now for before, now in pairwise(times))
    for now, after in pairwise(times):
        quiet_us = now - int(received[received <= now][-1])
        assert after - now <= max(0.2 * S, 0.021 * quiet_us) + 1
    assert year_us <= times[-1] <= year_us + S and min(abs(t - year_us) for t in times) <= 0.2 * S


def test_a_store_gives_back_what_was_put_in():
    store, base = SnapshotStore(), make_snapshot()
    for k in range(50):
        store.add(START_US + k * S, replace(base, frame=k))
    assert len(store) == 50 and (store.start_us, store.stop_us) == (START_US, START_US + 49 * S)
    for k in (0, 15, 16, 31, 47, 48, 49, 3):
        assert store.place(START_US + k * S + 1) == k
        again = store.snapshot(k)
        assert again.frame == k and again.image is None and repr(again.vehicles) == repr(base.vehicles)
    assert store.place(START_US - 1) == -1
    store.add(START_US, base)
    assert store.stop_us == START_US + 49 * S, "time does not go back"


@pytest.mark.slow
def test_an_hour_of_a_flight_takes_little_memory(flown):
    shown = [replace(snapshot, image=None) for snapshot in flown[1]] * 4
    store = SnapshotStore()
    tracemalloc.start()
    for k, snapshot in enumerate(shown):
        store.add(START_US + k * S, snapshot)
    kept, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    # 54 000 snapshots, an hour at 15 frames a second, are 160 MB at most; as they come they are more than a gigabyte
    assert len(shown) > 200 and kept / len(shown) < 3000


@pytest.mark.slow
def test_a_replay_lasts_as_long_as_the_flight(flown, tmp_path):
    analysis = by_time(flown[0], tmp_path)
    toml = tmp_path / "by time" / "session.toml"
    text = "\n".join(line for line in toml.read_text().splitlines() if not line.startswith(("started", "ended")))
    first, last = int(analysis.opened.known_us.min()), int(analysis.opened.known_us.max())
    began_us, ended_us = SCENARIO.start_us - 10 * S, SCENARIO.start_us + 120 * S
    for times, span in (
        ((began_us, ended_us), (began_us, ended_us)),
        ((began_us, last - S), (first, last)),
        ((first + S, ended_us), (first, last)),
        ((began_us, ended_us + 90_000 * S), (first, last)),
    ):
        began, ended = (datetime.fromtimestamp(t_us * 1e-6, UTC).isoformat() for t_us in times)
        toml.write_text(text.replace("[session]", f"[session]\nstarted = {began}\nended = {ended}"))
        known_us = Analysis(open_session(toml.parent, frame_size=SIZE)).opened.known_us
        assert (known_us.min(), known_us.max()) == span
