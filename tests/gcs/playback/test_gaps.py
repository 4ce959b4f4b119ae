"""What a replay's time line knows of a whole recording: its gaps, and how sure each name was."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gcs.playback.analysis import Analysis
from gcs.playback.replay import PARTS, ConfidenceHistory, find_gaps
from gcs.session.session import open_session
from tests.support.bundled import swarm_session
from tests.support.snapshots import snapshot

S = 1_000_000


def seconds(*times):
    return np.array([round(t * S) for t in times], dtype=np.int64)


def test_gaps_of_video_and_telemetry_are_told_apart():
    frames = np.delete(seconds(*np.arange(2.0, 60.0, 0.1)), slice(100, 130))  # 12 s to 15 s
    packets = seconds(*np.arange(0.0, 20.0, 0.5), *np.arange(40.0, 60.0, 0.5))
    gaps = [(gap.what, gap.start_us / S, gap.stop_us / S) for gap in find_gaps(frames, packets, 0, 60 * S)]
    assert gaps == [
        ("video", 0.0, 2.0),
        ("video", pytest.approx(11.9), pytest.approx(15.0)),
        ("telemetry", 19.5, 40.0),
    ]
    assert [gap.what for gap in find_gaps(None, packets, 0, 60 * S)] == ["telemetry"]
    assert find_gaps(seconds(), seconds(), 0, S // 2) == ()
    slow = seconds(0, 1.02, 2, 3, 4.1, 5, 6, 7, 11, 12)
    assert [gap.start_us / S for gap in find_gaps(slow, seconds(*range(13)), 0, 12 * S)] == [7.0]


def shown(t_us, standing, confidence):
    base = snapshot()
    rows = tuple(replace(row, standing=standing, confidence=confidence) for row in base.vehicles)
    return replace(base, t_us=t_us, vehicles=rows)


def test_the_worst_of_each_part_counts_and_names_hold_for_two_seconds_only():
    history = ConfidenceHistory(0, 100 * S)
    for t, standing, confidence in (
        (0.0, "confirmed", 0.98),
        (1.0, "confirmed", 0.96),
        (1.02, "tentative", 0.6),
        (1.04, "confirmed", 0.97),
        (2.0, "out of view", np.nan),
        (3.0, "confirmed", 0.99),
        (9.0, "confirmed", 0.99),
    ):
        history.add(shown(round(t * S), standing, confidence))
    sure = history.of(2)
    assert sure.shape == (PARTS,)
    assert sure[[0, 5]] == pytest.approx([0.98, 0.98])
    assert sure[10] == pytest.approx(0.6)
    assert sure[20] == 0.0 and sure[25] == 0.0
    assert sure[30] == pytest.approx(0.99) and (sure[31:90] == 0.0).all() and sure[90] == pytest.approx(0.99)
    assert np.isnan(sure[91:]).all()
    assert np.isnan(history.of(1)).all(), "the UAV has no name to find"
    assert np.isnan(history.of(99)).all()


def test_what_is_provisional_or_not_analysed_counts_for_nothing_and_time_may_go_back():
    history = ConfidenceHistory(0, 100 * S)
    history.add(replace(shown(50 * S, "confirmed", 0.9), provisional=True))
    history.add(replace(shown(50 * S, "confirmed", 0.9), analysed=False))
    assert np.isnan(history.of(2)).all()
    history.add(shown(50 * S, "confirmed", 0.9))
    history.add(shown(10 * S, "confirmed", 0.8))
    assert history.of(2)[[100, 500]] == pytest.approx([0.8, 0.9])


def test_a_film_that_is_over_has_ended_and_one_with_a_hole_has_stopped(tmp_path):
    folder = swarm_session(tmp_path, frames=40)
    header, *rows = (folder / "frames.csv").read_text().splitlines()
    late = (row.split(",") for row in rows[10:])
    rows[10:] = [f"{frame},{int(t_us) + 3 * S}" for frame, t_us in late]
    (folder / "frames.csv").write_text("\n".join([header, *rows]))
    analysis = Analysis(open_session(folder))
    first_us, last_us = int(analysis.times_us[0]), int(analysis.times_us[-1])
    after = {first_us: "none", first_us + 2_500_000: "stalled", last_us: "none", last_us + 5_000_000: "ended"}
    assert {t_us: analysis.health_at(t_us, -1).video for t_us in after} == after
