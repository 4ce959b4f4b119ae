"""The ``gcs`` command, before anything is imported that not every system has."""

from __future__ import annotations

import sys

NOT_AVAILABLE = 3
"""Exit code, as ``gcs.cli.output.console`` has it, which cannot be imported here."""


def main() -> None:
    """Run the command where it can run."""
    if sys.platform == "win32":
        sys.stderr.write("gcs: Windows is not supported; install it in WSL2, as on any Linux\n")
        raise SystemExit(NOT_AVAILABLE)
    from gcs.cli.app import main as run

    run()
