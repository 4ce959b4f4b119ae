"""Cursor on Target, version 2.0: one event for a box, as TAK's programs read it. Pure.

Layout: MITRE's "Cursor on Target Message Router User's Guide" (2009) and its ``Event.xsd``. Places are WGS-84 degrees;
``ce`` is 1σ in metres; 9999999.0 stands for a number that is unknown.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from typing import Final
from xml.etree import ElementTree

from gcs.export.maps.ways import time_utc
from gcs.missing import may_be
from gcs.snapshot import Box, Snapshot
from infra.plain_text import plain
from infra.reporting import Throttle

XML_DECLARATION: Final = b'<?xml version="1.0" encoding="UTF-8"?>\n'
"""XML declaration before an event that is sent alone, and before a file of events."""
PERIOD_US: Final = 1_000_000
"""Least time between two events of one vehicle."""
STALE_US: Final = 10_000_000
"""An event holds for this long: ten that follow it may be lost before a map shows the vehicle as gone."""
FRIEND, UNKNOWN = "a-f-G-E-V", "a-u-G-E-V"
"""Atom, friend or unknown, on the ground, equipment, vehicle."""
FUSED, BY_MACHINE = "m-f", "m-i"
"""Source of a place: telemetry and film together, or by the film alone."""
_NOT_KNOWN: Final = "9999999.0"
_MAX_LETTERS: Final = 64
"""Maximum letters of a name: an event is to fit into a datagram whatever a mission calls its vehicles."""


class CotPacer:
    """Thins events to one a second for each vehicle."""

    def __init__(self) -> None:
        self._throttle = Throttle(PERIOD_US)

    def due(self, uid: str, now_us: int) -> bool:
        """Tell whether an event of this uid may go out now; then it counts as sent."""
        return self._throttle.due(uid, now_us)


def cot_boxes(snapshot: Snapshot) -> Iterator[Box]:
    """Boxes of which an event can tell: seen at this very moment, tracked, and with a place on the ground."""
    for box in snapshot.new_boxes:
        if box.track_id and not box.coasting and math.isfinite(box.lat_deg) and math.isfinite(box.lon_deg):
            yield box


def cot_uid(box: Box, source: str) -> str:
    """Identifier of what an event is about, the same for one vehicle all through a flight, live and exported.

    Args:
        source: the session's name: two stations on one network tell of different things.
    """
    station = re.sub(r"[^A-Za-z0-9_.-]", "-", source)[:_MAX_LETTERS]
    what = f"vehicle.{box.system_id}" if box.system_id else f"track.{box.known_as}"
    return f"rollcall.{station}.{what}"


def cot_event(snapshot: Snapshot, box: Box, *, source: str, t_us: int | None = None, opex: str = "") -> bytes:
    """One ``<event>`` in UTF-8, on one line, without an XML declaration.

    A box that has a name is a friend, with confidence and evidence in ``<__rollcall>``; any other is unknown and has no
    vehicle's name or id in it.

    Args:
        box: one of :func:`cot_boxes`.
        source: as for :func:`cot_uid`.
        t_us: when it holds, Unix µs; None: the snapshot's own time.
        opex: ``s-replay`` for instance, where it is no live operation.
    """
    moment = snapshot.t_us if t_us is None else t_us
    event = ElementTree.Element(
        "event",
        version="2.0",
        uid=cot_uid(box, source),
        type=FRIEND if box.system_id else UNKNOWN,
        how=FUSED if box.system_id else BY_MACHINE,
        time=time_utc(moment),
        start=time_utc(moment),
        stale=time_utc(moment + STALE_US),
    )
    if opex:
        event.set("opex", opex)
    ElementTree.SubElement(
        event,
        "point",
        lat=f"{box.lat_deg:.7f}",
        lon=f"{box.lon_deg:.7f}",
        hae=_NOT_KNOWN,
        ce=f"{box.place_std_m:.2f}" if math.isfinite(box.place_std_m) else _NOT_KNOWN,
        le=_NOT_KNOWN,
    )
    detail = ElementTree.SubElement(event, "detail")
    name = plain(snapshot.name_of(box.system_id)) if box.system_id else f"unknown {box.known_as}"
    ElementTree.SubElement(detail, "contact", callsign=name[:_MAX_LETTERS])
    ElementTree.SubElement(detail, "__rollcall", _evidence(snapshot, box))
    data: bytes = ElementTree.tostring(event, encoding="utf-8", xml_declaration=False)
    return data


def _evidence(snapshot: Snapshot, box: Box) -> dict[str, str]:
    """Evidence that a name rests on; what is unknown is left out."""
    values = {"frame": str(snapshot.frame), "track": str(box.track_id)}
    if not box.system_id:
        values |= {"may_be": words} if (words := plain(may_be(snapshot, box))) else {}
        return values | _numbers({"none_of_ours": box.none_of_ours})
    values |= {"system_id": str(box.system_id)} | ({"stated": "true"} if box.stated else {})
    values |= {"doubt": box.doubt} if box.doubt else {}
    return values | _numbers(
        {
            "confidence": box.confidence,
            "margin": box.margin,
            "residual_m": box.residual_m,
            "position_age_s": box.position_age_s,
            "projection": box.projection,
            "topology": box.topology,
        }
    )


def _numbers(values: dict[str, float]) -> dict[str, str]:
    return {key: f"{value:.3f}" for key, value in values.items() if math.isfinite(value)}
