"""Base of every sink, and what passes between its process and the station."""

from __future__ import annotations

from abc import ABC, abstractmethod
from importlib import import_module
from typing import cast

import msgspec

from gcs.live_out.sink_url import SinkUrl
from gcs.snapshot import Snapshot


class SinkSource(msgspec.Struct, frozen=True, kw_only=True):
    """Flight or replay whose snapshots are published."""

    name: str
    """The session's name."""
    replayed: bool = False
    """True of a recording, which may have happened at any time."""


class SinkSettings(msgspec.Struct, kw_only=True, tag=True):
    """Settings from the station to a sink's process, once: what to publish, and where."""

    url: SinkUrl
    source: SinkSource
    memory: int
    """File descriptor of the newest snapshot."""
    images: bool
    """True if the memory holds pictures."""


class SinkReport(msgspec.Struct, kw_only=True, tag=True):
    """Report from a sink's process to the station, once a second: a sign of life."""

    sent: int = 0
    """Messages or pictures that left."""
    dropped: int = 0
    """Number of snapshots that were not sent: too large, or a receiver was too slow."""
    clients: int = 0
    """Clients that are being served."""
    error: str = ""
    """Reason why nothing leaves at the moment, empty while it does."""


class Sink(ABC):
    """Destination of snapshots; it may take its time, since it has a process of its own.

    Attributes:
        sent, dropped, clients: as in its reports.
    """

    sent = dropped = clients = 0

    @abstractmethod
    def __init__(self, url: SinkUrl, source: SinkSource) -> None:
        """Open the sink.

        Raises:
            OSError: it cannot be had now; it is tried again.
        """

    @abstractmethod
    def write(self, snapshot: Snapshot) -> None:
        """Publish a snapshot.

        Raises:
            OSError: it has to be opened again.
        """

    def serve(self) -> None:  # noqa: B027 - most have nobody to serve
        """Look after those who read; called many times a second."""

    @abstractmethod
    def close(self) -> None:
        """Close the sink."""


def open_sink(url: SinkUrl, source: SinkSource) -> Sink:
    """Open what an address stands for.

    Raises:
        OSError: it cannot be had now.
    """
    module, name = url.kind.sink.split(":")
    kind = cast(type[Sink], getattr(import_module(f"gcs.live_out.{module}"), name))
    return kind(url, source)
