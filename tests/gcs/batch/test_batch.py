"""Batches from the command: tables that others read, broken flights beside good ones, and nothing done twice."""

from __future__ import annotations

import json
import re
from dataclasses import replace

import duckdb
import pytest
from pyarrow import parquet

from gcs.playback.identification import identify_session
from gcs.session.identity_log import read_identity
from gcs.session.session import open_session
from sim.session import write_session
from sim.world.presets import nominal
from tests.support.batches.short_flights import broken_flights, short_flights
from tests.support.command_line import run_gcs


def identities(out):
    """The bytes of each flight's table."""
    return {path.parent.name: path.read_bytes() for path in out.glob("identity/*/part-0.parquet")}


def said(stderr):
    """Lines on stderr that are not about how far it is, which come where it takes its time."""
    return [line for line in stderr.splitlines() if not re.match(r"gcs: batch: +\d+ %", line)]


def told(stdout):
    return [json.loads(line) for line in stdout.splitlines()]


@pytest.mark.slow
def test_a_flight_comes_out_alone_as_in_a_batch_and_as_identify_has_it(tmp_path):
    flights = short_flights(tmp_path / "flights", 3)
    code, stdout, stderr = run_gcs("batch", "run", tmp_path / "flights", "-o", tmp_path / "out", "-j", 2)
    assert (code, said(stderr)) == (0, [])
    assert stdout.startswith("3 of 3 flights done, 0 of them before; 0 failed; 39 frames in ")
    assert run_gcs("batch", "run", flights[1], "-o", tmp_path / "alone")[0] == 0
    assert identities(tmp_path / "out")["flight=b"] == identities(tmp_path / "alone")["flight=b"]
    identify_session(open_session(flights[1]), tmp_path / "identified")
    logged = read_identity(tmp_path / "identified" / "identity.csv")
    table = parquet.read_table(tmp_path / "out" / "identity" / "flight=b" / "part-0.parquet")
    assert len(logged) == table.num_rows > 30
    for column in ("time_us", "frame", "cx", "w", "angle", "confidence", "lat", "system_id"):
        assert table[column].to_numpy().astype(float) == pytest.approx(logged[column], abs=0.005, nan_ok=True)


def test_broken_flights_are_told_and_the_others_finish(tmp_path):
    flights, broken = short_flights(tmp_path / "flights", 2), broken_flights(tmp_path)
    code, stdout, stderr = run_gcs(
        "batch", "run", *flights, *broken.values(), "-o", tmp_path / "out", "-j", 2, "--json"
    )
    assert code == 6
    assert not said(stderr)
    *lines, sums = told(stdout)
    assert (sums["flights"], sums["done"], sums["failed"]) == (8, 2, 6)
    errors = {line["flight"]: line["error"] for line in lines if line["status"] == "failed"}
    assert {path.name for path in broken.values()} == set(errors)
    for kind, path in broken.items():
        assert str(path) in errors[path.name], kind
        assert "\n" not in errors[path.name]
        assert "fault of this program" not in errors[path.name]
        assert errors[path.name] in (tmp_path / "out" / "logs" / f"{path.name}.log").read_text()
    rows = duckdb.sql(f"select status, count(*) from '{tmp_path}/out/flights.parquet' group by status").fetchall()
    assert dict(rows) == {"done": 2, "failed": 6}
    counts = duckdb.sql(f"select flight, count(*) from '{tmp_path}/out/identity/*/*.parquet' group by flight")
    assert dict(counts.fetchall()).keys() == {"a", "b"}


