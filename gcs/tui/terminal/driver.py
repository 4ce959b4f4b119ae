"""Textual's driver for a terminal that may be slow, may reply late, and may go away.

Textual's own puts every frame into a queue of 30, behind which keys wait for as long as a slow line needs for all of
them; reads the end of the input over and over once the terminal is gone; and takes replies that it does not know for
keys. Here what is drawn waits as cells (`PendingCells`), of which only as much is sent as the terminal takes
(`Pacing`), and the screens end with the terminal.
"""

from __future__ import annotations

import contextlib
import os
import select
import threading
import time
from codecs import getincrementaldecoder
from collections.abc import Callable
from queue import SimpleQueue
from typing import Any

from textual._compositor import CompositorUpdate
from textual._xterm_parser import XTermParser
from textual.app import App
from textual.drivers.linux_driver import LinuxDriver
from textual.geometry import Offset

from gcs.tui.terminal.pacing import LOST_S, QUESTION, Pacing
from gcs.tui.terminal.pending import PendingCells
from gcs.tui.terminal.replies import REPORT, Replies

READ_BYTES = 65_536
WAKE_S = 0.1
"""The input thread looks this often whether it is to end."""
LEAVE_S = 1.0
"""Time at the end for the terminal to reply and to take what is left; later replies are typed into the shell."""
SYNC_BEGIN, SYNC_END = "\x1b[?2026h", "\x1b[?2026l"


