"""Telemetry in, by a process of its own that nothing in the station can starve."""

from __future__ import annotations

import contextlib
import os
import select
import socket
import threading
import time
from collections import deque
from collections.abc import Collection, Sequence
from dataclasses import replace
from multiprocessing import Pipe
from pathlib import Path

import msgspec

from infra.files.journal import Journal, make_journal
from infra.processes.child_process import ChildProcess
from infra.processes.supervisor import Supervisor
from infra.wall_clock import now_us
from mavlink.errors import LinkError, MavlinkError, SigningError, TlogError
from mavlink.ingest.health import IngestHealth
from mavlink.ingest.health_events import HealthEvents
from mavlink.ingest.ingest_memory import RING_BYTES, IngestMemory, Slot, make_ingest_memory
from mavlink.ingest.messages import AcceptHeld, CannotOpen, IngestReport, KnownFleet, SendFrame
from mavlink.ingest.plan import Outputs, Plan, Signing, check_links
from mavlink.links.kinds import kind_of, parse_url
from mavlink.links.recvmmsg import BATCH
from mavlink.links.report import LinkCounts
from mavlink.links.udp import MIN_BUFFER_BYTES
from mavlink.protocol.packet import Packet
from mavlink.state import Level, Notice

START_S = 20.0
"""A start that takes longer has failed."""
STOP_S = 15.0
"""A process that is to end and shows no life for this long is killed: it may have much to write."""
WATCH_S = 0.05
HEALTH_S = 0.5
"""Seconds between looks at the health for what an operator should know."""
HUNG_S = 0.7
"""A process that shows no life for this long is replaced: with the start of the next that is a second."""
_SEND_S = 0.2
"""Time for the process to take a request, s."""
_MAX_NOTICES = 200
_ERRORS: dict[str, type[MavlinkError]] = {error.__name__: error for error in (LinkError, TlogError, SigningError)}
_AGAIN_S = 0.3
"""A process that lived for less is followed by the next only after this."""