@pytest.mark.slow
def test_each_camera_of_a_flight_is_a_flight_of_the_batch(tmp_path):
    write_session(replace(nominal(), duration_s=3.0, fps=5.0).filmed_by(2), tmp_path / "flight")
    words = ("batch", "run", tmp_path / "flight", "-o", tmp_path / "out", "-j", 1, "--json")
    assert {line["flight"]: line["status"] for line in told(run_gcs(*words)[1])[:-1]} == {
        "flight": "done",
        "flight.view-2": "done",
    }
    identify_session(open_session(tmp_path / "flight"), tmp_path / "identified")
    for folder in ("", "view-2"):
        table = tmp_path / "out" / "identity" / f"flight=flight.{folder}".rstrip(".") / "part-0.parquet"
        logged = read_identity(tmp_path / "identified" / folder / "identity.csv")
        assert logged["system_id"] == pytest.approx(parquet.read_table(table)["system_id"].to_numpy(), nan_ok=True)
    with (tmp_path / "flight" / "view-2" / "detections.csv").open("a") as seen:
        seen.write("14,10,10,20,10,0,0.9,\n")
    again = told(run_gcs(*words)[1])[:-1]
    assert not any(line["skipped"] for line in again), "each is named with what the other camera saw"
    one = tmp_path / "one.toml"
    one.write_text((tmp_path / "flight" / "session.toml").read_text().partition("[[view]]")[0])
    errors = [line.get("error") for line in told(run_gcs(*words, "--mission", one)[1])[:-1]]
    assert sum("has no [[view]]" in (error or "") for error in errors) == 1


@pytest.mark.slow
def test_what_is_done_is_skipped_until_input_or_options_change(tmp_path):
    flights = short_flights(tmp_path / "flights", 2)
    words = ("batch", "run", tmp_path / "flights", "-o", tmp_path / "out", "-j", 1, "--json")
    assert run_gcs(*words)[0] == 0
    before = identities(tmp_path / "out")
    *lines, sums = told(run_gcs(*words)[1])
    assert (sums["skipped"], sums["frames"]) == (2, 0)
    assert all(line["skipped"] for line in lines)

    rows = (flights[0] / "detections.csv").read_text().splitlines()
    (flights[0] / "detections.csv").write_text("\n".join(rows[:-3]))
    *lines, sums = told(run_gcs(*words)[1])
    assert {line["flight"]: line["skipped"] for line in lines} == {"a": False, "b": True}
    after = identities(tmp_path / "out")
    assert after["flight=a"] != before["flight=a"]
    assert after["flight=b"] == before["flight=b"]

    *lines, sums = told(run_gcs(*words, "--mission", flights[0] / "session.toml")[1])
    assert sums["skipped"] == 0


@pytest.mark.slow
def test_a_result_that_lacks_or_was_cut_is_made_again(tmp_path):
    short_flights(tmp_path / "flights", 2)
    words = ("batch", "run", tmp_path / "flights", "-o", tmp_path / "out", "-j", 1, "--json")
    assert run_gcs(*words)[0] == 0
    before = identities(tmp_path / "out")
    (tmp_path / "out" / "identity" / "flight=a" / "part-0.parquet").write_bytes(before["flight=a"][:-9])
    (tmp_path / "out" / "records" / "b.json").write_text("{")
    assert told(run_gcs(*words)[1])[-1]["skipped"] == 0
    assert identities(tmp_path / "out") == before


def test_a_folder_of_something_else_is_left_alone(tmp_path):
    (flight,) = short_flights(tmp_path / "flights", 1)
    code, _, stderr = run_gcs("batch", "run", flight, "-o", flight)
    assert code == 2
    assert "holds something else" in stderr
    assert not (flight / "records").exists()


@pytest.mark.slow
def test_a_flight_that_fails_later_keeps_its_earlier_result_and_says_so(tmp_path):
    flights = short_flights(tmp_path / "flights", 2)
    words = ("batch", "run", tmp_path / "flights", "-o", tmp_path / "out", "-j", 1)
    assert run_gcs(*words)[0] == 0
    before = identities(tmp_path / "out")
    (flights[0] / "frames.csv").unlink()
    assert run_gcs(*words)[0] == 6
    assert identities(tmp_path / "out") == before
    rows = duckdb.sql(f"select flight, status, earlier_result from '{tmp_path}/out/flights.parquet' order by flight")
    assert rows.fetchall() == [("a", "failed", True), ("b", "done", False)]