class TerminalDriver(LinuxDriver):
    """Sends what is drawn as quickly as the terminal takes it, and ends the app when the terminal is gone."""

    def __init__(self, app: App[Any], **options: Any) -> None:  # noqa: ANN401  (Textual's own)
        super().__init__(app, **options)
        self._pending = PendingCells()
        self._cursor = Offset(0, 0)
        self._pacing = Pacing()
        self._pacing_changed = threading.Condition()
        self._writer: _Writer | None = None
        self._retry: Any = None
        self._gone = False

    @property
    def has_picture(self) -> bool:
        """True if a part of the last picture is still to be sent."""
        return self._pending.has_picture

    def show(self, update: CompositorUpdate, cursor: Offset) -> None:
        """Have the screen show what was drawn as soon as there is room, instead of what waits for the same cells."""
        self._pending.add(update)
        self._cursor = cursor
        self._send()

    def write(self, data: str) -> None:
        """Send modes and the like, which neither wait nor are dropped."""
        if self._writer is not None:
            self._writer.put(data.encode())

    def start_application_mode(self) -> None:
        """Start as Textual does, with another writer, and ask what shows whether this terminal replies."""
        if self._file is None:
            raise RuntimeError("no terminal to draw on")
        self._writer = _Writer(self._file.fileno(), self._leave)
        super().start_application_mode()  # type: ignore[no-untyped-call]
        super().close()  # Textual's own writer
        self._ask(b"")

    def resume_application_mode(self) -> None:
        """Begin again, once: a stop by another than the terminal, or its end, comes with nothing to resume from."""
        if self._writer is not None:
            self.suspend_application_mode()
        if not self._gone:
            super().resume_application_mode()

    def disable_input(self) -> None:
        """Read no more once the last reply has come."""
        self._pending.clear()
        with self._pacing_changed:
            self._pacing_changed.wait_for(lambda: self._gone or not self._pacing.open_questions, LEAVE_S)
        super().disable_input()

    def close(self) -> None:
        """End the writer; what a terminal that takes nothing has not taken is lost."""
        writer, self._writer = self._writer, None
        if writer is not None:
            writer.stop(LEAVE_S)

    def run_input_thread(self) -> None:
        """Hand on what is typed until the screens or the terminal end."""
        parser, replies = XTermParser(self._debug), Replies(self._take_reply)
        decode = getincrementaldecoder("utf-8")("replace").decode
        last_s = time.monotonic()
        while not self.exit_event.is_set():
            hold_s = replies.hold_s
            keys = ""
            if self._is_readable(WAKE_S if hold_s is None else min(hold_s, WAKE_S)):
                data = self._read()
                if not data:
                    break
                keys, last_s = replies.keys_in(decode(data)), time.monotonic()
            elif hold_s is not None and time.monotonic() - last_s >= hold_s:
                keys = replies.release()
            for message in (*(parser.feed(keys) if keys else ()), *parser.tick()):
                self.process_message(message)
            if getattr(self._app, "hung_up", bool)():
                break
        else:
            return
        self._leave()

    def _is_readable(self, wait_s: float) -> bool:
        return bool(select.select([self.fileno], [], [], wait_s)[0])

    def _read(self) -> bytes:
        """Bytes that were typed, empty when the terminal is gone."""
        with contextlib.suppress(OSError):
            return os.read(self.fileno, READ_BYTES)
        return b""

    def _leave(self) -> None:
        """End since the terminal is gone; for any thread."""
        with self._pacing_changed:
            self._gone = True
            self._pacing_changed.notify_all()
        self._call(self._app.exit)

    def _take_reply(self, reply: str) -> None:
        if reply == REPORT:
            with self._pacing_changed:
                self._pacing.replied(time.monotonic())
                self._pacing_changed.notify_all()
            self._call(self._send)

    def _written(self) -> None:
        with self._pacing_changed:
            self._pacing.written()
        self._call(self._send)

    def _call(self, function: Callable[[], Any]) -> None:
        """Call from another thread; not once the screens have ended."""
        with contextlib.suppress(RuntimeError):
            self._loop.call_soon_threadsafe(function)

    def _send(self) -> None:
        """Fill the room that there is."""
        sync = getattr(self._app, "_sync_available", False)
        while self._pending and (room := self._room()):
            cells = self._pending.take(room, self._app.console)
            chunk = f"{SYNC_BEGIN * sync}{cells}\x1b[{self._cursor.y + 1};{self._cursor.x + 1}H{SYNC_END * sync}"
            self._ask(chunk.encode())
        if self._retry is not None:
            self._retry.cancel()
        # a reply may be lost with the terminal that owed it
        self._retry = self._loop.call_later(LOST_S, self._send) if self._pending else None

    def _room(self) -> int:
        with self._pacing_changed:
            return self._pacing.room(time.monotonic())

    def _ask(self, chunk: bytes) -> None:
        """Send a chunk and the question behind it."""
        if self._writer is not None:
            data = chunk + QUESTION
            with self._pacing_changed:
                self._pacing.send(len(data), time.monotonic())
            self._writer.put(data, self._written)


class _Writer(threading.Thread):
    """Writes to a terminal that may take its time, or nothing ever again: nobody waits for it.

    Args:
        fd: where to.
        on_gone: is called when the terminal is gone; what comes later is dropped.
    """

    def __init__(self, fd: int, on_gone: Callable[[], None]) -> None:
        super().__init__(name="terminal-output", daemon=True)
        self._fd = fd
        self._on_gone = on_gone
        self._chunks: SimpleQueue[tuple[bytes, Callable[[], None] | None] | None] = SimpleQueue()
        self.start()

    def put(self, data: bytes, on_written: Callable[[], None] | None = None) -> None:
        """Write this next, then call."""
        self._chunks.put((data, on_written))

    def stop(self, wait_s: float) -> None:
        """End after what was put."""
        self._chunks.put(None)
        self.join(wait_s)

    def run(self) -> None:
        """Write, until the end."""
        gone = False
        while (chunk := self._chunks.get()) is not None:
            data, on_written = chunk
            try:
                while data and not gone:
                    data = data[self._write(data) :]
            except OSError:
                gone = True
                self._on_gone()
            if on_written is not None:
                on_written()

    def _write(self, data: bytes) -> int:
        try:
            return os.write(self._fd, data)
        except BlockingIOError:  # somebody else has made the terminal non-blocking
            select.select([], [self._fd], [])
            return 0
