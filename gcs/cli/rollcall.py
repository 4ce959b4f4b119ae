"""The roll call, printed: at the end of flights and of identifications."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from gcs.certainty import certainty
from gcs.cli.output.console import print_lines
from gcs.cli.output.tables import print_sentences, print_table
from gcs.report.rollcall import RollCall, RollCallRow

_COLUMNS = ("id", "name", "first named", "boxes", "of frames in view", "confidence", "remark")


def print_rollcall(calls: RollCall) -> None:
    """The roll call to read: one line a vehicle, and the sums."""
    print_table(_COLUMNS, map(_cells, calls.rows()), right=("id", *_COLUMNS[2:6]), noted="name")
    skipped = f"; {calls.skipped}" if calls.skipped else ""
    print_sentences(
        f"{calls.named} of {len(calls.rows())} vehicles named; {calls.boxes} boxes in {calls.frames} frames, "
        f"{calls.unnamed} unnamed; {calls.span_s:.1f} s{skipped}"
    )
    print_lines(calls.reports)
    for view in calls.other_views:
        print_lines(f"seen from {view.uav_name}:")
        print_rollcall(view)


def rollcall_json(calls: RollCall) -> dict[str, Any]:
    """The roll call for programs."""
    return {
        "named": calls.named,
        "frames": calls.frames,
        "skipped_frames": calls.skipped_frames,
        "boxes": calls.boxes,
        "unnamed": calls.unnamed,
        "span_s": calls.span_s,
        **asdict(calls.alarms),
        "marks": calls.marks,
        "vehicles": [asdict(row) for row in calls.rows()],
        "other_views": [rollcall_json(view) for view in calls.other_views],
    }


def _cells(row: RollCallRow) -> tuple[str, ...]:
    if not row.boxes:
        return str(row.system_id), row.name, "", "", "", "", row.remark
    return (
        str(row.system_id),
        row.name,
        row.first_named,
        str(row.boxes),
        f"{row.share:.1%}" if row.frames_in_view else "-",
        certainty(row.confidence),
        row.remark,
    )
