"""The ingest process: one thread that waits for all links at once and does nothing that could make it wait elsewhere.

It ends when the station closes its end of the channel, which the system does if the station dies.
"""

from __future__ import annotations

import contextlib
import gc
import logging
import os
import select
import signal
import socket
import time
from pathlib import Path

from infra.files.journal import Journal
from infra.processes.channel import MessageChannel, connect_to_parent
from infra.wall_clock import now_us
from mavlink.errors import LinkError, MavlinkError
from mavlink.ingest.health import IngestHealth
from mavlink.ingest.ingest_memory import IngestMemory, Slot
from mavlink.ingest.messages import AcceptHeld, CannotOpen, IngestRequest, KnownFleet, Opened, SendFrame
from mavlink.ingest.plan import Plan
from mavlink.ingest.receiver import Receiver, Signatures, open_outputs
from mavlink.links.base import Link, LinkOptions
from mavlink.links.kinds import open_link
from mavlink.links.report import LinkReport
from mavlink.tlog.writer import TlogWriter

_log = logging.getLogger(__name__)

TICK_S = 0.05
"""Longest wait for packets, so that the station sees signs of life."""
PAUSE_S = 0.004
"""Datagrams of this long are read together; when each came the kernel has noted."""
HEALTH_S, HEALTH_SOON_S = 0.2, 0.05
"""Intervals at which health is reported to the station, and soon after a new sender: alarms name its address."""
_FEW = 128
"""Size of a batch below which the other links have their turn."""
_ROUNDS = 8
"""Batches of one link before the others have their turn."""


