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
from pathlib import Path

from infra.files.journal import Journal, make_journal
from mavlink.errors import LinkError, MavlinkError, SigningError, TlogError
from mavlink.ingest.changes import Changes
from mavlink.ingest.health import IngestHealth, Notice
from mavlink.ingest.ingest_memory import RING_BYTES, IngestMemory, Slot, make_ingest_memory
from mavlink.ingest.lent import small_buffers
from mavlink.ingest.plan import Outputs, Plan, Signing
from mavlink.ingest.process import START_S, IngestProcess
from mavlink.links.counters import now_us
from mavlink.links.kinds import KINDS, parse_url
from mavlink.links.recvmmsg import BATCH
from mavlink.links.report import LinkCounts
from mavlink.links.url import LinkUrl
from mavlink.protocol.packet import Packet

__all__ = ["Ingest"]

WATCH_S = 0.05
LOOK_S = 0.5
HUNG_S = 0.7
"""A process that shows no life for so long is replaced: with the start of the next that is a second."""
_MOST_NOTICES = 200
_ERRORS: dict[str, type[MavlinkError]] = {error.__name__: error for error in (LinkError, TlogError, SigningError)}
_AGAIN_S = 0.3
_STEP_S = 0.02


class Ingest:
    """All links of a flight: packets are recorded, verified and forwarded by another process, and read here in batches.

    The sockets of UDP links and of TCP servers are opened here and only lent: they outlive a process that dies, with
    what is in them. One thread reads; any thread may send and look at the health.

    Args:
        urls: links, as :func:`mavlink.links.kinds.parse_url` has them.
        log: of the first segment of the raw log; must not exist.
        system_ids: whose frames make a sender known, so that it always passes while strangers flood; empty: anybody's.
        signing: keys.
        outputs: where packets go on to.
        ring_bytes: packets wait in so much memory while nobody reads.

    Raises:
        LinkError: a link or output cannot be opened; the message says what to do.
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
        _check_once(self.names)
        _check_outputs(links, outputs.urls if outputs else ())
        self._sockets: list[socket.socket | None] = []
        self._notices: deque[Notice] = deque(maxlen=_MOST_NOTICES)
        self._before: tuple[LinkCounts, ...] = ()
        self._restarts, self._gap_s = 0, 0.0
        self._heard_us = 0
        self._health = IngestHealth()
        self._lock = threading.Lock()
        self._stopping = threading.Event()
        self._memory_fd = make_ingest_memory(ring_bytes)
        self._memory = IngestMemory(self._memory_fd)
        self._journal_fd = make_journal()
        self._journal = Journal(self._journal_fd)
        self._process: IngestProcess | None = None
        self._spare: IngestProcess | None = None
        """Takes over at once when the process is replaced."""
        try:
            opened = []
            for link, url in zip(links, urls, strict=True):
                prepared, sock = KINDS[link.scheme].prepare(link)
                self._sockets.append(sock)
                opened.append(url if prepared == link else prepared.name)
            self._plan = Plan(
                urls=tuple(opened),
                sockets=tuple(-1 if sock is None else sock.fileno() for sock in self._sockets),
                memory=self._memory_fd,
                journal=self._journal_fd,
                control=-1,
                log=str(log),
                system_ids=tuple(system_ids),
                signing=signing or Signing(),
                outputs=outputs or Outputs(),
            )
            self._process = self._start()
            self._process.go(1)
            self._wait_until_ready(self._process)
        except BaseException:
            self._let_go()
            raise
        for text in small_buffers(self.names, self._sockets):
            self._notice("warning", text)
        self._watch = threading.Thread(target=self._guard, name="ingest watch", daemon=True)
        self._watch.start()

    @property
    def pid(self) -> int:
        """Id of the present process."""
        return self._process.pid if self._process else 0

    def read(self, timeout_s: float) -> list[Packet]:
        """All packets that have come since the last call, in order, each with what its signature is worth.

        Those with ``auth > Auth.GOOD`` are not to be believed.

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
            self._wait(left_s)
        return []

    @property
    def heard_us(self) -> int:
        """Unix µs: whatever came before this has been read; 0 before anything could come."""
        return self._heard_us

    def send(self, link: int, data: bytes, peer: int = 0) -> None:
        """Sends a frame to those on the other end of a link who are known; :meth:`health` tells what did not work.

        Args:
            link: its place among the URLs.
            data: one frame, with its signature where it needs one.
            peer: the one who is to get it, as packets of this link have it; 0: all who are known.

        Raises:
            LinkError: there is no such link, or the process does not take it.
        """
        if not 0 <= link < len(self.names):
            raise LinkError(f"there is no link {link}; there are {len(self.names)}")
        with self._lock:
            if self._process is None or self._stopping.is_set():
                raise LinkError("the ingest has ended")
            self._process.send(link, data, peer)

    def accept_held(self, system_id: int) -> None:
        """An operator vouches for a system whose packets are held, and those that come now are believed.

        Raises:
            LinkError: the process does not take it.
        """
        with self._lock:
            if self._process is None or self._stopping.is_set():
                raise LinkError("the ingest has ended")
            self._process.accept_held(system_id)

    def address(self, link: int, peer: int) -> str:
        """Host and port of a sender, as packets of a link number them; empty where they are not known.

        Args:
            link: its place among the URLs.
            peer: the sender's number on that link.
        """
        links = (self._told() or self._health).links
        if not 0 <= link < len(links):
            return ""
        known = {number: f"{host}:{port}" for number, host, port in links[link].addresses}
        return (dict(links[link].others) | known).get(peer, "")

    def health(self) -> IngestHealth:
        """How it is doing, as told some times a second."""
        told = self._told()
        if told is not None:
            self._health = told
        total = self._health.plus(self._before)
        written = self._journal.written
        return replace(
            total,
            packets=written,
            record=replace(total.record, rows=written),
            links=tuple(replace(link, name=name) for link, name in zip(total.links, self.names, strict=False)),
            overrun=self._memory.slots[Slot.OVERRUN] if not self._stopping.is_set() else total.overrun,
            restarts=self._restarts,
            gap_s=self._gap_s,
        )

    def notices(self) -> list[Notice]:
        """What an operator should know, each told once."""
        told = []
        with contextlib.suppress(IndexError):
            while True:
                told.append(self._notices.popleft())
        return told

    def stop(self) -> None:
        """Has everything written, ends the process and closes the links; stopping twice does nothing."""
        if self._stopping.is_set():
            return
        self._stopping.set()
        self._watch.join()
        with self._lock:
            if self._process is not None:
                self._process.stop()
                self._process = None
        record = self.health().record
        if record.waiting:  # the disk does not answer: nobody will write them
            lost = replace(record, waiting=0, waiting_bytes=0, lost=record.lost + record.waiting)
            self._health = replace(self._health, record=lost)
            self._memory.status.put(b"")
        self._let_go()

    # ---- opening

    def _start(self) -> IngestProcess:
        files = [sock.fileno() for sock in self._sockets if sock is not None]
        return IngestProcess(self._plan, self._memory, [*files, self._memory_fd, self._journal_fd])

    def _wait_until_ready(self, process: IngestProcess) -> None:
        while not process.ready:
            if process.dead:
                told = self._told()
                kind, text = told.troubles if told and len(told.troubles) == 2 else ("", process.reason)
                raise _ERRORS.get(kind, LinkError)(text if kind else f"the ingest process ended: {text}")
            if time.monotonic() - process.began_s > START_S:
                raise LinkError("the ingest process did not start in time; is the machine overloaded?")
            time.sleep(_STEP_S)

    # ---- watching

    def _guard(self) -> None:
        """Replaces a process that has died or hangs."""
        beat, alive_s, cpu_s = 0, time.monotonic(), 0.0
        changes, look_s = Changes(), alive_s
        while not self._stopping.wait(WATCH_S):
            process, now_s = self._process, time.monotonic()
            assert process is not None
            seen = self._memory.slots[Slot.BEAT]
            if seen != beat:
                beat, alive_s, cpu_s = seen, now_s, process.cpu_s
            if process.dead or self._hangs(process, now_s - alive_s, cpu_s):
                self._replace(process, alive_s)
                alive_s, cpu_s = time.monotonic(), 0.0
            elif self._spare is None or self._spare.dead:
                self._prepare()
            if now_s >= look_s:
                look_s = now_s + LOOK_S
                for level, text in changes.of(self.health()):
                    self._notice(level, text)

    def _hangs(self, process: IngestProcess, silent_s: float, cpu_s: float) -> bool:
        if silent_s <= HUNG_S:
            return False
        # on a machine that is too busy another process would not fare better
        patient = not process.ready or process.waits_for_processor(silent_s, cpu_s)
        return silent_s > (START_S if patient else HUNG_S)

    def _prepare(self) -> None:
        """Starts a process that waits for its turn."""
        if self._spare is not None:
            self._spare.kill()
            self._stopping.wait(_AGAIN_S)
        try:
            self._spare = self._start()
        except LinkError as error:
            self._spare = None
            self._notice("warning", f"no second ingest process could be started: {error}")
            self._stopping.wait(_AGAIN_S)

    def _replace(self, process: IngestProcess, alive_s: float) -> None:
        """Ends a process and has the next take over."""
        if time.monotonic() - process.began_s < _AGAIN_S:
            self._stopping.wait(_AGAIN_S)
        why = f"died ({process.reason})" if process.dead else f"showed no life for {time.monotonic() - alive_s:.1f} s"
        if self._spare is None or self._spare.dead:
            self._prepare()
        if self._spare is None:
            return
        with self._lock:
            if self._stopping.is_set():
                return
            process.kill()
            why += self._in_hand()
            self._add_up()
            self._process, self._spare = self._spare, None
            self._restarts += 1
            with contextlib.suppress(LinkError):  # it has died as well: seen in the next round
                self._process.go(process.generation + 1)
        self._tell_gap(self._process, alive_s, why)

    def _in_hand(self) -> str:
        """What a process had taken off a socket and not yet put where it outlives it, in words."""
        index, self._memory.slots[Slot.IN_HAND] = self._memory.slots[Slot.IN_HAND], 0
        if not index:
            return ""
        return f" while it took packets off {self.names[index - 1]}, of which at most {BATCH} are lost,"

    def _add_up(self) -> None:
        """Keeps what the process before had counted."""
        last = self._told() or self._health
        self._before = tuple(link.counts for link in last.plus(self._before).links) or self._before
        links = tuple(replace(link, counts=LinkCounts()) for link in last.links)
        self._health = IngestHealth(links=links, record=last.record, packets=last.packets, refused=last.refused)
        self._memory.status.put(self._health.to_json())

    def _tell_gap(self, process: IngestProcess, alive_s: float, why: str) -> None:
        """Waits for the new process and tells for how long nobody received."""
        while not process.ready and not process.dead and not self._stopping.wait(_STEP_S):
            if time.monotonic() - process.began_s > START_S:
                break
        gap_s = time.monotonic() - alive_s
        self._gap_s += gap_s
        if process.ready:
            text = f"receiving {why} and another process took over; nobody received for {gap_s:.1f} s"
            self._notice("alarm", f"{text}, the system kept the datagrams of that time as far as they fit")
        else:
            self._notice("alarm", f"receiving {why} and did not start again ({process.reason}); trying on")

    # ---- between the two

    def _wait(self, timeout_s: float) -> None:
        """Until the process says that packets have come."""
        process = self._process
        try:
            if process is None or process.dead:
                time.sleep(min(timeout_s, _STEP_S))
            elif select.select([process.control], [], [], timeout_s)[0] and not process.control.recv(65536):
                time.sleep(min(timeout_s, _STEP_S))  # it has closed its end
        except (OSError, ValueError):
            time.sleep(min(timeout_s, _STEP_S))  # it is just being replaced

    def _told(self) -> IngestHealth | None:
        text = self._memory.status.get()
        try:
            return IngestHealth.from_json(text) if text else None
        except ValueError:
            return None  # it died while it wrote

    def _notice(self, level: str, text: str) -> None:
        self._notices.append(Notice(t_us=now_us(), level=level, text=text))

    def _let_go(self) -> None:
        for process in (self._process, self._spare):
            if process is not None:
                process.kill()
        self._process = self._spare = None
        for sock in self._sockets:
            if sock is not None:
                sock.close()
        os.close(self._memory_fd)
        os.close(self._journal_fd)


def _check_once(names: Sequence[str]) -> None:
    twice = next((name for k, name in enumerate(names) if name in names[:k]), "")
    if twice:
        raise LinkError(f"{twice}: given twice; name each link once")


def _check_outputs(links: Sequence[LinkUrl], outputs: Sequence[str]) -> None:
    """An output into a port of our own would record everything twice."""
    for output in outputs:
        out = parse_url(output.partition("?")[0])
        for link in links:
            here = out.host == link.host or (_is_local(out.host) and (link.host == "0.0.0.0" or _is_local(link.host)))
            if out.scheme.removesuffix("out") + "in" == link.scheme and out.port == link.port and here:
                raise LinkError(f"{output}: leads back to this station's own {link.name}; forward to another port")


def _is_local(host: str) -> bool:
    return host == "localhost" or host.startswith("127.")
