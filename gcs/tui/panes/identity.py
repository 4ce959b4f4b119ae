"""The identity pane: who the picked vehicle or box is, how sure, and what to do.

It also shows since when that is so, what speaks against it, where the vehicle should be, and who else the box may be.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from itertools import islice, zip_longest
from typing import ClassVar, Final, get_args

from textual.reactive import reactive
from textual.strip import Strip

from gcs.certainty import certainty, named
from gcs.health.heard import is_heard
from gcs.health.vehicle_alarms import CONTRADICTED, DOUBTED
from gcs.missing import may_be
from gcs.report.box_shapes import drawable
from gcs.report.overlay import named_count, standing_of, unnamed
from gcs.snapshot import HELD_SHOWN_S, NAMED, Box, Candidate, Snapshot, Standing, VehicleRow
from gcs.tui.draw.condition import Fact, condition_facts
from gcs.tui.draw.format import (
    age,
    as_far_as_known,
    box_as_far_as_known,
    degrees,
    metres,
    name_or_id,
    number,
    percent,
    position_of,
    standing_of_row,
)
from gcs.tui.draw.freshness import UNKNOWN, aged, fix_age_s, spread
from gcs.tui.draw.map_canvas import BOX_MARK, STANDING_MARKS
from gcs.tui.draw.strips import Part, bar, cut_between_words, fitted, folded, line, width_of
from gcs.tui.palette import (
    ACCENT,
    ALARM,
    BRIGHT,
    FAINT,
    HEAD,
    INK,
    WARN,
    count_colour,
    ink,
    level_colour,
    position_colour,
    standing_colour,
)
from gcs.tui.panes.advice import what_to_do
from gcs.tui.panes.alarms import trouble_of, worst_alarm
from gcs.tui.panes.pane import Pane
from gcs.tui.picking import picked_box
from gcs.tui.themes import Colour
from infra.plain_text import plain
from mavlink.state import SILENT_S

STANDINGS: Final[tuple[Standing, ...]] = get_args(Standing)
"""Standings in the order in which they are counted."""
MARGIN = 1
"""Cells kept free at the right."""
MAX_ROWS = 60
NAME_CELLS = 13
"""Width of what is before a fact."""
BAR_CELLS, SHORT_BAR_CELLS = 8, 4
ROOMY_CELLS = 36
"""Width of a candidate's bar: the short one in a pane narrower than the last."""
WITHOUT_NAME: Final[tuple[Standing, ...]] = ("unidentified", "misplaced", "no position", "out of view")
"""Standings of vehicles that no box is while there is a picture, first those that should be in it."""
MAX_WITHOUT_NAME: Final = 6
"""Most vehicles that are listed with the reason; the rest is counted."""
NEVER_HEARD: Final = "never heard"
PLACES: Final = (("upper left", "top", "upper right"), ("left", "", "right"), ("lower left", "bottom", "lower right"))
"""Thirds of the picture, from its top left."""
NONE_OF_OURS: Final = "none of ours"
EVIDENCE: Final = (
    "Masses of the published methods, at most 0.5 s old, for analysts: the name is decided by the confidence alone."
)
FACT_CELLS: Final = 40
"""Widest fact with its age on one row; a narrow pane has it on a second row."""


