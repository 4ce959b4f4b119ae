"""Rates of the links and when the disk will be full, from the counters of one snapshot after the other."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import replace

from gcs.snapshot import Health, LinkHealth

__all__ = ["Trends"]

WINDOW_S = 5.0
DISK_WINDOW_S = 60.0
LEAST_S = 1.0
"""Shorter spans give no rate."""


class Trends:
    """Remembers the counters of the last minute, once a second."""

    def __init__(self) -> None:
        self._seen: deque[tuple[float, Health]] = deque()

    def of(self, t_us: int, health: Health) -> Health:
        """The same health with rates and forecast.

        Args:
            t_us: now, Unix µs.
            health: as counted; one without links comes back as it is.
        """
        if not health.links:
            return health
        now_s = t_us * 1e-6
        if self._seen and now_s < self._seen[-1][0] - LEAST_S:
            self._seen.clear()
        if not self._seen or now_s >= self._seen[-1][0] + LEAST_S:
            self._seen.append((now_s, health))
        while now_s - self._seen[0][0] > DISK_WINDOW_S:
            self._seen.popleft()
        then_s, then = next(seen for seen in self._seen if now_s - seen[0] <= WINDOW_S)
        links = tuple(_rated(link, then.links, now_s - then_s) for link in health.links)
        first_s, first = self._seen[0]
        grown = health.recorded_bytes - first.recorded_bytes
        full_in_s = math.inf
        if now_s - first_s >= WINDOW_S and grown > 0:
            # t = free / (bytes recorded per second)
            full_in_s = health.free_bytes * (now_s - first_s) / grown
        return replace(health, links=links, full_in_s=min(health.full_in_s, full_in_s))


def _rated(link: LinkHealth, before: tuple[LinkHealth, ...], span_s: float) -> LinkHealth:
    then = next((each for each in before if each.name == link.name), None)
    if then is None or span_s < LEAST_S or link.packets < then.packets:
        return link
    return replace(
        link,
        packets_per_s=(link.packets - then.packets) / span_s,
        bytes_per_s=(link.bytes - then.bytes) / span_s,
    )
