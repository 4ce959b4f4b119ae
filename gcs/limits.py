"""Limits of the alarms about vehicles: the mission file's ``[limits]``."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from msgspec import Meta

Share = Annotated[float, Meta(ge=0.0, le=1.0)]


@dataclass(frozen=True, slots=True, kw_only=True)
class Limits:
    """Limits at which alarms are raised; 0 switches an alarm off, and so does 1 for the loss."""

    battery_share: Share = 0.25
    """Charge left, 0..1: a warning below, an alarm below half of it. A quarter is what brings a vehicle home that
    turned back in the middle."""
    battery_v: Annotated[float, Meta(ge=0.0, le=1000.0)] = 0.0
    """Volts: an alarm below. 0, since it depends on the number of cells."""
    satellites: Annotated[int, Meta(ge=0, le=100)] = 6
    """Number of satellites in use below which there is a warning. With fewer autopilots do not begin to use their
    receiver."""
    hdop: Annotated[float, Meta(ge=0.0, le=100.0)] = 2.5
    """Horizontal dilution of precision: a warning above, for the same reason."""
    loss: Share = 0.1
    """Share of packets lost: a warning above, an alarm above 0.5."""
    separation_m: Annotated[float, Meta(ge=0.0, le=10_000.0)] = 0.0
    """Horizontal distance between two ground vehicles: an alarm below. 0, since formations drive at any distance."""
