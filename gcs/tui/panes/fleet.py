"""The fleet table: one vehicle per row, what is wrong first, then who it is and how sure; as many columns as fit."""

from __future__ import annotations

import math
import statistics
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, Final

from rich.cells import cell_len
from textual import events
from textual.reactive import reactive
from textual.strip import Strip

from gcs.certainty import named
from gcs.snapshot import NAMED, Snapshot, VehicleRow
from gcs.tui.draw.condition import Cell, battery, from_uav, hdop, radio, satellites
from gcs.tui.draw.format import (
    age,
    as_far_as_known,
    name_or_id,
    number,
    percent,
    position,
    position_of,
    standing_of_row,
)
from gcs.tui.draw.freshness import UNKNOWN, aged, fix_age_s, spread
from gcs.tui.draw.map_canvas import STANDING_MARKS, UAV_MARK
from gcs.tui.draw.strips import Part, fitted, line, split_line, width_of
from gcs.tui.messages import VehiclePicked
from gcs.tui.palette import (
    ACCENT,
    ALARM,
    BRIGHT,
    FAINT,
    HEAD,
    INK,
    PICKED,
    WARN,
    ink,
    level_colour,
    level_tint,
    position_colour,
    standing_colour,
)
from gcs.tui.panes.alarms import worst_alarm
from gcs.tui.panes.pane import Pane
from infra.plain_text import plain
from mavlink.state import SILENT_S, Level
from mavlink.transmit.message_rates import LOSSY

IDENTITY, IDENTITY_CELLS = "IDENTITY", 15
MARKS: Final = {"info": "  ", "warning": " !", "alarm": "!!"}
GUTTER_CELLS: Final = 3
"""Cells before each row: the mark of its worst alarm, and that of the picked row."""
NARROW: Final = 40
"""Narrower tables have a shorter identity and link."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Column:
    """One column of the table."""

    title: str
    width: int
    rank: int
    """Columns of low rank stay when the pane is narrow."""
    cell: Callable[[VehicleRow], Cell]
    """Content while that is fresh."""
    align: str = "left"
    age_s: Callable[[VehicleRow], float] | None = None
    """Age of that, None for what does not age."""

    def aged_cell(self, row: VehicleRow) -> Cell:
        """Content now."""
        text, colour = self.cell(row)
        return (text, colour) if self.age_s is None else aged(text, colour, self.age_s(row), self.width)


def _heartbeat_age_s(row: VehicleRow) -> float:
    return row.heartbeat_age_s


def _position_age_s(row: VehicleRow) -> float:
    return row.position_age_s


def _mode(row: VehicleRow) -> Cell:
    return plain(row.mode) or UNKNOWN, INK


def _armed(row: VehicleRow) -> Cell:
    words: dict[bool | None, Cell] = {True: ("armed", BRIGHT), False: ("safe", INK), None: (UNKNOWN, FAINT)}
    return words[row.armed]


def _fix(row: VehicleRow) -> Cell:
    return plain(row.fix) or UNKNOWN, WARN if row.fix in ("none", "2D") else INK


def _heartbeat(row: VehicleRow) -> Cell:
    if math.isinf(row.heartbeat_age_s):
        return "never", FAINT
    if row.heartbeat_age_s > SILENT_S:
        return position("lost", row.heartbeat_age_s), ALARM
    return age(row.heartbeat_age_s), INK


def _position(row: VehicleRow) -> Cell:
    return position_of(row), position_colour(row.position_state)


def _spread(row: VehicleRow) -> Cell:
    return spread(row.std_m, row.position_age_s), INK


def _view(row: VehicleRow) -> Cell:
    words: dict[bool | None, Cell] = {True: ("in", INK), False: ("out", INK), None: (UNKNOWN, FAINT)}
    return words[row.in_view]


def _link(row: VehicleRow) -> Cell:
    """Format for how long a link is silent, else how much arrives: ``▆ ok``, ``▄ 9%`` lost."""
    if math.isinf(row.heartbeat_age_s):
        return UNKNOWN, FAINT
    if row.heartbeat_age_s > SILENT_S:
        return position("lost", row.heartbeat_age_s), ALARM
    if not math.isfinite(row.loss):
        return f"{BARS[-1]} ok", INK
    bars = BARS[max(0, len(BARS) - 1 - sum(row.loss > limit for limit in LOSSES))]
    return f"{bars} {percent(row.loss) if row.loss >= MIN_LOSS else 'ok'}", WARN if row.loss > LOSSY else INK


def _link_and_position(row: VehicleRow) -> Cell:
    """Format the link, and what is wrong with the position, where that has no column: ``pos 46s`` old."""
    if row.heartbeat_age_s > SILENT_S or row.position_state in ("ok", "never"):
        return _link(row)
    text, colour = _position(row)
    old = row.position_state in ("stale", "lost") and math.isfinite(row.position_age_s)
    return f"{'same' if row.frozen else 'pos'} {age(row.position_age_s)}" if old else text, colour


def _auth(row: VehicleRow) -> Cell:
    """Signing state now; else the worst it did: refused for its signature, or for want of one."""
    if not math.isnan(row.held_s):
        return f"held {age(row.held_s)}", ALARM
    if row.signs:
        return "signed", INK
    if row.bad_signature:
        return f"bad {_many(row.bad_signature)}", ALARM
    if row.unsigned:
        return f"open {_many(row.unsigned)}", WARN
    return aged("signed", INK, row.heartbeat_age_s, AUTH.width) if row.signed else (UNKNOWN, FAINT)


def _refusals(row: VehicleRow) -> Cell:
    """Format the most frequent reason, and the number of all."""
    if not row.refusals:
        return UNKNOWN, FAINT
    reason = max(row.refusals, key=row.refusals.__getitem__)
    return f"{_many(sum(row.refusals.values()))} {plain(reason)}", WARN


def _many(count: int) -> str:
    """Format a count in at most four letters."""
    return str(count) if count < 10_000 else f"{count // 1000}k" if count < 1_000_000 else f"{count // 1_000_000}M"


def _identity(row: VehicleRow) -> Cell:
    """Standing of a vehicle as a mark and a word; of one that another camera shows alone, which one does."""
    if row.elsewhere and row.standing not in NAMED:
        return f"{STANDING_MARKS[row.standing]} in {plain(row.elsewhere[0])}", INK
    words = named(standing_of_row(row), row.confidence, stated=row.stated)
    return f"{STANDING_MARKS[row.standing]} {words}", standing_colour(row.standing)


def _height(row: VehicleRow, snapshot: Snapshot) -> Cell:
    """Format, in the UAV's row, how far above the ground it is, or without a camera above the middle of the fleet."""
    heights = [float(each.p_enu[2]) for each in snapshot.vehicles if each.role == "ugv"]
    below = [snapshot.camera.ground_z] if snapshot.camera is not None else [z for z in heights if math.isfinite(z)]
    up = float(row.p_enu[2]) - statistics.median(below) if below else math.nan
    text = f"{UAV_MARK} {number(up, 'm', 0)} up" if math.isfinite(up) else UNKNOWN
    return aged(text, INK, row.position_age_s, IDENTITY_CELLS)


