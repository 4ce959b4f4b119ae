"""Numbers that no command can use are one clear line, whichever option they are given to."""

from __future__ import annotations

import re

import pytest

from tests.support.bundled import SWARM
from tests.support.command_line import help_pages, run_gcs

LOG = SWARM / "telemetry.tlog"
FILM = ("gt.txt", "--video", "film.mp4", "-o", "out")
IMPORTED = ("-o", "out", "--video", "film.mp4")
HEARD = ("-l", "udpin:127.0.0.1:0", "--headless", "--sessions", "sessions")
FLIGHT = (SWARM / "session.toml", "-l", "udpin:127.0.0.1:0", "--headless", "--sessions", "sessions")
OPTIONS = [
    ("fly", FLIGHT, "--duration"),
    ("fly", FLIGHT, "--accept-late"),
    ("fly", HEARD, "--uav"),
    ("fly", HEARD, "--listen"),
    *(("doctor", ("--mission", SWARM / "session.toml"), option) for option in ("--height", "--listen")),
    ("replay", (SWARM,), "--video-start"),
    ("replay", (SWARM, "--serve"), "--port"),
    ("identify", (SWARM, "-o", "out"), "--video-start"),
    *(("batch run", (SWARM, "-o", "out"), option) for option in ("--jobs", "--retries", "--timeout", "--memory")),
    ("import", IMPORTED, "--clock-within"),
    ("import", IMPORTED, "--fov"),
    ("import", IMPORTED, "--pitch"),
    *(("export", (SWARM, "-o", "out.csv"), option) for option in ("--video-start", "--every", "--min-confidence")),
    ("report", (SWARM, "-o", "out.html"), "--video-start"),
    ("tlog check", (LOG,), "--most"),
    ("tlog cut", (LOG, "cut.tlog"), "--from"),
    ("tlog cut", (LOG, "cut.tlog"), "--to"),
    ("tlog cut", (LOG, "cut.tlog"), "--message"),
    ("tlog cut", (LOG, "cut.tlog"), "--system"),
    ("calibrate", (LOG, "-o", "lens.toml"), "--square"),
    ("eval-detector", (SWARM,), "--gsd"),
    ("eval-detector", (SWARM,), "--score"),
    *(
        ("train-detector", (SWARM, "-o", "out"), option)
        for option in ("--minutes", "--steps", "--rendered", "--seed", "--gsd")
    ),
    ("sim run", ("curved-road",), "--duration"),
    ("sim run", ("curved-road",), "--seed"),
    ("sim run", ("curved-road",), "--views"),
    ("sim run", ("curved-road",), "--masts"),
    ("sim from-tracks", FILM, "--first-frame"),
    ("sim from-tracks", FILM, "--fps"),
    ("sim from-tracks", FILM, "--duration"),
    ("sim from-tracks", FILM, "--height"),
    ("sim from-tracks", FILM, "--fov"),
    ("sim from-tracks", FILM, "--pitch"),
    ("sim from-tracks", FILM, "--team"),
    ("sim from-tracks", FILM, "--vehicle"),
    ("sim from-tracks", FILM, "--seed"),
]


MORE = ("inf", "-1e300", str(10**30))


def test_every_option_that_takes_a_number_is_tried_here():
    numeric = {
        (command, option)
        for command, page in help_pages()
        for option in re.findall(r"(--[a-z-]+)\s+(?:NUMBER|SECONDS|MINUTES|GIB|METRES|DEGREES|RATE|SHARE|ID)\s", page)
    }
    assert numeric == {(command, option) for command, _, option in OPTIONS}


@pytest.mark.parametrize("value", ["nan", "-1", *(pytest.param(value, marks=pytest.mark.slow) for value in MORE)])
@pytest.mark.parametrize(("command", "words", "option"), OPTIONS)
def test_a_number_that_cannot_be_used(command, words, option, value, tmp_path, monkeypatch):
    if value == "-1" and option in ("--video-start", "--from", "--to"):
        pytest.skip("a second earlier")
    monkeypatch.chdir(tmp_path)
    code, _, told = run_gcs(*command.split(), *words, option, value)
    assert code == 2
    assert (
        option in told or (command == "sim run" and option[2:] in told) or (command == "calibrate" and "square" in told)
    )
    assert not list(tmp_path.iterdir())


def test_the_first_camera_is_on_no_mast(tmp_path):
    for views in ((), ("--views", "2")):
        code, _, told = run_gcs("sim", "run", "curved-road", *views, "--masts", "2", "-o", tmp_path / "out")
        assert code == 2 and "--masts 2: the first camera flies" in told and not list(tmp_path.iterdir())
