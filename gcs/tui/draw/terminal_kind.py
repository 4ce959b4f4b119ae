"""The kind of terminal, and how finely it divides a cell: no terminal can be asked what its fonts have.

Some draw sextants and octants themselves, without a font, as they draw boxes; those are known by name and version.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Mapping
from typing import Final

from gcs.tui.draw.mosaic import Grain
from gcs.tui.terminal.question import ask

Version = tuple[int, ...]
OCTANTS_SINCE: Final[Mapping[str, Version]] = {"kitty": (0, 40), "foot": (1, 20), "ghostty": (1, 2), "vte": (7800,)}
SEXTANTS_SINCE: Final[Mapping[str, Version]] = {
    "kitty": (0, 20),
    "foot": (1, 6),
    "ghostty": (1, 0),
    "vte": (7000,),
    "wezterm": (20210814,),
}
QUESTION: Final = b"\x1b[>0q"
"""XTVERSION, which few reply to."""
VERSION: Final = re.compile(r"\x1bP>\|([ -~]{1,100})\x1b\\")
NAMED: Final = re.compile(r"(\w+)[ (]([\d.]+)")


def finest_grain(environ: Mapping[str, str], ask: Callable[[], str]) -> Grain:
    """The finest division of cells that the terminal is known to draw.

    Args:
        environ: of this process.
        ask: for the terminal's own word on its name and version, where the environment does not tell.
    """
    name, version = _of_environment(environ) or _of_reply(ask())
    if name in OCTANTS_SINCE and version >= OCTANTS_SINCE[name]:
        return "octants"
    return "sextants" if name in SEXTANTS_SINCE and version >= SEXTANTS_SINCE[name] else "halves"


def is_in_multiplexer(environ: Mapping[str, str]) -> bool:
    """Tell whether tmux or screen is between, which draws what it knows itself."""
    return bool(environ.get("TMUX") or environ.get("STY")) or environ.get("TERM", "").startswith(("tmux", "screen"))


def _of_environment(environ: Mapping[str, str]) -> tuple[str, Version] | None:
    if is_in_multiplexer(environ):
        return "", ()
    if environ.get("VTE_VERSION", "").isascii() and environ.get("VTE_VERSION", "").isdecimal():
        return "vte", (int(environ["VTE_VERSION"]),)
    name = environ.get("TERM_PROGRAM", "").casefold()
    if name in SEXTANTS_SINCE:
        return name, _numbers(environ.get("TERM_PROGRAM_VERSION", ""))
    return None


def _of_reply(reply: str) -> tuple[str, Version]:
    found = NAMED.match(reply)
    return (found[1].casefold(), _numbers(found[2])) if found else ("", ())


def _numbers(text: str) -> Version:
    return tuple(int(part) for part in re.findall(r"\d{1,9}", text, re.ASCII)[:3])


def ask_version(reads: int, writes: int) -> str:
    """Reply of a terminal to XTVERSION, such as ``kitty(0.40.1)``; empty when it does not."""
    found = VERSION.search("".join(ask(reads, writes, QUESTION)))
    return found[1] if found else ""


def has_terminal() -> bool:
    """Tell whether input and output both are a terminal."""
    streams = (sys.__stdin__, sys.__stdout__)
    return all(stream is not None and not stream.closed and stream.isatty() for stream in streams)
