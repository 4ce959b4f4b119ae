"""Who holds a port, where the system says so."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

__all__ = ["owner_of"]


def owner_of(protocol: Literal["udp", "tcp"], port: int) -> str:
    """`` by process <id> (<name>)`` that holds a port, empty when it cannot be told."""
    try:
        inodes = _inodes(Path(f"/proc/net/{protocol}").read_text().splitlines()[1:], port)
        return _process_with(inodes) if inodes else ""
    except OSError:
        return ""


def _inodes(lines: list[str], port: int) -> set[str]:
    fields = (line.split() for line in lines)
    return {field[9] for field in fields if len(field) > 9 and int(field[1].rpartition(":")[2], 16) == port}


def _process_with(inodes: set[str]) -> str:
    wanted = {f"socket:[{inode}]" for inode in inodes}
    for process in Path("/proc").iterdir():
        if not process.name.isdigit():
            continue
        try:
            if any(str(handle.readlink()) in wanted for handle in (process / "fd").iterdir()):
                return f" by process {process.name} ({(process / 'comm').read_text().strip()})"
        except OSError:
            continue  # gone meanwhile, or somebody else's
    return ""
