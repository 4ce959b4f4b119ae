"""Play attacks against a real ``gcs fly --headless`` and report what was recorded and accepted of them.

    python -m bench.attacks --list
    python -m bench.attacks components --quick
    python -m bench.attacks --gcs /path/to/another/.venv/bin/gcs --rows before.csv
    python -m bench.attacks -o bench/results/attacks.md --before before.csv

Everything that is sent is written with pymavlink; what is recorded is read from the session's files; what is accepted
is what the station under test makes of its own recording, and what its event log holds.
"""

from __future__ import annotations

import argparse
import os
import shlex
import shutil
import signal
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from bench.attacks import (
    contests,
    disclosure,
    disk,
    doors,
    quiet,
    signed,
    streams,
    takeover,
    video_port,
)
from bench.attacks.handed import commands, files, folders
from bench.attacks.report import AttackRow, page
from bench.attacks.run import Attack, Options
from bench.rows import read, write

ATTACKS: Final[dict[str, Attack]] = {
    "components": takeover.components,
    "duplicates": contests.duplicates,
    "late-links": contests.late_links,
    "jammed": contests.jammed,
    "first-position": takeover.first_position,
    "folders": folders.hostile_folders,
    "password": disclosure.video_password,
    "behind-out": disclosure.behind_an_output,
    "late-start": signed.late_start,
    "restarts": signed.restarts,
    "replayed": signed.replayed,
    "frozen-disk": disk.frozen_disk,
    "stopped": disk.stopped_processes,
    "quiet": quiet.healthy_fleet,
    "recording": quiet.played_recording,
    "slow-clocks": quiet.slow_clocks,
    "three-bytes": streams.swallowed_frames,
    "video-port": video_port.others_at_the_port,
    "files": files.hostile_files,
    "commands": commands.hostile_surroundings,
    "doors": doors.doors_of_a_flight,
}


def _options(chosen: argparse.Namespace) -> Options:
    words = shlex.split(chosen.gcs) if chosen.gcs else [str(Path(sys.executable).with_name("gcs"))]
    words[0] = str(Path(words[0]).absolute()) if "/" in words[0] else words[0]
    python = Path(words[0]).with_name("python")
    return Options(
        gcs=tuple(words),
        python=str(python) if python.exists() else sys.executable,
        quick=chosen.quick,
        minutes=chosen.minutes,
        recording=chosen.recording,
    )


def _play(name: str, options: Options) -> list[AttackRow]:
    """One attack; one that cannot be played is a row with the reason."""
    began_s = time.monotonic()
    try:
        rows = ATTACKS[name](options)
    except Exception as error:  # noqa: BLE001 - the others are still to be played, and the row has the error
        rows = [
            AttackRow(attack=name, case="cannot be judged", held=False, note=f"{type(error).__name__}: {error}"[:300])
        ]
    print(f"{name}: {time.monotonic() - began_s:.0f} s", file=sys.stderr, flush=True)
    for row in rows:
        print(f"  {'held    ' if row.held else 'NOT HELD'} {row.case}: {row.summary}", file=sys.stderr, flush=True)
    return rows


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m bench.attacks", description=(__doc__ or "").split("\n")[0])
    add = parser.add_argument
    add("names", nargs="*", metavar="NAME", help="attacks; all when none is given")
    add("--list", action="store_true", help="what there is")
    add("--gcs", default="", metavar="COMMAND", help="the station under test; that of this environment by default")
    add("--quick", action="store_true", help="shorter flights and fewer cases")
    add("--minutes", type=float, default=20.0, help="of the quiet flight")
    add("--recording", type=Path, default=Path("sitl_logs/ardupilot-swarm"), help="session that is played live")
    add("--rows", type=Path, help="keep the results in this file as well, for --before")
    add("--results", type=Path, action="append", default=[], help="play nothing, report these; the last one counts")
    add("--before", type=Path, action="append", default=[], help="results of an earlier build, for a column more")
    add("-o", "--out", type=Path, help="the page, in Markdown")
    add("--keep", action="store_true", help="keep the sessions, and print where")
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command; 1 when something was not held."""
    chosen = _parser().parse_args(argv)
    if chosen.list:
        for name, attack in ATTACKS.items():
            print(f"{name:<14} {(attack.__doc__ or '').split(chr(10))[0]}")
        return 0
    if unknown := set(chosen.names) - set(ATTACKS):
        print(f"{', '.join(sorted(unknown))}: no such attack; --list names them", file=sys.stderr)
        return 2
    rows = _results(chosen.results) if chosen.results else _played(chosen)
    text = page(rows, "Attacks", _words(chosen), _results(chosen.before))
    if chosen.out:
        chosen.out.write_text(text, encoding="utf-8")
    print(text)
    return 0 if all(row.held for row in rows) else 1


def _results(files: Sequence[Path]) -> list[AttackRow]:
    """Kept results; of a case that was played again, the last."""
    rows = [row for file in files for row in read(file, AttackRow)]
    return list({(row.attack, row.case): row for row in rows}.values())


def _played(chosen: argparse.Namespace) -> list[AttackRow]:
    options = _options(chosen)
    # as Ctrl-C: what was started is ended, what was mounted or frozen is set free
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    rows: list[AttackRow] = []
    try:
        for name in chosen.names or ATTACKS:
            rows += _play(name, options)
            if chosen.rows:
                write(chosen.rows, AttackRow, rows)
    finally:
        if chosen.keep:
            print(f"sessions in {options.folder}", file=sys.stderr)
        else:
            shutil.rmtree(options.folder, ignore_errors=True)
    return rows


WORDS = """
`python -m bench.attacks{words}`

Attacks played from outside against a real `gcs fly --headless`. Packets are written with pymavlink; what was recorded
is read from `telemetry.tlog`, reports from `events.jsonl`, and what is accepted is what the station under test
makes of its own recording, looked at five times a second.

"Lost" are packets of true vehicles that are not in the log or, with keys, were refused. "Recorded" are those of the
attacker. "False believed" is for how long a false place was used after it could be known to be false, "alarm after" is
how long the alarm took from then. A case is held when nothing false is believed, nothing true is lost and the alarm
comes within two seconds, with one more granted to a busy machine. "Innocent" cases must raise no alarm. "Before" is the
same case against an earlier build.

Sender and station shared {cores} cores with other work. Floods that claim to be a vehicle are tried by
`python -m bench.receiving.flood_claims`.
"""


def _words(chosen: argparse.Namespace) -> str:
    options = [*chosen.names, *(["--quick"] if chosen.quick else []), f"--minutes {chosen.minutes:g}"]
    return WORDS.format(words="".join(f" {word}" for word in options), cores=os.cpu_count())


if __name__ == "__main__":
    raise SystemExit(main())
