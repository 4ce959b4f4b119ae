"""Events for operators from the ingest's health: each change once, and losses again only when they have grown."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import replace

from infra.reporting import ReportGrowth
from mavlink.forwarding.forward import HARMLESS
from mavlink.forwarding.outputs import InboundFrames, OutputCounts
from mavlink.ingest.health import IngestHealth
from mavlink.links.batch import MIXED
from mavlink.links.flood_limiter import STRANGERS, FloodLimit
from mavlink.links.report import LinkReport
from mavlink.state import Level

_Event = tuple[Level, str]
"""Level and text."""
PATIENCE = 10
"""Health reports, two a second, for which a connection that is being made is not reported as lost."""
MAX_FLOODS = 5
"""Floods that are reported one by one at a time."""
QUIET = 20
"""Health reports for which a connection that comes and goes is not reported as lost again, and after which frames from
a program are reported again, and an output without losses is well."""


class HealthEvents:
    """Compares one health with the one before."""

    def __init__(self) -> None:
        self._connected: dict[str, bool] = {}
        self._patience: dict[str, int] = {}
        self._limits: dict[str, dict[tuple[str, int, bool], FloodLimit]] = {}
        self._losses: defaultdict[str, ReportGrowth] = defaultdict(ReportGrowth)
        self._troubles: frozenset[str] = frozenset()
        self._looks = 0
        self._dropped: dict[str, int] = {}
        """Packets that each output dropped."""
        self._dropped_at: dict[str, int] = {}
        """Number of the health report at which they became more, of outputs that nobody takes."""
        self._inbound: defaultdict[tuple[str, InboundFrames], ReportGrowth] = defaultdict(
            lambda: ReportGrowth(rest=QUIET)
        )

    def since_last(self, health: IngestHealth) -> list[_Event]:
        """Events that are new since the last call."""
        events: list[_Event] = []
        self._looks += 1
        for link in health.links:
            events += self._link(link)
            text = f"{link.name}: {{}} datagrams were lost, the machine is too busy to receive them in time"
            events += self._loss(link.name, link.counts.dropped, text)
        events += self._loss(
            "ring", health.overrun, "{} packets were recorded and not shown: the screen cannot keep up"
        )
        for output in health.outputs:
            events += self._forwarding(output)
            for frames in output.inbound:
                events += self._of_program(output.name, frames)
        troubles = frozenset(health.troubles)
        events += [("warning", text) for text in sorted(troubles - self._troubles)]
        self._troubles = troubles
        return events

    def _link(self, link: LinkReport) -> list[_Event]:
        now = {_key(limit): limit for limit in link.limits}
        before = self._limits.get(link.name, {})
        self._limits[link.name] = now
        events = self._connection(link)
        events += _few("alarm", [f"{link.name}: {_flood(now[key])}" for key in now if key not in before])
        events += _few("info", [f"{link.name}: {_flood_over(before[key])}" for key in before if key not in now])
        return events

    def _connection(self, link: LinkReport) -> list[_Event]:
        name, before = link.name, self._connected.get(link.name)
        patience = self._patience[name] = max(self._patience.get(name, PATIENCE + 1) - 1, 0)
        if link.connected:
            if before is not True:
                self._connected[name], self._patience[name] = True, QUIET if before is False else 0
            return [("info", f"{name}: back")] if before is False else []
        if before is False or patience:
            return []
        self._connected[name] = False
        return [("alarm", f"{name}: lost, trying on" if before else f"{name}: no connection yet, trying on")]

    def _of_program(self, output: str, frames: InboundFrames) -> list[_Event]:
        """Frames from a program behind an output: when they begin, and again when there are twice as many."""
        if not self._inbound[output, replace(frames, count=0)].due(frames.count, self._looks):
            return []
        sender, refusal = frames.sender or "others", frames.refusal
        target = f"system {frames.target}" if frames.target else "all systems"
        times = f", {frames.count:,} times so far" if frames.count > 1 else ""
        if not frames.message:
            goes = f"goes nowhere: {refusal}" if refusal else "was sent on"
            return [("info", f"{output}: what {sender} sent {goes}{times}")]
        level: Level = "info" if frames.message in HARMLESS else "warning"
        if refusal:
            return [(level, f"{output}: {frames.message} of {sender} for {target} was stopped: {refusal}{times}")]
        return [(level, f"{output}: {sender} sent {frames.message} to {target} through this station{times}")]

    def _forwarding(self, output: OutputCounts) -> list[_Event]:
        """Report once that nobody takes what an output sends, and when it is taken again."""
        name, before = output.name, self._dropped.get(output.name, 0)
        self._dropped[name] = output.dropped
        if output.dropped > before:
            known = name in self._dropped_at
            self._dropped_at[name] = self._looks
            text = f"{name}: packets are not forwarded: nobody receives there, or too slowly"
            return [] if known else [("warning", text)]
        if self._looks - self._dropped_at.get(name, self._looks) < QUIET:
            return []
        del self._dropped_at[name]
        return [("info", f"{name}: forwarded again; {output.dropped:,} packets so far were not")]

    def _loss(self, name: str, count: int, text: str) -> list[_Event]:
        return [("alarm", text.format(f"{count:,}"))] if self._losses[name].due(count) else []


def _few(level: Level, texts: list[str]) -> list[_Event]:
    """The first of them, and how many more there are."""
    more = len(texts) - MAX_FLOODS
    return [(level, text) for text in texts[:MAX_FLOODS]] + [(level, f"{more} more such senders")] * (more > 0)


def _key(limit: FloodLimit) -> tuple[str, int, bool]:
    """Key of what it is about; the addresses of unknown senders change."""
    return "" if limit.system_id == STRANGERS else limit.address, limit.system_id, limit.refused


def _flood(limit: FloodLimit) -> str:
    rate = float(f"{limit.wanted_per_s:.2g}")
    if limit.refused:
        return f"{_source(limit)} floods this link with packets that are refused; not all of them are recorded"
    if limit.system_id == STRANGERS:
        return f"strangers flood this port, {rate:,.0f} datagrams/s from {limit.address}; only few of them are let in"
    return f"{_source(limit)} floods this port, {rate:,.0f} datagrams/s, or they are forged; only some are let in"


def _flood_over(limit: FloodLimit) -> str:
    if limit.refused:
        return f"{_source(limit)} floods no more; {limit.turned_away:,} refused packets were not recorded"
    if limit.system_id == STRANGERS:
        return f"about {limit.turned_away:,} datagrams of strangers were turned away; the flood is over"
    return f"{_source(limit)} is let in whole again; about {limit.turned_away:,} datagrams were turned away"


def _source(limit: FloodLimit) -> str:
    kind = "in datagrams of several frames" if limit.system_id == MIXED else f"as system {limit.system_id}"
    return f"{limit.address} {kind}"
