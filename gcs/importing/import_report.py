"""Account of what an import found, assumed and left out: in all, and of each of the flight's files."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from types import MappingProxyType
from typing import Any

import numpy as np

from gcs.importing.film import ImportedFilm
from gcs.importing.ground_vehicles import GroundVehicles
from gcs.importing.row_times import gaps
from gcs.importing.timeline import FilmTimes
from gcs.importing.vehicle_log import ImportNotes, PlaceTrack, VehicleLog
from gcs.session.metadata import import_rows

_MOST_GAPS = 100
_CLOCKS = {
    "video": "that of the film",
    "frame": "that of the film: its frames are numbered",
    "utc": "Unix time as it stands in the file",
    "own": "one of its own, of which no date is known",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class SourceAccount:
    """Account of a file."""

    role: str
    """Such as ``uav`` or ``ugv 11``."""
    name: str
    clock: str
    """In words: which clock its times are of, and what shows it."""
    read: tuple[str, ...]
    assumed: tuple[str, ...] = ()
    left_out: Mapping[str, int] = field(default_factory=lambda: MappingProxyType({}))
    """How many records, by reason."""
    spans: Mapping[str, tuple[tuple[float, float], ...]] = field(default_factory=lambda: MappingProxyType({}))
    """From and to which second of the film it tells of whom, without gaps."""

    def table(self) -> dict[str, Any]:
        """For session.toml and for programs."""
        told = {"clock": self.clock, "read": list(self.read), "assumed": list(self.assumed)}
        spans = {whose: [list(span) for span in parts] for whose, parts in self.spans.items()}
        return {"role": self.role, "name": self.name, **told, "left_out": dict(self.left_out), "spans": spans}


@dataclass(frozen=True, slots=True, kw_only=True)
class ImportReport:
    """Account of what was found, assumed and left out."""

    found: tuple[tuple[str, str], ...]
    """Subject and text."""
    assumed: tuple[str, ...]
    sources: tuple[SourceAccount, ...]
    uav_id: int = 0
    ugv_ids: tuple[int, ...] = ()

    @property
    def left_out(self) -> dict[str, int]:
        """How many records, by file and reason."""
        return {f"{each.name}: {reason}": n for each in self.sources for reason, n in each.left_out.items()}

    def table(self) -> dict[str, Any]:
        """For session.toml and for programs."""
        return {
            "found": {subject: text for subject, text in self.found},
            "assumed": list(self.assumed),
            "left_out": self.left_out,
            "sources": [each.table() for each in self.sources],
        }

    def rows(self) -> list[tuple[str, str]]:
        """Account in short."""
        rows = [*self.found, *(("assumed", text) for text in self.assumed)]
        return rows + [("left out", f"{count} of {reason}") for reason, count in self.left_out.items()]

    def explained(self) -> Iterator[tuple[str, str]]:
        """Account file by file."""
        roles = {each.role for each in self.sources}
        for what, text in import_rows(self.table()):
            yield what if what in roles else f"  {what}", text
        assumed = [(each.name, text) for each in self.sources for text in each.assumed]
        told = roles | {text for _, text in assumed} | {f"{name}: {text}" for name, text in assumed}
        yield from ((subject, text) for subject, text in self.found if subject not in told)
        yield from (("assumed", text) for text in self.assumed if text not in told)


def source_accounts(
    film: ImportedFilm, fleet: GroundVehicles, uav: VehicleLog | None, timeline: FilmTimes
) -> tuple[SourceAccount, ...]:
    """Accounts of each file: the film, the UAV's log, those of ground vehicles, and the fleet's."""
    length_s = float(film.elapsed_us[-1]) * 1e-6
    video = SourceAccount(
        role="video",
        name=film.path.name,
        clock=f"its own time stamps, {length_s:.1f} s; begins {_when(timeline.film_us)} UTC by {timeline.said}",
        read=(f"{len(film.elapsed_us)} frames of {_size(film)}",),
        assumed=film.assumed,
        spans={"video": ((0.0, round(length_s, 3)),)},
    )
    accounts = [video]
    if uav is not None:
        accounts.append(_of_log("uav", uav, timeline.uav_shift_us - timeline.film_us))
    for system_id, log in fleet.logs.items():
        accounts.append(_of_log(f"ugv {system_id}", log, -timeline.film_us))
    if fleet.tlog is not None:
        tlog = fleet.tlog
        tracks = {i: track for i, track in tlog.tracks.items() if len(track) and i not in fleet.logs}
        of_each = (f"system {i}: {_against_film(track, -timeline.film_us)}" for i, track in tracks.items())
        notes = ImportNotes(assumed=tlog.assumed, skipped=tlog.skipped)
        account = _account("fleet", tlog.tlog.path.name, tlog.clock, tuple(of_each), notes)
        spans = {f"system {i}": _spans(track, -timeline.film_us) for i, track in tracks.items()}
        accounts.append(replace(account, spans=spans))
    return tuple(accounts)


def _of_log(role: str, log: VehicleLog, shift_us: int) -> SourceAccount:
    read = ", ".join(log.notes.found), _against_film(log.places, shift_us)
    account = _account(role, log.source, log.dated or _CLOCKS[log.clock], read, log.notes)
    return replace(account, spans={role: _spans(log.places, shift_us)})


def _account(role: str, name: str, clock: str, read: tuple[str, ...], notes: ImportNotes) -> SourceAccount:
    return SourceAccount(
        role=role, name=name, clock=clock, read=read, assumed=notes.assumed, left_out=dict(notes.skipped)
    )


def _spans(places: PlaceTrack, shift_us: int) -> tuple[tuple[float, float], ...]:
    """Seconds of the film between gaps, of which only the longest count where there are many."""
    behind, steps = gaps(places.t_us), np.diff(places.t_us)
    behind = np.sort(behind[np.argsort(steps[behind])[-_MOST_GAPS:]])
    t_s = np.round((places.t_us + shift_us) * 1e-6, 3)
    return tuple(zip(t_s[np.r_[0, behind + 1]].tolist(), t_s[np.r_[behind, -1]].tolist(), strict=True))


def _size(film: ImportedFilm) -> str:
    return f"{film.width}×{film.height} px" + (f" ({film.shown_as})" if film.shown_as else "")


def _against_film(places: PlaceTrack, shift_us: int) -> str:
    """Positions beside the film's time."""
    t_s = (places.t_us + shift_us) * 1e-6
    if len(t_s) < 2:
        return f"{len(t_s)} positions"
    steps = np.diff(t_s)
    return (
        f"{len(t_s)} positions from {t_s[0]:+.1f} to {t_s[-1]:+.1f} s of the film, every {np.median(steps):.2f} s, the "
        f"longest gap {steps.max():.1f} s"
    )


def _when(t_us: int) -> str:
    return f"{datetime.fromtimestamp(t_us * 1e-6, UTC):%Y-%m-%d %H:%M:%S}"
