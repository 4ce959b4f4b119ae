"""Boxes without a name that may be vehicles of ours of which nobody knows where they are: in one wording for all."""

from __future__ import annotations

from typing import Final

from gcs.snapshot import Box, Snapshot

__all__ = ["may_be"]

LEAST: Final = 0.1
"""Probability from which it is told: a missing vehicle has a larger share in every box that it may be."""


def may_be(snapshot: Snapshot, box: Box) -> str:
    """``may be Bravo: no position for 27 s``: the likeliest missing vehicle; empty where there is none.

    Args:
        snapshot: what the box is from.
        box: one with a name, and one of which the operator stated that it is none of ours, may be nobody else.
    """
    if box.system_id or box.stated:
        return ""
    missing = [each for each in box.candidates if each.missing and each.confidence >= LEAST]
    likeliest = max(missing, key=lambda each: each.confidence, default=None)
    return f"may be {snapshot.name_of(likeliest.system_id)}: {likeliest.missing}" if likeliest else ""
