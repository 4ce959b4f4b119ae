"""The program's log: quiet, bounded, plain, without secrets, from several processes into one file."""

import logging
import os
import re
import subprocess
import sys
import threading

import pytest

from infra import program_log, secrets
from infra.program_log import LogFile, child_environment, least_level

LOG = logging.getLogger("gcs.somewhere")


@pytest.fixture
def log(tmp_path):
    file = LogFile(tmp_path / "program.log")
    yield file
    file.close()


def lines(log):
    log.close()
    return log.path.read_text().splitlines() if log.path.exists() else []


def test_a_line_says_when_how_bad_which_process_and_where(log):
    LOG.info("disk %s", "full")
    (line,) = lines(log)
    assert re.fullmatch(
        rf"\d{{4}}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{{3}}Z INFO    {os.getpid()} gcs\.somewhere: disk full", line
    )


def test_quiet_until_somebody_asks(capfd, tmp_path):
    LOG.error("said to nobody")
    assert capfd.readouterr() == ("", "")
    assert not LOG.isEnabledFor(logging.INFO)


def test_text_of_others_begins_no_line_and_speaks_to_no_terminal(log):
    LOG.warning("name %s", "a\n2026 forged\x1b[2J")
    (line,) = lines(log)
    assert "\x1b" not in line


def test_a_fault_has_its_traceback(log):
    try:
        raise ValueError("bad\nnews")
    except ValueError:
        LOG.exception("fault while naming")
    first, *trace = lines(log)
    assert first.endswith("fault while naming")
    assert all(line.startswith("    ") for line in trace)
    assert any("ValueError: bad" in line for line in trace)


def test_secrets_are_taken_out(log, monkeypatch):
    monkeypatch.setattr(secrets, "_hidden", [])
    secrets.hide("rtsp://admin:hunter2@camera")
    try:
        raise OSError("rtsp://admin:hunter2@camera")
    except OSError:
        LOG.exception("cannot open %s", "hunter2")
    text = "\n".join(lines(log))
    assert "hunter2" not in text
    assert "***" in text


def test_a_file_does_not_grow_without_end(log, monkeypatch):
    monkeypatch.setattr(program_log, "MAX_BYTES", 2000)
    for _ in range(200):
        LOG.info("x" * 50)
    assert sum(len(line) + 1 for line in lines(log)) < 2200


def test_nobody_waits_for_a_disk_that_hangs(tmp_path, monkeypatch):
    answers, opened = threading.Event(), program_log.open_to_append
    monkeypatch.setattr(program_log, "open_to_append", lambda path, links=True: answers.wait() and opened(path))
    monkeypatch.setattr(program_log, "MAX_WAITING", 3)
    log = LogFile(tmp_path / "program.log")
    for number in range(100):
        LOG.info("number %d", number)
    answers.set()
    found = lines(log)
    assert sum("number" in line for line in found) < 10  # three that waited, and those in hand
    assert any("lines were left out" in line for line in found)


def test_the_level_is_the_lowest_that_somebody_asked_for(log, tmp_path):
    assert least_level(logging.INFO) == logging.INFO
    more = LogFile(tmp_path / "debug.log", logging.DEBUG)
    LOG.debug("only there")
    assert least_level(logging.INFO) == logging.DEBUG
    assert len(lines(more)) == 1
    assert lines(log) == []


def test_a_link_in_its_place_is_not_followed(tmp_path):
    (tmp_path / "program.log").symlink_to(tmp_path / "elsewhere")
    log = LogFile(tmp_path / "program.log")
    LOG.info("x")
    log.close()
    assert not (tmp_path / "elsewhere").exists()


def test_a_child_process_logs_into_the_same_file(log):
    LOG.info("parent")
    code = "import logging, infra.program_log as p; p.log_as_parent(); logging.getLogger('gcs.x').info('child'); 1 / 0"
    child = subprocess.run(
        [sys.executable, "-c", code], env={**os.environ, **child_environment()}, capture_output=True, check=False
    )
    assert b"ZeroDivisionError" in child.stderr
    text = "\n".join(lines(log))
    assert "gcs.x: child" in text
    assert "gcs.somewhere: parent" in text
    assert "an error ends the process" in text
    assert "ZeroDivisionError" in text
