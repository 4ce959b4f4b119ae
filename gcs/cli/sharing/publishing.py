"""``--publish`` and ``--stream``: what a flight or a replay publishes while it runs.

What publishes is imported when an address is given: to load it takes 0.2 s, which most screens need not wait for.
"""

from __future__ import annotations

import contextlib
import errno
import os
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from gcs.errors import GcsError
from infra.files.safe_open import create, read_small
from infra.wall_clock import now_us

if TYPE_CHECKING:
    from gcs.live_out.sink_url import SinkUrl
    from gcs.snapshot import Snapshot
    from gcs.station import Station
    from mavlink.state import Level

Publish = Annotated[
    list[str] | None,
    typer.Option(
        "--publish",
        metavar="URL",
        help="Publish names and boxes live, to json+udp://HOST:PORT, json+tcp://127.0.0.1:PORT, "
        "cot+udp://239.2.3.1:6969, cot+tcp://HOST:PORT, cot+tls://HOST:PORT?cert=…&key=…&ca=… or "
        "foxglove://127.0.0.1:8765; may be repeated.",
    ),
]


Stream = Annotated[
    str | None,
    typer.Option(
        "--stream",
        metavar="URL",
        help="Stream the video with boxes and names drawn in: udp://HOST:PORT (MPEG-TS) or rtp://HOST:PORT "
        "(with a .sdp file).",
    ),
]


def parse_sinks(
    publish: Sequence[str] | None, stream: str | None = None, links: Sequence[str] = ()
) -> tuple[SinkUrl, ...]:
    """The addresses of these options, each once.

    Args:
        publish: of ``--publish``.
        stream: of ``--stream``.
        links: URLs of the flight's links and outputs, to which nothing else may be sent.

    Raises:
        GcsError: one is no address, is given twice, or is that of a link.
    """
    if not publish and stream is None:
        return ()
    from gcs.live_out.sink_url import check_separate, parse_publish_url, parse_stream_url

    sinks = (*map(parse_publish_url, publish or ()), *([] if stream is None else [parse_stream_url(stream)]))
    places = [(sink.host, sink.port) for sink in sinks]
    for sink, place in zip(sinks, places, strict=True):
        if places.count(place) > 1:
            raise GcsError(f"{sink.text}: given twice; take a port for each")
    check_separate(sinks, links)
    return sinks


@contextlib.contextmanager
def publishing(
    station: Station,
    sinks: Sequence[SinkUrl],
    name: str,
    folder: Path,
    latest: Callable[[], Snapshot | None] | None = None,
    *,
    replayed: bool = False,
) -> Iterator[None]:
    """Send a station's snapshots to others while the context lasts; trouble with that is an event, once.

    Args:
        sinks: of :func:`parse_sinks`.
        name: of the session.
        folder: where a file goes that receivers of a stream need.
        latest: the newest snapshot to publish; None: the one on show.
        replayed: True of a recording, which may have happened at any time.

    Raises:
        GcsError: the system starts no process for it.
    """
    if not sinks:
        yield
        return
    from gcs.live_out.live_out import LiveOut
    from gcs.live_out.sink import SinkSource
    from gcs.snapshot import Event

    def report(text: str, level: Level) -> None:
        snapshot = station.latest()
        at_us = snapshot.now_us if snapshot is not None and station.timeline is not None else now_us()
        station.add_event(Event(t_us=at_us, level=level, kind="program", text=text))

    source = SinkSource(name=name, replayed=replayed)
    try:
        live_out = LiveOut(latest or station.latest, sinks, source, report)
    except OSError as error:
        raise GcsError(f"others cannot be told: {error.strerror or error}; leave --publish and --stream out") from error
    with live_out:
        for sink in sinks:
            if sink.scheme == "rtp":
                _describe(sink, folder / f"{name}-{sink.port}.sdp", report)
        yield


def _describe(sink: SinkUrl, path: Path, report: Callable[[str, Level], None]) -> None:
    """Write what a receiver of an RTP stream has to know; what is there already stays."""
    from gcs.live_out.picture import sdp  # the video library takes its time, and lines do without

    try:
        text = sdp(sink).encode()
        if not path.exists():
            with os.fdopen(create(path), "wb") as file:
                file.write(text)
        elif read_small(path, len(text)) != text:
            raise FileExistsError(errno.EEXIST, "is there, and describes something else")
        report(f"{sink.text}: receivers open {path}", "info")
    except OSError as error:
        report(f"{sink.text}: {path} is not written, which receivers need: {error.strerror or error}", "warning")
