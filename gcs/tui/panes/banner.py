"""The row below the status: the worst that is wrong, loud until it is acknowledged; always there, so nothing moves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, Literal

from rich.cells import cell_len
from textual.reactive import reactive
from textual.strip import Strip

from gcs.errors import FlightError
from gcs.report.vehicle_names import text_with_sender
from gcs.snapshot import Alarm, Event, Snapshot
from gcs.station import SIMULATION_OVER
from gcs.tui.draw.format import REPORTED_WORDS, age, clock
from gcs.tui.draw.strips import cut_between_words, fitted, line
from gcs.tui.kept_lines import KeptLines, PlainLines
from gcs.tui.palette import ALARM, FAINT, HEAD, PANEL, WARN, ink
from gcs.tui.panes.alarms import ALARMS_UNKNOWN, Seen, is_final, unseen
from infra.plain_text import plain

EVENT_SHOWN_US = 8_000_000
"""For how long an alarm is news, and one of the event log that is in no list of alarms is shown: time to read two
lines."""
HINTS = ("  a: what to do, A: seen ", "  a: what to do ")
"""The first that does not cut the words; the footer has the key, too."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Alert:
    """Alert that the row shows."""

    level: Literal["alarm", "warning", "calm"] = "calm"
    """``alarm`` is loud; ``calm`` is also what was acknowledged."""
    text: str = ""
    at: str = ""
    """Time of day since which it is so, left out where the words take its room; empty for none."""
    more: str = ""
    """Number of others like it: ``(and 2 more)``, never cut; empty for none."""
    hinted: bool = False
    """True if the list of alarms has more about it."""


def error_line(error: BaseException) -> str:
    """One plain line on why the station stopped, or what of a flight that goes on does not work any more."""
    text = plain(str(error)) or type(error).__name__
    return text if isinstance(error, FlightError) else f"station stopped: {text}"


def alert_of(
    snapshot: Snapshot | None,
    events: Sequence[Event],
    seen: Seen,
    *,
    error: BaseException | None = None,
    silent_s: float = 0.0,
    over: bool = False,
) -> Alert:
    """The worst that is wrong.

    Args:
        snapshot: The newest.
        events: The log.
        seen: Acknowledged alarms.
        error: Why the station stopped, or what of it does not work.
        silent_s: For how long a flight has given nothing new, 0 while it does.
        over: Whether the simulated fleet has ended, so that who is silent is no news; the recording goes on.
    """
    if error is not None:
        goes_on = isinstance(error, FlightError)
        return Alert(level="alarm", text=error_line(error) + ("" if goes_on else " — q quits"))
    if silent_s:
        return Alert(level="alarm", text=f"nothing new for {age(float(int(silent_s)))}: the screen shows the past")
    if snapshot is None:
        return Alert()
    fresh = unseen(snapshot.alarms, seen)
    loud = [alarm for alarm in fresh if alarm.level == "alarm"]
    if over and not any(alarm.kind == "recording" for alarm in loud):
        return Alert(text=f"{SIMULATION_OVER} — q quits")
    if loud:
        return _first(loud, snapshot.now_us, level="alarm", hinted=True)
    lately = [event for event in events if 0 <= snapshot.now_us - event.t_us < EVENT_SHOWN_US]
    # what the list of alarms has, or had, is told by it; older recordings have its words alone
    listed = {alarm.text for alarm in snapshot.alarms}
    listed |= {event.text.partition(": ")[2] for event in lately if event.text.startswith("over after ")}
    loose = [event for event in lately if event.level == "alarm" and event.kind != "text" and not event.alarm]
    recent = [event for event in loose if event.text not in listed and not _is_listed(event, snapshot.alarms)]
    if recent:
        counted = any(alarm.level == "alarm" for alarm in snapshot.alarms)
        text = text_with_sender(recent[-1], snapshot.name_of)
        return Alert(level="alarm" if counted else "warning", text=text, at=clock(recent[-1].t_us))
    if fresh:
        return _first(fresh, snapshot.now_us, level="warning", hinted=True)
    if snapshot.alarms:
        return _first(snapshot.alarms, snapshot.now_us, before="seen: ")
    return Alert(text="no alarms" if is_final(snapshot) else ALARMS_UNKNOWN)


def _is_listed(event: Event, alarms: Sequence[Alarm]) -> bool:
    """Tell whether the list has what an event says of a vehicle in its own words: it came then."""
    about = (alarm for alarm in alarms if event.system_id and alarm.system_id == event.system_id)
    return any(abs(alarm.since_us - event.t_us) < EVENT_SHOWN_US for alarm in about)


def _first(
    alarms: Sequence[Alarm],
    now_us: int,
    before: str = "",
    *,
    level: Literal["alarm", "warning", "calm"] = "calm",
    hinted: bool = False,
) -> Alert:
    """The worst alarm; of warnings the newest while it is news, then the newest of the worst.

    A warning that lasts, as that nothing is authenticated, would hide all later ones.
    """
    worst = [each for each in alarms if (each.level, each.doubts_name) == (alarms[0].level, alarms[0].doubts_name)]
    news = [each for each in alarms if each.level == alarms[0].level and now_us - each.since_us < EVENT_SHOWN_US]
    loud = alarms[0].level == "alarm"
    shown = alarms[0] if loud else max(news or worst, key=lambda each: each.since_us)
    return Alert(
        level=level,
        text=f"{before}{REPORTED_WORDS[shown.reported]}{plain(shown.text)}",
        at="" if before else clock(shown.since_us),
        more=f"(and {len(alarms) - 1} more)" if len(alarms) > 1 else "",
        hinted=hinted,
    )


class Banner(KeptLines, PlainLines):
    """One row for the worst."""

    ALLOW_SELECT: ClassVar[bool] = False
    alert: reactive[Alert] = reactive(Alert())

    def render_line(self, y: int) -> Strip:
        """Dark on red while it is an alarm; the marks and words alone are enough."""
        width = self.size.width
        if self.alert.level == "calm":
            text = fitted(_fitting(self.alert, " ", width), width)
            return line([(text, ink(FAINT, HEAD))], width, HEAD)
        loud = self.alert.level == "alarm"
        style, paper = (ink(PANEL, ALARM, bold=True), ALARM) if loud else (ink(WARN, HEAD), HEAD)
        text = _fitting(self.alert, f" {'!!' if loud else '! '} ", width)
        room = width - cell_len(text.rstrip())
        hint = next((hint for hint in HINTS if self.alert.hinted and len(hint) <= room), "")
        return line([(fitted(text, width - len(hint)), style), (hint, style)], width, paper)

    async def on_click(self) -> None:
        """Show all alarms."""
        await self.run_action("app.pane('alarms')")


def _fitting(alert: Alert, before: str, width: int) -> str:
    """The words with the time where there is room for it, cut only where they do not fit without."""
    text, more = plain(alert.text), f" {alert.more}" if alert.more else ""
    dated = f"{before}{alert.at} {text}{more}"
    if alert.at and cell_len(dated) <= width:
        return dated
    return cut_between_words(before + text, width - len(more)) + more
