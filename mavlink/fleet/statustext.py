"""One vehicle's status texts: pieces put together, repetitions left out."""

from __future__ import annotations

from mavlink.protocol.messages import StatusText
from mavlink.state import Level

_REPEATED_US = 5_000_000
"""The same text within this is a repetition."""
_PIECE_BYTES = 50
"""Length of STATUSTEXT's field: a shorter piece is the last of its text."""
_MAX_CHARS, _MAX_OPEN = 1000, 8
"""Most characters of one text, and most texts that wait for further pieces: any sender can send them."""
_WARNING = 4
"""MAV_SEVERITY; lower is more serious."""


class StatusTexts:
    """STATUSTEXT messages in order of arrival."""

    def __init__(self) -> None:
        self.last = ""
        """The newest whole text."""
        self._last_us = 0
        self._pieces: dict[tuple[int, int], str] = {}

    def add(self, sample: StatusText) -> tuple[Level, str]:
        """The text to show; empty for a piece of a longer one and for a repetition within seconds."""
        level: Level = "info" if sample.severity > _WARNING else "warning" if sample.severity == _WARNING else "alarm"
        text = self._joined(sample) if sample.text_id else sample.text
        if not text or (text == self.last and sample.t_us - self._last_us < _REPEATED_US):
            return level, ""
        self.last, self._last_us = text, sample.t_us
        return level, text

    def _joined(self, sample: StatusText) -> str:
        """A long text once its last piece has come, empty before."""
        key = (sample.component_id, sample.text_id)
        text = self._pieces.pop(key, "") + sample.text
        if len(sample.text.encode()) >= _PIECE_BYTES and len(text) < _MAX_CHARS:
            while len(self._pieces) >= _MAX_OPEN:
                del self._pieces[next(iter(self._pieces))]
            self._pieces[key] = text
            return ""
        return text
