"""One flight under attack: station, stage, and what came of it."""

from __future__ import annotations

import math
import tempfile
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

from bench.attacks.actors import Body
from bench.attacks.records import LoggedEvent, VehicleEstimate, estimates_of, fold_recording, read_events, recorded
from bench.attacks.report import AttackRow
from bench.attacks.stage import FALSE, TRUE, PacketSchedule, Party, SenderFactory, Stage, StageCounts
from bench.ports import free_port
from bench.station import FlyingStation, mission_text

SETTLE_S = 1.0
"""What was sent last is on its way to the disk for as long."""
PROMISE_S = 2.0
"""Two senders of one id are distinguished within this."""
SLACK_S = 1.0
"""Granted on top to a machine that other work shares."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """What is attacked, and how hard."""

    gcs: tuple[str, ...]
    """The command under test."""
    python: str
    """Its interpreter."""
    quick: bool = False
    minutes: float = 20.0
    """Length of the quiet flight."""
    recording: Path = Path("sitl_logs/ardupilot-swarm")
    folder: Path = field(default_factory=lambda: Path(tempfile.mkdtemp(prefix="attacks-")))
    """For sessions, mission files and keys."""


Attack = Callable[[Options], list[AttackRow]]


@dataclass(frozen=True, kw_only=True)
class Flown:
    """A flight that is over."""

    options: Options
    session: Path
    sent: StageCounts
    exit_code: int
    flown_s: float

    @cached_property
    def recorded(self) -> Counter[Party]:
        """Packets in the log, by party."""
        return recorded(self.session, self.sent)

    @cached_property
    def events(self) -> list[LoggedEvent]:
        """The event log."""
        return read_events(self.session, self.sent)

    @cached_property
    def _folded(self) -> list[dict[str, Any]]:
        return fold_recording(self.options.python, self.session, self.sent)

    def estimates(self, system_id: int) -> list[VehicleEstimate]:
        """What was accepted of a vehicle, five times a second."""
        return estimates_of(self._folded, system_id)

    def counts(self, system_id: int) -> dict[str, int]:
        """The columns of a row that are counts of packets of one vehicle."""
        sent, found = self.sent.count, self.recorded
        true, false = (TRUE, system_id), (FALSE, system_id)
        return {
            "sent": sent[true],
            "lost": sent[true] - found[true],
            "false_sent": sent[false],
            "false_recorded": found[false],
        }


def fly(
    options: Options,
    name: str,
    ugvs: Sequence[int],
    lines: Callable[..., list[PacketSchedule]],
    duration_s: float,
    *,
    ports: int = 1,
    more: Sequence[str] = (),
    keys: str = "none",
    during: Callable[[FlyingStation, Stage], None] | None = None,
) -> Flown:
    """Fly while lines are played; the station ends before they do, so that no sender falls silent in flight.

    Args:
        options: what is attacked.
        name: of the flight's folder.
        ugvs: system ids of the mission's vehicles.
        lines: what is sent, given a sender factory for each of the ports that the station listens on.
        duration_s: how long.
        ports: how many links.
        more: further words for the command line.
        keys: folder of signing keys.
        during: done while it flies, beside the lines.
    """
    listened = [free_port() for _ in range(ports)]
    folder = options.folder / name
    with ExitStack() as stack:
        senders = [SenderFactory(port) for port in listened]
        for new_sender in senders:
            stack.callback(new_sender.close)
        links = [f"udpin:127.0.0.1:{port}" for port in listened]
        station = FlyingStation(options.gcs, folder, mission_text(ugvs, keys), links, more)
        stack.callback(station.kill)
        stage = Stage(lines(*senders))
        stage.start()
        stack.callback(stage.stop)
        if during is not None:
            during(station, stage)
        stage.wait(duration_s)
        sent = stage.stop()
        flown_s = stage.now_s
        exit_code = station.end()
        return Flown(
            options=options,
            session=station.session,
            sent=sent,
            exit_code=exit_code,
            flown_s=flown_s,
        )


def false_position_s(
    seen: Sequence[VehicleEstimate], true: Body, apart_m: float, since_s: float, until_s: float
) -> float:
    """For how long a place was used that is more than half of ``apart_m`` from the true one."""
    wrong = 0
    for estimate in seen:
        if since_s <= estimate.t_s <= until_s and estimate.used and estimate.place is not None:
            wrong += math.dist(estimate.place, true.at(estimate.t_s)) > apart_m / 2
    return wrong / 5.0
