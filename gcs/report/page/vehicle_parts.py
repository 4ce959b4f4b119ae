"""What there is to know of each vehicle: when it was named, how surely, why, and how good its own reports were."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from gcs.certainty import certainty
from gcs.report.page.flight_summary import MOST_CHANGES, FlightSummary, VehicleRecord
from gcs.report.page.html import fixed, table, words
from gcs.report.page.timeline import clock

__all__ = ["rollcall_table", "vehicle_parts"]


def rollcall_table(record: FlightSummary) -> str:
    """One line a vehicle."""
    columns = ("vehicle", "id", "first named", "boxes", "of frames in view", "mean confidence", "remark")
    rows = []
    for row in record.rollcall.rows():
        share = min(row.boxes / row.frames_in_view, 1.0) if row.frames_in_view else np.nan
        remark = "" if row.boxes else "in view, never named" if row.frames_in_view else "never in view"
        first = clock(row.first_named_s) if row.boxes else "–"
        rows.append(
            (
                *(row.name, str(row.system_id), first, str(row.boxes), fixed(100 * share, 1, "%")),
                *(certainty(row.confidence) or "–", remark),
            )
        )
    return table(columns, rows, right=columns[1:6], caption="Roll call")


def vehicle_parts(record: FlightSummary) -> str:
    """A part for each vehicle of the mission."""
    return f'<div class="parts">{"".join(_part(record, vehicle) for vehicle in record.vehicles.values())}</div>'


def _part(record: FlightSummary, vehicle: VehicleRecord) -> str:
    rows = [
        ("named first", _moment(record, vehicle.first_us)),
        ("confirmed first", _moment(record, vehicle.sure_us)),
        ("confidence", f"median {_share(np.median, vehicle.confidence)}, least {_share(np.min, vehicle.confidence)}"),
        ("from its box to its report", _metres(vehicle.residual_m)),
        ("who else it might have been", _others(vehicle)),
        ("its name on another track", _changes(record, vehicle)),
        ("GNSS fix", _fixes(vehicle)),
        ("1σ of its position", _metres(vehicle.std_m)),
        ("packets lost", f"median {_percent(np.median, vehicle.loss)}, most {_percent(np.max, vehicle.loss)}"),
        ("longest without a position", _most(vehicle.silent_s, "s")),
    ]
    head = f"<h3>{words(vehicle.name)} <span class='soft'>system id {vehicle.system_id}</span></h3>"
    return f"<article>{head}{table(('what', 'found'), rows, caption=f'What is known of {vehicle.name}')}</article>"


def _moment(record: FlightSummary, t_us: int) -> str:
    return clock((t_us - record.start_us) * 1e-6) if t_us else "never"


def _known(values: NDArray[np.float64]) -> NDArray[np.float64]:
    return values[np.isfinite(values)]


def _share(which: Callable[[NDArray[np.float64]], np.floating], values: NDArray[np.float64]) -> str:
    known = _known(values)
    return (certainty(float(which(known))) if len(known) else "") or "–"


def _percent(which: Callable[[NDArray[np.float64]], np.floating], values: NDArray[np.float64]) -> str:
    known = _known(values)
    return fixed(100 * float(which(known)), 1, "%") if len(known) else "–"


def _metres(values: NDArray[np.float64]) -> str:
    known = _known(values)
    return f"median {fixed(float(np.median(known)), 2, 'm')}, most {_most(values, 'm')}" if len(known) else "–"


def _most(values: NDArray[np.float64], unit: str) -> str:
    known = _known(values)
    return fixed(float(known.max()), 2, unit) if len(known) else "–"


def _others(vehicle: VehicleRecord) -> str:
    return ", ".join(name for name, _ in vehicle.runners_up.most_common(3)) or "nobody"


def _fixes(vehicle: VehicleRecord) -> str:
    whole = sum(vehicle.fixes.values())
    return ", ".join(f"{fix} {100 * count / whole:.0f}%" for fix, count in vehicle.fixes.most_common(4)) or "–"


def _changes(record: FlightSummary, vehicle: VehicleRecord) -> str:
    if not vehicle.changed:
        return "never"
    told = [f"{_moment(record, t_us)} (track {before} to {after})" for t_us, before, after in vehicle.changes]
    more = vehicle.changed - len(told)
    return ", ".join(told[:MOST_CHANGES]) + (f" and {more} more" if more else "")
