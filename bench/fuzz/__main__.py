"""Command line of the fuzzers."""

from __future__ import annotations

import argparse
import math
import sys
import time
import tomllib
from itertools import chain
from pathlib import Path

from bench.fuzz.datagrams import BLOCK, DatagramScore, fuzz_datagrams
from bench.fuzz.logs import LogScore, fuzz_logs
from bench.fuzz.missions import GOOD, fuzz_missions
from bench.fuzz.readers import ReaderScore, fuzz_places, fuzz_readers
from bench.fuzz.report import datagrams_text, logs_text, missions_text, readers_text, streams_text, write_section

_COUNTS = {"logs": 10_000, "datagrams": 1_000_000, "streams": 2000, "missions": 10_000, "readers": 500}
_STEP = 200


def _logs(first: int, count: int) -> str:
    scores: dict[str, LogScore] = {}
    for seed in range(first, first + count, _STEP):
        for kind, score in fuzz_logs(range(seed, min(seed + _STEP, first + count))).items():
            scores.setdefault(kind, LogScore()).add(score)
        _print_progress(f"{scores['all'].logs} logs, {len(scores['all'].failures)} to look at")
    return logs_text(scores)


def _datagrams(first: int, count: int) -> str:
    score = DatagramScore()
    for start in range(0, count, BLOCK):
        score.add(fuzz_datagrams(first + start // BLOCK, min(BLOCK, count - start)))
        _print_progress(f"{score.datagrams} datagrams, {len(score.failures)} exceptions")
    return datagrams_text(score)


def _readers(good: Path, first: int, count: int, only: str, most_s: float) -> str:
    score, end_s = ReaderScore(), time.monotonic() + most_s
    for one in chain(fuzz_places(good, only=only), fuzz_readers(good, range(first, first + count), only=only)):
        score.add(one)
        if one.failures or not (score.read + score.refused) % _STEP:
            said = one.failures[0] if one.failures else f"{score.read} read, {score.refused} refused"
            _print_progress(said)
        if time.monotonic() > end_s:
            break
    return readers_text(score)


def _print_progress(line: str) -> None:
    print(line, file=sys.stderr, flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m bench.fuzz", description=__doc__)
    parser.add_argument("what", choices=list(_COUNTS))
    parser.add_argument("--count", type=int, help="cases; " + ", ".join(f"{k} {v}" for k, v in _COUNTS.items()))
    parser.add_argument("--seed", type=int, default=0, help="the first seed")
    parser.add_argument("--good", type=Path, default=Path("tests/corpus/readers"), help="good files of all readers")
    parser.add_argument("--minutes", type=float, default=math.inf, help="readers: no file is begun after that")
    parser.add_argument("--only", default="", help="one reader")
    parser.add_argument("--out", type=Path, default=Path("bench-results/fuzz.md"))
    options = parser.parse_args()
    count = _COUNTS[options.what] if options.count is None else options.count
    if options.what == "logs":
        text = _logs(options.seed, count)
    elif options.what == "datagrams":
        text = _datagrams(options.seed, count)
    elif options.what == "readers":
        text = _readers(options.good, options.seed, count, options.only, 60 * options.minutes)
    elif options.what == "streams":
        text = streams_text(count)
    else:
        text = missions_text(fuzz_missions(range(options.seed, options.seed + count), tomllib.loads(GOOD)))
    print(text)
    write_section(options.out, options.what.capitalize(), text)


if __name__ == "__main__":
    main()
