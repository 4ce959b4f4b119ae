"""Many datagrams with one system call (recvmmsg) beside one datagram a call: processor time of the ingest process.

    python -m bench.receiving.receive_calls [--rounds 4]

Both ways in turn, in one run, at steady rates; a line in its ``sitecustomize`` makes the process that receives do
without the batch call. Written as a table to standard output; ``bench/results/receive_calls.md`` is one that was kept.
"""

from __future__ import annotations

import argparse
import os
import statistics
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import mavlink
from bench.receiving.ingest_cost import steady

RATES = (5000.0, 20_000.0)
ROUNDS = 4
_WITHOUT = "import mavlink.links.udp_link\nmavlink.links.udp_link.available = lambda: False\n"


@contextmanager
def one_a_call() -> Iterator[None]:
    """Has processes that are started meanwhile do without the batch call."""
    before = os.environ.get("PYTHONPATH")
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "sitecustomize.py").write_text(_WITHOUT)
        os.environ["PYTHONPATH"] = os.pathsep.join([folder, str(Path(mavlink.__file__).parents[1])])
        try:
            yield
        finally:
            del os.environ["PYTHONPATH"]
            if before is not None:
                os.environ["PYTHONPATH"] = before


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--rounds", type=int, default=ROUNDS)
    rounds = parser.parse_args().rounds
    print("| packets/s | recvmmsg, µs a packet | one a call, µs a packet | saved |\n|---|---|---|---|")
    for rate in RATES:
        many, each = [], []
        for _ in range(rounds):
            many.append(steady(rate)[0])
            with one_a_call():
                each.append(steady(rate)[0])
        saved = 1.0 - statistics.median(many) / statistics.median(each)
        print(f"| {rate:,.0f} | {_spread(many)} | {_spread(each)} | {saved:.0%} |", flush=True)


def _spread(figures: list[float]) -> str:
    return f"{statistics.median(figures):.2f} ({min(figures):.2f}–{max(figures):.2f})"


if __name__ == "__main__":
    main()
