"""Listening before it is known who flies: links are opened once, recorded from the first packet, and handed to the
flight."""

from __future__ import annotations

import contextlib
import shutil
import socket
from collections import deque
from collections.abc import Sequence
from functools import partial
from pathlib import Path

from gcs.mission.mission import SigningChoice
from gcs.mission.roster import Roster
from gcs.session.session import create_folder
from infra.session_format import LOG
from infra.wall_clock import now_us
from mavlink.errors import LinkError
from mavlink.forwarding.outputs import parse_output
from mavlink.ingest.ingest import Ingest
from mavlink.ingest.plan import Outputs, Signing
from mavlink.links.kinds import kind_of, open_link, parse_url
from mavlink.protocol.packet import Packet
from mavlink.transmit.transmitter import SYSTEM_ID
from vision.errors import VideoError
from vision.stream.port import bind
from vision.stream.source import PORT, offered
from vision.stream.trial import looks_like

USUAL_LINKS = tuple(f"udpin:0.0.0.0:{port}" for port in (14550, 14540, 14551))
"""The UDP ports that autopilots, simulators and routers send to unless they are told otherwise."""
HEARD_VIDEO = f"udp://:{PORT}"
"""The video of whoever sends RTP or MPEG-TS to the usual port."""
MAX_KEPT = 50_000
"""Packets for the flight: a minute of a large fleet. What was heard before is recorded and not folded in."""
_MAX_DATAGRAMS = 200
"""Most datagrams of video looked at in one turn."""
_ENOUGH_DATAGRAMS = 3
"""Datagrams that look like video: one may be anything."""


