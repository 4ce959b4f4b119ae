"""Textual's driver for a browser, with whole messages: its threads write to one pipe, pictures beside what is drawn."""

from __future__ import annotations

import os
import threading
from functools import partial
from typing import Any

from textual.app import App
from textual.drivers.web_driver import WebDriver

__all__ = ["BrowserDriver"]


class BrowserDriver(WebDriver):
    """Writes one message after the other, where Textual's lets them cross once one is larger than a pipe takes."""

    def __init__(self, app: App[Any], **options: Any) -> None:  # noqa: ANN401  (Textual's own)
        super().__init__(app, **options)
        self._writing = threading.Lock()
        self._write = partial(self._write_whole)

    def _write_whole(self, data: bytes) -> int:
        size = len(data)
        with self._writing:
            while data:
                data = data[os.write(self.fileno, data) :]
        return size
