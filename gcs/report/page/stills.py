"""Pictures of the moments that matter, boxes and names drawn in: first names, changes, alarms, the least sure name."""

from __future__ import annotations

import base64
import math
from dataclasses import dataclass
from typing import Final, Literal

import cv2

from gcs.certainty import CONFIRMED, certainty
from gcs.report.overlay import draw
from gcs.report.page.flight_summary import FlightSummary
from gcs.report.page.html import empty, whole_words, words
from gcs.report.page.timeline import clock
from gcs.report.vehicle_names import text_with_sender
from gcs.snapshot import Snapshot

Kind = Literal["name", "change", "alarm", "least sure"]

MAX_STILLS: Final[dict[Kind, int]] = {"name": 4, "change": 4, "alarm": 4, "least sure": 1}
"""Most pictures of each kind, the first that come."""
SIZES: Final = ((880, 75), (880, 50), (640, 40), (320, 30))
"""Width, px, and JPEG's quality; the first with which a picture is small enough."""
MAX_BYTES: Final = 100_000
"""Largest picture: thirteen of them and their base64 stay below 2 MB."""
TOGETHER_US: Final = 1_000_000
"""Span within which moments of one kind are one."""
SETTLED_US: Final = 5_000_000
"""Names are young before, and less sure."""
SURER: Final = 0.02
"""A name is less sure than another by this at least: not every frame of a slow fall is drawn."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Still:
    t_us: int
    what: str
    jpeg: bytes


class Stills:
    """Takes snapshots with their images, in order of time, and keeps pictures of some."""

    def __init__(self) -> None:
        self._kept: dict[Kind, list[_Still]] = {kind: [] for kind in MAX_STILLS}
        self._confirmed: set[int] = set()
        self._alarms: set[tuple[str, str]] = set()
        self._start_us = 0
        self._least = math.inf

    def add(self, snapshot: Snapshot) -> None:
        """Take in one frame; without an image nothing is kept of it."""
        self._start_us = self._start_us or snapshot.t_us
        if snapshot.image is None:
            return
        named = [box for box in snapshot.new_boxes if box.system_id and not box.coasting]
        came = [box for box in named if box.confidence >= CONFIRMED and box.system_id not in self._confirmed]
        self._confirmed |= {box.system_id for box in came}
        if came:
            names = ", ".join(f"{snapshot.name_of(box.system_id)} ({certainty(box.confidence)})" for box in came)
            self._keep("name", snapshot, f"confirmed first: {names}")
        for event in snapshot.events:
            if event.kind == "identity" and event.level != "info":
                self._keep("change", snapshot, text_with_sender(event, snapshot.name_of))
        alarms = {(alarm.key, alarm.level): alarm for alarm in snapshot.alarms if not alarm.reported}
        for key in alarms.keys() - self._alarms:
            self._keep("alarm", snapshot, alarms[key].text)
        self._alarms = set(alarms)
        if named and snapshot.t_us - self._start_us > SETTLED_US:
            least = min(named, key=lambda box: box.confidence)
            if least.confidence < self._least - SURER:
                self._least = least.confidence
                self._kept["least sure"].clear()
                name = snapshot.name_of(least.system_id)
                self._keep("least sure", snapshot, f"the least sure name: {name} ({certainty(least.confidence)})")

    def drawn(self, record: FlightSummary) -> str:
        """Pictures that were kept, in order of time."""
        stills = sorted((still for kept in self._kept.values() for still in kept), key=lambda still: still.t_us)
        if not stills:
            return empty("No pictures: the recording has no video, or nothing happened in it.")
        return f'<div class="stills">{"".join(_figure(record, still) for still in stills)}</div>'

    def _keep(self, kind: Kind, snapshot: Snapshot, what: str) -> None:
        kept = self._kept[kind]
        if len(kept) >= MAX_STILLS[kind] or (kept and snapshot.t_us - kept[-1].t_us < TOGETHER_US):
            return
        kept.append(_Still(t_us=snapshot.t_us, what=what, jpeg=_jpeg(snapshot)))


def _jpeg(snapshot: Snapshot) -> bytes:
    for width, quality in SIZES:
        image = draw(snapshot, scale=min(1.0, width / snapshot.width))
        data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, quality])[1].tobytes()
        if len(data) <= MAX_BYTES:
            break
    return data


def _figure(record: FlightSummary, still: _Still) -> str:
    data = base64.b64encode(still.jpeg).decode("ascii")
    at, what = clock((still.t_us - record.start_us) * 1e-6), words(still.what)
    return (
        f'<figure><img src="data:image/jpeg;base64,{data}" alt="The picture at {at}: {what}">'
        f"<figcaption>{at} – {whole_words(still.what)}</figcaption></figure>"
    )
