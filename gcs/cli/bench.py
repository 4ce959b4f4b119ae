"""``gcs bench``: the benchmarks, each in a process of its own."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Annotated

import typer

from gcs.errors import GcsError

__all__ = ["bench"]

ROOT = Path(__file__).parents[2]
SUITES = ("paper", "field", "latency", "apriltag")


def bench(
    context: typer.Context,
    suite: Annotated[str, typer.Argument(help=f"One of {', '.join(SUITES)}; --help after it lists its options.")],
) -> None:
    """Run a benchmark: the published experiments, the field suite, latencies, or tags; results in bench-results/."""
    if suite not in SUITES:
        raise GcsError(f"no benchmark {suite!r}; there are {', '.join(SUITES)}")
    if not (ROOT / "bench" / suite).is_dir():
        raise GcsError(f"{ROOT}: no bench folder here; install the whole wheel, or run it from a checkout")
    path = os.pathsep.join(filter(None, (str(ROOT), os.environ.get("PYTHONPATH"))))
    command = [sys.executable, "-m", f"bench.{suite}", *context.args]
    raise SystemExit(subprocess.call(command, env=os.environ | {"PYTHONPATH": path}))
