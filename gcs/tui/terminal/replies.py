"""Replies of a terminal, taken out of what is typed on it; a reply that comes late, or in parts, is never a key."""

from __future__ import annotations

import re
from collections.abc import Callable

REPORT = "\x1b[0n"
"""The reply to a device status request: all is well."""

_REPLY = re.compile(
    r"\x1b\[[03]n"  # device status
    r"|\x1b\[\?[\d;:]*[cnuSW]"  # attributes, states, flags of the keyboard, graphics
    r"|\x1b\[[>=][\d;:]*[a-zA-Z]"  # attributes, secondary and tertiary
    r"|\x1b\[[46];\d+;\d+t"  # pixels of the window and of a cell
    r"|\x1b_G[^\x1b]*\x1b\\"  # kitty's graphics
    r"|\x1b\][^\x1b\x07]*(?:\x1b\\|\x07)"  # colours
    r"|\x1bP[^\x1b]*\x1b\\"  # settings and versions
)
_BEGUN = re.compile(
    r"\x1b(?:\[(?:[03]?|[?>=][\d;:]*\$?|[46](?:;\d*(?:;\d*)?)?)|_G[^\x1b]*\x1b?|\][^\x1b\x07]*\x1b?|P[^\x1b]*\x1b?|_)?\Z"
)
"""The end of what was read may be the beginning of one of these."""
_NO_KEY = re.compile(r"\x1b(?:\[[?>=]|_G)")
"""Beginning that no key has."""
MAX_CHARACTERS = 4_096
"""A reply that is longer is none."""
KEY_HOLD_S = 0.03
"""An escape is held for this long, for it may begin a reply: parts of one come together but for the line between."""
REPLY_HOLD_S = 1.0
"""Time for which the rest of what can only be a reply is awaited."""


class Replies:
    """Separates replies from keys over any number of reads."""

    def __init__(self, on_reply: Callable[[str], None]) -> None:
        self._on_reply = on_reply
        self._held = ""

    @property
    def hold_s(self) -> float | None:
        """Seconds to wait for the rest of what may be part of a reply, None when nothing is held."""
        if not self._held:
            return None
        return REPLY_HOLD_S if _NO_KEY.match(self._held) else KEY_HOLD_S

    def keys_in(self, text: str) -> str:
        """Typed part of what was read."""
        text = self._held + text
        begun = _BEGUN.search(text)
        at = len(text) if begun is None or len(text) - begun.start() > MAX_CHARACTERS else begun.start()
        text, self._held = text[:at], text[at:]
        return _REPLY.sub(self._take, text)

    def release(self) -> str:
        """Text that was held, as typed: the rest of a reply has not come; of what no key begins with, nothing."""
        held, self._held = self._held, ""
        return "" if _NO_KEY.match(held) else held

    def _take(self, match: re.Match[str]) -> str:
        self._on_reply(match.group())
        return ""
