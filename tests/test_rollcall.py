"""The package that scripts import: its names, its table, and that no folder beside a script breaks it."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest

import rollcall
from gcs.session.box_table import COLUMNS
from tests.support.bundled import CURVED_ROAD, ROOT, SWARM, shortened


def test_its_names_are_few_and_sorted():
    assert sorted(rollcall.__all__) == rollcall.__all__
    assert len(rollcall.__all__) <= 30
    assert all(getattr(rollcall, name).__doc__ for name in rollcall.__all__)


@pytest.fixture(scope="module")
def flight(tmp_path_factory):
    return rollcall.open(shortened(SWARM, tmp_path_factory.mktemp("short") / "session", 40))


@pytest.fixture(scope="module")
def boxes(flight, tmp_path_factory):
    return flight.identify(out=tmp_path_factory.getbasetemp() / "named")


def test_the_table_is_the_identity_log(boxes, tmp_path_factory):
    lines = (tmp_path_factory.getbasetemp() / "named" / "identity.jsonl").read_text(encoding="utf-8").splitlines()
    assert list(boxes) == list(COLUMNS)
    assert boxes.rows == len(lines) > 100
    row = json.loads(lines[-1])
    for name in ("time_us", "system_id", "name", "confidence", "lat", "residual_m"):
        assert boxes[name][-1] == row[name]
    assert (boxes["cx"][-1], boxes["north_m"][-1]) == (row["box"][0], row["enu_m"][1])


def test_every_column_is_documented():
    text = Path("docs/python.md").read_text(encoding="utf-8")
    assert not [name for name in COLUMNS if f"`{name}`" not in text]


def test_pandas_and_arrow_have_the_same(boxes):
    frame, table = boxes.to_pandas(), boxes.to_arrow()
    assert list(frame.columns) == table.column_names == list(boxes)
    assert frame["confidence"].tolist() == pytest.approx(boxes["confidence"], nan_ok=True)
    assert table["system_id"].null_count == int((boxes["system_id"] == 0).sum()) > 0
    assert table["frame"].null_count == table["stated"].null_count == 0


def test_names_are_scored_from_the_table_as_from_the_file(flight, boxes, tmp_path_factory):
    score = rollcall.score(boxes, flight.truth)
    of_file = rollcall.score(tmp_path_factory.getbasetemp() / "named" / "identity.csv", flight.truth)
    assert asdict(score) == pytest.approx(asdict(of_file), nan_ok=True)
    assert score.precision > 0.9
    assert rollcall.score(boxes.where(boxes["system_id"] > 0), flight.truth).named == score.named


def test_a_flight_without_truth_says_so():
    with pytest.raises(rollcall.GcsError, match="no truth"):
        _ = rollcall.open(SWARM / "telemetry.tlog").truth


def test_snapshots_come_with_images_where_they_are_asked_for():
    first = next(rollcall.open(CURVED_ROAD).snapshots(images=True))
    assert first.image.ndim == 3
    assert len(rollcall.open(SWARM).mission.ugv) == 6


def test_columns_of_a_log_go_by_number_and_by_name():
    log = rollcall.read_tlog(SWARM / "telemetry.tlog")
    by_name, by_number = log.columns("GLOBAL_POSITION_INT", 11), log.columns(33, 11)
    assert np.array_equal(by_name[1], by_number[1])
    with pytest.raises(rollcall.MavlinkError, match="GLOBAL_POSITION"):
        log.columns("GLOBAL_POSITION")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("script", "says"),
    [
        ("import rollcall\nprint(len(rollcall.open(sys.argv[1]).identify()['frame']))", ""),
        ("import rollcall, vision\nprint(vision.__file__)", ""),
        ("import sim\nimport rollcall", "is loaded as 'sim'"),
        ("import vision\nimport rollcall", "is loaded as 'vision'"),
    ],
)
def test_folders_beside_a_script_break_nothing(script, says, tmp_path):
    for name in ("vision", "gcs"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "__init__.py").write_text("OWN = True\n", encoding="utf-8")
    (tmp_path / "sim.py").write_text("OWN = True\n", encoding="utf-8")
    (tmp_path / "script.py").write_text(f"import sys\n{script}\n", encoding="utf-8")
    done = subprocess.run(
        [sys.executable, "script.py", str(shortened(SWARM, tmp_path / "a second", 10))],
        cwd=tmp_path,
        env={"PYTHONPATH": str(ROOT), "PATH": "", "OMP_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert (done.returncode != 0) == bool(says), done.stderr
    assert says in done.stderr
