"""One vehicle's status texts: pieces put together, repetitions left out."""

from __future__ import annotations

from mavlink.protocol.messages import StatusText

__all__ = ["Texts"]

_REPEATED_US = 5_000_000
_PIECE_BYTES, _MOST_CHARS, _MOST_OPEN = 50, 1000, 8


class Texts:
    """Takes STATUSTEXT messages in order of arrival."""

    def __init__(self) -> None:
        self.last = ""
        """The newest whole text."""
        self._last_us = 0
        self._pieces: dict[tuple[int, int], str] = {}

    def take(self, sample: StatusText) -> str:
        """The text to show; empty for a piece of a longer one and for a repetition within seconds."""
        text = self._joined(sample) if sample.text_id else sample.text
        if not text or (text == self.last and sample.t_us - self._last_us < _REPEATED_US):
            return ""
        self.last, self._last_us = text, sample.t_us
        return text

    def _joined(self, sample: StatusText) -> str:
        """A long text once its last piece is there (a piece shorter than full), empty before."""
        key = (sample.component_id, sample.text_id)
        text = self._pieces.pop(key, "") + sample.text
        if len(sample.text.encode()) >= _PIECE_BYTES and len(text) < _MOST_CHARS:
            while len(self._pieces) >= _MOST_OPEN:
                del self._pieces[next(iter(self._pieces))]
            self._pieces[key] = text
            return ""
        return text
