"""Who holds a port, where the system says so."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

__all__ = ["owner_of"]

_PROC = Path("/proc")


def owner_of(protocol: Literal["udp", "tcp"], port: int) -> str:
    """`` by process <id> (<name>)`` that holds a port, empty when it cannot be told.

    Of several the eldest is named: a station that lends its sockets to processes of its own is what a user would stop.
    """
    try:
        inodes = _inodes((_PROC / "net" / protocol).read_text().splitlines()[1:], port)
        holders = _processes_with(inodes) if inodes else []
    except OSError:
        return ""
    if not holders:
        return ""
    _, process_id, name = min(holders)
    return f" by process {process_id} ({name})"


def _inodes(lines: list[str], port: int) -> set[str]:
    fields = (line.split() for line in lines)
    return {field[9] for field in fields if len(field) > 9 and int(field[1].rpartition(":")[2], 16) == port}


def _processes_with(inodes: set[str]) -> list[tuple[int, int, str]]:
    """Start (ticks since boot, proc(5)), id and name of each process that holds one of these sockets."""
    wanted = {f"socket:[{inode}]" for inode in inodes}
    holders = []
    for process in _PROC.iterdir():
        if not process.name.isdigit():
            continue
        try:
            if any(str(handle.readlink()) in wanted for handle in (process / "fd").iterdir()):
                stat, name = ((process / file).read_text(errors="replace") for file in ("stat", "comm"))
                holders.append((int(stat.rpartition(")")[2].split()[19]), int(process.name), name.strip()))
        except OSError:
            continue  # gone meanwhile, or somebody else's
    return holders
