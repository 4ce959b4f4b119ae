"""The command that is measured: of this checkout, by this Python."""

from __future__ import annotations

import shlex
import sys

__all__ = ["GCS", "GCS_WORDS"]

GCS_WORDS = (sys.executable, "-c", "from gcs.cli.app import main; main()")
GCS = shlex.join(GCS_WORDS)
