"""The identity pane: why the selected vehicle is, or is not, the box that carries its name."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from typing import ClassVar, Final

from textual.strip import Strip

from gcs.report.overlay import named_count
from gcs.snapshot import Box, Snapshot, Standing, VehicleRow
from gcs.tui.draw.format import age, degrees, metres, number, percent, plain, position, standing_word, sure
from gcs.tui.draw.strips import Part, bar, line
from gcs.tui.palette import (
    ACCENT,
    ALARM,
    BRIGHT,
    FAINT,
    HEAD,
    INK,
    WARN,
    Rgb,
    ink,
    position_colour,
    standing_colour,
)
from gcs.tui.panes.pane import Pane

__all__ = ["IdentityPane"]

DOUBTS: Final[tuple[Standing, ...]] = ("tentative", "coasting", "unidentified", "out of view", "no position")
Fact = tuple[str, str, Rgb]


class IdentityPane(Pane):
    """Evidence, rivals and position of one vehicle; the fleet in numbers while none is selected."""

    label: ClassVar[str] = "IDENTITY"

    def note(self) -> Sequence[Part]:
        """Whose identity."""
        if self.snapshot is None or not self.selected:
            return ()
        return [(f"{plain(self.snapshot.name_of(self.selected))} ", ink(ACCENT, HEAD, bold=True))]

    def body(self, width: int, height: int) -> list[Strip]:
        """Facts as name and value, the weightiest first, in two columns where there is room."""
        if self.snapshot is None:
            return []
        row = next((row for row in self.snapshot.vehicles if row.system_id == self.selected), None)
        facts = _fleet_facts(self.snapshot) if row is None else _facts(self.snapshot, row)
        half = math.ceil(len(facts) / 2)
        if height >= len(facts) or width < 60:
            return [line(_fact_parts(fact, 12), width) for fact in facts[:height]]
        strips = []
        for index in range(min(half, height)):
            left = line(_fact_parts(facts[index], 12), width // 2)
            right = _fact_parts(facts[half + index], 12) if half + index < len(facts) else []
            strips.append(Strip.join([left, line(right, width - width // 2)]))
        return strips


def _fact_parts(fact: Fact, width: int) -> list[Part]:
    name, value, colour = fact
    return [(f" {name:<{width}}", ink(FAINT)), (value, ink(colour))]


def _fleet_facts(snapshot: Snapshot) -> list[Fact]:
    named, total = named_count(snapshot)
    counts = Counter(row.standing for row in snapshot.vehicles if row.role == "ugv")
    facts: list[Fact] = [("confirmed", f"{named} of {total}", standing_colour("confirmed"))]
    facts += [
        (standing_word(standing), str(counts[standing]), standing_colour(standing))
        for standing in DOUBTS
        if counts[standing]
    ]
    unnamed = sum(not box.system_id for box in snapshot.boxes)
    facts.append(("boxes", f"{len(snapshot.boxes)}, {unnamed} unnamed", INK))
    health = snapshot.health
    if health.time_offset_s:
        facts.append(("video clock", f"{health.time_offset_s:+.2f}{_spread(health.time_offset_std_s, 2)} s", INK))
    if math.isfinite(health.yaw_offset):
        spread = _spread(math.degrees(health.yaw_offset_std), 1)
        facts.append(("camera yaw", f"{math.degrees(health.yaw_offset):+.1f}{spread}°", INK))
    facts.append(("", "↑↓ pick a vehicle", FAINT))
    return facts


def _spread(std: float, digits: int) -> str:
    return f" ±{std:.{digits}f}" if math.isfinite(std) else ""


def _facts(snapshot: Snapshot, row: VehicleRow) -> list[Fact]:
    facts: list[Fact] = []
    if row.role == "ugv":
        words = f"{standing_word(row.standing)} {sure(row.confidence)}".rstrip()
        facts.append(("standing", words, standing_colour(row.standing)))
        box = next((box for box in snapshot.boxes if box.system_id == row.system_id), None)
        facts += _evidence(snapshot, box) if box else [("box", "none in this frame", FAINT)]
    facts += _doubts(row, keyed=bool(snapshot.health.keys))
    where = position(row.position_state, row.position_age_s)
    spread = f" ±{metres(row.std_m)}" if math.isfinite(row.std_m) else ""
    facts.append(("position", where + spread, position_colour(row.position_state)))
    facts.append(("heading", degrees(row.heading), INK))
    armed = {True: "armed", False: "disarmed", None: ""}[row.armed]
    facts.append(("state", " ".join(word for word in (plain(row.mode), armed, plain(row.fix)) if word) or "–", INK))
    facts.append(("heartbeat", f"{age(row.heartbeat_age_s)}  loss {percent(row.loss) or '–'}", INK))
    return facts


def _doubts(row: VehicleRow, *, keyed: bool) -> list[Fact]:
    """Whether its packets come from the vehicle itself, and what of them was rejected."""
    facts: list[Fact] = []
    if row.contested:
        facts.append(("sender", "SEVERAL with this id", ALARM))
    if keyed or row.signed or row.bad_signature:
        colour = INK if row.signs else ALARM if row.bad_signature else WARN if row.unsigned else INK
        held = f"  held {row.held}" if row.held else ""
        facts.append(("signed", f"{row.signed}  unsigned {row.unsigned}  bad {row.bad_signature}{held}", colour))
    for reason, times in sorted(row.refusals.items(), key=lambda item: -item[1])[:4]:
        facts.append(("refused", f"{times} {plain(reason)}", WARN))
    return facts


def _evidence(snapshot: Snapshot, box: Box) -> list[Fact]:
    rival = "none" if not box.runner_up else plain(snapshot.name_of(box.runner_up))
    facts: list[Fact] = [
        ("runner-up", f"{rival} {percent(box.runner_up_confidence)}".rstrip(), INK),
        ("residual", f"{number(box.residual_m, 'm')}  {number(box.residual_px, 'px', 0)}", INK),
    ]
    for name, mass in (("projection", box.projection), ("topology", box.topology), ("fused", box.fused)):
        facts.append((name, f"{percent(mass) or '–':>4} {bar(mass, 10)}", BRIGHT if name == "fused" else INK))
    track = f"{box.track_id}" + (" coasting" if box.coasting else "")
    facts.append(("track", track, INK))
    if math.isfinite(box.lat_deg) and math.isfinite(box.lon_deg):
        facts.append(("place", f"{box.lat_deg:.5f} {box.lon_deg:.5f}", INK))
    return facts
