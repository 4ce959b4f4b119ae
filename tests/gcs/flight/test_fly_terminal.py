"""A flight outlives its terminal, and seals its recording when it is told to end."""

import os
import signal
import sys
import threading

import pytest

from gcs.cli.fly import fly
from gcs.flight.flight import Flight
from gcs.session.event_log import read_events
from gcs.tui import Ended
from tests.support.command_line import MISSION, Terminal
from tests.support.ports import free_port
from tests.support.waiting import until


@pytest.fixture
def begin(tmp_path):
    begun = []

    def _begin(*extra, **more):
        begun.append(Terminal(tmp_path, *extra, **more))
        return begun[-1]

    yield _begin
    for terminal in begun:
        if terminal.process.poll() is None:
            terminal.process.kill()
            terminal.process.wait()


@pytest.mark.slow_but_first
@pytest.mark.parametrize(("extra", "shown"), [((), b"NAME"), (("--headless",), b"stop with Ctrl-C")])
def test_a_flight_goes_on_when_its_terminal_is_closed(begin, extra, shown):
    terminal = begin(*extra)
    terminal.read_until(shown)
    terminal.send(10)
    os.close(terminal.keeper)
    (session,) = terminal.sessions.iterdir()
    console = session / "console.log"
    assert until(lambda: console.exists() and (extra or "still recording" in console.read_text()))
    terminal.send(50)
    assert terminal.process.poll() is None
    code, _ = terminal.ended(signal.SIGTERM)
    assert code == 0
    said = (session / "console.log").read_text()
    assert f"{terminal.sent} packets received" in said
    assert "Traceback" not in said
    if not extra:
        assert f"still recording in {session}" in said and f"kill {terminal.process.pid}" in said


@pytest.fixture
def interrupt():
    """Interrupts a flight in this process once it waits for that; gives what was done so far."""
    done, threads, before = [], [], signal.getsignal(signal.SIGINT)

    def when_it_waits():
        if until(lambda: signal.getsignal(signal.SIGINT) is not before):
            done.append("interrupted")
            os.kill(os.getpid(), signal.SIGINT)

    def start():
        threads.append(threading.Thread(target=when_it_waits))
        threads[-1].start()
        return done

    yield start
    for thread in threads:
        thread.join()


def test_a_screen_that_breaks_ends_no_flight(tmp_path, monkeypatch, capsys, interrupt):
    done = []

    def broken(*_, **__):
        nonlocal done
        done = interrupt()
        raise ValueError("no such colour")

    monkeypatch.setattr("gcs.tui.run", broken)
    monkeypatch.setattr(sys.stdout, "isatty", lambda: True)
    monkeypatch.setattr(sys.stdin, "isatty", lambda: True)
    (tmp_path / "mission.toml").write_text(MISSION)
    fly(tmp_path / "mission.toml", link=[f"udpin:127.0.0.1:{free_port()}"], sessions=tmp_path / "sessions")
    assert done == ["interrupted"], "it went on until the signal"
    (session,) = (tmp_path / "sessions").iterdir()
    said = capsys.readouterr()
    assert f"still recording in {session}" in said.err and "0 packets received" in said.out
    assert "ValueError: no such colour" in (session / "program.log").read_text()
    assert "ended" in (session / "session.toml").read_text()


@pytest.mark.slow
def test_a_signal_to_end_seals_what_the_screen_shows(begin):
    terminal = begin()
    terminal.read_until(b"NAME")
    terminal.send(10)
    code, _ = terminal.ended(signal.SIGTERM)
    assert code == 0
    terminal.read_until(b"10 packets received")
    os.close(terminal.keeper)


def fly_with_screens(run, tmp_path, monkeypatch):
    """The session of a flight whose screens a function stands for."""
    monkeypatch.setattr("gcs.tui.run", run)
    monkeypatch.setattr(sys.stdout, "isatty", lambda: True)
    monkeypatch.setattr(sys.stdin, "isatty", lambda: True)
    (tmp_path / "mission.toml").write_text(MISSION)
    fly(tmp_path / "mission.toml", link=[f"udpin:127.0.0.1:{free_port()}"], sessions=tmp_path / "sessions")
    (session,) = (tmp_path / "sessions").iterdir()
    return session