def main() -> int:
    """Wait for its turn, then run until the station closes the channel.

    Returns:
        The exit code, 3 when something cannot be opened.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the terminal's interrupt is the station's
    with contextlib.suppress(OSError):
        os.nice(-5)  # where that is allowed: it takes little, and it must not wait
    station: MessageChannel[IngestRequest] = connect_to_parent(IngestRequest)
    try:
        plan = station.receive()
    except EOFError:
        return 0  # never needed
    assert isinstance(plan, Plan)
    try:
        worker = _IngestWorker(plan, station)
    except MavlinkError as error:
        station.send(CannotOpen(error=type(error).__name__, text=str(error)))
        return 3
    _log.info("links open: %s", ", ".join(plan.urls))
    gc.collect()
    gc.freeze()
    station.send(Opened())
    worker.run()
    return 0


class _IngestWorker:
    def __init__(self, plan: Plan, station: MessageChannel[IngestRequest]) -> None:
        self._station = station
        self._memory = IngestMemory(plan.memory)
        self._wake = plan.wake
        os.set_blocking(plan.wake, False)
        self._open = True
        self._published_s, self._published_senders = 0.0, 0
        self._send_trouble = ""
        self._reports: tuple[LinkReport, ...] = ()
        self._signatures = Signatures(plan.signing)
        self._links: list[Link] = [_open_link(plan, k, self._signatures.on) for k in range(len(plan.urls))]
        _resume(self._links, self._memory.status.get())
        self._outputs = open_outputs(plan.outputs, plan.system_ids)
        self._journal = Journal(plan.journal)
        written = self._journal.written if plan.generation > 1 else None
        self._log = TlogWriter(Path(plan.log), resume_after=written, journal=self._journal)
        self._receiver = Receiver(self._links, self._log, self._memory, self._signatures, self._outputs)
        self._publish_health()

    def run(self) -> None:
        """Take in and send packets until the station closes the channel."""
        while self._open:
            self._memory.slots[Slot.BEAT] += 1
            ready, heard_us, all_taken = self._wait(), now_us(), True
            for index, link in enumerate(self._links):
                if link.overdue or ready.intersection(link.fds):
                    all_taken &= self._drain(index, link)
                link.maintain()
            if all_taken:
                self._memory.put_received_until(heard_us)
            if self._station.fileno() in ready:
                self._handle_requests()
            if self._outputs:
                self._outputs.maintain()
                if self._outputs.overdue or ready.intersection(self._outputs.fds):
                    self._receiver.forward(())
            period_s = HEALTH_S if self._senders() == self._published_senders else HEALTH_SOON_S
            if time.monotonic() - self._published_s >= period_s:
                self._publish_health()
        self._close()

    def _wait(self) -> set[int]:
        """File descriptors that have something."""
        stamped = {fd for link in self._links if link.has_kernel_stamps for fd in link.fds}
        others = {fd for link in self._links if not link.has_kernel_stamps for fd in link.fds}
        others |= {self._station.fileno(), *(self._outputs.fds if self._outputs else ())}
        ready = set(select.select(stamped | others, [], [], TICK_S)[0])
        if ready and ready <= stamped:
            ready |= set(select.select(others, [], [], PAUSE_S)[0])
        return ready

    def _drain(self, index: int, link: Link) -> bool:
        """Take what a link has; False where that is too much for one turn."""
        for _ in range(_ROUNDS):
            self._memory.slots[Slot.IN_HAND] = index + 1
            batch = link.read_batch()
            if not batch.frames:
                self._memory.slots[Slot.IN_HAND] = 0
                return True
            self._receiver.receive_batch(index, batch)
            with contextlib.suppress(BlockingIOError):  # it has not read for long: the ring counts what does not fit
                os.write(self._wake, b".")
            if len(batch.frames) < _FEW:
                return True  # what came meanwhile can wait for the next round
        return False

    def _handle_requests(self) -> None:
        """Do what the station wants done."""
        try:
            while (request := self._station.receive(0.0)) is not None:
                if isinstance(request, SendFrame):
                    self._send(request)
                elif isinstance(request, AcceptHeld):
                    self._signatures.accept_held(request.system_id)
                elif isinstance(request, KnownFleet):
                    for link in self._links:
                        link.set_fleet(request.system_ids)
                    if self._outputs:
                        self._outputs.set_fleet(request.system_ids, request.uav)
        except EOFError:
            self._open = False

    def _send(self, request: SendFrame) -> None:
        try:
            self._receiver.send(request.link, request.frame, request.peer)
            self._send_trouble = ""
        except LinkError as error:
            self._send_trouble = str(error)

    def _publish_health(self) -> None:
        """Reports the health to the station."""
        self._published_s, self._published_senders = time.monotonic(), self._senders()
        if self._open or not self._reports:
            reports = [link.report() for link in self._links]
            self._reports = tuple(
                self._receiver.limiter.add_to_report(k, report, self._links[k].address)
                for k, report in enumerate(reports)
            )
        record = self._log.state
        outputs = self._outputs.counts if self._outputs else ()
        troubles = [self._send_trouble, self._receiver.output_trouble, *self._signatures.troubles]
        troubles += [text for link in self._links for text in link.troubles]
        health = IngestHealth(
            links=self._reports,
            outputs=outputs,
            record=record,
            refused=self._memory.slots[Slot.REFUSED],
            packets=record.rows,
            sent=self._memory.slots[Slot.SENT],
            overrun=self._memory.slots[Slot.OVERRUN],
            cpu_s=time.process_time(),
            troubles=tuple(text for text in troubles if text),
        )
        self._memory.status.put(health.encode())

    def _senders(self) -> int:
        """Number of packets received so far."""
        return sum(link.last_peer for link in self._links)

    def _close(self) -> None:
        for index, link in enumerate(self._links):
            self._drain(index, link)
            if (rest := link.read_rest()).frames:
                self._receiver.receive_batch(index, rest)
        self._reports = ()
        self._publish_health()
        for link in self._links:
            link.close()
        if self._outputs:
            self._outputs.close()
        self._log.close()
        with contextlib.suppress(MavlinkError):  # the next start reports what could not be saved
            self._signatures.close()
        self._publish_health()


def _open_link(plan: Plan, index: int, signed: bool) -> Link:
    """A link, on the socket that the station has opened where there is one."""
    fd = plan.sockets[index]
    sock = socket.socket(fileno=fd) if fd >= 0 else None
    if sock is not None:
        sock.setblocking(False)
    options = LinkOptions(
        sock=sock,
        system_ids=plan.system_ids,
        trusts_checksums=not signed,
        waits_for_device=plan.generation > 1,
    )
    return open_link(plan.urls[index], options)


def _resume(links: list[Link], status: bytes | None) -> None:
    """Hand links what the process before this one knew of them."""
    try:
        before = IngestHealth.decode(status).links if status else ()
    except ValueError:
        return  # nothing was reported yet
    for link, report in zip(links, before, strict=False):
        link.resume(report)
