"""The commands as a user gives them: what they print, what they write, and how they end."""

import errno
import json
import os
import re
import socket
from pathlib import Path

import pytest

from gcs.cli.output.console import as_typed, errors_as_exit_codes
from tests.support.bundled import SWARM, swarm_session
from tests.support.command_line import run_gcs, run_gcs_process


@pytest.fixture(scope="module", params=[80, pytest.param(600, marks=pytest.mark.slow)])
def named(request, tmp_path_factory):
    """The bundled real telemetry, so many frames of it or all, identified once: session, results, and what was said."""
    folder = tmp_path_factory.mktemp("swarm")
    session, out = swarm_session(folder, frames=request.param), folder / "out"
    code, stdout, stderr = run_gcs("identify", session, "-o", out)
    assert code == 0, stderr
    return session, out, stdout


def pipe(path):
    os.mkfifo(path)
    return path


def test_what_is_to_be_typed_is_one_word_and_no_option():
    assert [as_typed(each) for each in ("out/S", Path("-S"), "a b")] == ["out/S", "./-S", "'a b'"]


def test_version_is_told_without_a_command():
    code, stdout, stderr = run_gcs_process("--version")
    assert (code, stderr) == (0, "")
    assert re.fullmatch(r"rollcall-gcs \d+\.\d+\.\d+\n", stdout)


def test_names_the_swarm_and_is_right(named):
    session, out, stdout = named
    assert "6 of 6 vehicles named" in stdout
    code, stdout, _ = run_gcs("score", session, out / "identity.csv", "--json")
    assert code == 0
    score = json.loads(stdout)
    assert score["precision"] >= 0.98
    assert score["coverage"] >= 0.93
    assert score["fper"] >= 0.95


@pytest.mark.slow
def test_same_input_same_bytes(tmp_path):
    session = swarm_session(tmp_path)
    assert run_gcs("identify", session, "-o", tmp_path / "here")[0] == 0
    assert run_gcs_process("identify", session, "-o", tmp_path / "there")[0] == 0  # sets have another order there
    for name in ("identity.csv", "identity.jsonl", "events.jsonl"):
        assert (tmp_path / "here" / name).read_bytes() == (tmp_path / "there" / name).read_bytes(), name


def test_score_prints_every_figure(named):
    session, out, _ = named
    code, stdout, _ = run_gcs("score", session, out / "identity.csv")
    assert code == 0
    shape = re.sub(r" *-?[\d.]+", " #", stdout)
    assert shape.splitlines() == [
        " # frames, # boxes of ours, # named",
        "precision #%  right names of names given",
        "coverage #%  our boxes that got a name",
        "right #%  our boxes that got the right name",
        "FPER #%  of # false targets, left unnamed",
        "switches #  changes of a vehicle's name",
        "IDF # #%  of the names; #% of the bare tracks",
        "ECE #  expected calibration error of the confidence",
        "ECE of all #  the same of all answers, none of ours among them",
        "wrong, sure # s  vehicle-seconds wrong at confidence ≥ #",
        "strangers #%  of boxes called none of ours at confidence ≥ #, ours",
    ]


def test_never_writes_over_a_log(named):
    session, out, _ = named
    before = (out / "identity.csv").read_bytes()
    code, _, stderr = run_gcs("identify", session, "-o", out)
    assert code == 2
    assert stderr.count("\n") == 1
    assert "never overwritten" in stderr
    assert (out / "identity.csv").read_bytes() == before


def test_exports_what_was_said(named, tmp_path):
    session, out, _ = named
    code, _, stderr = run_gcs("export", session, "--identity", out / "identity.csv", "-o", tmp_path / "o.csv")
    assert code == 0, stderr
    assert len((tmp_path / "o.csv").read_text().splitlines()) == len((out / "identity.csv").read_text().splitlines())


