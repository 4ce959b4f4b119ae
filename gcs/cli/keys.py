"""``gcs keys``: the keys that vehicles sign with."""

from __future__ import annotations

import base64
import getpass
import secrets
import sys
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer

from gcs.cli.output.console import AsJson, print_json, print_lines, print_note
from gcs.cli.output.tables import print_table
from gcs.errors import ConfigError
from gcs.mission.mission import user_keys
from gcs.session.log import SessionLog
from infra.files.segment import segments
from infra.session_format import LOG, REFUSED
from mavlink.errors import SigningError
from mavlink.protocol.dialect import RADIO_STATUS
from mavlink.protocol.packet import Auth
from mavlink.signing.keys import (
    FLEET,
    KEY_LENGTH,
    KeyRing,
    key_path,
    passphrase_secret,
    read_ring,
    remove_key,
    write_key,
)
from mavlink.signing.verifier import Verifier
from mavlink.tlog.log import Tlog

app = typer.Typer(
    help="Make, list and check the keys that vehicles sign with.",
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode=None,
)
SHORT = 16
_Who = Annotated[str, typer.Argument(help="System id of the vehicle, 1 to 255, or fleet: all without their own.")]
_Folder = Annotated[
    Path | None, typer.Option("--keys", help="Folder of the keys; else ~/.config/rollcall/keys.", show_default=False)
]


@app.command("new")
def new(
    who: _Who,
    keys: _Folder = None,
    show: Annotated[bool, typer.Option("--show", help="Print the passphrase that gives this key, once.")] = False,
) -> None:
    """Make a random key."""
    folder, system_id = keys or user_keys(), _system_id(who)
    # other ground stations take passphrases, not keys: a random one of 256 bits, letters and digits, makes the key
    passphrase = base64.b32encode(secrets.token_bytes(KEY_LENGTH)).decode().rstrip("=")
    print_lines(_write_key(folder, system_id, passphrase_secret(passphrase)))
    if show:
        print_lines(f"Passphrase: {passphrase}")
        print_lines("It is shown this once. Put it into the vehicle over a cable, never over the air, with MAVProxy:")
        print_lines("  signing setup PASSPHRASE")
        print_lines("or with Mission Planner; see docs/signing.md.")
    else:
        print_lines("Put it into the vehicle over a cable, never over the air; see docs/signing.md.")


@app.command("add")
def add(
    who: _Who,
    keys: _Folder = None,
    file: Annotated[Path | None, typer.Option("--file", help="Read it from the first line of a file.")] = None,
    is_hex: Annotated[bool, typer.Option("--hex", help="It is the key itself, 64 hexadecimal digits.")] = False,
) -> None:
    """Take the passphrase a vehicle already has.

    It is asked for where there is a terminal, else read from standard input; or from a file with --file.
    """
    folder, system_id = keys or user_keys(), _system_id(who)
    if key_path(folder, system_id).exists():
        raise SigningError(f"{key_path(folder, system_id)}: exists already, and keys are never overwritten")
    text = _read_file(file) if file else _read_secret("Key: " if is_hex else "Passphrase: ")
    if not text:
        raise SigningError(f"nothing given{f' in {file}' if file else ''}; a passphrase cannot be empty")
    if not is_hex and len(text) < SHORT:
        print_note(f"who records one frame can try passphrases; {SHORT} characters or more are hard to guess")
    secret = _from_hex(text) if is_hex else passphrase_secret(text)
    del text
    print_lines(_write_key(folder, system_id, secret))


@app.command("remove")
def remove(who: _Who, keys: _Folder = None) -> None:
    """Remove a key for good: its vehicle is not accepted any more."""
    system_id = _system_id(who)
    path, fingerprint = remove_key(keys or user_keys(), system_id)
    print_lines(f"Key of {_name(system_id)}, fingerprint {fingerprint}, removed from {path}")


@app.command("list")
def list_(keys: _Folder = None, as_json: AsJson = False) -> None:
    """List the keys: whose they are, and their fingerprints."""
    folder = keys or user_keys()
    ring = read_ring(folder)
    if as_json:
        print_json(
            {"folder": str(folder), "keys": [{"of": _name(i), "fingerprint": f} for i, f in _fingerprints(ring)]}
        )
        return
    print_lines(f"{folder}: {_count(ring)}")
    if ring:
        print_table(("key of", "fingerprint"), ((_name(i), fingerprint) for i, fingerprint in _fingerprints(ring)))


@app.command("check")
def check(
    keys: _Folder = None,
    log: Annotated[list[Path] | None, typer.Option("--log", help="Telemetry log to verify; may be repeated.")] = None,
    as_json: AsJson = False,
) -> None:
    """Check that a folder of keys is fit to fly with.

    With --log: how many frames of a recording would be accepted, and what is wrong with the others.
    """
    folder = keys or user_keys()
    ring = read_ring(folder)
    if not ring:
        raise SigningError(f"{folder}: no key in it; make one with gcs keys new")
    shared = [[_name(system_id) for system_id in systems] for systems in _shared(ring)]
    for names in shared:
        print_note(f"{' and '.join(names)} have the same key: one of them, stolen, can pose as the others")
    checker = Verifier(ring, steady_ns=lambda: 0)
    judged = ((path, verdicts(checker, path)) for path in log or [])
    if as_json:
        logs = [{"path": str(path), "verdicts": verdict_rows(counts)} for path, counts in judged]
        print_json({"folder": str(folder), "keys": len(_fingerprints(ring)), "shared": shared, "logs": logs})
        return
    print_lines(f"{folder}: {_count(ring)}, readable by their owner only")
    for path, counts in judged:
        print_lines("")
        _print_verdicts(path, counts)
        print_lines(*flight_lines(counts))