class Ingest:
    """All links of a flight: packets are recorded, verified and forwarded by another process, and read here in batches.

    The sockets of UDP links and of TCP servers are opened and kept here: they outlive a process that dies, with
    what is in them. One thread reads; any thread may send and look at the health.

    Args:
        urls: links, as :func:`mavlink.links.kinds.parse_url` has them.
        log: of the first segment of the raw log; must not exist.
        system_ids: whose frames make a sender known, so that it always passes while unknown senders flood; empty: any.
        outputs: where packets go on to.
        ring_bytes: size of the memory in which packets wait to be read.

    Raises:
        LinkError: a link or output cannot be opened; the message has what to do.
        TlogError: the log exists or cannot be made.
        SigningError: the keys cannot be used.
    """

    def __init__(
        self,
        urls: Sequence[str],
        log: Path,
        *,
        system_ids: Collection[int] = (),
        signing: Signing | None = None,
        outputs: Outputs | None = None,
        ring_bytes: int = RING_BYTES,
    ) -> None:
        links = [parse_url(url) for url in urls]
        self.names = tuple(link.name for link in links)
        check_links(links, outputs.urls if outputs else ())
        self._sockets: list[socket.socket | None] = []
        self._notices: deque[Notice] = deque(maxlen=_MAX_NOTICES)
        self._before: tuple[LinkCounts, ...] = ()
        self._gap_s = 0.0
        self._generation = 0
        self._beat = 0
        """The last sign of life."""
        self._interrupted = ""
        """Rest that the process before had in hand when it ended, in words."""
        self._heard_us = 0
        self._health = IngestHealth()
        self._health_events, self._health_s = HealthEvents(), 0.0
        self._stopping = threading.Event()
        self._memory_fd = make_ingest_memory(ring_bytes)
        self._memory = IngestMemory(self._memory_fd)
        self._journal_fd = make_journal()
        self._journal = Journal(self._journal_fd)
        # never closed, but with the last who holds them: one thread may wait for the pipe while another stops
        self._wake, self._waker = Pipe(duplex=False)
        self._supervisor: Supervisor[ChildProcess[IngestReport]] | None = None
        try:
            opened = []
            for link, url in zip(links, urls, strict=True):
                prepared, sock = kind_of(link).prepare(link)
                self._sockets.append(sock)
                opened.append(url if prepared == link else prepared.name)
            self._plan = Plan(
                urls=tuple(opened),
                sockets=tuple(-1 if sock is None else sock.fileno() for sock in self._sockets),
                memory=self._memory_fd,
                journal=self._journal_fd,
                wake=self._waker.fileno(),
                log=str(log),
                system_ids=tuple(system_ids),
                signing=signing or Signing(),
                outputs=outputs or Outputs(),
            )
            self._supervisor = self._start_supervisor()
            self._require_opened(self._supervisor.process)
        except BaseException:
            self._release()
            raise
        self._warn_of_small_buffers()
        self._supervisor.supervise()

    @property
    def supervisor(self) -> Supervisor[ChildProcess[IngestReport]]:
        """Keep the process running."""
        assert self._supervisor is not None
        return self._supervisor

    @property
    def pid(self) -> int:
        """Id of the present process."""
        return self.supervisor.process.pid

    def read(self, timeout_s: float) -> list[Packet]:
        """Take all packets that have come since the last call, in order, each with what its signature is worth.

        Those with ``auth > Auth.GOOD`` are rejected.

        Returns:
            Empty after the timeout and when stopped.
        """
        stop_s = time.monotonic() + timeout_s
        while not self._stopping.is_set():
            packets = self._memory.take_packets()
            self._heard_us = self._memory.heard_us() or self._heard_us
            left_s = stop_s - time.monotonic()
            if packets or left_s <= 0.0:
                return packets
            if select.select([self._wake], [], [], left_s)[0]:
                os.read(self._wake.fileno(), 1 << 16)
        return []

    @property
    def heard_us(self) -> int:
        """Unix µs: whatever came before this has been read; 0 before anything could come."""
        return self._heard_us

    def send(self, link: int, data: bytes, peer: int = 0) -> None:
        """Send a frame to those on the other end of a link who are known; :meth:`health` reports what did not work.

        Args:
            link: its place among the URLs.
            data: one frame, with its signature where it needs one.
            peer: the one who is to get it, as packets of this link have it; 0: all who are known.

        Raises:
            LinkError: there is no such link, or the process does not take it.
        """
        if not 0 <= link < len(self.names):
            raise LinkError(f"there is no link {link}; there are {len(self.names)}")
        self._request(SendFrame(link, data, peer))

    def accept_held(self, system_id: int) -> None:
        """An operator accepts a system whose packets are held; those that come from now on are accepted.

        Raises:
            LinkError: the process does not take it.
        """
        self._request(AcceptHeld(system_id))

    def set_fleet(self, system_ids: Collection[int], uav: int) -> None:
        """Limit the senders that become known from now on to those of these systems, and let outputs send to this UAV.

        Raises:
            LinkError: the process does not take it; the one after it will.
        """
        outputs = replace(self._plan.outputs, uav=uav)
        self._plan = msgspec.structs.replace(self._plan, system_ids=tuple(system_ids), outputs=outputs)
        self._request(KnownFleet(self._plan.system_ids, uav))

    def address(self, link: int, peer: int) -> str:
        """Host and port of a sender, as packets of a link number them; empty where they are not known."""
        links = (self._published_health() or self._health).links
        if not 0 <= link < len(links):
            return ""
        known = {number: f"{host}:{port}" for number, host, port in links[link].addresses}
        return (dict(links[link].others) | known).get(peer, "")

    def health(self) -> IngestHealth:
        """Health of the process, as reported some times a second."""
        reported = self._published_health()
        if reported is not None:
            self._health = reported
        total = self._health.plus(self._before)
        written = self._journal.written
        return replace(
            total,
            packets=written,
            record=replace(total.record, rows=written),
            links=tuple(replace(link, name=name) for link, name in zip(total.links, self.names, strict=False)),
            overrun=self._memory.slots[Slot.OVERRUN] if not self._stopping.is_set() else total.overrun,
            restarts=self.supervisor.restarts,
            gap_s=self._gap_s,
        )

    def notices(self) -> list[Notice]:
        """News for the operator, each reported once."""
        reported = []
        with contextlib.suppress(IndexError):
            while True:
                reported.append(self._notices.popleft())
        return reported

    def stop(self) -> None:
        """Have everything written, end the process and close the links; stopping twice does nothing."""
        if self._stopping.is_set():
            return
        self._stopping.set()
        self.supervisor.stop()
        record = self.health().record
        if record.waiting:  # the disk does not answer: they will not be written
            lost = replace(record, waiting=0, waiting_bytes=0, lost=record.lost + record.waiting)
            self._health = replace(self._health, record=lost)
            self._memory.status.put(b"")
        self._release()

    # ---- one process after the other

    def _start_supervisor(self) -> Supervisor[ChildProcess[IngestReport]]:
        try:
            return Supervisor(
                "ingest watch",
                start=self._start,
                begin=self._begin,
                watch=self._watch,
                replaced=self._note_gap,
                watch_s=WATCH_S,
                start_s=START_S,
                stop_s=STOP_S,
                pauses_s=(0.0, _AGAIN_S),
                steady_s=_AGAIN_S,
                spare=True,
            )
        except OSError as error:
            raise LinkError(f"the ingest process cannot be started: {error.strerror or error}") from error

    def _start(self) -> ChildProcess[IngestReport]:
        """A process that waits for its turn: it has imported all it needs, and opened nothing."""
        sockets = [sock.fileno() for sock in self._sockets if sock is not None]
        try:
            return ChildProcess(
                "mavlink.ingest", IngestReport, fds=[*sockets, self._memory_fd, self._journal_fd, self._waker.fileno()]
            )
        except OSError as error:
            self._notice("warning", f"no ingest process could be started: {error}")
            raise

    def _begin(self, process: ChildProcess[IngestReport]) -> None:
        """Give the process its turn."""
        if self._generation:
            self._interrupted = self._describe_in_hand()
            self._carry_counts_over()
        self._generation += 1
        with contextlib.suppress(OSError):  # it has died as well, which is seen when it is watched
            process.channel.send(msgspec.structs.replace(self._plan, generation=self._generation))

    def _require_opened(self, process: ChildProcess[IngestReport]) -> None:
        """Wait until the first process has opened everything, and raise its error if it failed."""
        try:
            report = process.channel.receive(START_S)
        except EOFError as error:
            process.end(STOP_S)
            raise LinkError(f"the ingest process ended: {process.exit_reason}") from error
        if isinstance(report, CannotOpen):
            raise _ERRORS.get(report.error, LinkError)(report.text)
        if report is None:
            raise LinkError("the ingest process did not start in time; is the machine overloaded?")

    def _watch(self, process: ChildProcess[IngestReport], timeout_s: float) -> float | None:
        """Wait for the process's end, and look for signs of life."""
        process.channel.receive(timeout_s)
        now_s = time.monotonic()
        if now_s >= self._health_s:
            self._health_s = now_s + HEALTH_S
            for level, text in self._health_events.since_last(self.health()):
                self._notice(level, text)
        beat = self._memory.slots[Slot.BEAT]
        if beat == self._beat:
            return None
        self._beat = beat
        return HUNG_S

    def _describe_in_hand(self) -> str:
        """Packets that a process had taken off a socket and not yet put where it outlives it, in words."""
        index, self._memory.slots[Slot.IN_HAND] = self._memory.slots[Slot.IN_HAND], 0
        if not index:
            return ""
        return f" while it took packets off {self.names[index - 1]}, of which at most {BATCH} are lost,"

    def _carry_counts_over(self) -> None:
        """Keep what the process before had counted."""
        last = self._published_health() or self._health
        self._before = tuple(link.counts for link in last.plus(self._before).links) or self._before
        links = tuple(replace(link, counts=LinkCounts()) for link in last.links)
        self._health = IngestHealth(links=links, record=last.record, packets=last.packets, refused=last.refused)
        self._memory.status.put(self._health.encode())

    def _note_gap(self, failure: str, alive_s: float) -> None:
        """Wait until the next process has opened everything, and note for how long no process received."""
        trouble = ""
        try:
            self._require_opened(self.supervisor.process)
        except MavlinkError as error:
            trouble = str(error)
        gap_s = time.monotonic() - alive_s
        self._gap_s += gap_s
        text = f"receiving {failure}{self._interrupted} and"
        if trouble:
            text = f"{text} did not start again ({trouble}); trying on"
        else:
            text = f"{text} another process took over; nothing received for {gap_s:.1f} s, the system kept the"
            text = f"{text} datagrams of that time as far as they fit"
        self._notice("alarm", text)

    # ---- between the two

    def _request(self, request: SendFrame | AcceptHeld | KnownFleet) -> None:
        if self._stopping.is_set():
            raise LinkError("the ingest has ended")
        try:
            self.supervisor.process.channel.send(request, _SEND_S)
        except OSError as error:
            raise LinkError(f"the ingest process does not take what is to be sent: {error}") from error

    def _published_health(self) -> IngestHealth | None:
        """Health that the process last reported; None where that cannot be read now."""
        data = self._memory.status.get()
        try:
            return IngestHealth.decode(data) if data else None
        except ValueError:
            return None

    def _warn_of_small_buffers(self) -> None:
        for link in self.health().links:
            if 0 < link.buffer_bytes < MIN_BUFFER_BYTES:
                size = f"{link.buffer_bytes >> 10} kB"
                text = f"{link.name}: the system grants only {size} of receive buffer, too little when it is busy"
                self._notice("warning", f"{text}; raise net.core.rmem_max to {MIN_BUFFER_BYTES}")

    def _notice(self, level: Level, text: str) -> None:
        self._notices.append(Notice(t_us=now_us(), level=level, kind="link", text=text))

    def _release(self) -> None:
        if self._supervisor is not None:
            self._supervisor.stop()
        for sock in self._sockets:
            if sock is not None:
                sock.close()
        os.close(self._memory_fd)
        os.close(self._journal_fd)
