"""Files that an operator asks for: new ones only."""

from __future__ import annotations

from pathlib import Path

__all__ = ["save_new"]


def save_new(path: str, text: str) -> Path:
    """Write a file that must not exist; raises OSError or ValueError in words an operator can act on."""
    goal = Path(path.strip()).expanduser()
    if not path.strip():
        raise ValueError("a file name is needed")
    try:
        with goal.open("x", encoding="utf-8") as file:
            file.write(text)
    except FileExistsError:
        raise ValueError("that file exists; choose another name") from None
    return goal