def usual_links() -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Links on the usual ports that are free, and in words which are not.

    Raises:
        LinkError: none is.
    """
    links, taken = [], []
    for url in USUAL_LINKS:
        try:
            _, sock = kind_of(url).prepare(parse_url(url))
        except LinkError as error:
            taken.append(str(error))
            continue
        links.append(url)
        if sock is not None:
            sock.close()
    if not links:
        raise LinkError("; ".join(taken))
    return tuple(links), tuple(taken)


def open_ingest(
    links: Sequence[str],
    log: Path,
    *,
    signing: SigningChoice,
    forward: Sequence[str] = (),
    command: bool = False,
    accept_late: tuple[int, ...] = (),
    uav: int = 0,
    system_ids: tuple[int, ...] = (),
) -> Ingest:
    """The links of a flight, and where packets go on to; as of :class:`mavlink.ingest.ingest.Ingest`.

    Raises:
        LinkError: also for an output that lets a program send, in a flight that may not.
    """
    for out in forward:
        if not command and parse_output(out)[1] is not None:
            raise LinkError(f"{out}: ?rw lets a program send to vehicles, which takes --command; ?ro only listens")
    return Ingest(
        links,
        log,
        system_ids=system_ids,
        signing=Signing(
            keys=str(signing.folder) if signing.folder else "",
            unsigned=signing.unsigned,
            keyless=signing.keyless,
            accept_late=accept_late,
        ),
        outputs=Outputs(urls=tuple(forward), uav=uav, own=SYSTEM_ID),
    )


class Listening:
    """Links in, a session folder that begins with them, and who is heard. One thread polls.

    Args:
        links: to listen to.
        sessions: where the folder is made.
        signing: whose packets count.
        forward: where packets go on to.
        command: whether the flight may send, and programs behind outputs that say so.
        accept_late: vehicles whose signed packets are accepted without a proof that they are made now.
        for_video: whether to look for video on the usual port.
        troubles: of opening the links.

    Attributes:
        folder: of the session.
        ingest: the links.
        roster: who is heard.
        troubles: which ports could not be had and who has them, a line each.

    Raises:
        LinkError, SessionError: something cannot be opened; nothing is left open.
    """

    def __init__(
        self,
        links: Sequence[str],
        sessions: Path,
        signing: SigningChoice,
        *,
        forward: Sequence[str] = (),
        command: bool = False,
        accept_late: tuple[int, ...] = (),
        for_video: bool = True,
        troubles: Sequence[str] = (),
    ) -> None:
        self.troubles = tuple(troubles)
        self._open = partial(open_ingest, signing=signing, forward=forward, command=command, accept_late=accept_late)
        self._sessions = sessions
        self._handed_over = False
        self._video: socket.socket | None = None
        self._datagrams = 0
        self._video_us = 0
        self._begin(links)
        if for_video:
            try:
                self._video = bind("", PORT)
                self._video.setblocking(False)
            except VideoError as error:
                self.troubles += (str(error),)

    def _begin(self, links: Sequence[str]) -> None:
        """Open these links, and record them into a folder of their own."""
        folder, began_us = create_folder(self._sessions), now_us()
        try:
            self.ingest = self._open(links, folder / LOG)
        except BaseException:
            shutil.rmtree(folder, ignore_errors=True)
            raise
        self.folder, self.links, self.began_us = folder, tuple(links), began_us
        self.roster = Roster()
        self._kept: deque[Packet] = deque(maxlen=MAX_KEPT)

    def add_link(self, url: str) -> None:
        """Listen to one more link from now on; the recording and who is heard begin again.

        Raises:
            LinkError: it cannot be opened; the others are listened to as before.
            SessionError: no other folder can be made.
        """
        if parse_url(url).name in self.ingest.names:
            raise LinkError(f"{url} is listened to already")
        open_link(url).close()  # whoever mistypes a device loses nothing
        self.ingest.stop()
        shutil.rmtree(self.folder, ignore_errors=True)
        try:
            self._begin((*self.links, url))
        except LinkError:
            self._begin(self.links)
            raise

    @property
    def where(self) -> str:
        """Links that are listened to, in a few words: ports that any address may send to together."""
        usual = [link.rpartition(":")[2] for link in self.links if link in USUAL_LINKS]
        others = [name for link, name in zip(self.links, self.ingest.names, strict=True) if link not in USUAL_LINKS]
        return ", ".join([f"UDP {', '.join(usual)}"] * bool(usual) + others)

    def poll(self, timeout_s: float) -> None:
        """Take in what has come, waiting for it at most this long."""
        packets = self.ingest.read(timeout_s)
        for packet in packets:
            self.roster.add_packet(packet)
        self._kept.extend(packets)
        self._look_at_datagrams()

    @property
    def offer(self) -> str:
        """Address of the video that a vehicle offers, empty while none does."""
        offers = (each.video for each in self.roster.vehicles if each.video is not None)
        return next((url for offer in offers if (url := offered(offer.type, offer.uri, offer.encoding))), "")

    @property
    def hears_video(self) -> bool:
        """True if somebody sends what looks like video to the usual port."""
        return self._datagrams >= _ENOUGH_DATAGRAMS

    @property
    def quiet_s(self) -> float:
        """Time since something new was heard, s."""
        return (now_us() - max(self.began_us, self.roster.news_us, self._video_us)) * 1e-6

    def hand_over(self) -> tuple[Packet, ...]:
        """Hand the links over to the flight; return the packets until now that it does not have yet."""
        self.poll(0.0)
        self._handed_over = True
        kept = tuple(self._kept)
        self._kept.clear()
        return kept

    def close_video(self) -> None:
        """Give the port of video back, for whoever receives it."""
        if self._video is not None:
            self._video.close()
            self._video = None

    def close(self) -> None:
        """Close the links and delete what was recorded, unless a flight has it."""
        self.close_video()
        if not self._handed_over:
            self.ingest.stop()
            shutil.rmtree(self.folder, ignore_errors=True)

    def _look_at_datagrams(self) -> None:
        if self._video is None or self.hears_video:
            return
        with contextlib.suppress(OSError):  # nothing more
            for _ in range(_MAX_DATAGRAMS):
                data = self._video.recv(65536)
                if data and looks_like(data, ""):
                    self._datagrams += 1
                    self._video_us = now_us()
