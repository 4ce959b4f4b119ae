"""Serious texts of vehicles as alarms: each stays until the operator has acknowledged it.

They are words from the air, so they are of a kind of their own, begin with who says them, and are few of each vehicle
however many it sends: the event log and the telemetry log have them all.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from gcs.snapshot import Alarm, Event
from mavlink.state import ARMING_FAILURES

MOST_TEXTS = 6
"""Different texts of one vehicle that are alarms of their own; further ones share one."""
GONE_US = 60_000_000
"""An acknowledged text is over when it was not repeated for so long: autopilots repeat what still holds every 30 s."""
ADVICE = "these are the vehicle's own words, not this program's: check the vehicle; acknowledged, it goes"


@dataclass(slots=True)
class _Text:
    """Texts of one vehicle."""

    event: Event
    """The first, or of those that share an alarm the newest."""
    since_us: int
    last_us: int
    others: int = 0
    """Further texts that share this alarm."""
    seen: bool = False

    def is_over(self, now_us: int) -> bool:
        return self.seen and now_us - self.last_us > GONE_US


class TextAlarms:
    """Texts that are not over yet, by the key of their alarm."""

    def __init__(self) -> None:
        self._texts: dict[str, _Text] = {}

    def add(self, event: Event) -> None:
        """Take in an event; only serious texts of vehicles count, and not arming checks: they have their own alarm."""
        words = event.text.partition(" says: ")[2]
        if event.kind != "text" or event.level != "alarm" or words.startswith(ARMING_FAILURES):
            return
        whose = f"text {event.system_id} "
        key = whose + event.text
        if key not in self._texts and not self._has_room(whose):
            key = whose  # shared: no text is empty
        known = self._texts.get(key)
        if known is None or known.is_over(event.t_us):
            self._texts[key] = _Text(event, event.t_us, event.t_us)
            return
        known.last_us = event.t_us
        if key == whose:
            known.event, known.others = event, known.others + 1
            # what comes on top of what was acknowledged is new
            if known.seen:
                known.seen, known.since_us = False, event.t_us

    def acknowledge(self, key: str) -> None:
        """The operator has seen an alarm; nothing where it is none of these."""
        if key in self._texts:
            self._texts[key].seen = True

    def update(self, now_us: int) -> Iterator[Alarm]:
        """The alarms at a time."""
        for key, text in list(self._texts.items()):
            if text.is_over(now_us):
                del self._texts[key]
                continue
            more = f" (and {text.others} more)" if text.others else ""
            yield Alarm(
                key=key,
                level="alarm",
                kind="text",
                text=text.event.text + more,
                advice=ADVICE,
                since_us=text.since_us,
                system_id=text.event.system_id,
            )

    def _has_room(self, whose: str) -> bool:
        """Tell whether a vehicle may have one more alarm of its own; the oldest that was seen makes room."""
        own = [key for key in self._texts if key.startswith(whose) and key != whose]
        if len(own) < MOST_TEXTS:
            return True
        oldest = next((key for key in own if self._texts[key].seen), None)
        if oldest is not None:
            del self._texts[oldest]
        return oldest is not None
