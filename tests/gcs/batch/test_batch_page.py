"""What docs/batch.md says of the tables: each query runs on a small batch's output, each column is there."""

from __future__ import annotations

import re
from pathlib import Path

import duckdb
import pytest
from pyarrow import parquet

from tests.support.batches.short_flights import broken_flights, short_flights
from tests.support.command_line import run_gcs

pytestmark = pytest.mark.slow

PAGE = Path("docs/batch.md").read_text(encoding="utf-8")
SQL = re.findall(r"```sql\n(.*?)```", PAGE, re.S)
PYTHON = re.findall(r"```python\n(.*?)```", PAGE, re.S)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """With ``results``: flight a is done, 0002 was and fails now, another never was."""
    folder = tmp_path_factory.mktemp("page")
    flights = short_flights(folder / "flights", 2)
    numbered = flights[1].rename(folder / "flights" / "0002")
    words = ("batch", "run", folder / "flights", broken_flights(folder)["log"], "-o", folder / "results", "-j", 1)
    assert run_gcs(*words)[0] == 6
    (numbered / "frames.csv").unlink()
    assert run_gcs(*words)[0] == 6
    return folder


@pytest.fixture
def answers(folder, monkeypatch):
    monkeypatch.chdir(folder)
    return [duckdb.sql(query).fetchall() for query in SQL]


def test_the_queries_of_duckdb(folder, answers):
    worst, seen, never, cost, copied = answers
    assert [row[:2] for row in worst] == [("0002", "failed"), ("broken log", "failed"), ("a", "done")]
    assert {name for name, *_ in seen} <= {f"UGV-{k}" for k in range(2, 8)}
    assert all(flights == 1 and 0 < confidence <= 1 for _, _, flights, confidence in seen)
    assert {flight for flight, *_ in never} <= {"a"}
    assert len(seen) + len(never) == 6
    assert [row[0] for row in cost] == [1]
    assert copied == duckdb.sql(f"select count(*) from '{folder}/boxes.parquet'").fetchall()
    assert copied[0][0] >= sum(row[1] for row in seen)


def test_the_lines_of_pandas(folder, answers, monkeypatch):
    monkeypatch.chdir(folder)
    (lines,) = PYTHON
    exec(lines, values := {})
    assert dict(values["flights"].groupby("status").size()) == {"done": 1, "failed": 2}
    assert {(flight, name): size for (flight, name), size in values["seen"]["size"].items()} == {
        ("a", name): boxes for name, boxes, *_ in answers[1]
    }


def test_every_column_is_on_the_page(folder):
    flights = parquet.read_schema(folder / "results" / "flights.parquet").names
    boxes = parquet.read_schema(folder / "results" / "identity" / "flight=a" / "part-0.parquet").names
    for column in (*flights, *boxes):
        assert f"`{column}`" in PAGE
