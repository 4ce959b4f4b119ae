"""Flights and results in stores of files: fsspec's memory, and an S3 server on this machine."""

from __future__ import annotations

import json
import os
import platform
import subprocess
import sys
from pathlib import Path

import fsspec
import pytest

from gcs.batch.addresses import store_errors
from gcs.batch.stores import open_results
from gcs.errors import StoreError
from tests.support.batches.results import single_run
from tests.support.batches.short_flights import short_flights
from tests.support.command_line import run_gcs
from tests.support.ports import free_port
from tests.support.waiting import until


def in_memory(address):
    """Files of fsspec's memory below an address, by their path in it."""
    files = fsspec.filesystem("memory")
    root = address.removeprefix("memory:/").rstrip("/")
    return {path.removeprefix(f"{root}/"): files.cat_file(path) for path in files.find(root)}


@pytest.fixture
def memory():
    yield fsspec.filesystem("memory")
    fsspec.filesystem("memory").store.clear()
    fsspec.filesystem("memory").pseudo_dirs[:] = [""]


@pytest.mark.slow
def test_flights_and_results_in_memory(tmp_path, memory, monkeypatch):
    flights = short_flights(tmp_path, 2)
    memory.put(str(tmp_path), "/flights", recursive=True)
    memory.pipe_file("/flights/broken/telemetry.tlog", b"no log")
    memory.pipe_file("/flights/notes.md", b"windy")
    words = ("batch", "run", "memory://flights/*", "-o", "memory://out", "--json")
    code, stdout, stderr = run_gcs(*words)
    assert code == 6
    assert "notes.md: neither a folder" in stderr
    assert "of this process alone" in stderr
    *lines, sums = map(json.loads, stdout.splitlines())
    assert (sums["done"], sums["failed"]) == (2, 1)
    (failed,) = (line for line in lines if line["status"] == "failed")
    assert failed["flight"] == "broken"
    results = in_memory("memory://out")
    for flight in flights:
        assert results[f"identity/flight={flight.name}/part-0.parquet"] == single_run(flight)
    assert {"flights.parquet", "logs/a.log", "records/a.json", "records/broken.json"} <= results.keys()

    with monkeypatch.context() as patched:  # what the store tells is the same: nothing is fetched again
        patched.setattr("gcs.batch.work.fetch", None)
        assert json.loads(run_gcs(*words)[1].splitlines()[-1])["skipped"] == 2
    memory.pipe_file("/flights/a/detections.csv", memory.cat_file("/flights/b/detections.csv"))
    *_, sums = map(json.loads, run_gcs(*words)[1].splitlines())
    assert (sums["skipped"], sums["done"]) == (1, 2)


@pytest.fixture
def quick_lock(monkeypatch):
    monkeypatch.setattr("gcs.batch.stores.RENEW_S", 0.02)
    monkeypatch.setattr("gcs.batch.stores.WATCH_S", 60.0)
    return monkeypatch


@pytest.mark.slow
def test_two_batches_do_not_write_into_one_store(tmp_path, memory, quick_lock):
    (flight,) = short_flights(tmp_path, 1)
    with open_results("memory://out").claim(older_s=0.0):
        code, _, stderr = run_gcs("batch", "run", flight, "-o", "memory://out")
        assert code == 3
        assert f"another batch is writing into it (process {os.getpid()} of " in stderr
    assert run_gcs("batch", "run", flight, "-o", "memory://out")[0] == 0
    assert not memory.exists("/out/.lock")


@pytest.mark.slow
@pytest.mark.parametrize("host", [platform.node(), "elsewhere"])
def test_what_a_killed_batch_held_is_taken_over(host, tmp_path, memory, quick_lock):
    (flight,) = short_flights(tmp_path, 1)
    over = subprocess.Popen([sys.executable, "-c", ""])
    over.wait()
    left = {"host": host, "pid": over.pid, "began_s": 1.0, "key": "left"}
    memory.pipe_file("/out/.lock", json.dumps(left).encode())
    if host == "elsewhere":  # nobody can tell but by watching
        quick_lock.setattr("gcs.batch.stores.WATCH_S", 0.2)
    assert run_gcs("batch", "run", flight, "-o", "memory://out")[0] == 0
    assert memory.exists("/out/flights.parquet")
    assert not memory.exists("/out/.lock")


