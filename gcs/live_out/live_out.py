"""The station's side of publishing: hands the newest snapshot over, and keeps a process for each address."""

from __future__ import annotations

import contextlib
import logging
import threading
import time
from collections.abc import Callable, Sequence

from gcs.live_out.hand_over import SnapshotWriter
from gcs.live_out.sink import SinkReport, SinkSettings, SinkSource
from gcs.live_out.sink_url import SinkUrl
from gcs.snapshot import Snapshot
from infra.plain_text import plain
from infra.processes.child_process import ChildProcess
from infra.processes.supervisor import Supervisor
from infra.reporting import Throttle
from mavlink.state import Level

_log = logging.getLogger(__name__)

LOOK_S = 0.01
"""Seconds between two looks for a newer snapshot."""
WATCH_S = 0.2
START_S = 30.0
"""A process may take this long to begin on a computer that has other things to do."""
PATIENCE_S = 10.0
"""Time without a sign of life after which a process hangs, s: longer than any connection is waited for."""
STOP_S = 2.0
PAUSES_S = (0.0, 1.0, 5.0, 15.0)
"""Pauses before another process is started, s; the last repeats."""
STEADY_S = 60.0
AGAIN_S = 60.0
"""Least time between two reports of trouble with one address."""
CLOSE_S = 3.0


class LiveOut:
    """Publishes a station's snapshots until it is closed; nothing of it can hold the station up.

    Args:
        latest: the station's newest snapshot; asked for from a thread of its own.
        sinks: where to.
        report: called with one line when there is trouble with an address, and when it is over, from any thread.

    Raises:
        OSError: no process or memory is to be had.
    """

    def __init__(
        self,
        latest: Callable[[], Snapshot | None],
        sinks: Sequence[SinkUrl],
        source: SinkSource,
        report: Callable[[str, Level], None],
    ) -> None:
        self._latest = latest
        images = any(sink.kind.images for sink in sinks)
        self._writer = SnapshotWriter(images=images)
        self.outlets: tuple[Outlet, ...] = ()
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._hand_over, name="publishing", daemon=True)
        try:
            for sink in sinks:
                settings = SinkSettings(url=sink, source=source, memory=self._writer.fd, images=images)
                self.outlets = (*self.outlets, Outlet(settings, report))
        except OSError:
            self.close()
            raise
        self._thread.start()

    def close(self) -> None:
        """End all processes; twice does nothing."""
        self._stop.set()
        if self._thread.is_alive():
            self._thread.join(CLOSE_S)
        closing = [threading.Thread(target=outlet.close) for outlet in self.outlets]
        for thread in closing:
            thread.start()
        for thread in closing:
            thread.join(CLOSE_S)
        self._writer.close()

    def __enter__(self) -> LiveOut:
        return self

    def __exit__(self, *args: object) -> None:
        self.close()

    def _hand_over(self) -> None:
        handed: Snapshot | None = None
        while not self._stop.wait(LOOK_S):
            snapshot = self._latest()
            if snapshot is not None and snapshot is not handed:
                handed = snapshot
                try:
                    self._writer.put(snapshot)
                except Exception:  # noqa: BLE001 - logged; a snapshot that cannot be packed costs itself
                    _log.exception("a snapshot was not handed over")


class Outlet:
    """One address and the process that publishes to it.

    Attributes:
        url: the address.
        latest: what its process reported last.
        supervisor: keeps its process running.
    """

    def __init__(self, settings: SinkSettings, report: Callable[[str, Level], None]) -> None:
        self.url = settings.url
        self.latest = SinkReport()
        self._settings, self._report = settings, report
        self._throttle = Throttle(AGAIN_S)
        self._troubled = False
        """True if trouble was reported that is not over."""
        self.supervisor: Supervisor[ChildProcess[SinkReport]] = Supervisor(
            f"publishing {settings.url.text}",
            start=self._start,
            begin=self._begin,
            watch=self._watch,
            replaced=self._note_restart,
            watch_s=WATCH_S,
            start_s=START_S,
            stop_s=STOP_S,
            pauses_s=PAUSES_S,
            steady_s=STEADY_S,
        )
        self.supervisor.supervise()

    def close(self) -> None:
        """End the process."""
        self.supervisor.stop(CLOSE_S)

    def _start(self) -> ChildProcess[SinkReport]:
        # arrays only carry pictures there: threads for algebra would take memory for nothing
        environment = {"OPENBLAS_NUM_THREADS": "1"}
        fds = [self._settings.memory]
        return ChildProcess("gcs.live_out.sink_worker", SinkReport, fds=fds, environment=environment)

    def _begin(self, process: ChildProcess[SinkReport]) -> None:
        with contextlib.suppress(OSError):  # it is gone already, which is seen when it is watched
            process.channel.send(self._settings)

    def _watch(self, process: ChildProcess[SinkReport], timeout_s: float) -> float | None:
        report = process.channel.receive(timeout_s)
        if report is None:
            return None
        self.latest = report
        if report.error:
            self._trouble(plain(report.error))
        elif report.sent and self._troubled:
            self._troubled = False
            self._report(f"{self.url.text}: is told again", "info")
        return PATIENCE_S

    def _note_restart(self, failure: str, alive_s: float) -> None:
        del alive_s
        self._trouble(f"its process {failure} and was started again")

    def _trouble(self, what: str) -> None:
        """Reports it once, and again at the earliest a minute after it was over."""
        if not self._troubled and self._throttle.due("", time.monotonic()):
            self._troubled = True
            self._report(f"{self.url.text}: {plain(what)}; nobody is told there meanwhile, all else goes on", "warning")
