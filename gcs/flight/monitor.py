"""The health of a flight, twice a second: links, message rates, recording, disk and video, in one record.

It has a thread of its own, so that neither a slow detector nor a busy fold makes an alarm late.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Collection
from dataclasses import dataclass, replace

from gcs.flight.video import FlightVideo
from gcs.health.faults import Faults
from gcs.session.recorder import Recorder
from gcs.snapshot import Event, Health, LinkHealth
from infra.wall_clock import now_us
from mavlink.ingest.health import IngestHealth
from mavlink.ingest.ingest import Ingest
from mavlink.links.report import LinkReport
from mavlink.protocol.messages import VideoStreamInformation
from mavlink.state import Level
from mavlink.transmit.message_rates import MessageRates


@dataclass(frozen=True, slots=True, kw_only=True)
class Throughput:
    """Rate at which frames are processed."""

    frames: int
    """Frames processed so far."""
    fps: float
    """Frames processed a second."""
    packets_dropped: int
    """Packets that waited too long to be processed."""


class FlightMonitor:
    """Collects the health of all parts of a flight, and reports what has changed.

    Args:
        ingest: how telemetry comes in.
        recorder: writes the session.
        video: the camera, if there is one.
        rates: message rates to report, without those that the command service does.
        keys: signing keys in use.
        spare: names of links that are not reported before something came over them.
        on_event: called with each change.
    """

    def __init__(
        self,
        ingest: Ingest,
        recorder: Recorder,
        video: FlightVideo,
        rates: Collection[MessageRates],
        *,
        keys: int,
        spare: Collection[str] = (),
        on_event: Callable[[Event], None],
    ) -> None:
        self._ingest, self._recorder, self._video, self._rates = ingest, recorder, video, rates
        self._keys, self._spare, self._on_event = keys, frozenset(spare), on_event

    def check(self, throughput: Throughput, faults: Faults, offer: VideoStreamInformation | None) -> Health:
        """Return the health at this moment, and report what has changed; to be called once a second or more often.

        Args:
            throughput: of the fold.
            faults: of the program.
            offer: the video that the UAV offers, None while it offers none.
        """
        ingest = self._ingest.health()
        for notice in self._ingest.notices():
            self._note(notice.t_us, notice.level, notice.text)
        for rate in (rate for rates in self._rates for rate in rates.troubles(time.monotonic())):
            self._note(now_us(), "warning", rate.words, rate.system_id)
        for event in (*self._recorder.check(ingest.record), *self._video.check(offer)):
            self._on_event(event)
        return self._health(ingest, throughput, faults)

    def _note(self, t_us: int, level: Level, text: str, system_id: int = 0) -> None:
        self._on_event(Event(t_us=t_us, level=level, kind="link", text=text, system_id=system_id))

    def _health(self, ingest: IngestHealth, throughput: Throughput, faults: Faults) -> Health:
        recorder = self._recorder
        states = recorder.states(ingest.record).values()
        worst = max(states, key=lambda state: state.failing_s)
        health = Health(
            links=tuple(
                _link(index, link)
                for index, link in enumerate(ingest.links)
                if link.counts.packets or link.name not in self._spare
            ),
            recording_since_us=recorder.began_us,
            free_bytes=recorder.free_bytes,
            full_in_s=recorder.full_in_s,
            write_failing_s=worst.failing_s,
            write_reason=worst.reason if worst.failing_s else "",
            write_stalled_s=max(state.stalled_s for state in states),
            write_lost=sum(state.lost for state in states),
            keys=self._keys,
            ingest_restarts=ingest.restarts,
            ring_dropped=ingest.overrun + throughput.packets_dropped,
            clock_step_s=ingest.record.clock_step_s,
            faults=faults.count,
            fault=faults.last,
        )
        return with_video(health, self._video, throughput)


def with_video(health: Health, video: FlightVideo, throughput: Throughput) -> Health:
    """A flight's health as it is for one of its cameras."""
    stream = video.stream
    return replace(
        health,
        fps=throughput.fps,
        frames=throughput.frames,
        skipped_frames=stream.skipped if stream else 0,
        video=video.state,
        video_sender=str(stream.sender or "") if stream else "",
        video_rival=str(stream.rival or "") if stream else "",
        undecoded=stream.undecoded if stream else 0,
    )


def _link(index: int, link: LinkReport) -> LinkHealth:
    counts = link.counts
    return LinkHealth(
        name=link.name,
        packets=counts.packets,
        bad=counts.bad,
        dropped=counts.dropped,
        silent_s=counts.silent_s,
        junk_bytes=counts.junk_bytes,
        flooded=link.narrow,
        index=index,
    )