BAD = {
    "a pipe": (lambda t: ("identify", pipe(t / "pipe"), "-o", t / "o"), 2, "no such session"),
    "no such session": (lambda t: ("identify", t / "absent", "-o", t / "o"), 2, "no such session"),
    "an empty folder": (lambda t: ("identify", t, "-o", t / "o"), 2, "no telemetry.tlog"),
    "an empty log": (
        lambda t: ("identify", swarm_session(t, tlog=lambda _: b""), "-o", t / "o"),
        2,
        "empty file",
    ),
    "a garbage log": (
        lambda t: ("identify", swarm_session(t, tlog=lambda _: bytes(range(256)) * 40), "-o", t / "o"),
        2,
        "no MAVLink frame",
    ),
    "an unknown key": (
        lambda t: ("identify", swarm_session(t, toml=lambda s: s.replace("[clock]", "[clok]")), "-o", t / "o"),
        2,
        "did you mean clock?",
    ),
    "a wrong value": (
        lambda t: ("identify", swarm_session(t, toml=lambda s: s.replace("1200.0", '"x"', 1)), "-o", t / "o"),
        2,
        "fx is 'x'",
    ),
    "detections without times": (
        lambda t: ("identify", swarm_session(t, without=("frames.csv",)), "-o", t / "o"),
        2,
        "needs frames.csv",
    ),
    "a video that is no video": (
        lambda t: ("identify", SWARM / "telemetry.tlog", "--video", SWARM / "truth.csv", "-o", t / "o"),
        2,
        "truth.csv",
    ),
    "no video to look at": (lambda t: ("identify", SWARM, "--detect", "-o", t / "o"), 2, "no video to detect in"),
    "no truth": (lambda t: ("score", t, SWARM / "truth.csv"), 2, "truth.csv: no such file"),
    "no film without video": (lambda t: ("export", SWARM, "-o", t / "o.mp4"), 2, "no video in it"),
    "no such mission": (lambda t: ("fly", t / "m.toml", "-l", "14550"), 2, "no such file"),
    "no link": (lambda t: ("fly", SWARM / "session.toml"), 2, "no telemetry link"),
    "several cameras": (
        lambda t: (
            *("fly", swarm_session(t, toml=lambda s: s + "\n[[view]]\nsystem_id = 99\n") / "session.toml"),
            *("--video", "udp://:5600", "--video", "rtp://@:5600"),
        ),
        2,
        "udp://:5600 and rtp://@:5600 are one place",
    ),
    "a bad link": (lambda t: ("fly", SWARM / "session.toml", "-l", "pigeon:1"), 3, "pigeon"),
    "a flight of no time": (
        lambda t: ("fly", SWARM / "session.toml", "-l", "14550", "--headless", "--duration", "nan"),
        2,
        "--duration nan: give a number",
    ),
    "no such film": (
        lambda t: ("fly", SWARM / "session.toml", "-l", "14550", "-v", t / "nothere.mp4", "--sessions", t),
        2,
        "nothere.mp4: no such file",
    ),
    "no such model": (
        lambda t: (
            *("fly", SWARM / "session.toml", "-l", "udpin:127.0.0.1:0", "-v", "udp://127.0.0.1:1"),
            *("--model", t / "m.onnx", "--sessions", t),
        ),
        2,
        "m.onnx",
    ),
    "a model that is none": (
        lambda t: (
            *("fly", SWARM / "session.toml", "-l", "udpin:127.0.0.1:0", "-v", "udp://127.0.0.1:1"),
            *("--model", SWARM / "truth.csv", "--sessions", t),
        ),
        2,
        "truth.csv",
    ),
    "a log with no vehicles": (
        lambda t: ("tlog", "info", SWARM / "truth.csv"),
        2,
        "no MAVLink frame",
    ),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_input_is_one_clear_line(case, tmp_path):
    args, code, message = BAD[case]
    got, stdout, stderr = run_gcs(*args(tmp_path))
    assert message in stderr
    assert got == code
    assert stderr.count("\n") == 1, stderr
    assert stderr.startswith("gcs: ")
    assert stdout == ""


def test_the_process_ends_with_the_code_and_the_line():
    code, stdout, stderr = run_gcs_process("tlog", "info", "/nowhere")
    assert (code, stdout, stderr.count("\n")) == (2, "", 1)
    assert stderr.startswith("gcs: ")


def test_a_port_in_use(tmp_path):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        port = str(taken.getsockname()[1])
        code, _, stderr = run_gcs(
            "fly", SWARM / "session.toml", "-l", f"udpin:127.0.0.1:{port}", "--sessions", tmp_path
        )
    assert code == 3
    assert port in stderr
    assert stderr.count("\n") == 1


@pytest.mark.slow
def test_a_truncated_log_still_names(tmp_path):
    folder = swarm_session(tmp_path, tlog=lambda b: b[: len(b) * 3 // 4 + 3])
    code, stdout, stderr = run_gcs("identify", folder, "-o", tmp_path / "o")
    assert code == 0
    assert "6 of 6 vehicles named" in stdout
    assert "damaged places" in stderr


@pytest.mark.slow
def test_without_the_uavs_attitude_it_says_so(tmp_path):
    kept = tmp_path / "kept.tlog"
    no_attitude = [0, 1, 2, 24, 33, 253]
    arguments = [part for message in no_attitude for part in ("--message", str(message))]
    assert run_gcs("tlog", "cut", SWARM / "telemetry.tlog", kept, *arguments)[0] == 0
    folder = swarm_session(tmp_path, tlog=lambda _: kept.read_bytes())
    code, _, stderr = run_gcs("identify", folder, "-o", tmp_path / "o")
    assert "never reported its attitude" in stderr
    assert code in (0, 4)


@pytest.mark.slow
def test_without_a_camera_nothing_is_said_of_the_uavs_attitude(tmp_path):
    (tmp_path / "mission.toml").write_text("[uav]\nsystem_id = 1\n[[ugv]]\nsystem_id = 2\n")
    mission = ("--mission", tmp_path / "mission.toml")
    code, _, stderr = run_gcs("identify", SWARM / "telemetry.tlog", "-o", tmp_path / "o", *mission)
    assert code == 4 and "no [camera]" in stderr and "attitude" not in stderr


def test_what_others_wrote_in_a_session_gives_the_terminal_no_orders(tmp_path):
    name = r"A\u001b]0;owned\u0007\u009b31m\u202eB"
    (tmp_path / "mission.toml").write_text(f'[uav]\nsystem_id = 1\n[[ugv]]\nsystem_id = 99\nname = "{name}"\n')
    mission = ("--mission", tmp_path / "mission.toml")
    _, stdout, stderr = run_gcs("identify", SWARM / "telemetry.tlog", "-o", tmp_path / "o", *mission)
    assert "owned" in stdout and "owned" in stderr
    assert all(character.isprintable() or character == "\n" for character in stdout + stderr)


@pytest.mark.slow
def test_vehicles_that_never_report_stay_unnamed(tmp_path):
    kept = tmp_path / "kept.tlog"
    assert run_gcs("tlog", "cut", SWARM / "telemetry.tlog", kept, "--system", "1")[0] == 0
    folder = swarm_session(tmp_path, tlog=lambda _: kept.read_bytes())
    code, stdout, stderr = run_gcs("identify", folder, "-o", tmp_path / "o")
    assert code == 4
    assert "UGV-2, UGV-3, UGV-4, UGV-5, UGV-6, UGV-7 cannot be named: never heard" in stderr
    assert "0 of 6 vehicles named" in stdout


def test_tlog_info_names_systems_and_messages():
    code, stdout, _ = run_gcs("tlog", "info", SWARM / "telemetry.tlog")
    assert code == 0
    assert "GLOBAL_POSITION_INT" in stdout
    assert "16301" in stdout


@pytest.mark.parametrize(("number", "code"), [(errno.ENOSPC, 3), (errno.EROFS, 3), (errno.EIO, 3)])
def test_a_disk_that_does_not_take_it_is_one_line(number, code, capsys):
    with pytest.raises(SystemExit) as left, errors_as_exit_codes():
        raise OSError(number, os.strerror(number), "/out/identity.csv")
    assert left.value.code == code
    said = capsys.readouterr().err
    assert said == f"gcs: /out/identity.csv: {os.strerror(number)}; free space or choose another place\n"


def test_a_name_that_no_disk_can_have_is_one_line(capsys):
    with pytest.raises(SystemExit) as left, errors_as_exit_codes():
        Path("a" * 300).stat()
    assert left.value.code == 2
    assert capsys.readouterr().err == f"gcs: {'a' * 200}: File name too long\n"


def test_other_errors_of_the_system_are_faults_of_the_program():
    with pytest.raises(OSError, match="no such device"), errors_as_exit_codes():
        raise OSError(errno.ENODEV, "no such device")


def test_logs_where_it_is_asked_to(tmp_path):
    out, log = tmp_path / "out", tmp_path / "gcs.log"
    code, _, stderr = run_gcs_process(
        "--log-level", "debug", "--log-file", log, "identify", swarm_session(tmp_path, frames=5), "-o", out
    )
    assert code == 0, stderr
    assert "gcs.session.event_log" in log.read_text()
    code, _, stderr = run_gcs("--log-file", tmp_path, "tlog", "info", SWARM)
    assert (code, "--log-file" in stderr, "choose another place" in stderr) == (2, True, True)
