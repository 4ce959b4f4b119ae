"""A sink's own process: takes the newest snapshot, publishes it, and takes the next that is newest then.

Started by ``gcs.live_out.live_out``. The end of the requests means stop.
"""

from __future__ import annotations

import contextlib
import logging
import os
import time

from gcs.live_out.hand_over import SnapshotReader
from gcs.live_out.sink import Sink, SinkReport, SinkSettings, open_sink
from infra.plain_text import plain
from infra.processes.channel import MessageChannel, connect_to_parent
from infra.reporting import Backoff

_log = logging.getLogger(__name__)

POLL_S = 0.005
REPORT_S = 1.0
PAUSES_S = (0.2, 0.5, 1.0, 2.0, 5.0)
"""Pauses before the sink is opened again, s; the last repeats."""
NICENESS = 5
"""The flight comes first where the processor is short."""
MAX_LETTERS = 200


class _SinkWorker:
    """Opens, writes and reports in turn."""

    def __init__(self, settings: SinkSettings, station: MessageChannel[SinkSettings]) -> None:
        self._settings, self._station = settings, station
        self._snapshots = SnapshotReader(settings.memory, images=settings.images)
        self._backoff = Backoff(PAUSES_S)
        self._sink: Sink | None = None
        self._report = SinkReport()
        self._before = SinkReport()
        """Sums of sinks that are closed now."""
        self._report_due_s = 0.0

    def run(self) -> None:
        """Serve until the station ends."""
        try:
            while True:
                self._turn()
                self._tell_station()
                self._station.receive(POLL_S)
        except EOFError:
            self._close()

    def _turn(self) -> None:
        try:
            if self._sink is None and self._backoff.due(time.monotonic()):
                self._sink = open_sink(self._settings.url, self._settings.source)
            if self._sink is not None:
                snapshot = self._snapshots.newest()
                self._sink.serve()
                if snapshot is not None:
                    self._sink.write(snapshot)
                    self._backoff.succeeded()
                    self._report.error = ""
        except OSError as error:
            self._close()
            self._report.error = plain(error.strerror or str(error) or type(error).__name__)[:MAX_LETTERS]
            _log.warning("%s: %s", self._settings.url.text, self._report.error)

    def _tell_station(self) -> None:
        now_s = time.monotonic()
        if now_s < self._report_due_s:
            return
        self._report_due_s = now_s + REPORT_S
        self._report.sent, self._report.dropped, self._report.clients = self._before.sent, self._before.dropped, 0
        if self._sink is not None:
            self._report.sent += self._sink.sent
            self._report.dropped += self._sink.dropped
            self._report.clients = self._sink.clients
        try:
            self._station.send(self._report, 0.0)
        except TimeoutError:
            pass  # the station has no time for it now
        except OSError as error:
            raise EOFError from error

    def _close(self) -> None:
        sink, self._sink = self._sink, None
        if sink is not None:
            self._before.sent += sink.sent
            self._before.dropped += sink.dropped
            with contextlib.suppress(OSError):
                sink.close()


def main() -> None:
    """Wait for the settings, then tell until the station ends."""
    station: MessageChannel[SinkSettings] = connect_to_parent(SinkSettings)
    with contextlib.suppress(OSError):
        os.nice(NICENESS)
    try:
        settings = station.receive()
    except EOFError:
        return
    if settings is not None:
        _SinkWorker(settings, station).run()


if __name__ == "__main__":
    main()
