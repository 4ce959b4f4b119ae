"""Memory without a name that several processes can share; it goes with the last that has it open."""

from __future__ import annotations

import os
import tempfile

__all__ = ["make_nameless"]


def make_nameless(size: int) -> int:
    """A file descriptor of ``size`` zero bytes, to be mapped.

    Raises:
        OSError: no memory is left.
    """
    if hasattr(os, "memfd_create"):
        fd = os.memfd_create("rollcall")
    else:
        with tempfile.TemporaryFile() as file:
            fd = os.dup(file.fileno())
    os.ftruncate(fd, size)
    return fd
