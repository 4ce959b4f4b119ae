"""Rule of an alarm: one entry of the tables in this folder."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

from gcs.snapshot import Snapshot
from mavlink.state import Level

CLEARS_AFTER_S = 3.0
"""Seconds after its last sign until an alarm is over: what is gone for a moment only is not reported twice."""
GROWING_S = 10.0
"""A counter that should not grow counts as growing for this long after it grew: long enough to be seen."""

Subject = TypeVar("Subject")


@dataclass(frozen=True, slots=True, kw_only=True)
class AlarmRule(Generic[Subject]):
    """One alarm that a vehicle, a pair of vehicles, a link or the station may have.

    Its functions take the subject (a row of the fleet table, a pair of rows, a link, the health of the station) and the
    snapshot that it is part of. Either ``condition`` or ``counter`` is given.
    """

    key: str
    """Together with whose alarm it is, the key of the alarm. Rules of one key are levels of one alarm."""
    level: Level
    kind: str
    """Kind of the alarm, as an event's."""
    text: str
    """Text of what is wrong; on the screen after the name of the vehicle or the link."""
    meaning: str
    """Condition that raises it, with the limit, as the operator's page has it."""
    advice: str
    """Advice to the operator."""
    condition: Callable[[Subject, Snapshot], bool] | None = None
    """True if this is wrong now."""
    counter: Callable[[Subject, Snapshot], int] | None = None
    """A count that should not grow: this is wrong for ``GROWING_S`` after it grew."""
    detail: Callable[[Subject, Snapshot], str] | None = None
    """Reason or figure, put after the text."""
    vehicles: Callable[[Subject, Snapshot], Sequence[int]] | None = None
    """System ids of all vehicles that it is about, where it is not one vehicle's."""
    on_and_off: str = ""
    """Text when it keeps coming back; empty: ``again and again`` and the text."""
    each_detail: bool = False
    """True if each detail is an alarm of its own."""
    kept_while: Callable[[Subject, Snapshot], bool] | None = None
    """Condition under which an alarm that was raised before is not over; it raises none."""
    doubts_name: bool = False
    """True if nobody is to act on the vehicle's name meanwhile: it does not count as confirmed."""
    lasts_s: float = 0.0
    """Time for which the condition must last to raise the alarm."""
    clears_after_s: float = CLEARS_AFTER_S
    """Time for which the condition must be gone to end the alarm. 0 where ``condition`` itself holds on after its last
    sign."""
    logged_by: str = ""
    """Module that logs this alarm's events, with addresses or file names that the alarm does not have; empty: its own
    coming and going is logged."""