def _name(row: VehicleRow) -> Cell:
    """Cell with the vehicle's name, the fainter the older what it reports."""
    silent = not row.heartbeat_age_s <= SILENT_S
    return plain(row.name), FAINT if silent else BRIGHT if row.position_state == "ok" else INK


BARS: Final = "▁▂▄▆"
LOSSES: Final = (0.02, 0.10, 0.30)
"""Shares of packets lost from which a link has a bar less; the second is where operators are warned."""
MIN_LOSS: Final = 0.005
"""Least loss that is shown."""
NAME = Column(title="NAME", width=6, rank=0, cell=_name)
POSITION: Final = "POS"
LINK = Column(title="LINK", width=8, rank=1, cell=_link_and_position)
COLUMNS = (
    Column(title="ID", width=3, rank=11, align="right", cell=lambda row: (str(row.system_id), FAINT)),
    NAME,
    Column(title=IDENTITY, width=IDENTITY_CELLS, rank=0, cell=_identity),
    LINK,
    Column(title="TYPE", width=6, rank=12, cell=lambda row: (plain(row.kind) or UNKNOWN, FAINT)),
    Column(title="MODE", width=8, rank=3, cell=_mode, age_s=_heartbeat_age_s),
    Column(title="ARM", width=5, rank=7, cell=_armed, age_s=_heartbeat_age_s),
    Column(title="FIX", width=9, rank=4, cell=_fix, age_s=fix_age_s),
    Column(title="HEART", width=8, rank=5, align="right", cell=_heartbeat),
    Column(title=POSITION, width=8, rank=2, align="right", cell=_position),
    Column(title="±", width=6, rank=8, align="right", cell=_spread, age_s=_position_age_s),
    Column(title="VIEW", width=4, rank=6, cell=_view, age_s=_position_age_s),
    Column(title="TRK", width=4, rank=10, align="right", cell=lambda row: (str(row.track_id or UNKNOWN), FAINT)),
)
BATTERY: Final = "BATT"
AUTH = Column(title="AUTH", width=9, rank=3, cell=_auth)
REFUSED = Column(title="REFUSED", width=14, rank=8, cell=_refusals)


