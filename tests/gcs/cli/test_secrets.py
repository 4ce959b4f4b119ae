"""A secret in an address of any option stands in nothing that a command prints, logs or writes."""

from __future__ import annotations

import re
import threading
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer

import pytest
from pyarrow import parquet

from infra import secrets
from tests.support.batches.short_flights import short_flights
from tests.support.bundled import SWARM
from tests.support.command_line import help_pages, run_gcs, run_gcs_process
from tests.support.ports import free_port

PASSWORD = "hunter2-Zx9"
USER = f"admin:{PASSWORD}@127.0.0.1"
MISSION = '[uav]\nsystem_id = 1\n[[ugv]]\nsystem_id = 11\n[links]\nvideo = "rtsp://{user}:1/x"\n'
FLY = ("fly", "{folder}/mission.toml", "--headless", "--duration", "2", "--sessions", "{folder}/sessions")
REPLAY = ("replay", str(SWARM))
BATCH = ("batch", "run", str(SWARM), "-o", "{folder}/out")
OPTIONS = {
    ("fly", "--link"): (*FLY, "-l", "tcp://{user}:1"),
    ("fly", "--forward"): (*FLY, "-l", "udpin:127.0.0.1:{port}", "--forward", "tcp://{user}:1"),
    ("fly", "--video"): (*FLY, "-l", "udpin:127.0.0.1:{port}", "--video=rtsp://{user}:1/x"),
    ("fly", "key of a stream"): (*FLY, "-l", "udpin:127.0.0.1:{port}", "--video=rtmp://127.0.0.1:1/live/{password}"),
    ("fly", "--publish"): (*FLY, "-l", "udpin:127.0.0.1:{port}", "--publish", "cot+tcp://{user}:1"),
    ("fly", "--stream"): (*FLY, "-l", "udpin:127.0.0.1:{port}", "--stream", "udp://{user}:1?password={password}"),
    ("replay", "--publish"): (*REPLAY, "--publish", "json+udp://{user}:1?token={password}"),
    ("replay", "--stream"): (*REPLAY, "--stream", "rtp://{user}:1"),
    ("batch run", "--out"): ("batch", "run", str(SWARM), "-o", "http://{user}:1/out"),
    ("batch run", "--scheduler"): (*BATCH, "--scheduler", "tcp://{user}:1"),
    ("batch run", "flights"): (*BATCH, "http://{user}:1/a", "b=http://{user}:1/x?sig={password}"),
    ("batch run", "no protocol"): ("batch", "run", "{user}:1/a.tlog", "-o", "{folder}/out"),
    ("batch report", "results"): ("batch", "report", "http://{user}:1/out"),
    ("sim run", "--stream"): ("sim", "run", "nominal", "--live", "--duration", "1", "--stream", "udp://{user}:x"),
}
"""Commands by the option whose address holds the secret."""


@pytest.fixture(autouse=True)
def nothing_hidden(monkeypatch):
    monkeypatch.setattr(secrets, "_hidden", [])


def told_in(folder):
    """Files that hold the secret."""
    return [path.name for path in folder.rglob("*") if path.is_file() and PASSWORD.encode() in path.read_bytes()]


@pytest.mark.slow_but_first
@pytest.mark.parametrize("words", OPTIONS.values(), ids=map(" ".join, OPTIONS))
def test_it_stands_in_no_output(tmp_path, words):
    (tmp_path / "mission.toml").write_text(MISSION.format(user="127.0.0.1"))
    given = {"folder": tmp_path, "user": USER, "password": PASSWORD, "port": free_port()}
    filled = [word.format(**given) for word in words]
    assert any(PASSWORD in word for word in filled)
    code, stdout, stderr = run_gcs_process("--log-level", "debug", "--log-file", tmp_path / "log", *filled)
    assert code in (0, 2, 3, 4, 6), stderr
    assert PASSWORD not in stdout + stderr
    assert told_in(tmp_path) == []


def test_every_option_that_takes_an_address_is_tried():
    """Those whose help shows one, by the command's name."""
    found = set()
    for command, page in help_pages():
        option = ""
        for line in page.splitlines():
            named = re.match(r"  (?:-\w, )?(--[\w-]+|[a-z]+)", line)
            option = named[1] if named else option
            if re.search(r"\w://|[Aa]ddress", line) and option:
                found.add((command, option))
    assert found - OPTIONS.keys() == {("replay", "--serve")}, "which prints the address that it makes"


@pytest.fixture
def web(tmp_path):
    """A server of files, which cares for no query."""

    class Quiet(SimpleHTTPRequestHandler):
        def log_message(self, *args):
            pass

    handler = partial(Quiet, directory=str(tmp_path / "web"))
    with ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        yield f"127.0.0.1:{server.server_port}"
        server.shutdown()
        thread.join()


@pytest.mark.slow
def test_a_signed_address_is_worked_on_and_kept_nowhere(tmp_path, web):
    (flight,) = short_flights(tmp_path / "web", 1)
    (flight / "telemetry.tlog").rename(tmp_path / "web" / "flown.tlog")
    mission = flight / "session.toml"
    out = tmp_path / "out"
    signed = f"http://{web}/flown.tlog?X-Amz-Credential=AK/eu&X-Amz-Signature={PASSWORD}"
    broken = f"http://{web}/gone.tlog?X-Amz-Signature={PASSWORD}"
    words = ("batch", "run", signed, f"other={broken}", "-o", out, "--mission", mission, "-j", 1, "--retries", 0)
    code, stdout, stderr = run_gcs("--log-file", tmp_path / "log", *words)
    assert code == 6 and "other failed" in stderr and "no such file" in stderr
    report = run_gcs("batch", "report", out)
    rows = parquet.read_table(out / "flights.parquet").to_pylist()
    assert [(row["flight"], row["status"]) for row in rows] == [("flown", "done"), ("other", "failed")], rows
    assert rows[0]["source"] == f"http://{web}/flown.tlog?X-Amz-Credential=***&X-Amz-Signature=***"
    assert PASSWORD not in f"{rows}{stdout}{stderr}{report}"
    assert (out / "report.html").exists() and (out / "logs" / "flown.log").exists()
    assert told_in(tmp_path) == []
    # the same flight, signed anew
    again = run_gcs(*(str(word).replace(PASSWORD, f"{PASSWORD}-2") for word in words))
    assert "1 of them before" in again[1] and PASSWORD not in "".join(again[1:])
