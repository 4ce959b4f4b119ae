import contextlib
import io
import os
import pty
import re
import struct
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import ardupilotmega
from typer.main import get_command

from gcs.cli.keys import SHORT, app
from gcs.cli.output.console import errors_as_exit_codes
from mavlink.protocol.packet import Auth
from mavlink.signing.keys import FLEET, Key, key_path, passphrase_secret, read_ring, write_key
from mavlink.signing.store import StreamStore
from mavlink.signing.verifier import without_secret
from mavlink.tlog.writer import TlogWriter
from tests.support.signed_vehicles import NOW, T0, Sender, secret_of, shown_anywhere

PASSPHRASE = "the quick brown fox, sworn to secrecy"
COMMAND = [sys.executable, "-c", "from gcs.cli.app import main; main()", "keys"]


@pytest.fixture
def keys(monkeypatch, capsys):
    """Runs ``gcs keys`` as a user does; returns exit code, stdout, stderr."""

    def run(*args, given="", home=None):
        if home:
            monkeypatch.setenv("XDG_CONFIG_HOME", str(home))
        given = given.encode("utf-8", "surrogateescape")
        monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(given)))
        capsys.readouterr()
        code = 0
        try:
            with errors_as_exit_codes():
                get_command(app)([*map(str, args)], standalone_mode=False)
        except SystemExit as end:
            code = end.code
        return code, *capsys.readouterr()

    return run


def hides(texts, passphrase=PASSPHRASE):
    return not any(passphrase in text or shown_anywhere(text, passphrase_secret(passphrase)) for text in texts)


def test_a_new_key_is_where_it_says_and_not_on_the_screen(keys, tmp_path):
    code, out, err = keys("new", "7", home=tmp_path)
    assert (code, err) == (0, "")
    path = tmp_path / "rollcall" / "keys" / "7.key"
    assert str(path) in out
    secret = bytes.fromhex(path.read_text())
    assert len(secret) == 32
    assert not shown_anywhere(out, secret)
    assert Key(secret).fingerprint in out
    assert path.stat().st_mode & 0o777 == 0o600
    assert path.parent.stat().st_mode & 0o777 == 0o700
    code, out, _ = keys("list", home=tmp_path)
    assert code == 0
    assert f"system 7  {Key(secret).fingerprint}" in out
    assert not shown_anywhere(out, secret)


def test_a_removed_key_is_gone_and_its_fingerprint_told(keys, tmp_path):
    keys("new", "7", "--keys", tmp_path)
    fingerprint = read_ring(tmp_path).key_of(7).fingerprint
    code, out, _ = keys("remove", "7", "--keys", tmp_path)
    assert code == 0 and fingerprint in out and not list(tmp_path.iterdir())
    code, _, err = keys("remove", "7", "--keys", tmp_path)
    assert code == 2 and "7.key" in err


def test_what_is_shown_is_the_passphrase_of_the_key(keys, tmp_path):
    code, out, _ = keys("new", "fleet", "--keys", tmp_path / "k", "--show")
    assert code == 0
    passphrase = re.search(r"^Passphrase: (\S{40,})$", out, re.M)[1]
    assert bytes.fromhex((tmp_path / "k" / "fleet.key").read_text()) == passphrase_secret(passphrase)
    assert "signing setup" in out


def test_no_two_new_keys_are_the_same_and_none_is_overwritten(keys, tmp_path):
    assert keys("new", "1", "--keys", tmp_path / "k")[0] == 0
    assert keys("new", "2", "--keys", tmp_path / "k")[0] == 0
    before = key_path(tmp_path / "k", 1).read_text()
    assert before != key_path(tmp_path / "k", 2).read_text()
    for command in ("new", "add"):
        code, out, err = keys(command, "1", "--keys", tmp_path / "k", given=PASSPHRASE)
        assert (code, out) == (2, "")
        assert "never overwritten" in err
    assert key_path(tmp_path / "k", 1).read_text() == before


