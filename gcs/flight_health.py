"""How a flight itself is doing: links, recording, disk and video in one record."""

from __future__ import annotations

from gcs.flight_video import FlightVideo
from gcs.recorder import Recorder
from gcs.snapshot import Health, LinkHealth
from mavlink.ingest.health import IngestHealth, LinkReport

__all__ = ["flight_health"]


def flight_health(
    ingest: IngestHealth, recorder: Recorder, video: FlightVideo, *, keys: int, frames: int, fps: float
) -> Health:
    """The health of now.

    Args:
        ingest: how telemetry comes in.
        recorder: where it goes.
        video: the camera, if there is one.
        keys: signing keys in use.
        frames: pictures looked at so far.
        fps: pictures looked at per second.
    """
    stream = video.stream
    states = recorder.states(ingest.record).values()
    worst = max(states, key=lambda state: state.failing_s)
    return Health(
        fps=fps,
        frames=frames,
        skipped_frames=stream.skipped if stream else 0,
        video=video.state,
        undecoded=stream.undecoded if stream else 0,
        links=tuple(map(_link, ingest.links)),
        recorded_bytes=recorder.bytes,
        recording=True,
        free_bytes=recorder.free_bytes,
        full_in_s=recorder.full_in_s,
        write_failing_s=worst.failing_s,
        write_reason=worst.reason if worst.failing_s else "",
        write_waiting=sum(state.waiting for state in states),
        write_lost=sum(state.lost for state in states),
        keys=keys,
        ingest_restarts=ingest.restarts,
        ring_dropped=ingest.overrun,
        clock_step_s=ingest.record.clock_step_s,
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
    )
