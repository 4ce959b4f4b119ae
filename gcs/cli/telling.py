"""``--tell`` and ``--show``: what a flight or a replay tells others while it runs."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Sequence
from typing import Annotated

import typer

from gcs.errors import GcsError
from gcs.live_out.live_out import LiveOut
from gcs.live_out.sink import SinkSource
from gcs.live_out.sink_url import SinkUrl, check_apart, parse_tell
from gcs.snapshot import Event
from gcs.station import Station
from infra.wall_clock import now_us

__all__ = ["Tell", "parse_sinks", "telling"]

Tell = Annotated[
    list[str] | None,
    typer.Option(
        "--tell",
        metavar="URL",
        help="Tell others while it runs, at json+udp://HOST:PORT, json+tcp://127.0.0.1:PORT, cot+udp://239.2.3.1:6969, "
        "cot+tcp://HOST:PORT or cot+tls://HOST:PORT?cert=…&key=…&ca=…; may be repeated.",
    ),
]


def parse_sinks(tell: Sequence[str] | None, links: Sequence[str] = ()) -> tuple[SinkUrl, ...]:
    """The addresses of these options, each once.

    Args:
        tell: of ``--tell``.
        links: URLs of the flight's links and outputs, which nothing else may be told at.

    Raises:
        GcsError: one is no address, is given twice, or is that of a link.
    """
    sinks = tuple(map(parse_tell, tell or ()))
    places = [(sink.host, sink.port) for sink in sinks]
    for sink, place in zip(sinks, places, strict=True):
        if places.count(place) > 1:
            raise GcsError(f"{sink.text}: given twice; take a port for each")
    if sinks:
        check_apart(sinks, links)
    return sinks


@contextlib.contextmanager
def telling(station: Station, sinks: Sequence[SinkUrl], source: SinkSource) -> Iterator[None]:
    """While this lasts others are told of the station; trouble with that is an event, once.

    Raises:
        GcsError: the system starts no process for it.
    """
    if not sinks:
        yield
        return

    def report(text: str) -> None:
        snapshot = station.latest()
        at_us = snapshot.now_us if snapshot is not None and station.timeline is not None else now_us()
        station.add_event(Event(t_us=at_us, level="warning", kind="program", text=text))

    try:
        live_out = LiveOut(station.latest, sinks, source, report)
    except OSError as error:
        raise GcsError(f"others cannot be told: {error.strerror or error}; leave --tell out") from error
    with live_out:
        yield
