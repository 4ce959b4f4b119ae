"""Progress of long work: one bar on a terminal, a line now and then where stderr is a file or a pipe."""

from __future__ import annotations

import contextlib
import os
import sys
import time
from collections.abc import Callable, Iterator

from gcs.cli.output.console import print_note

Report = Callable[[int, int], None]
"""Callback for progress: how much is done, and of how much."""

_BAR_STEPS = 500
"""A bar moves in steps of this share of the work: drawing costs the work nothing."""
LINE_STEP_PERCENT = 10
"""Share of the work after which a line is printed, per cent."""
LINE_PAUSE_S = 5.0
"""Least time between two lines, s, so that short work prints none."""


@contextlib.contextmanager
def progress(
    work: str, clock_s: Callable[[], float] = time.monotonic, words: Callable[[], str] | None = None
) -> Iterator[Report]:
    """Show on stderr how far a piece of work is, until the block ends.

    Args:
        work: what is done, in a word or two.
        clock_s: seconds that go by.
        words: more about how far it is, in place of how much is done and of how much.

    Yields:
        a function to be called with how much is done, and of how much, as often as one likes.
    """
    if sys.stderr.isatty() and os.environ.get("TERM", "dumb") != "dumb":
        with _bar(work, words or (lambda: "")) as report:
            yield report
    else:
        yield _lines(work, clock_s, words)


@contextlib.contextmanager
def _bar(work: str, words: Callable[[], str]) -> Iterator[Report]:
    from rich import progress as bars
    from rich.console import Console

    columns = (
        bars.TextColumn("{task.description}", markup=False),
        bars.BarColumn(),
        bars.TaskProgressColumn(),
        bars.TimeRemainingColumn(),
        bars.TextColumn("{task.fields[words]}", markup=False),
    )
    # not sys.stderr: what is written there is made plain; what others write there meanwhile goes above the bar
    terminal = Console(file=sys.__stderr__)
    with bars.Progress(*columns, console=terminal, transient=True, redirect_stdout=False) as shown:
        task = shown.add_task(work, total=None, words="")
        drawn = -1

        def report(done: int, total: int) -> None:
            nonlocal drawn
            if (step := done * _BAR_STEPS // max(total, 1)) != drawn:
                drawn = step
                shown.update(task, completed=done, total=total, words=words())

        yield report


def _lines(work: str, clock_s: Callable[[], float], words: Callable[[], str] | None) -> Report:
    printed_percent, printed_s = 0, clock_s()

    def report(done: int, total: int) -> None:
        nonlocal printed_percent, printed_s
        percent = 100 * done // max(total, 1)
        if percent >= printed_percent + LINE_STEP_PERCENT and clock_s() >= printed_s + LINE_PAUSE_S:
            printed_percent, printed_s = percent - percent % LINE_STEP_PERCENT, clock_s()
            print_note(f"{work}: {percent} % ({words() if words else f'{done} of {total}'})")

    return report
