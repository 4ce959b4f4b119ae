"""Boxes without a name that may be vehicles of ours of which nobody knows where they are: in one wording for all."""

from __future__ import annotations

from typing import Final

from gcs.snapshot import Box, Snapshot

MIN_CONFIDENCE: Final = 0.1
"""Probability from which it is reported: a missing vehicle has a larger share in every box that it may be."""
ALIKE: Final = 0.05
"""Difference of confidence from the likeliest within which others are named with it: nothing tells them apart."""


def may_be(snapshot: Snapshot, box: Box) -> str:
    """``may be Bravo: no position for 27 s``: the likeliest missing vehicle; empty where there is none.

    Several that are about as likely are named together: ``may be Alpha or Bravo: none of them tells where it is``.

    Args:
        box: one with a name, and one of which the operator stated that it is none of ours, may be nobody else.
    """
    if box.system_id or box.stated:
        return ""
    missing = [each for each in box.candidates if each.missing and each.confidence >= MIN_CONFIDENCE]
    least = max((each.confidence for each in missing), default=0.0) - ALIKE
    alike = [each for each in missing if each.confidence > least]
    if len(alike) < 2:
        return "".join(f"may be {snapshot.name_of(each.system_id)}: {each.missing}" for each in alike)
    *names, last = (snapshot.name_of(system_id) for system_id in sorted(each.system_id for each in alike))
    if 1.0 - box.none_of_ours - sum(each.confidence for each in box.candidates) > least:
        names, last = [*names, last], "another"  # candidates are the likeliest few
    return f"may be {', '.join(names)} or {last}: none of them tells where it is"
