"""A place of a recording that is not analysed yet shows its frame and nothing old, and is worked out first."""

import threading
from dataclasses import replace

import pytest

from gcs.playback.analysis import Analysis
from gcs.playback.preview import Preview
from gcs.playback.replay import Replay
from gcs.session.session import open_session
from sim.world.presets import nominal
from sim.world.scenario import ScenarioGround
from tests.support.bundled import CURVED_ROAD
from tests.support.fake_station import make_snapshot
from tests.support.scripted import CAMERA, InjectedFaults, fly
from tests.support.snapshots import boxes
from tests.support.waiting import until

pytestmark = pytest.mark.slow

S = 1_000_000
SCENARIO = replace(nominal(3), ground=ScenarioGround(kind="curved", vehicles=4, spacing_m=8.0), duration_s=16.0)
END_US = SCENARIO.start_us + 15 * S


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return fly(tmp_path_factory.mktemp("flown"), SCENARIO, InjectedFaults())


@pytest.fixture
def held_up(folder, monkeypatch):
    """A replay whose analysis stops at the fifth second, and whose preview does not begin, until they are let go on."""
    final, provisional = threading.Event(), threading.Event()
    begin = Analysis.moments

    def moments(self, flown=(), provisional_from_us=None):
        for at_us, snapshot in begin(self, flown, provisional_from_us):
            if provisional_from_us is not None:
                provisional.wait(300)
            elif at_us > SCENARIO.start_us + 5 * S and replay.now_us <= SCENARIO.start_us + 5 * S:
                final.wait(300)
            yield at_us, snapshot

    monkeypatch.setattr(Analysis, "moments", moments)
    replay = Replay(open_session(folder, frame_size=(CAMERA.width, CAMERA.height)))
    replay.pause()
    yield replay, final, provisional
    final.set()
    provisional.set()
    replay.stop()


def shown(replay, condition):
    assert until(lambda: replay.latest() is not None and condition(replay.latest())), replay.error
    return replay.latest()


def test_what_is_not_analysed_is_blank_then_provisional_then_final(held_up):
    replay, final, provisional = held_up
    named = shown(replay, lambda snapshot: snapshot.analysed)
    assert named.vehicles and not named.provisional
    assert until(lambda: replay.analysed and replay.analysed[-1][1] >= SCENARIO.start_us + 4 * S)
    replay.seek(END_US)
    final.set()
    blank = shown(replay, lambda snapshot: not snapshot.analysed)
    assert not (blank.vehicles or blank.boxes or blank.alarms)
    assert blank.frame > named.frame and abs(blank.frame_us - END_US) < S and abs(blank.t_us - END_US) < S
    assert replay.analysed == [(replay.start_us, replay.analysed[-1][1])] and replay.analysed[-1][1] < END_US
    provisional.set()
    soon = shown(replay, lambda snapshot: snapshot.provisional or not replay.title.endswith(")"))
    assert soon.provisional and sum(row.standing == "confirmed" for row in soon.vehicles) == 4
    last = shown(replay, lambda snapshot: snapshot.analysed and not snapshot.provisional)
    assert abs(last.t_us - END_US) < S and until(lambda: not replay.title.endswith(")"))
    assert replay.analysed == [(replay.start_us, replay.stop_us)]


def test_an_analysis_that_has_passed_has_no_second_one_beside_it():
    begun = []

    def begin(from_us):
        begun.append(from_us)
        return iter([(from_us + k * S, replace(make_snapshot(), frame=k)) for k in range(30)])

    preview = Preview(begin)
    while preview.wants(100 * S):
        preview.advance(100 * S)
    assert begun == [99 * S] and preview.at(98 * S) is None
    store, number = preview.at(100 * S)
    assert store.snapshot(number).frame == 1 and len(store) < 8, "not much further than where one looks"
    while preview.wants(105 * S):
        preview.advance(105 * S)
    assert begun == [99 * S], "near places go on from there"
    assert preview.wants(90 * S) and preview.wants(500 * S)
    preview.advance(500 * S)
    assert begun == [99 * S, 499 * S] and preview.at(100 * S) is None
    preview.clear()
    assert preview.at(500 * S) is None


def test_a_preview_that_finds_nothing_is_not_begun_for_ever():
    begun = []
    preview = Preview(lambda from_us: iter(begun.append(from_us) or ()))
    for _ in range(10):
        if preview.wants(S):
            preview.advance(S)
    assert len(begun) == 1


def test_frames_without_recorded_boxes_are_looked_at_from_shortly_before(monkeypatch):
    """Of a place in the middle the detector sees the last seconds, not all of the video."""
    asked = []

    class Detector:
        def detect(self, image, *, gsd_m=None):
            asked.append(gsd_m)
            return boxes([(image.shape[1] / 2, image.shape[0] / 2)])

    analysis = Analysis(open_session(CURVED_ROAD))
    monkeypatch.setattr(analysis, "detector", Detector)
    goal_us = int(analysis.times_us[0]) + 14 * S
    moments = analysis.moments(provisional_from_us=goal_us)
    shown = next(snapshot for at_us, snapshot in moments if at_us >= goal_us)
    moments.close()
    analysis.close()
    assert shown.boxes and shown.frame_us >= goal_us and not shown.held
    between = int(((analysis.times_us > goal_us - 5 * S) & (analysis.times_us < goal_us + S)).sum())
    assert 0 < len(asked) <= between and all(asked)