ALWAYS: Final = 1
"""Columns of this rank and below are in every table."""
LEVELS: Final[tuple[Level, ...]] = ("info", "warning", "alarm")
STANDINGS: Final = tuple(STANDING_MARKS)
"""The surest first."""


def condition_columns(snapshot: Snapshot) -> tuple[Column, ...]:
    """Condition columns: each value that is known of any vehicle has one."""
    limits, rows = snapshot.limits, snapshot.vehicles
    columns = (
        Column(
            title=BATTERY,
            width=5,
            rank=1,
            cell=lambda row: battery(row, limits),
            age_s=lambda row: row.condition.power_age_s,
        ),
        Column(title="SATS", width=4, rank=9, cell=lambda row: satellites(row, limits), age_s=fix_age_s),
        Column(title="HDOP", width=4, rank=12, cell=lambda row: hdop(row, limits), age_s=fix_age_s),
        Column(title="RADIO", width=5, rank=13, cell=radio, age_s=lambda row: row.condition.radio_age_s),
        Column(title="FROM UAV", width=11, rank=11, cell=lambda row: from_uav(row, snapshot), age_s=_position_age_s),
    )
    return tuple(
        replace(column, align="right") for column in columns if any(column.cell(row)[0] != UNKNOWN for row in rows)
    )


def columns_for(
    width: int, rows: Sequence[VehicleRow] = (), *, keyed: bool = False, more: Sequence[Column] = ()
) -> tuple[Column, ...]:
    """Columns that fit ``width`` cells, in their order on screen; name, identity, battery and link always.

    Signatures have a column once there are keys or any were seen, refusals once there are any; ``more``: others.
    """
    signing = keyed or any(row.signed or row.bad_signature for row in rows)
    refusing = any(row.refusals for row in rows)
    power = [column for column in more if column.title == BATTERY]
    order = [*COLUMNS[:3], *power, *COLUMNS[3:], *(column for column in more if column not in power)]
    order += [*((AUTH,) if signing else ()), *((REFUSED,) if refusing else ())]
    longest = max((cell_len(plain(row.name)) for row in rows), default=0)
    if width < NARROW or longest > _name_cells(order, width):
        order = [_narrowed(column) for column in order]
    most = max(NAME.width, _name_cells(order, width))
    order = [replace(each, width=min(max(each.width, longest), most)) if each is NAME else each for each in order]
    return _kept(order, width)


def _kept(columns: Sequence[Column], width: int) -> tuple[Column, ...]:
    """Return the columns that fit, in order; what is wrong with a position is shown by its own column, else by the
    link's."""
    kept: list[Column] = []
    room = width - GUTTER_CELLS  # the first column has no gap before it, and the last one a margin behind it
    for column in sorted(columns, key=lambda column: column.rank):
        if column.rank > ALWAYS and room < column.width + 1:
            break
        kept.append(column)
        room -= column.width + 1
    placed = any(column.title == POSITION for column in kept)
    return tuple(
        replace(column, cell=_link) if placed and column is LINK else column for column in columns if column in kept
    )


def _name_cells(columns: Sequence[Column], width: int) -> int:
    """Width left for names beside the other columns that are in every table, each with a gap before it."""
    others = sum(column.width + 1 for column in columns if column.rank <= ALWAYS and column is not NAME)
    return width - GUTTER_CELLS - others


def _narrowed(column: Column) -> Column:
    """Return the columns without what can be left out."""
    if column.title == IDENTITY:
        return replace(
            column,
            width=IDENTITY_CELLS - 1,
            cell=lambda row: (_identity(row)[0].replace(" ", "", 1), _identity(row)[1]),
        )
    if column.title == LINK.title:
        return replace(column, width=4, cell=lambda row: (_link(row)[0].split()[-1], _link(row)[1]))
    return column


def ordered(snapshot: Snapshot, *, by_trouble: bool) -> tuple[VehicleRow, ...]:
    """The fleet's rows, UAV first, or those first that have the worst alarm, then those whose names are least sure."""
    if not by_trouble:
        return snapshot.vehicles

    def trouble(row: VehicleRow) -> tuple[int, int]:
        worst = worst_alarm(snapshot, row.system_id)
        return -LEVELS.index(worst.level if worst else "info"), -STANDINGS.index(row.standing)

    return tuple(sorted(snapshot.vehicles, key=trouble))


def _columns_of(snapshot: Snapshot | None, width: int) -> tuple[Column, ...]:
    if snapshot is None:
        return columns_for(width)
    more, keyed = condition_columns(snapshot), bool(snapshot.health.keys)
    return columns_for(width, snapshot.vehicles, keyed=keyed, more=more)


