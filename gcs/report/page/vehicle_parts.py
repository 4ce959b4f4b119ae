"""Parts of the page about each vehicle: when it was named, how surely, why, and how good its own reports were."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Final

from gcs.certainty import certainty
from gcs.report.page.flight_summary import MAX_CHANGES, FlightSummary, Spread, VehicleRecord
from gcs.report.page.html import bar, fixed, table, words
from gcs.report.page.timeline import clock
from gcs.report.rollcall import RollCallRow

_STANDINGS: Final = MappingProxyType({"confirmed": "confirmed", "tentative": "tentative", "never named": "never"})
"""Look of each standing."""


def standing_of(record: FlightSummary, row: RollCallRow) -> str:
    """The best that a vehicle's name was: ``confirmed``, ``tentative`` or ``never named``."""
    if not row.boxes:
        return "never named"
    return "confirmed" if record.vehicles[row.system_id].sure_us else "tentative"


def rollcall_table(record: FlightSummary) -> str:
    """One line a vehicle."""
    columns = (
        *("vehicle", "standing", "mean confidence", "named for", "of frames in view"),
        *("first named", "boxes", "id", "remark"),
    )
    rows = []
    for row in record.rollcall.rows():
        vehicle = record.vehicles[row.system_id]
        held = clock(vehicle.named_us * 1e-6) if row.boxes else "–"
        rows.append(
            (
                *(row.name, standing_of(record, row), certainty(row.confidence) or "–", held),
                *(fixed(100 * row.share, 1, "%"), _first_named(record, row) or "–"),
                *(str(row.boxes), str(row.system_id), row.remark),
            )
        )
    kinds: Mapping[str, Callable[[str], str | None]] = {"standing": _STANDINGS.get, "of frames in view": bar}
    return table(columns, rows, right=columns[2:8], kinds=kinds, caption="Roll call")


def vehicle_parts(record: FlightSummary) -> str:
    """A part for each vehicle of the mission."""
    called = zip(record.vehicles.values(), record.rollcall.rows(), strict=True)
    return f'<div class="parts">{"".join(_part(record, vehicle, row) for vehicle, row in called)}</div>'


def _part(record: FlightSummary, vehicle: VehicleRecord, row: RollCallRow) -> str:
    rows = [
        ("first named", _first_named(record, row) or "never"),
        ("first confirmed", _at(record, vehicle.sure_us) if vehicle.sure_us else "never"),
        ("confidence", _confidence(vehicle.named)),
        ("from its box to its report", _metres(vehicle.residual_m)),
        ("who else it might have been", _others(vehicle)),
        ("its name on another track", _changes(record, vehicle)),
        ("GNSS fix", _fixes(vehicle)),
        ("1σ of its position", _metres(vehicle.std_m)),
        ("packets lost", _percent(vehicle.loss)),
        (
            "longest without a position",
            fixed(row.longest_silence_s, 2, "s") + ", while it stood still" * row.silence_frozen,
        ),
    ]
    head = f"<h3>{words(vehicle.name)} <span class='soft'>system id {vehicle.system_id}</span></h3>"
    return f"<article>{head}{table(('what', 'found'), rows, caption=f'What is known of {vehicle.name}')}</article>"


def _at(record: FlightSummary, t_us: float) -> str:
    return clock((t_us - record.start_us) * 1e-6)


def _first_named(record: FlightSummary, row: RollCallRow) -> str:
    """Time of its first name since the flight began, as everywhere on the page; empty without one."""
    return _at(record, record.rollcall.first_frame_us + row.first_named_s * 1e6) if row.boxes else ""


def _confidence(named: Spread) -> str:
    return f"mean {certainty(named.mean)}, least {certainty(named.least)}" if named.count else "–"


def _metres(values: Spread) -> str:
    return f"mean {fixed(values.mean, 2, 'm')}, most {fixed(values.most, 2, 'm')}" if values.count else "–"


def _percent(values: Spread) -> str:
    return f"mean {fixed(100 * values.mean, 1, '%')}, most {fixed(100 * values.most, 1, '%')}" if values.count else "–"


def _others(vehicle: VehicleRecord) -> str:
    return ", ".join(name for name, _ in vehicle.runners_up.most_common(3)) or "nobody"


def _fixes(vehicle: VehicleRecord) -> str:
    whole = sum(vehicle.fixes.values())
    return ", ".join(f"{fix} {100 * count / whole:.0f}%" for fix, count in vehicle.fixes.most_common(4)) or "–"


def _changes(record: FlightSummary, vehicle: VehicleRecord) -> str:
    if not vehicle.changed:
        return "never"
    told = [f"{_at(record, t_us)} (track {before} to {after})" for t_us, before, after in vehicle.changes]
    more = vehicle.changed - len(told)
    return ", ".join(told[:MAX_CHANGES]) + (f" and {more} more" if more else "")
