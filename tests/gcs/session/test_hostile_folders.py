"""Folders that somebody else could write to: no start is held up, nothing of ours is written where it should not be."""

import json
import os
import signal
import subprocess
import sys
import threading
import tomllib

import pytest

from gcs.errors import ConfigError
from gcs.health.faults import Faults
from gcs.mission.mission import load_mission
from gcs.session.metadata import SessionFile, seal
from gcs.session.recorder import Recorder
from gcs.session.session import create_folder, open_session
from gcs.snapshot import Event
from infra.files.disk import Disk
from infra.files.restorable_file import RestorableFile
from infra.files.safe_open import create, is_shared, open_to_append, read_small
from mavlink.errors import TlogError
from mavlink.tlog.log import Tlog
from tests.support.frames import records
from tests.support.ports import free_port
from tests.support.snapshots import ONE_UGV

MISSION_TOML = "[uav]\nsystem_id = 1\n[[ugv]]\nsystem_id = 2\n"
INTERRUPTED = MISSION_TOML + "[session]\nformat = 1\nstarted = 2026-11-20T10:33:12Z\n"
SECRET = "[session]\nstarted = 2026-11-20T10:33:12Z\ncode = 'secret'\n"


def interrupted(parent, name, toml=INTERRUPTED):
    folder = parent / name
    folder.mkdir()
    (folder / "session.toml").write_text(toml)
    (folder / "telemetry.tlog").write_bytes(records(10))
    return folder


def command(tmp_path, sessions, *extra):
    (tmp_path / "mission.toml").write_text(MISSION_TOML)
    return [
        *(sys.executable, "-c", "from gcs.cli.app import main; main()", "fly", tmp_path / "mission.toml"),
        *("-l", f"udpin:127.0.0.1:{free_port()}", "--headless", "--sessions", sessions, *extra),
    ]


def flown_until(tmp_path, sessions, words, times):
    """What a flight says on stderr until it said something so often, and how it ends; sealing has no hurry."""
    with subprocess.Popen(command(tmp_path, sessions), stderr=subprocess.PIPE, stdout=subprocess.DEVNULL) as flight:
        killer = threading.Timer(180, flight.kill)
        killer.start()
        said = []
        while sum(words in line for line in said) < times and (line := flight.stderr.readline().decode()):
            said.append(line)
        flight.send_signal(signal.SIGINT)
        said.append(flight.stderr.read().decode())
        killer.cancel()
    return "".join(said), flight.returncode


@pytest.mark.slow
def test_a_flight_starts_and_seals_the_good_session_among_the_bad_ones(tmp_path):
    sessions, outside = tmp_path / "sessions", tmp_path / "outside"
    sessions.mkdir()
    outside.mkdir()
    victim = outside / "victim"
    victim.write_text("mine")
    secret = interrupted(outside, "secret", SECRET)
    good = interrupted(sessions, "0-good")
    linked = interrupted(sessions, "1-linked-new")
    (linked / "session.toml.new").symlink_to(victim)
    (sessions / "2-linked-folder").symlink_to(secret)
    reading = interrupted(sessions, "3-linked-toml")
    (reading / "session.toml").unlink()
    (reading / "session.toml").symlink_to(secret / "session.toml")
    pipe = sessions / "4-pipe"
    pipe.mkdir()
    os.mkfifo(pipe / "session.toml")
    piped_log = interrupted(sessions, "5-piped-log")
    (piped_log / "telemetry.tlog").unlink()
    os.mkfifo(piped_log / "telemetry.tlog")
    for name, toml in {
        "6-brackets": "a = " + "[" * 50_000,
        "7-dots": "a" + ".a" * 50_000 + " = 1",
        "8-digits": "[session]\nstarted = " + "9" * 5000,
        "9-hexadecimal": INTERRUPTED + "x = 0x" + "f" * 9000,
        "a-large": "#" * (1 << 20),
        "b-other": "session = 5",
    }.items():
        interrupted(sessions, name, toml)
    said, code = flown_until(tmp_path, sessions, "cannot be sealed", 8)
    assert code == 0, said
    assert victim.read_text() == "mine"
    assert (secret / "session.toml").read_text() == SECRET
    assert (reading / "session.toml").is_symlink()
    for folder, packets in ((good, 10), (linked, 10), (piped_log, 0)):
        notes = tomllib.loads((folder / "session.toml").read_text())["session"]
        assert (notes["interrupted"], notes["packets"]) == (True, packets), folder
    assert not list(sessions.glob("*/*.new")) or list(sessions.glob("*/*.new")) == [linked / "session.toml.new"]
    told = [line for line in said.splitlines() if "seal" in line]
    assert sum("; sealed" in line for line in told) == 3
    for name in ("3-linked-toml", "4-pipe", "6-brackets", "7-dots", "8-digits", "9-hexadecimal", "a-large", "b-other"):
        assert any(f"gcs: {name}: cannot be sealed: " in line for line in told), name
    assert "Traceback" not in said
    (flown,) = sessions.glob("20*Z*")
    events = [json.loads(line) for line in (flown / "events.jsonl").read_text().splitlines()]
    assert sum("cannot be sealed" in event["text"] for event in events) == 8


