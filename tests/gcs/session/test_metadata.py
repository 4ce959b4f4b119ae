import errno
import os
import shutil
import signal
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from gcs.session.metadata import SessionFile, recorded_folders, seal
from gcs.session.recorder import Recorder
from gcs.session.session import open_session
from tests.support.bundled import ROOT
from tests.support.frames import records
from tests.support.snapshots import ONE_UGV

FLIGHT = """
import sys, time
sys.path.insert(0, sys.argv[2])
from pathlib import Path
from tests.support.faulty_disk import WholeRecorder
from tests.support.snapshots import ONE_UGV
from tests.support.frames import packet
recorder = WholeRecorder(Path(sys.argv[1]), ONE_UGV, video=True)
for k in range(100):
    recorder.packet(packet(k))
print(recorder.folder, flush=True)
time.sleep(600)
"""


@pytest.fixture
def flight(tmp_path):
    """A living flight and its folder."""
    command = [sys.executable, "-c", FLIGHT, tmp_path, ROOT]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        yield process, Path(process.stdout.readline().strip())
        process.kill()


def seal_interrupted(parent):
    return [found for folder in recorded_folders(parent) if (found := seal(folder)) is not None]


def content(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir() if path.name != "session.toml"}


def notes(folder):
    return tomllib.loads((folder / "session.toml").read_text())["session"]


def test_a_flight_is_left_alone_while_it_lives_and_sealed_when_it_was_killed(flight, tmp_path):
    process, folder = flight
    before = (folder / "session.toml").read_bytes()
    assert seal_interrupted(tmp_path) == []
    assert (folder / "session.toml").read_bytes() == before
    process.send_signal(signal.SIGKILL)
    process.wait()
    data = content(folder)
    (found,) = seal_interrupted(tmp_path)
    assert (found.folder, found.records, found.trouble) == (folder, 100, "")
    assert "100 telemetry records; sealed" in found.text
    assert content(folder) == data, "no data file is touched"
    assert data["telemetry.tlog"] == records(100)
    sealed = notes(folder)
    assert (sealed["interrupted"], sealed["packets"]) == (True, 100)
    assert sealed["ended"] >= sealed["started"].replace(microsecond=0)
    assert open_session(folder).mission.ugv[0].name == "Alpha"
    assert seal_interrupted(tmp_path) == [], "once"


def test_a_flight_that_ended_and_what_is_no_flight_are_left_alone(tmp_path):
    recorder = Recorder(tmp_path, ONE_UGV, video=False)
    assert seal(recorder.folder) is None, "our own, going on"
    recorder.close()
    (tmp_path / "simulated").mkdir()
    (tmp_path / "simulated" / "session.toml").write_text("[uav]\nsystem_id = 1\n")
    (tmp_path / "empty").mkdir()
    assert seal_interrupted(tmp_path) == []
    assert seal_interrupted(tmp_path / "absent") == []
    assert "interrupted" not in notes(recorder.folder)


def test_a_damaged_session_file_is_said_and_left(tmp_path):
    folder = tmp_path / "a"
    folder.mkdir()
    (folder / "session.toml").write_text("[session\n")
    (found,) = seal_interrupted(tmp_path)
    assert "cannot be sealed: session.toml: not valid TOML: Expected" in found.text
    assert (folder / "session.toml").read_text() == "[session\n"


def test_without_telemetry_there_is_nothing_to_count(tmp_path):
    folder = tmp_path / "a"
    folder.mkdir()
    file = SessionFile(folder, ONE_UGV)
    os.close(file._fd)  # its process is gone
    (found,) = seal_interrupted(tmp_path)
    assert found.records == 0
    assert notes(folder)["interrupted"] is True


def test_a_session_file_that_cannot_be_written_leaves_no_half_of_one(tmp_path, monkeypatch):
    file = SessionFile(tmp_path, ONE_UGV)
    before = (tmp_path / "session.toml").read_bytes()

    def full(fd):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "fsync", full)
    file.close({"packets": 3})
    assert [path.name for path in tmp_path.iterdir()] == ["session.toml"]
    assert (tmp_path / "session.toml").read_bytes() == before


def test_a_deleted_session_file_is_restored_and_stays_locked(tmp_path):
    file = SessionFile(tmp_path, ONE_UGV)
    (tmp_path / "session.toml").unlink()
    file.restore()
    assert "started" in notes(tmp_path)
    assert seal(tmp_path) is None
    shutil.rmtree(tmp_path)
    file.restore()
    file.close({"packets": 3})
    assert notes(tmp_path)["packets"] == 3
