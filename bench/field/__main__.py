"""Command line of the field suite."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from bench.field.explain import explain
from bench.field.families import FAMILIES
from bench.field.suite import WORKERS, run


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m bench.field", description="Field suite")
    parser.add_argument("--quick", action="store_true", help="one short session of each family and version")
    parser.add_argument("--seeds", choices=("tune", "report"), default="report")
    parser.add_argument("--family", type=int, action="append", default=[], choices=tuple(FAMILIES), help="repeatable")
    parser.add_argument("--hard", action="store_true", help="the hard version only")
    parser.add_argument("--standard", action="store_true", help="the standard version only")
    parser.add_argument("--out", type=Path, default=Path("bench-results/field"))
    parser.add_argument("--workers", type=int, default=WORKERS)
    parser.add_argument("--seed", type=int, help="of the session to explain")
    parser.add_argument("--explain", action="store_true", help="say where the product was wrong in one session")
    options = parser.parse_args()
    if options.explain:
        if len(options.family) != 1 or options.seed is None:
            parser.error("--explain needs one --family and a --seed")
        print(explain(options.family[0], options.hard, options.seed))
        return
    versions = [hard for hard, asked in ((False, options.standard), (True, options.hard)) if asked] or [False, True]
    text = run(
        options.out,
        options.quick,
        split=options.seeds,
        families=options.family,
        versions=versions,
        workers=options.workers,
        say=lambda line: print(line, file=sys.stderr, flush=True),
    )
    print(text)


if __name__ == "__main__":
    main()
