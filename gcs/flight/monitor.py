"""Looks after a flight, twice a second: links, message rates, recording, disk and video, in one record.

It has a thread of its own, so that neither a slow detector nor a busy fold makes an alarm late.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import cast

from gcs.flight.video import FlightVideo
from gcs.health.faults import Faults
from gcs.session.recorder import Recorder
from gcs.snapshot import Event, Health, Level, LinkHealth
from infra.wall_clock import now_us
from mavlink.ingest.health import IngestHealth
from mavlink.ingest.ingest import Ingest
from mavlink.links.report import LinkReport
from mavlink.protocol.messages import VideoStreamInformation
from mavlink.transmit.message_rates import MessageRates

__all__ = ["FlightMonitor", "Throughput"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Throughput:
    """How the fold gets on."""

    frames: int
    """Frames looked at so far."""
    fps: float
    """Frames looked at a second."""
    pushed_out: int
    """Packets that waited too long for it."""


class FlightMonitor:
    """Counts, compares and tells what is new.

    Args:
        ingest: how telemetry comes in.
        recorder: where all goes.
        video: the camera, if there is one.
        rates: message rates to compare; None where somebody else does.
        keys: signing keys in use.
        tell: given what is new.
    """

    def __init__(
        self,
        ingest: Ingest,
        recorder: Recorder,
        video: FlightVideo,
        rates: MessageRates | None,
        *,
        keys: int,
        tell: Callable[[Event], None],
    ) -> None:
        self._ingest, self._recorder, self._video, self._rates = ingest, recorder, video, rates
        self._keys, self._tell = keys, tell

    def check(self, throughput: Throughput, faults: Faults, offer: VideoStreamInformation | None) -> Health:
        """The health of now; to be called once a second or more often.

        Args:
            throughput: of the fold.
            faults: of the program.
            offer: the video that the UAV offers, None while it offers none.
        """
        ingest = self._ingest.health()
        for notice in self._ingest.notices():
            self._note(notice.t_us, cast(Level, notice.level), notice.text)
        for rate in self._rates.troubles(time.monotonic()) if self._rates else ():
            self._note(now_us(), "warning", rate.words, rate.system_id)
        for event in (*self._recorder.check(ingest.record), *self._video.check(offer)):
            self._tell(event)
        return self._health(ingest, throughput, faults)

    def _note(self, t_us: int, level: Level, text: str, system_id: int = 0) -> None:
        self._tell(Event(t_us=t_us, level=level, kind="link", text=text, system_id=system_id))

    def _health(self, ingest: IngestHealth, throughput: Throughput, faults: Faults) -> Health:
        recorder, stream = self._recorder, self._video.stream
        states = recorder.states(ingest.record).values()
        worst = max(states, key=lambda state: state.failing_s)
        return Health(
            fps=throughput.fps,
            frames=throughput.frames,
            skipped_frames=stream.skipped if stream else 0,
            video=self._video.state,
            undecoded=stream.undecoded if stream else 0,
            links=tuple(map(_link, ingest.links)),
            recorded_bytes=recorder.bytes,
            recording=True,
            free_bytes=recorder.free_bytes,
            full_in_s=recorder.full_in_s,
            write_failing_s=worst.failing_s,
            write_reason=worst.reason if worst.failing_s else "",
            write_stalled_s=max(state.stalled_s for state in states),
            write_waiting=sum(state.waiting for state in states),
            write_lost=sum(state.lost for state in states),
            keys=self._keys,
            ingest_restarts=ingest.restarts,
            ring_dropped=ingest.overrun + throughput.pushed_out,
            clock_step_s=ingest.record.clock_step_s,
            faults=faults.count,
            fault=faults.last,
        )


def _link(link: LinkReport) -> LinkHealth:
    counts = link.counts
    return LinkHealth(
        name=link.name,
        packets=counts.packets,
        bytes=counts.bytes,
        bad=counts.bad,
        dropped=counts.dropped,
        silent_s=counts.silent_s,
        junk_bytes=counts.junk_bytes,
        flooded=link.narrow,
    )
