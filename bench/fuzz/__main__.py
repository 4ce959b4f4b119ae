"""Command line of the fuzzers."""

from __future__ import annotations

import argparse
import random
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from itertools import chain
from pathlib import Path

from bench.command_line import RESULTS, write_page
from bench.fuzz.datagrams import BLOCK, INPUTS, DatagramScore, fuzz_datagrams, lost, read_with_ours, read_with_pymavlink
from bench.fuzz.frames import FuzzScore, frame_pool
from bench.fuzz.logs import LogScore, fuzz_logs
from bench.fuzz.readers import ReaderScore, fuzz_places, fuzz_readers
from gcs.cli.output.console import print_note
from infra.markdown import markdown_table

_HEAD = """# What damage and hostility cost: {}

Every case comes from a seed; the truth is known because the damage was done here.

"""
_MAX_FAILURES = 20
_LOG_COUNTS = (
    *("logs", "whole", "lost", "wrong_times", "phantoms", "unknown_phantoms", "false_bytes", "missed_bytes"),
)


def logs_text(scores: Mapping[str, LogScore]) -> str:
    """Sums by kind of damage."""
    total = scores["all"]
    share = total.phantoms / max(1, total.whole)
    exceptions = sum("Error" in line for line in total.failures)
    lines = [
        f"{total.logs:,} logs with 0 to 4 kinds of damage each, {total.whole:,} records left whole. Exceptions "
        f"{exceptions}; whole records lost {total.lost}, with a wrong time {total.wrong_times} (and {total.lonely} "
        f"alone with their clock, which look like a damaged stamp); messages that were never written "
        f"{total.phantoms} ({share:.1e} of the whole ones; nearly all were carried by a tunnel whose own header is "
        f"gone), of unknown kinds {total.unknown_phantoms}. "
        f"Undamaged bytes named as damaged {total.false_bytes}, damaged bytes in no range "
        f"{total.missed_bytes} of {total.damaged_bytes:,}. Frames saved besides, whose own stamp is gone: "
        f"{total.found_besides:,}; stamps wrong by more than a minute that were accepted: {total.stamps_believed}. "
        f"Slowest log {total.slowest_ms:.0f} ms of CPU.",
        "",
        markdown_table(
            (
                "",
                *("logs", "whole", "lost", "wrong time", "phantoms", "of unknown kind"),
                *("falsely named B", "missed B", "slowest ms"),
            ),
            [
                [kind, *(str(getattr(s, name)) for name in _LOG_COUNTS), f"{s.slowest_ms:.1f}"]
                for kind, s in sorted(scores.items())
            ],
        ),
    ]
    shown = sorted(total.failures, key=lambda line: "lost 0, wrong times 0" in line)[:_MAX_FAILURES]
    if shown:
        lines += ["", "Seeds to look at:", "", *(f"- {line}" for line in shown)]
    return "\n".join(lines)


def datagrams_text(score: DatagramScore) -> str:
    """One paragraph, and what failed."""
    return _with_failures(
        f"{score.datagrams:,} datagrams through split, decode and the fleet's state: {score.frames:,} frames let "
        f"through, {score.notices:,} notices. Exceptions {len(score.failures)}; slowest datagram "
        f"{score.slowest_ms:.1f} ms of CPU.",
        score,
    )


def _with_failures(text: str, score: FuzzScore) -> str:
    return "\n".join([text, *(f"- {line[:400]}" for line in score.failures[:_MAX_FAILURES])])


def streams_text(count: int = 2000) -> str:
    """Undamaged frames lost by our parser and by pymavlink's."""
    version2 = [f for f in frame_pool(carried=False) if f[0] == 0xFD and not f[2] and f[7:10] != b"\x61\xea\0"]
    frames: Sequence[bytes] = version2[:count]
    made = {name: make(frames, random.Random(1)) for name, make in INPUTS.items()}
    rows = [
        [name, *(str(lost(parts, read)[0]) for read in (read_with_ours, read_with_pymavlink))]
        for name, parts in made.items()
    ]
    about = f"Undamaged frames lost of {len(frames)}, one in ten hit, pieces of 333 bytes."
    return f"{about}\n\n{markdown_table(('input', 'ours lost', 'pymavlink lost'), rows)}"


def readers_text(score: ReaderScore) -> str:
    """One paragraph, and what failed."""
    files = score.read + score.refused + len(score.failures)
    return _with_failures(
        f"{files:,} files of all readers, damaged or replaced by pipes, folders, devices and links: {score.read:,} "
        f"read, {score.refused:,} refused in one line each. Exceptions, crashes, files that took longer than a minute "
        f"or more memory than three times their size and 200 MB: {len(score.failures)}. Most memory for one file: "
        f"{score.most_bytes / 1e6:.0f} MB.",
        score,
    )


_COUNTS = {"logs": 10_000, "datagrams": 1_000_000, "streams": 2000, "readers": 500}
_STEP = 200
GOOD = Path("tests/corpus/readers")
"""Good files of all readers."""


def _logs(first: int, count: int) -> str:
    scores: dict[str, LogScore] = {}
    for seed in range(first, first + count, _STEP):
        for kind, score in fuzz_logs(range(seed, min(seed + _STEP, first + count))).items():
            scores.setdefault(kind, LogScore()).add(score)
        print_note(f"{scores['all'].logs} logs, {len(scores['all'].failures)} to look at")
    return logs_text(scores)


def _datagrams(first: int, count: int) -> str:
    score = DatagramScore()
    for start in range(0, count, BLOCK):
        score.add(fuzz_datagrams(first + start // BLOCK, min(BLOCK, count - start)))
        print_note(f"{score.datagrams} datagrams, {len(score.failures)} exceptions")
    return datagrams_text(score)


def _readers(first: int, count: int, only: str) -> str:
    score = ReaderScore()
    for one in chain(fuzz_places(GOOD, only=only), fuzz_readers(GOOD, range(first, first + count), only=only)):
        score.add(one)
        if one.failures or not (score.read + score.refused) % _STEP:
            said = one.failures[0] if one.failures else f"{score.read} read, {score.refused} refused"
            print_note(said)
    return readers_text(score)


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m bench.fuzz", description=__doc__)
    parser.add_argument("what", choices=list(_COUNTS))
    parser.add_argument("--count", type=int, help="cases; " + ", ".join(f"{k} {v}" for k, v in _COUNTS.items()))
    parser.add_argument("--seed", type=int, default=0, help="the first seed")
    parser.add_argument("--only", default="", help="one reader")
    parser.add_argument("--out", type=Path, default=RESULTS, help="folder of the page (%(default)s)")
    options = parser.parse_args()
    count = _COUNTS[options.what] if options.count is None else options.count
    fuzzers: dict[str, Callable[[int, int], str]] = {
        "logs": _logs,
        "datagrams": _datagrams,
        "streams": lambda first, count: streams_text(count),
        "readers": partial(_readers, only=options.only),
    }
    text = fuzzers[options.what](options.seed, count)
    write_page(options.out / f"fuzz_{options.what}.md", _HEAD.format(options.what) + text + "\n")


if __name__ == "__main__":
    main()
