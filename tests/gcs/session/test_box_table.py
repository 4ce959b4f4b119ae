"""One table of boxes: every encoding has the same columns, and the version of them."""

import csv
import json

import numpy as np
import pytest
from pyarrow import parquet

from gcs.batch.work import write_identity_table
from gcs.export.formats import format_for
from gcs.export.job import ExportJob
from gcs.export.tables.named_boxes import NamedBoxes
from gcs.session.box_table import BOX, COLUMNS, DIGITS, ENU, VERSION, EvidenceRow, csv_row, text_cell
from gcs.session.identity_log import IdentityLog
from infra.session_format import IDENTITY
from tests.support.snapshots import box, snapshot

PLACE = {"lat_deg": 47.1234567, "lon_deg": -8.5, "place_std_m": 1.234, "p_enu": np.array([-3.25, 4.5, 0.0])}
BOXES = [
    box(1, 2, **PLACE, runner_up=3, runner_up_confidence=0.0123, residual_m=0.456, residual_px=12.25, stated=True),
    box(2, 0, heading=np.nan, number=4, doubt="=few, reports"),
    box(3, 3, coasting=True),
]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """The same two boxes in every encoding."""
    folder = tmp_path_factory.mktemp("boxes")
    with IdentityLog(folder) as log:
        log.write(snapshot(7, boxes=BOXES))
    for suffix in ("csv", "jsonl", "parquet"):
        path = folder / f"a.{suffix}"
        sink = format_for(path).open(ExportJob(path=path))
        sink.write(snapshot(7, boxes=BOXES))
        sink.close()
    write_identity_table(folder / "identity.jsonl", folder / "batch.parquet", {"rollcall.version": "1.2"})
    return folder


def rows_of(path):
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def flat(row):
    """A row of JSON by column."""
    lists = {"box": BOX, "enu_m": ENU}
    values = {name: row.get(name) for name in COLUMNS} | {"stated": row.get("stated", False)}
    return values | {name: value for key, names in lists.items() for name, value in zip(names, row[key], strict=True)}


def test_every_encoding_has_the_same_values(folder):
    table, batch = parquet.read_table(folder / "a.parquet"), parquet.read_table(folder / "batch.parquet")
    lines = (folder / "a.jsonl").read_text().splitlines()[1:]
    assert table.to_pylist() == batch.to_pylist() == [flat(json.loads(line)) for line in lines]
    assert NamedBoxes.of_lines(line.encode() for line in lines).to_arrow().to_pylist() == table.to_pylist()
    assert (folder / "identity.jsonl").read_text().splitlines() == lines
    for told, row in zip(rows_of(folder / "a.csv"), table.to_pylist(), strict=True):
        assert told.pop("schema") == str(VERSION)
        assert told.pop("doubt") == ("'=few, reports" if row["doubt"] else "")
        unknown = {name: np.nan for name in told if row[name] is None and COLUMNS[name].kind == "double"}
        assert told == {name: text_cell(unknown.get(name, row[name]), DIGITS[name]) for name in told}


def test_every_encoding_has_the_columns_in_their_order_and_their_version(folder):
    names = list(COLUMNS)
    assert (folder / "a.csv").read_text().splitlines()[0].split(",") == [*names, "schema"]
    for name, more in (("a", {}), ("batch", {b"rollcall.version": b"1.2"})):
        schema = parquet.read_schema(folder / f"{name}.parquet")
        assert schema.names == names
        told = {key: value for key, value in schema.metadata.items() if key.startswith(b"rollcall")}
        assert told == {b"rollcall.boxes": str(VERSION).encode(), **more}
    assert json.loads((folder / "a.jsonl").read_text().splitlines()[0])["version"] == VERSION
    of_json = [name for name in EvidenceRow.__struct_fields__ if name not in ("box", "enu_m")]
    assert [name for name in names if name not in (*BOX, *ENU)] == of_json
    chosen = iter(names)
    assert all(name in chosen for name in IDENTITY.columns), "identity.csv has some of them, in their order"


def test_a_log_that_lacks_what_came_later_is_read(folder):
    rows = [json.loads(line) for line in (folder / "identity.jsonl").read_text().splitlines()]
    old = [{key: row[key] for key in row if key not in ("place_std_m", "stated", "number", "doubt")} for row in rows]
    boxes = NamedBoxes.of_lines(json.dumps(row).encode() for row in old)
    assert boxes["system_id"].tolist() == [2, 0] and np.isnan(boxes["place_std_m"]).all()
    assert boxes["number"].tolist() == [0, 0] and boxes["doubt"].tolist() == ["", ""]


def test_unknown_numbers_are_empty_cells():
    values = dict.fromkeys(COLUMNS) | {name: np.nan for name, column in COLUMNS.items() if column.kind == "double"}
    assert csv_row(values | {"time_us": 5, "frame": 0, "angle": -0.00001}) == "5,0,,,,,,,,0.0000,,,"
