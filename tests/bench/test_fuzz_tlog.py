"""Damaged logs with the truth beside them; ten thousand of them are run by ``python -m bench.fuzz logs``."""

import random
from dataclasses import replace

import numpy as np
import pytest

from bench.fuzz.__main__ import logs_text
from bench.fuzz.frames import frame_pool
from bench.fuzz.logs import DAMAGES, MarkedTruth, compare, draw_case, fuzz_logs, marked_log, run_case
from mavlink.tlog.check import check
from mavlink.tlog.index import Damage, build_index
from mavlink.tlog.log import Tlog
from tests.support.bundled import ROOT

CORPUS = sorted((ROOT / "tests" / "corpus" / "tlog").iterdir())
LOGS = 250


@pytest.fixture(scope="module")
def scores():
    return fuzz_logs(range(100_000, 100_000 + LOGS))


@pytest.mark.slow
def test_no_undamaged_record_is_lost_and_all_have_their_time(scores):
    total = scores["all"]
    assert total.logs == LOGS and total.whole > 50_000
    assert not [line for line in total.failures if "Error" in line]
    assert (total.lost, total.wrong_times, total.wrong_counts) == (0, 0, 0)


@pytest.mark.slow
def test_damage_is_reported_to_the_byte(scores):
    total = scores["all"]
    assert total.damaged_bytes > 100_000
    assert (total.false_bytes, total.missed_bytes) == (0, 0)


@pytest.mark.slow
def test_phantoms_are_fewer_than_one_in_ten_thousand(scores):
    assert scores["all"].phantoms + scores["all"].unknown_phantoms <= 1e-4 * scores["all"].whole


@pytest.mark.slow
def test_every_damage_layout_and_clock_was_tried(scores):
    assert set(DAMAGES) <= set(scores)
    assert sum(kind.startswith("layout: ") for kind in scores) == 5
    assert sum(kind.startswith("clock: ") for kind in scores) == 4


@pytest.mark.parametrize("seed", range(5))
def test_the_oracle_sees_what_a_worse_reader_does(seed):
    case = draw_case(300 + seed)
    good = run_case(case)
    index = build_index(case.log.data)
    half = np.arange(0, len(index), 2)
    worse = {name: getattr(index, name)[half] for name in ("offset", "length", "t_us", "known", "time_ok")}
    worse["t_us"] = worse["t_us"] + 1
    score = compare(case, replace(index, **worse))
    assert good.lost == good.wrong_times == good.wrong_counts == 0
    assert score.lost > 0
    assert score.wrong_times > 0 or case.layout == "none"
    assert score.wrong_counts == 1


def test_the_oracle_sees_untrue_reports_of_damage():
    case = next(case for case in map(draw_case, range(500, 600)) if "hole zeroed" in case.damages)
    index = build_index(case.log.data)
    assert compare(case, index).missed_bytes == 0
    assert compare(case, replace(index, damage=())).missed_bytes > 0
    assert compare(case, replace(index, damage=(Damage(0, case.log.size, "all"),))).false_bytes > 0


def test_the_same_seed_makes_the_same_log():
    one, other = draw_case(17), draw_case(17)
    assert one.log.data.tobytes() == other.log.data.tobytes()
    assert one.damages == other.damages


def test_an_untouched_log_is_whole():
    frames = frame_pool()[:500]
    truth = MarkedTruth(frames=frames, t_us=1_790_000_000_000_000 + np.arange(500) * 1000, order=">")
    index = build_index(marked_log(truth, range(500)).data)
    assert index.damage == () and len(index) == 500


@pytest.mark.parametrize("path", CORPUS, ids=lambda path: path.name)
def test_kept_logs_are_read(path):
    log = Tlog.open(path, any_file=True)
    found = check(log)
    covered = int(log.index.length.sum()) + 8 * int(log.index.time_ok.sum())
    assert covered + found.damaged_bytes >= found.size_bytes or found.time_source == "none"
    assert len(list(log.packets())) == found.records


@pytest.mark.parametrize("kind", ["empty", "one byte", "magic only", "two frames"])
def test_tiny_files(kind):
    frame = frame_pool()[0]
    data = {"empty": b"", "one byte": b"\xfd", "magic only": b"\xfd\xfe" * 40, "two frames": frame * 2}[kind]
    index = build_index(np.frombuffer(data, dtype=np.uint8))
    assert len(index) == (2 if kind == "two frames" else 0)
    assert sum(d.stop - d.start for d in index.damage) == (0 if kind == "two frames" else len(data))


def test_hostile_logs_do_not_take_long_loops():
    # every row is a candidate of something: magics only, unknown frames only, frames without any usable time
    rng = random.Random(1)
    pool = [f for f in frame_pool(carried=False) if len(f) < 60]
    unstamped = b"".join(rng.randbytes(8) + rng.choice(pool) for _ in range(3000))
    for data in (b"\xfd" * 200_000, b"\xfe\x00" * 100_000, unstamped):
        index = build_index(np.frombuffer(data, dtype=np.uint8))
        assert index.counts.size_bytes == len(data)


@pytest.mark.slow
def test_the_page_tells_how_many_logs_there_were_of_each_kind(scores):
    text = logs_text(scores)
    assert f"{LOGS} logs" in text
    assert f"| all | {LOGS} |" in text and all(f"| {kind} |" in text for kind in scores)