class FleetPane(Pane):
    """The fleet."""

    label: ClassVar[str] = "FLEET"
    by_trouble: reactive[bool] = reactive(False, repaint=False)
    """True if those with the worst trouble come first."""

    def __init__(self, *, id: str) -> None:
        super().__init__(id=id)
        self._first = 0
        self._laid: tuple[Snapshot | None, int, tuple[Column, ...]] | None = None

    def in_order(self, snapshot: Snapshot) -> tuple[VehicleRow, ...]:
        """All rows as they are on screen, from the top."""
        return ordered(snapshot, by_trouble=self.by_trouble)

    def watch_by_trouble(self) -> None:
        """Go to the top when the order changes."""
        self._first = 0
        self.redraw()

    def heading(self, width: int) -> Strip:
        """Column names are the heading, so that no row is lost."""
        style = ink(ACCENT if self.has_focus else BRIGHT, HEAD, bold=True)
        titles = [fitted(column.title, column.width, column.align) for column in self._columns(width)]
        before = "▌" if self.has_focus else " "
        left = [(before.ljust(GUTTER_CELLS), ink(ACCENT, HEAD)), (" ".join(titles).rstrip() + " ", style)]
        right: list[Part] = [("by trouble ", ink(ACCENT, HEAD))] if self.by_trouble else []
        right += self._more_parts(width - width_of(left) - width_of(right) - 1)
        return split_line(left, right, width, rule=True)

    def _more_parts(self, room: int) -> list[Part]:
        """Number of rows that are not on screen, with the mark of the worst alarm among them."""
        height = self.size.height - 1
        if self.snapshot is None or len(self.snapshot.vehicles) <= height:
            return []
        rows = self.in_order(self.snapshot)
        hidden = [*rows[: self._first], *rows[self._first + height :]]
        worst = (worst_alarm(self.snapshot, row.system_id) for row in hidden)
        level: Level = max((alarm.level for alarm in worst if alarm), key=LEVELS.index, default="info")
        mark = MARKS[level].strip()
        for words in (f"{mark} {len(hidden)} more ".lstrip(), f"{mark}+{len(hidden)} "):
            if len(words) <= room:
                return [(words, ink(level_colour(level) if mark else WARN, HEAD))]
        return []

    def body(self, width: int, height: int) -> list[Strip]:
        """One row per vehicle; scrolled so that the selected one is on screen."""
        if self.snapshot is not None and not self.snapshot.analysed:
            return []
        if self.snapshot is None or not self.snapshot.vehicles:
            return [line([(" no vehicle received yet", ink(FAINT))], width)]
        rows = self.in_order(self.snapshot)
        at = next((index for index, row in enumerate(rows) if row.system_id == self.selected), self._first)
        self._first = max(0, min(max(self._first, at - height + 1), at, len(rows) - height))
        columns, doubted = self._columns(width), self.snapshot.doubted
        shown = rows[self._first : self._first + height]
        return [self._row(row, self.snapshot, columns, width, doubted=row.system_id in doubted) for row in shown]

    def _columns(self, width: int) -> tuple[Column, ...]:
        """Columns of the heading, which are those of the rows."""
        if self._laid is None or self._laid[0] is not self.snapshot or self._laid[1] != width:
            self._laid = self.snapshot, width, _columns_of(self.snapshot, width)
        return self._laid[2]

    def _row(
        self, row: VehicleRow, snapshot: Snapshot, columns: Sequence[Column], width: int, *, doubted: bool
    ) -> Strip:
        picked = bool(self.selected) and row.system_id == self.selected
        held = snapshot.held_s > 0
        worst = worst_alarm(snapshot, row.system_id)
        level: Level = worst.level if worst else "info"
        paper = PICKED if picked else level_tint(level)
        parts: list[Part] = [
            (MARKS[level], ink(level_colour(level), paper, bold=True)),
            ("▸" if picked else " ", ink(ACCENT, paper, bold=True)),
        ]
        for index, column in enumerate(columns):
            aloft = row.role == "uav" and column.title == IDENTITY
            text, colour = _height(row, snapshot) if aloft else column.aged_cell(row)
            text = as_far_as_known(snapshot, text)
            if column.title == IDENTITY and (row.track_id or snapshot.provisional):
                colour = FAINT if held or snapshot.provisional else ALARM if doubted else colour
            if column.title == NAME.title:
                text = name_or_id(text, row.system_id, column.width)
            space = " " if index else ""
            parts.append((space + fitted(text, column.width, column.align), ink(colour, paper, bold=picked)))
        return line(parts, width, paper)

    def on_click(self, event: events.Click) -> None:
        """Pick the vehicle of a row."""
        if self.snapshot is None:
            return
        at = self._first + event.y - 1
        rows = self.in_order(self.snapshot)
        if event.y > 0 and at < len(rows):
            self.post_message(VehiclePicked(rows[at].system_id))
