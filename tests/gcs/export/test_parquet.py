"""The table of boxes, as DuckDB and pandas read it."""

import sys
from importlib import import_module

import duckdb
import numpy as np
import pytest

from gcs.errors import GcsError, SessionError
from gcs.export.formats import FORMATS, format_for
from gcs.export.job import ExportJob
from tests.support.snapshots import box, snapshot


@pytest.fixture(scope="module")
def pd():
    # not above: loading it takes every test process half a second, and one of them runs these tests
    return import_module("pandas")


def written(path, *snapshots):
    sink = format_for(path).open(ExportJob(path=path))
    for each in snapshots:
        sink.write(each)
    sink.close()
    return path


def test_duckdb_counts_what_the_csv_has(export_to, tmp_path, pd):
    for suffix in ("parquet", "csv"):
        export_to(tmp_path / f"a.{suffix}")
    count = "select system_id, name, count(*), round(avg(confidence), 4) from '{}' group by all order by all"
    counts = [duckdb.sql(count.format(tmp_path / f"a.{suffix}")).fetchall() for suffix in ("parquet", "csv")]
    assert counts[0] == [(*row[:1], row[1] or None, *row[2:]) for row in counts[1]]
    assert len(counts[0]) >= 6 and sum(row[2] for row in counts[0]) > 200
    table, rows = (read(tmp_path / f"a.{kind}") for read, kind in ((pd.read_parquet, "parquet"), (pd.read_csv, "csv")))
    assert np.allclose(table.lat, rows.lat, atol=1e-7) and np.allclose(table.place_std_m, rows.place_std_m, atol=1e-3)
    with pytest.raises(SessionError, match="exists already"):
        export_to(tmp_path / "a.parquet")


def test_what_is_unknown_is_null_and_strangers_have_no_name(tmp_path, pd):
    boxes = [box(1, 2), box(2, 0, runner_up=3, heading=np.nan), box(3, 3, coasting=True)]
    table = pd.read_parquet(written(tmp_path / "a.parquet", snapshot(0, boxes=boxes)))
    assert table.track_id.tolist() == [1, 2]
    assert table.name.isna().tolist() == [False, True] and table.system_id.isna().tolist() == [False, True]
    assert table.heading.isna().tolist() == [False, True] and table.lat.isna().all()


def test_a_recording_without_boxes_is_an_empty_table(tmp_path):
    assert duckdb.sql(f"select count(*) from '{written(tmp_path / 'a.parquet')}'").fetchall() == [(0,)]


def test_without_the_library_it_says_how_to_get_it(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(GcsError, match=r"pip install 'rollcall-gcs\[tables\]'"):
        FORMATS["parquet"].open(ExportJob(path=tmp_path / "a.parquet"))
    assert not (tmp_path / "a.parquet").exists()