class IdentityPane(Pane):
    """Candidates and position of what is picked; the fleet in numbers while nothing is."""

    label: ClassVar[str] = "IDENTITY"

    named_for: reactive[Mapping[int, float]] = reactive({}, repaint=False)
    """Share of the time that it could be named for which each vehicle was, 0 for never; without those of which nothing
    is known. Of a flight by its roll call, of a replay over the whole recording."""

    def __init__(self, *, id: str) -> None:
        super().__init__(id=id)
        self._evidence = False

    def watch_named_for(self) -> None:
        """Draw again when more is known."""
        self.redraw()

    def show_evidence(self) -> None:
        """Switch to the view for analysts, or back."""
        self._evidence = not self._evidence
        self.redraw()

    def note(self) -> Sequence[Part]:
        """Title: whose identity it is."""
        if self.snapshot is None or not (self.selected or self.picked_track):
            return ()
        who = plain(self.snapshot.name_of(self.selected)) if self.selected else f"track {self.picked_track}"
        held = f"names {age(self.snapshot.held_s)} old · " if self.snapshot.held_s else ""
        held += "provisional · " if self.snapshot.provisional else ""
        return [(held, ink(WARN, HEAD)), (f"{who} ", ink(ACCENT, HEAD, bold=True))]

    def body(self, width: int, height: int) -> list[Strip]:
        """Candidates in whole lines, then facts as name and value, in two columns where there is room."""
        if self.snapshot is None:
            return []
        if not self.snapshot.analysed:
            return []
        room = width - MARGIN
        # what is analysed lies before a provisional place, and tells nothing of what was until there
        named_for = {} if self.snapshot.provisional else self.named_for
        row = next((row for row in self.snapshot.vehicles if row.system_id == self.selected), None)
        box = box_as_far_as_known(self.snapshot, picked_box(self.snapshot, self.selected, self.picked_track))
        if self._evidence:
            lines, facts = [[(f" {text}", ink(FAINT))] for text in folded(EVIDENCE, room - 2)], _evidence(box)
        elif row is not None and row.role == "ugv":
            lines, facts = _vehicle(self.snapshot, row, box, room), _vehicle_facts(self.snapshot, row, box)
            facts += _named_fact(named_for.get(row.system_id))
        elif row is not None:
            lines, facts = [], _vehicle_facts(self.snapshot, row, None)
        elif self.picked_track:
            lines, facts = _unnamed(self.snapshot, box, room), _box_facts(box) if box else []
        else:
            lines, facts = [], _fleet_facts(self.snapshot, named_for)
        strips = [line(parts, width) for parts in lines[:height]]
        return strips + _columns(facts, width, height - len(strips))

    def rows_wanted(self, width: int) -> int:
        """Rows below the heading that everything would take."""
        return len(self.body(width, MAX_ROWS))


