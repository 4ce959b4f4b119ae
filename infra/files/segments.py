"""The names of a recording's files: ``telemetry.tlog``, then ``telemetry.1.tlog``, ``telemetry.2.tlog``, …"""

from __future__ import annotations

from pathlib import Path

__all__ = ["segment_path", "segments"]


def segment_path(path: Path, segment: int) -> Path:
    """``telemetry.tlog`` for segment 0, ``telemetry.1.tlog`` for segment 1."""
    return path.with_name(f"{path.stem}.{segment}{path.suffix}") if segment else path


def segments(path: Path) -> list[Path]:
    """All segments that exist of a recording, in the order they were written."""
    rest = path.parent.glob(f"{path.stem}.*{path.suffix}")
    numbered = [(int(number), file) for file in rest if (number := file.stem.removeprefix(f"{path.stem}.")).isdecimal()]
    return [path] * path.is_file() + [file for _, file in sorted(numbered) if file.is_file()]
