"""``gcs`` as a shell starts it: in this process where that proves the same, else in one of its own."""

from __future__ import annotations

import gc
import io
import os
import subprocess
import sys
from pathlib import Path
from unittest.mock import patch

from gcs.cli.app import main

GCS = (sys.executable, "-c", "from gcs.cli.app import main; main()")
"""A command that starts it, without its arguments."""


def run_gcs(*arguments: object) -> tuple[int, str, str]:
    """Runs the command in this process; returns exit code, stdout, stderr."""
    out, err = (io.TextIOWrapper(io.BytesIO(), encoding="utf-8") for _ in range(2))
    thresholds = gc.get_threshold()
    words = ["gcs", *map(str, arguments)]
    with Path(os.devnull).open() as nothing, patch.multiple(sys, argv=words, stdin=nothing, stdout=out, stderr=err):
        try:
            main()
            code = 0
        except SystemExit as end:
            code = end.code or 0
        finally:
            gc.set_threshold(*thresholds)
            gc.unfreeze()
    return code, *(stream.buffer.getvalue().decode() for stream in (out, err))


def run_gcs_process(*arguments: object) -> tuple[int, str, str]:
    """Runs the command in a process of its own; returns exit code, stdout, stderr."""
    done = subprocess.run(
        [*GCS, *map(str, arguments)],
        capture_output=True,
        text=True,
        stdin=subprocess.DEVNULL,
        timeout=120,
        check=False,
    )
    return done.returncode, done.stdout, done.stderr