def _columns(facts: Sequence[Fact], width: int, height: int) -> list[Strip]:
    """One column, or two where they do not fit in one and the pane is wide."""
    rows = [parts for fact in facts for parts in _text(fact, width - MARGIN)]
    if height >= len(rows) or width < 60:
        return [line(parts, width) for parts in rows[: max(height, 0)]]
    half, cells = math.ceil(len(facts) / 2), (width // 2, width - width // 2)
    room = cells[0] - NAME_CELLS - 2
    pairs = zip_longest(facts[:half], facts[half:], fillvalue=("", "", FAINT))
    shortened = ([(name, cut_between_words(text, room), colour) for name, text, colour in pair] for pair in pairs)
    return [Strip.join(map(line, map(_fact_parts, pair), cells)) for pair in islice(shortened, max(height, 0))]


def _fact_parts(fact: Fact) -> list[Part]:
    name, value, colour = fact
    return [(f" {name:<{NAME_CELLS}}", ink(FAINT)), (value, ink(colour))]


def _text(fact: Fact, width: int) -> list[list[Part]]:
    """A fact in as many lines as its text needs."""
    name, text, colour = fact
    first, *more = folded(text, max(1, width - NAME_CELLS - 2))
    return [_fact_parts((name, first, colour)), *(_fact_parts(("", each, colour)) for each in more)]


def _since(snapshot: Snapshot, since_us: int) -> str:
    # of a provisional place nothing tells since when: it was worked out from some seconds before on
    return f" for {age((snapshot.now_us - since_us) * 1e-6)}" if since_us and not snapshot.provisional else ""


def _vehicle(snapshot: Snapshot, row: VehicleRow, box: Box | None, width: int) -> list[list[Part]]:
    """Rows of a name: certainty, age, what speaks against it, its place, what to do; then who else its box may be, or
    which box it may be."""
    words = named(as_far_as_known(snapshot, standing_of_row(row)), row.confidence, stated=row.stated)
    since_us = snapshot.frame_us if row.standing == "no new frame" else row.standing_since_us
    lines = _standing(f"{STANDING_MARKS[row.standing]} {words}", row.standing, since_us, snapshot, width)
    if row.elsewhere:
        too = " too" if row.standing in NAMED else ""
        lines += _text(("seen by", f"{', '.join(map(plain, row.elsewhere))}{too}: C shows it", INK), width)
    against, colour = _against(snapshot, row, box)
    lines += _text(("against", against, colour), width)
    lines += _text(("should be", _unless_said(expected_place(snapshot, row), ": ", against), INK), width)
    lines += _text(("do", what_to_do(snapshot, row), INK), width)
    if box is not None:
        return lines + _candidates(snapshot, box, width)
    other = _likeliest_box(snapshot, row.system_id)
    if other is not None:
        name = f"track {other[0].track_id}" if not other[0].system_id else plain(snapshot.name_of(other[0].system_id))
        words = _unless_said(as_far_as_known(snapshot, _in_words(other[1])), ", ", against)
        lines += _text(("likeliest", f"{name}: {words}", INK), width)
    return lines


def _unless_said(text: str, between: str, said: str) -> str:
    """A text without those of its parts that are among those that are said, with semicolons between."""
    return between.join(part for part in text.split(between) if part not in said.split("; "))


def _standing(words: str, standing: Standing, since_us: int, snapshot: Snapshot, width: int) -> list[list[Part]]:
    """Certainty, and since when: on a row of its own where that is too long for one."""
    colour, since = standing_colour(standing), _since(snapshot, since_us)
    if len(words) + len(since) + NAME_CELLS + 2 <= width:
        return [_fact_parts(("standing", words + since, colour))]
    return [_fact_parts(("standing", words, colour)), *([_fact_parts(("", since.strip(), colour))] if since else [])]


def _against(snapshot: Snapshot, row: VehicleRow, box: Box | None) -> tuple[str, Colour]:
    """Reasons against relying on a vehicle's name, the worst first: one may be why there is another."""
    alarms = [each for each in snapshot.alarms if each.system_id == row.system_id and each.kind != "text"]
    alarms.sort(key=lambda each: not each.doubts_name)
    if alarms:
        return plain("; ".join(dict.fromkeys(map(trouble_of, alarms)))), level_colour(alarms[0].level)
    if box is None and not is_heard(row):
        return as_far_as_known(snapshot, NEVER_HEARD), WARN
    if box is None:
        return ("nothing names it now", FAINT) if row.standing not in NAMED else ("nothing", FAINT)
    if doubt := may_be(snapshot, box) or box.doubt:
        return plain(doubt), WARN
    own = next((each.against for each in box.candidates if each.system_id == row.system_id), "")
    return (plain(own), WARN) if own else ("nothing", FAINT)


def _unnamed(snapshot: Snapshot, box: Box | None, width: int) -> list[list[Part]]:
    """A box without a name: since when, and who it may be."""
    if box is None:
        stalled = not snapshot.boxes and snapshot.boxes_age_s > HELD_SHOWN_S
        gone = (
            f"not known: no new frame for {age(snapshot.boxes_age_s)}" if stalled else "gone: no longer in the picture"
        )
        return _text(("standing", gone, FAINT), width)
    standing = standing_of(snapshot, box)
    words = "stated: none of ours" if box.stated else "no name"
    lines = _standing(f"{BOX_MARK} {words}", standing, box.since_us, snapshot, width)
    doubt = may_be(snapshot, box) or box.doubt
    lines += _text(("against", plain(doubt), WARN), width) if doubt else []
    if not box.stated and box.track_id:
        lines += _text(("do", "= states who it is, if you know; else wait", INK), width)
    return lines + _candidates(snapshot, box, width)


def _candidates(snapshot: Snapshot, box: Box, width: int) -> list[list[Part]]:
    """A line a candidate: name, probability, bar, distance, and what speaks against it."""
    if not box.candidates:
        why = "not tracked yet" if not box.track_id else "nothing to compare: the camera's pose is unknown"
        return [] if snapshot.pose != "unknown" and box.track_id else _text(("candidates", why, FAINT), width)
    lines: list[list[Part]] = []
    for candidate in box.candidates:
        own = candidate.system_id == box.system_id
        colour = standing_colour(standing_of(snapshot, box)) if own else INK
        lines += _share(snapshot.name_of(candidate.system_id), candidate, colour, width)
    if math.isfinite(box.none_of_ours):
        lines += _share(NONE_OF_OURS, Candidate(system_id=0, confidence=box.none_of_ours), FAINT, width)
    return lines


def _share(name: str, candidate: Candidate, colour: Colour, width: int) -> list[list[Part]]:
    """Probability in number and bar; what speaks against it behind where there is room, else below."""
    away = metres(candidate.distance_m) if math.isfinite(candidate.distance_m) else ""
    parts: list[Part] = [
        (f" {fitted(name_or_id(plain(name), candidate.system_id, len(NONE_OF_OURS)), len(NONE_OF_OURS))}", ink(colour)),
        (f"{certainty(candidate.confidence):>4} ", ink(colour)),
        (bar(candidate.confidence, BAR_CELLS if width >= ROOMY_CELLS else SHORT_BAR_CELLS), ink(colour)),
        (f" {away:>6}", ink(INK)),
    ]
    if not candidate.against:
        return [parts]
    against = plain(candidate.against)
    room = width - width_of(parts) - 2
    if room >= len(against):
        return [[*parts, (f"  {against}", ink(WARN))]]
    return [parts, *([(f"   {text}", ink(WARN))] for text in folded(against, max(1, width - 4)))]


def _in_words(candidate: Candidate) -> str:
    """Probability, distance and what speaks against it, in one line."""
    away = f"{metres(candidate.distance_m)} away" if math.isfinite(candidate.distance_m) else ""
    return ", ".join(each for each in (certainty(candidate.confidence), away, plain(candidate.against)) if each)


def _likeliest_box(snapshot: Snapshot, system_id: int) -> tuple[Box, Candidate] | None:
    """The box of which the vehicle is the likeliest, as far as it is a candidate of any."""
    found = [(box, each) for box in snapshot.boxes for each in box.candidates if each.system_id == system_id]
    return max(found, key=lambda pair: pair[1].confidence, default=None)


def expected_place(snapshot: Snapshot, row: VehicleRow) -> str:
    """The expected place of a vehicle without a box, by its report, and whether the picture shows that place."""
    if why := _not_known(snapshot, row):
        return f"not known: {why}"
    if row.expected_px is None:
        return "behind the camera: the picture does not show it"
    x, y = row.expected_px
    across = "left" if x < 0 else "right" if x >= snapshot.width else ""
    along = "above" if y < 0 else "below" if y >= snapshot.height else ""
    if across or along:
        away = math.hypot(max(-x, x - snapshot.width, 0.0), max(-y, y - snapshot.height, 0.0))
        side = " and ".join(word for word in (along, across) if word) + " of" * bool(across)
        far = "far " if away > max(snapshot.width, snapshot.height) else ""
        return f"{far}{side} the picture"
    place = "in the middle of the picture"
    column, third = min(int(3 * x / snapshot.width), 2), min(int(3 * y / snapshot.height), 2)
    if (column, third) != (1, 1):
        place = f"in the picture at the {PLACES[third][column]}"
    there = next((box for box in snapshot.boxes if drawable(box) and _covers(box, x, y)), None)
    if there is None:
        return f"{place}, where no box is"
    if there.system_id == row.system_id:
        return "where its box is"
    return f"{place}, where {snapshot.name_of(there.system_id) if there.system_id else f'track {there.track_id}'} is"


def _not_known(snapshot: Snapshot, row: VehicleRow) -> str:
    """Reason why nobody knows where the picture should show a vehicle, empty for none."""
    if row.position_state not in ("ok", "stale"):
        return "it has no usable position" if is_heard(row) else as_far_as_known(snapshot, NEVER_HEARD)
    if row.standing == "no new frame" or snapshot.held_s:  # the vehicle went on, and its box did not
        return "the picture is old"
    if row.system_id in snapshot.conflicts:
        return CONTRADICTED
    if row.doubted_for:
        return DOUBTED
    return "the camera's pose is unknown" if snapshot.pose == "unknown" else ""


def _covers(box: Box, x: float, y: float) -> bool:
    """Tell whether a place is within a box's length of its middle."""
    return math.hypot(box.cx - x, box.cy - y) <= max(box.w, box.h)


def _named_fact(share: float | None) -> list[Fact]:
    """Format for how much of the time it was named so far."""
    return [] if share is None else [("named", f"{percent(share)} of the time" if share else "never yet", INK)]


def _fleet_facts(snapshot: Snapshot, named_for: Mapping[int, float]) -> list[Fact]:
    count, total = named_count(snapshot)
    counts = Counter(
        (row.standing, as_far_as_known(snapshot, standing_of_row(row)))
        for row in snapshot.vehicles
        if row.role == "ugv"
    )
    facts: list[Fact] = [("confirmed", f"{count} of {total}", count_colour(count, total))]
    facts += [
        (word, str(count), standing_colour(standing))
        for (standing, word), count in sorted(counts.items(), key=lambda each: STANDINGS.index(each[0][0]))
        if standing != "confirmed"
    ]
    facts += _without_name(snapshot)
    if named_for:
        facts.append(("ever named", f"{sum(map(bool, named_for.values()))} of {total}", INK))
    unnamed = sum(not box.system_id for box in snapshot.boxes)
    facts.append(("boxes", f"{len(snapshot.boxes)}, {unnamed} unnamed", INK))
    facts.append(("", "↑↓ or / picks a vehicle", FAINT))
    worst = next(iter(snapshot.alarms), None)
    if worst is not None and worst.advice:
        facts.append(("do", f"{plain(worst.text)}: {plain(worst.advice)}", level_colour(worst.level)))
    health = snapshot.health  # for analysts, where there is room
    if health.time_offset_s:
        facts.append(("video clock", f"{health.time_offset_s:+.2f}{_spread(health.time_offset_std_s, 2)} s", INK))
    if math.isfinite(health.yaw_offset):
        spread = _spread(math.degrees(health.yaw_offset_std), 1)
        facts.append(("camera yaw", f"{math.degrees(health.yaw_offset):+.1f}{spread}°", INK))
    return facts


def _without_name(snapshot: Snapshot) -> list[Fact]:
    """Each vehicle that is not named, and why: the worst that is wrong with it, else where it should be."""

    def first(row: VehicleRow) -> tuple[bool, int]:
        return worst_alarm(snapshot, row.system_id) is None, WITHOUT_NAME.index(row.standing)

    rows = [
        row for row in snapshot.vehicles if row.role == "ugv" and row.standing in WITHOUT_NAME and not row.elsewhere
    ]
    facts: list[Fact] = []
    for row in sorted(rows, key=first)[:MAX_WITHOUT_NAME]:
        worst = worst_alarm(snapshot, row.system_id)
        why = plain(trouble_of(worst)) if worst is not None else expected_place(snapshot, row)
        colour = standing_colour(row.standing) if worst is None else level_colour(worst.level)
        facts.append((name_or_id(plain(row.name), row.system_id, NAME_CELLS - 1), why, colour))
    more = len(rows) - len(facts)
    return [*facts, ("", f"and {more} more", FAINT)] if more else facts


def _spread(std: float, digits: int) -> str:
    return f" ±{std:.{digits}f}" if math.isfinite(std) else ""


def _vehicle_facts(snapshot: Snapshot, row: VehicleRow, box: Box | None) -> list[Fact]:
    facts = _doubts(row, keyed=bool(snapshot.health.keys))
    where = position_of(row)
    wide = spread(row.std_m, row.position_age_s)
    known = "" if wide == UNKNOWN else f" ±{wide}"
    facts.append(("position", as_far_as_known(snapshot, where) + known, position_colour(row.position_state)))
    facts += _box_facts(box) if box else []
    facts.append(_dated("heading", degrees(row.heading), row.position_age_s))
    armed = {True: "armed", False: "disarmed", None: ""}[row.armed]
    facts.append(_dated("state", " ".join(word for word in (plain(row.mode), armed) if word), row.heartbeat_age_s))
    facts.append(_dated("GNSS", plain(row.fix), fix_age_s(row)))
    facts += condition_facts(row, snapshot, FACT_CELLS)
    facts.append(_dated("loss", percent(row.loss), row.heartbeat_age_s))
    silent = row.heartbeat_age_s > SILENT_S
    facts.append(("heartbeat", as_far_as_known(snapshot, age(row.heartbeat_age_s)), ALARM if silent else INK))
    # first what is asked most often: the last ones have no room in a small pane
    return sorted(facts, key=lambda fact: fact[0] != "battery")


def _dated(name: str, text: str, age_s: float) -> Fact:
    """Format a fact by its age."""
    return (name, *aged(text or UNKNOWN, INK, age_s, FACT_CELLS))


def _doubts(row: VehicleRow, *, keyed: bool) -> list[Fact]:
    """Tell whether its packets come from the vehicle itself, and what of them was rejected."""
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


def _box_facts(box: Box) -> list[Fact]:
    everywhere = f", {unnamed(box)} in all pictures" if box.number and not box.system_id else ""
    facts: list[Fact] = [("track", f"{box.track_id or '–'}{everywhere}{' coasting' if box.coasting else ''}", INK)]
    if math.isfinite(box.lat_deg) and math.isfinite(box.lon_deg):
        facts.append(("place", f"{box.lat_deg:.5f} {box.lon_deg:.5f}", INK))
    return facts


def _evidence(box: Box | None) -> list[Fact]:
    if box is None:
        return [("", "no box is picked", FAINT)]
    facts: list[Fact] = []
    for name, mass in (("projection", box.projection), ("topology", box.topology), ("fused", box.fused)):
        facts.append((name, f"{percent(mass) or '–':>4} {bar(mass, 10)}", BRIGHT if name == "fused" else INK))
    facts.append(("residual", f"{number(box.residual_m, 'm')}  {number(box.residual_px, 'px', 0)}", INK))
    return facts
