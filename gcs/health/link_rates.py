"""Rates of the links, from the counters of one snapshot after the other."""

from __future__ import annotations

from collections import deque
from dataclasses import replace

from gcs.snapshot import Health, LinkHealth

WINDOW_S = 5.0
MIN_S = 1.0
"""Shortest span that gives a rate, s."""


class LinkRates:
    """Remembers the counters of the last seconds, once a second."""

    def __init__(self) -> None:
        self._seen: deque[tuple[float, Health]] = deque()

    def with_rates(self, t_us: int, health: Health) -> Health:
        """Return the health with rates.

        Args:
            t_us: now, Unix µs.
            health: as counted; one without links comes back as it is.
        """
        if not health.links:
            return health
        now_s = t_us * 1e-6
        if self._seen and now_s < self._seen[-1][0] - MIN_S:
            self._seen.clear()
        if not self._seen or now_s >= self._seen[-1][0] + MIN_S:
            self._seen.append((now_s, health))
        while now_s - self._seen[0][0] > WINDOW_S:
            self._seen.popleft()
        then_s, then = self._seen[0]
        links = tuple(_rated(link, then.links, now_s - then_s) for link in health.links)
        return replace(health, links=links)


def _rated(link: LinkHealth, before: tuple[LinkHealth, ...], span_s: float) -> LinkHealth:
    then = next((each for each in before if each.name == link.name), None)
    if then is None or span_s < MIN_S or link.packets < then.packets:
        return link
    return replace(
        link,
        packets_per_s=(link.packets - then.packets) / span_s,
        junk_per_s=max(link.junk_bytes - then.junk_bytes, 0) / span_s,
    )