def test_a_folder_of_something_else_in_a_store_is_left_alone(tmp_path, memory):
    (flight,) = short_flights(tmp_path, 1)
    memory.pipe_file("/mine/thesis.tex", b"words")
    code, _, stderr = run_gcs("batch", "run", flight, "-o", "memory://mine")
    assert code == 2
    assert "holds something else" in stderr
    assert in_memory("memory://mine") == {"thesis.tex": b"words"}


@pytest.mark.slow_but_first
@pytest.mark.parametrize(
    "address", ["nonsense://bucket/a", "memory://nothing/here", "reference::memory://a", "reference://a"]
)
def test_addresses_that_cannot_be_read(address, tmp_path):
    code, stdout, stderr = run_gcs("batch", "run", address, "-o", tmp_path / "out")
    assert code == 6
    assert f"failed: {address}: " in stderr
    assert "Traceback" not in stdout + stderr


def test_an_address_of_thousands_of_letters_is_one_short_line():
    with (
        pytest.raises(StoreError, match=r"^memory://x+: no such file or folder$") as error,
        store_errors("memory://" + "x" * 5000),
    ):
        raise FileNotFoundError
    assert len(str(error.value)) < 300
    with pytest.raises(StoreError) as error, store_errors("memory://a"):
        raise OSError("words\n" * 5000)
    assert "\n" not in str(error.value) and len(str(error.value)) < 600


@pytest.fixture
def s3(tmp_path, monkeypatch):
    """An S3 server with an empty bucket; the settings are those that every tool of S3 takes."""
    port = free_port()
    monkeypatch.setenv("AWS_ENDPOINT_URL", f"http://127.0.0.1:{port}")
    for name in ("AWS_ACCESS_KEY_ID", "AWS_SECRET_ACCESS_KEY"):
        monkeypatch.setenv(name, "testing")
    monkeypatch.setenv("AWS_DEFAULT_REGION", "us-east-1")
    monkeypatch.setenv("AWS_CONFIG_FILE", str(tmp_path / "none"))
    monkeypatch.setenv("AWS_SHARED_CREDENTIALS_FILE", str(tmp_path / "none"))
    with Path(tmp_path / "s3.log").open("wb") as log:
        command = [sys.executable, "-m", "moto.server", "-H", "127.0.0.1", "-p", str(port)]
        server = subprocess.Popen(command, stdout=log, stderr=log)
    try:
        assert until(lambda: "Running on" in (tmp_path / "s3.log").read_text())
        files = fsspec.filesystem("s3", use_listings_cache=False, skip_instance_cache=True)
        files.mkdir("rollcall")
        yield files
    finally:
        server.kill()
        server.wait()


@pytest.mark.slow
def test_flights_and_results_in_an_object_store(tmp_path, s3):
    *stored, own = flights = short_flights(tmp_path / "flights", 3)
    for flight in stored:
        s3.put(f"{flight}/", f"rollcall/flights/{flight.name}/", recursive=True)
    words = ("batch", "run", "s3://rollcall/flights/*", own, "-o", "s3://rollcall/out", "-j", 1, "--json")
    code, stdout, stderr = run_gcs(*words)
    assert code == 0, stderr
    assert json.loads(stdout.splitlines()[-1])["done"] == 3
    for flight in flights:
        assert s3.cat_file(f"rollcall/out/identity/flight={flight.name}/part-0.parquet") == single_run(flight)
    assert s3.exists("rollcall/out/flights.parquet")
    assert not s3.exists("rollcall/out/.lock")

    s3.rm_file("rollcall/out/records/a.json")
    *_, sums = map(json.loads, run_gcs(*words)[1].splitlines())
    assert (sums["done"], sums["skipped"]) == (3, 2)

    # results of a store's flight on a disk
    assert run_gcs("batch", "run", "s3://rollcall/flights/a", "-o", tmp_path / "here", "-j", 1)[0] == 0
    assert (tmp_path / "here/identity/flight=a/part-0.parquet").read_bytes() == single_run(flights[0])