def test_a_screen_that_is_left_ends_no_flight_and_its_marks_are_kept(tmp_path, monkeypatch, capsys, interrupt):
    def left(flight, *_, **__):
        flight.mark(1_795_170_792_000_000, "take-off", 11)
        interrupt()
        return Ended(code=0, left=False)

    session = fly_with_screens(left, tmp_path, monkeypatch)
    assert f"still recording in {session}" in capsys.readouterr().err
    (mark,) = (event for event in read_events(session / "events.jsonl")[0] if event.kind == "mark")
    assert (mark.t_us, mark.text, mark.system_id) == (1_795_170_792_000_000, "take-off", 11)


@pytest.mark.slow
def test_errors_that_go_to_a_file_leave_the_screen_where_it_is(begin, tmp_path):
    with (tmp_path / "errors.txt").open("wb") as errors:
        terminal = begin(errors=errors)
    terminal.read_until(b"NAME")
    terminal.send(10)
    code, _ = terminal.ended(signal.SIGTERM)
    assert code == 0
    terminal.read_until(b"10 packets received")
    os.close(terminal.keeper)
    assert b"\x1b" not in (tmp_path / "errors.txt").read_bytes(), "no screen in it"


@pytest.mark.slow
def test_what_goes_to_a_file_stays_there_when_the_terminal_is_gone(begin, tmp_path):
    with (tmp_path / "errors.txt").open("wb") as errors:
        terminal = begin("--headless", errors=errors)
    assert until(lambda: b"stop with Ctrl-C" in (tmp_path / "errors.txt").read_bytes())
    terminal.send(5)
    os.close(terminal.keeper)
    terminal.process.send_signal(signal.SIGHUP)
    _, session = terminal.ended(signal.SIGTERM)
    assert "5 packets received" in (session / "console.log").read_text(), "stdout was the terminal's"
    assert b"packets received" not in (tmp_path / "errors.txt").read_bytes()


def test_signals_to_end_that_come_while_the_recording_is_sealed_interrupt_nothing(tmp_path, monkeypatch, capsys):
    def stopped(flight, stop=Flight.stop):
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGINT):
            os.kill(os.getpid(), number)
        stop(flight)
        os.kill(os.getpid(), signal.SIGINT)

    monkeypatch.setattr(Flight, "stop", stopped)
    (tmp_path / "mission.toml").write_text(MISSION)
    before = signal.getsignal(signal.SIGINT)
    link = [f"udpin:127.0.0.1:{free_port()}"]
    fly(tmp_path / "mission.toml", link=link, sessions=tmp_path / "sessions", headless=True, duration=0.1)
    (session,) = (tmp_path / "sessions").iterdir()
    assert "0 packets received" in capsys.readouterr().out
    assert "ended" in (session / "session.toml").read_text()
    assert signal.getsignal(signal.SIGINT) is before


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_that_comes_just_when_the_screens_have_ended_is_heeded(tmp_path, monkeypatch, capsys, number):
    def left(*_, **__):
        os.kill(os.getpid(), number)
        os.kill(os.getpid(), signal.SIGTERM)
        return Ended(code=0, left=False)

    session = fly_with_screens(left, tmp_path, monkeypatch)
    assert "ended" in (session / "session.toml").read_text()
    assert "0 packets received" in capsys.readouterr().out


@pytest.mark.slow
def test_a_flight_whose_screen_was_left_goes_on_after_a_stop(begin):
    terminal = begin(controls=False)
    terminal.read_until(b"NAME")
    os.write(terminal.keeper, b"q")
    terminal.read_until(b"leave")
    os.write(terminal.keeper, b"l")
    terminal.read_until(b"still recording")
    terminal.process.send_signal(signal.SIGSTOP)
    terminal.process.send_signal(signal.SIGCONT)
    terminal.send(5)
    code, session = terminal.ended(signal.SIGINT)
    assert code == 0
    assert "Traceback" not in (session / "program.log").read_text()
    os.close(terminal.keeper)
