"""Alarms of one link, from its counters."""

from __future__ import annotations

import math

from gcs.health.alarm_rule import AlarmRule
from gcs.snapshot import LinkHealth, Snapshot
from mavlink.state import SILENT_S

FIRST_PACKET_S = 10.0
"""A radio that was just switched on finds its partner in this time."""


def is_silent(link: LinkHealth) -> bool:
    """Tell whether nothing was received for ``SILENT_S`` or ever, or that is unknown."""
    return not link.silent_s <= SILENT_S


def _carries_junk(link: LinkHealth) -> bool:
    return link.junk_bytes > 0 and not link.packets


def _fell_silent(link: LinkHealth, now: Snapshot) -> bool:
    return is_silent(link) and not math.isinf(link.silent_s)


def _never_received(link: LinkHealth, now: Snapshot) -> bool:
    return math.isinf(link.silent_s) and not _carries_junk(link)


LINK_RULES: tuple[AlarmRule[LinkHealth], ...] = (
    AlarmRule(
        key="link",
        level="alarm",
        kind="link",
        text="nothing is received any more",
        on_and_off="it is received on and off",
        meaning=f"silent for {SILENT_S:g} s",
        advice="check radio, cable and port",
        condition=_fell_silent,
    ),
    AlarmRule(
        key="no packet",
        level="alarm",
        kind="link",
        text="nothing is received",
        meaning=f"nothing came in the first {FIRST_PACKET_S:g} s",
        advice="check radio, cable and port; on a udpout link only a station with --command sends first: have the "
        "other end send here and use udpin",
        condition=_never_received,
        lasts_s=FIRST_PACKET_S,
    ),
    AlarmRule(
        key="junk",
        level="alarm",
        kind="link",
        text="what is received is no MAVLink",
        meaning=f"bytes came for {FIRST_PACKET_S:g} s, and not one packet",
        advice="check the baud rate, and what sends there",
        condition=lambda link, _: _carries_junk(link),
        lasts_s=FIRST_PACKET_S,
    ),
    AlarmRule(
        key="flood",
        level="alarm",
        kind="link",
        text="it is flooded, and not all is let in",
        meaning="more comes than can be processed: from unknown senders, in the name of a vehicle, or from its "
        "address, which can be forged. Of those who flood only some is let in; known vehicles keep their place",
        advice="have the sender switched off: the event log shows from where, how much and when it is over",
        condition=lambda link, _: link.flooded,
        logged_by="mavlink.ingest.health_events",
    ),
    AlarmRule(
        key="dropped",
        level="alarm",
        kind="link",
        text="the system drops packets before they can be read",
        meaning="the receive buffer overflowed",
        advice="free the processor; allow larger receive buffers (sysctl net.core.rmem_max=8388608)",
        counter=lambda link, _: link.dropped,
    ),
)