def verdicts(checker: Verifier, path: Path) -> Counter[tuple[int, Auth, Auth]]:
    """Counts of each verdict that is given to each system of a log at the times of its records, and was in flight.

    The flight's is ``GOOD`` for all that it accepted; for a log without a session's tables it is the same as here.
    """
    flown = path.name == LOG and bool(segments(path.with_name(REFUSED.name)))
    log = SessionLog(path) if flown else Tlog.open(path)
    counts: Counter[tuple[int, Auth, Auth]] = Counter()
    for packet in log.packets():
        here = checker.check(packet)
        counts[packet.system_id, here, max(packet.auth, Auth.GOOD) if flown else here] += 1
    return counts


def flight_lines(judged: Counter[tuple[int, Auth, Auth]]) -> list[str]:
    """Lines about what the flight decided otherwise; none where it did not."""
    lines = []
    for (system_id, here, flown), count in sorted(judged.items()):
        if here <= Auth.GOOD < flown:
            lines.append(f"system {system_id}: {count} of these were refused in flight, {flown.name.lower()}")
        elif flown <= Auth.GOOD < here:
            lines.append(f"system {system_id}: {count} were accepted in flight that are {here.name.lower()} here")
    return [*lines, "The flight knew of frames from before it, and what its operator accepted."] if lines else []


def verdict_rows(judged: Counter[tuple[int, Auth, Auth]]) -> list[dict[str, object]]:
    """The verdicts for programs."""
    return [
        {"system_id": system_id, "verdict": here.name.lower(), "in_flight": flown.name.lower(), "frames": count}
        for (system_id, here, flown), count in sorted(judged.items())
    ]


def _print_verdicts(path: Path, judged: Counter[tuple[int, Auth, Auth]]) -> None:
    counts: Counter[tuple[int, Auth]] = Counter()
    for (system_id, here, _), count in judged.items():
        counts[system_id, here] += count
    systems = sorted({system_id for system_id, _ in counts})
    good = sum(count for (_, verdict), count in counts.items() if verdict is Auth.GOOD)
    print_lines(f"{path}: {good} of {counts.total()} frames would be accepted")
    shown = [verdict for verdict in Auth if verdict is not Auth.OPEN or any((s, Auth.OPEN) in counts for s in systems)]
    columns = ("system", *(verdict.name.lower() for verdict in shown))
    print_table(columns, ((str(s), *(str(counts[s, verdict]) for verdict in shown)) for s in systems), right=columns)
    if Auth.OPEN in shown:
        print_lines(f"open: RADIO_STATUS ({RADIO_STATUS}), which may come unsigned and reports nothing about a vehicle")


def _system_id(who: str) -> int:
    if who == "fleet":
        return FLEET
    if who.isascii() and who.isdigit() and 1 <= int(who) <= 255:
        return int(who)
    raise ConfigError(f"whose key? {who!r} is neither a system id, 1 to 255, nor fleet")


def _write_key(folder: Path, system_id: int, secret: bytes) -> str:
    path, key = write_key(folder, system_id, secret)
    return f"Key of {_name(system_id)}, fingerprint {key.fingerprint}, in {path}"


def _read_secret(prompt: str) -> str:
    """A line from the terminal, unseen, or from standard input where there is none."""
    if not sys.stdin.isatty():
        return sys.stdin.buffer.readline().decode("utf-8", "surrogateescape").rstrip("\r\n")
    try:
        text = getpass.getpass(prompt)
        same = text == getpass.getpass("Again: ")
    except EOFError:
        raise SigningError("nothing given; nothing was written") from None
    if not same:
        del text
        raise SigningError("the two are not the same; nothing was written")
    return text


def _read_file(path: Path) -> str:
    try:
        with path.open(encoding="utf-8", errors="surrogateescape") as file:
            return file.readline().rstrip("\r\n")
    except OSError as error:
        raise SigningError(f"{path}: cannot be read: {error.strerror}") from None


def _from_hex(text: str) -> bytes:
    try:
        return bytes.fromhex(text)
    except ValueError:
        del text
        raise SigningError(f"not a key: {2 * KEY_LENGTH} hexadecimal digits are needed with --hex") from None


def _name(system_id: int) -> str:
    return "the fleet" if system_id == FLEET else f"system {system_id}"


def _count(ring: KeyRing) -> str:
    return "1 key" if len(ring) == 1 else f"{len(ring)} keys"


def _fingerprints(ring: KeyRing) -> Sequence[tuple[int, str]]:
    default = [(FLEET, ring.default.fingerprint)] if ring.default else []
    return [*sorted((system_id, key.fingerprint) for system_id, key in ring.keys.items()), *default]


def _shared(ring: KeyRing) -> list[list[int]]:
    """Return the systems that have one key together."""
    by_key: dict[str, list[int]] = {}
    for system_id, fingerprint in _fingerprints(ring):
        by_key.setdefault(fingerprint, []).append(system_id)
    return [systems for systems in by_key.values() if len(systems) > 1]
