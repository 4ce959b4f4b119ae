"""Vehicles that were heard or not, and why what came in their names was not accepted."""

from __future__ import annotations

import math

from mavlink.state import VehicleStatus


def is_heard(row: VehicleStatus) -> bool:
    """Tell whether any of its packets was accepted so far."""
    condition = row.condition
    ages_s = (
        *(row.heartbeat_age_s, row.position_age_s, condition.power_age_s, condition.receiver_age_s),
        *(condition.radio_age_s, condition.filter_age_s),
    )
    return any(map(math.isfinite, (*ages_s, row.loss))) or bool(row.signed or row.refusals or row.contested)


def refused_because(row: VehicleStatus) -> str:
    """Return why packets or positions of it were not accepted so far, in words; empty where none was refused."""
    if row.contested:
        return "several senders use its system id"
    if not math.isnan(row.held_s):
        return "nothing proves that its packets are new"
    if row.position_state == "refused":
        return row.refused_for or "its positions cannot be right"
    if row.replayed:
        return "a recording of its signed packets is replayed"
    if row.bad_signature:
        return "packets with a wrong signature"
    if row.held:
        return "nothing proves that its packets are new"
    return "unsigned packets" if row.unsigned and not is_heard(row) else ""