def test_a_passphrase_from_standard_input_is_in_no_argument_and_no_text(tmp_path):
    process = subprocess.Popen(
        [*COMMAND, "add", "7", "--keys", str(tmp_path / "k")],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    process.stdin.write(PASSPHRASE + "\n")
    process.stdin.flush()
    visible = [Path(f"/proc/{process.pid}/{name}").read_text() for name in ("cmdline", "environ", "status")]
    out, err = process.communicate(timeout=60)
    assert process.returncode == 0, err
    assert hides([*visible, out, err])
    assert bytes.fromhex(key_path(tmp_path / "k", 7).read_text()) == passphrase_secret(PASSPHRASE)


@pytest.mark.slow_but_first
@pytest.mark.parametrize("again", [PASSPHRASE, "another"])
def test_a_passphrase_from_the_terminal_is_not_echoed(tmp_path, again):
    master, slave = pty.openpty()
    process = subprocess.Popen(
        [*COMMAND, "add", "7", "--keys", str(tmp_path / "k")],
        stdin=slave,
        stdout=slave,
        stderr=slave,
        start_new_session=True,
    )
    os.close(slave)
    seen = ""
    for prompt, answer in (("Passphrase: ", PASSPHRASE), ("Again: ", again)):
        end = time.monotonic() + 60
        while prompt not in seen and time.monotonic() < end:
            seen += os.read(master, 1000).decode()
        os.write(master, answer.encode() + b"\n")
    code = process.wait(timeout=60)
    with contextlib.suppress(OSError):
        seen += os.read(master, 10_000).decode()
    os.close(master)
    assert hides([seen])
    if again == PASSPHRASE:
        assert code == 0
        assert read_ring(tmp_path / "k").key_of(7).fingerprint == Key(passphrase_secret(PASSPHRASE)).fingerprint
    else:
        assert code == 2
        assert "not the same" in seen
        assert not (tmp_path / "k").exists()


def test_from_a_file_and_as_hexadecimal_digits(keys, tmp_path):
    (tmp_path / "phrase").write_text(PASSPHRASE + "\r\nsecond line\n")
    assert keys("add", "7", "--keys", tmp_path / "k", "--file", tmp_path / "phrase")[0] == 0
    assert keys("add", "8", "--keys", tmp_path / "k", "--hex", given=secret_of(8).hex() + "\n")[0] == 0
    ring = read_ring(tmp_path / "k")
    assert ring.key_of(7).fingerprint == Key(passphrase_secret(PASSPHRASE)).fingerprint
    assert ring.key_of(8).fingerprint == Key(secret_of(8)).fingerprint


def test_short_passphrases_are_taken_with_a_warning(keys, tmp_path):
    code, _, err = keys("add", "7", "--keys", tmp_path / "k", given="opensesame\n")
    assert code == 0
    assert str(SHORT) in err
    assert "opensesame" not in err


BAD = {
    "nobody": (("new", "0"), "", "neither a system id"),
    "too large": (("new", "256"), "", "neither a system id"),
    "a word": (("add", "seven"), "", "neither a system id"),
    "nothing": (("add", "7"), "\n", "cannot be empty"),
    "half a key": (("add", "7", "--hex"), "abcd", "a key has 32 bytes, not 2"),
    "no digits": (("add", "7", "--hex"), PASSPHRASE, "64 hexadecimal digits"),
    "zeros": (("add", "7", "--hex"), "00" * 32, "zeros"),
    "no file": (("add", "7", "--file", "/nowhere/at/all"), "", "No such file"),
    "no folder": (("list",), "", "gcs keys new"),
    "nothing to check": (("check",), "", "gcs keys new"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_input_is_one_clear_line(case, keys, tmp_path):
    args, given, message = BAD[case]
    code, out, err = keys(*args, "--keys", tmp_path / "k", given=given)
    assert (code, out) == (2, "")
    assert message in err
    assert err.count("\n") == 1
    assert err.startswith("gcs: ")
    assert hides([err])
    assert not (tmp_path / "k").exists()


def test_check_refuses_what_cannot_be_flown_with(keys, tmp_path):
    folder = tmp_path / "k"
    path, _ = write_key(folder, 7, secret_of(7))
    assert keys("check", "--keys", folder)[0] == 0
    path.chmod(0o644)
    code, _, err = keys("check", "--keys", folder)
    assert code == 2
    assert f"run: chmod 600 {path}" in err


def test_check_names_those_who_share_a_key(keys, tmp_path):
    for system_id in (3, 5, FLEET):
        write_key(tmp_path / "k", system_id, secret_of(3))
    write_key(tmp_path / "k", 9, secret_of(9))
    code, out, err = keys("check", "--keys", tmp_path / "k")
    assert code == 0
    assert "4 keys" in out
    assert "system 3 and system 5 and the fleet have the same key" in err


def test_check_counts_what_a_recording_is_worth(keys, tmp_path):
    folder, log = tmp_path / "k", tmp_path / "flight.tlog"
    for system_id in (1, 2):
        write_key(folder, system_id, secret_of(system_id))
    senders = [Sender(1), Sender(2), Sender(2, secret=secret_of(1)), Sender(3, signs=False), Sender(2, version=1)]
    radio = Sender(51, 68, signs=False)
    with log.open("wb") as file:

        def put(t_us, raw):
            file.write(struct.pack(">Q", t_us) + raw)

        for k in range(20):
            t_us = T0 + k * 100_000
            frames = [s.frame(timestamp=NOW + k * 10_000 if s.mav.signing.secret_key else None) for s in senders]
            for frame in frames:
                put(t_us, frame)
            put(t_us, frames[0])
            put(t_us, radio.frame(ardupilotmega.MAVLink_radio_status_message(180, 170, 100, 40, 40, 0, 0)))
        put(T0 + 3_000_000, Sender(2, timestamp=NOW + 700 * 100_000).frame())
    code, out, err = keys("check", "--keys", folder, "--log", log)
    assert (code, err) == (0, "")
    table = [line.split() for line in out.splitlines()[3:8]]
    assert table == [
        ["system", "open", "good", "unsigned", "bad", "replayed", "future", "held"],
        ["1", "0", "20", "0", "0", "20", "0", "0"],
        ["2", "0", "20", "20", "20", "0", "1", "0"],
        ["3", "0", "0", "20", "0", "0", "0", "0"],
        ["51", "20", "0", "0", "0", "0", "0", "0"],
    ]
    assert "40 of 141 frames would be accepted" in out


def test_check_says_where_the_flight_decided_otherwise(keys, tmp_path):
    folder = tmp_path / "k"
    write_key(folder, 7, secret_of(7))
    late, sender = Sender(8, timestamp=NOW - 90 * 100_000), Sender(7)
    write_key(folder, 8, secret_of(8))
    with TlogWriter(tmp_path / "telemetry.tlog") as log:
        for k in range(10):
            # 7 is good here, and the flight had heard its first three; 8 is held here, and an operator accepted it
            log.write(replace(sender.packet(t_us=T0 + k * 10_000), auth=Auth.REPLAYED if k < 3 else Auth.GOOD))
            log.write(replace(late.packet(t_us=T0 + k * 10_000), auth=Auth.GOOD))
    code, out, err = keys("check", "--keys", folder, "--log", tmp_path / "telemetry.tlog")
    assert (code, err) == (0, "")
    assert "10 of 20 frames would be accepted" in out
    assert "system 7: 3 of these were refused in flight, replayed" in out
    assert "system 8: 10 were accepted in flight that are held here" in out
    # of the same frames in a log of somebody else nothing is said
    (tmp_path / "telemetry.tlog").rename(tmp_path / "other.tlog")
    assert "in flight" not in keys("check", "--keys", folder, "--log", tmp_path / "other.tlog")[1]


def test_nothing_that_a_flight_writes_holds_a_key(tmp_path):
    """A key that is sent to a vehicle while recording is in no file; nor is one that verifies."""
    secret = passphrase_secret(PASSPHRASE)
    packet = Sender(255, 190).packet(ardupilotmega.MAVLink_setup_signing_message(7, 1, list(secret), NOW))
    assert secret in packet.raw
    with TlogWriter(tmp_path / "telemetry.tlog") as log:
        log.write(without_secret(packet))
        log.write(Sender(7, secret=secret).packet())
    store = StreamStore(tmp_path)
    store.streams.admit(7, 1, 0, NOW, NOW)
    store.close()
    written = [path.read_bytes() for path in tmp_path.iterdir() if path.is_file()]
    assert len(written) >= 3
    for data in written:
        assert secret[:6] not in data
        assert secret.hex()[:12].encode() not in data
        assert PASSPHRASE.encode() not in data