@pytest.mark.slow
def test_a_folder_that_others_may_write_to_is_told(tmp_path):
    sessions = tmp_path / "sessions"
    sessions.mkdir()
    sessions.chmod(0o777)
    words = command(tmp_path, sessions, "--duration", "1")
    done = subprocess.run(words, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stderr
    assert f"gcs: {sessions}: others may write to this folder" in done.stderr
    (flown,) = sessions.glob("20*Z*")
    assert f"{sessions}: others may write" in (flown / "events.jsonl").read_text()
    assert f"{flown}: others" not in done.stderr


def test_a_session_folder_is_made_for_its_owner_to_write(tmp_path):
    before = os.umask(0)
    try:
        folder = create_folder(tmp_path)
    finally:
        os.umask(before)
    assert folder.stat().st_mode & 0o022 == 0
    assert not is_shared(folder)
    folder.chmod(0o757)
    assert is_shared(folder)


def test_what_a_flight_notes_of_itself_follows_no_link(tmp_path):
    victim = tmp_path / "victim"
    victim.write_text("mine")
    (tmp_path / "faults.txt").symlink_to(victim)
    Faults(tmp_path / "faults.txt").record("job", ValueError("x"))
    (tmp_path / "video.mkv").symlink_to(tmp_path / "absent")
    with pytest.raises(FileExistsError):
        RestorableFile(tmp_path / "video.mkv")
    (tmp_path / "session.toml").symlink_to(victim)
    SessionFile(tmp_path, ONE_UGV).close({})
    assert victim.read_text() == "mine"
    assert not (tmp_path / "session.toml").is_symlink()
    assert not (tmp_path / "absent").exists()


def test_files_of_others_are_not_appended_to(tmp_path):
    path = tmp_path / "console.log"
    os.close(open_to_append(path))
    os.write(fd := open_to_append(path), b"a line\n")
    os.close(fd)
    assert path.read_text() == "a line\n"
    os.link(path, tmp_path / "other name")
    for place in (path, tmp_path):
        with pytest.raises(OSError):
            open_to_append(place)
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(OSError, match="No such device"):
        open_to_append(tmp_path / "pipe")
    with pytest.raises(FileExistsError):
        create(path)


def test_what_is_no_regular_file_is_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(TlogError, match="not a regular file"):
        Tlog.open(tmp_path / "pipe")
    with pytest.raises(ConfigError, match="not a regular file"):
        load_mission(tmp_path / "pipe")
    with pytest.raises(ConfigError, match="not a regular file"):
        load_mission(tmp_path.__class__("/dev/zero"))
    with pytest.raises(OSError, match="larger than 0 KiB"):
        read_small(__file__, 10)
    (tmp_path / "mission.toml").write_text(MISSION_TOML + "[camera]\nlens = 'pipe'\n")
    with pytest.raises(ConfigError, match="not a regular file"):
        load_mission(tmp_path / "mission.toml")


def test_a_file_of_the_system_that_waits_is_not_read(monkeypatch):
    reading, writing = os.pipe2(os.O_NONBLOCK)
    monkeypatch.setattr("infra.files.safe_open.open_to_read", lambda path: reading)
    with pytest.raises(BlockingIOError, match="/proc/kmsg"):
        read_small("/proc/kmsg", 10)
    os.close(writing)


def test_a_session_of_pipes_is_refused_in_a_line(tmp_path):
    folder = interrupted(tmp_path, "a")
    for name in ("frames.csv", "detections.csv", "refused.csv", "senders.csv", "clock.csv", "video.mkv"):
        os.mkfifo(folder / name)
    opened = open_session(folder)
    assert (opened.video, opened.frames, opened.detections) == (None, None, None)
    assert seal(folder).records == 10


@pytest.mark.parametrize(
    "toml", ["a = " + "[" * 50_000, "a" + ".a" * 50_000 + " = 1", "a = " + "9" * 5000, "a = 0x" + "f" * 9000]
)
def test_a_mission_made_to_break_its_reader_is_refused_in_a_line(tmp_path, toml):
    (tmp_path / "m.toml").write_text(toml)
    with pytest.raises(ConfigError) as error:
        load_mission(tmp_path / "m.toml")
    assert len(str(error.value)) < 400


@pytest.mark.parametrize("there", [True, False], ids=["files of the same names", "an empty folder"])
def test_a_link_in_the_place_of_a_flights_folder_is_not_followed(tmp_path, there):
    """Whoever may write beside it moves the folder away and puts a link there: all goes on where it was."""
    victim = tmp_path / "victim"
    victim.mkdir()
    for name in ("session.toml", "events.jsonl", "frames.csv") if there else ():
        (victim / name).write_text("another's")
    before = {path.name: path.read_text() for path in victim.iterdir()}
    recorder = Recorder(tmp_path, ONE_UGV, video=True)
    film = RestorableFile(recorder.video_path)
    recorder.folder.rename(tmp_path / "moved")
    recorder.folder.symlink_to(victim)
    line = Event(t_us=1, level="info", kind="operator", text="after the move")
    recorder.events((line,))
    recorder.frame_time(0, 1)
    for _ in range(3):
        recorder.check()
        film._looked_s = 0.0
        assert not film.is_gone()
    film.close()
    recorder.close()
    assert {path.name: path.read_text() for path in victim.iterdir()} == before
    assert "after the move" in (tmp_path / "moved" / "events.jsonl").read_text()
    assert "ended" in (tmp_path / "moved" / "session.toml").read_text()


def test_no_file_is_made_in_a_folder_that_a_link_stands_for(tmp_path):
    (tmp_path / "victim").mkdir()
    (tmp_path / "session").symlink_to("victim")
    with pytest.raises(OSError, match="session"):
        Disk().open(tmp_path / "session" / "telemetry.tlog")
    assert list((tmp_path / "victim").iterdir()) == []
