"""Command line of this program as other users see it."""

from __future__ import annotations

import ctypes
import os
from collections.abc import Iterable
from pathlib import Path

_STAT = Path("/proc/self/stat")
_ARG_START, _ARG_END = 47, 48
"""Fields of proc_pid_stat(5), from 0: where the arguments lie in memory, which is what ps shows."""


def hide_in_process_list(argument: str, secrets: Iterable[str]) -> None:
    """Overwrite parts of an argument where the system keeps it, for ps and the like; Python's copies stay as they are.

    On systems without /proc nothing is done.

    Args:
        argument: as it was given, or the value in ``--option=value``.
    """
    try:
        # the second field is a name in brackets and may hold spaces
        fields = ["", "", *_STAT.read_text().rpartition(")")[2].split()]
        start, end = int(fields[_ARG_START]), int(fields[_ARG_END])
    except (OSError, ValueError, IndexError):
        return
    if not 0 < start < end:
        return
    line, wanted = ctypes.string_at(start, end - start), os.fsencode(argument)
    place = line.find(wanted)
    while place >= 0:
        for secret in map(os.fsencode, secrets):
            at = wanted.find(secret)
            while at >= 0:
                ctypes.memset(start + place + at, ord("*"), len(secret))
                at = wanted.find(secret, at + 1)
        place = line.find(wanted, place + 1)
