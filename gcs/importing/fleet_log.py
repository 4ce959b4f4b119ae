"""Telemetry logs: who sends in one, where the vehicles were, and each of them as a vehicle's log."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from gcs.errors import ImportFileError
from gcs.importing.checks.plausible import place_words
from gcs.importing.checks.row_times import RowTimes, ascending, check_one_clock, numbered, row_times
from gcs.importing.messages import TlogRecord
from gcs.importing.vehicle_log import M_PER_HDOP, AngleTrack, ImportNotes, PlaceTrack, VehicleLog, in_order
from mavlink.estimation.gimbal import yaw_frame
from mavlink.geodesy import euler_from_quaternion
from mavlink.protocol.modes import is_aircraft, is_ground_vehicle, is_vehicle, kind_name
from mavlink.tlog.clocks import dated_by_senders, sender_clocks
from mavlink.tlog.log import Tlog

_HEARTBEAT, _GPS_RAW, _ATTITUDE, _GLOBAL_POSITION, _GIMBAL = 0, 24, 30, 33, 285
_FIX_3D = 3
_UNKNOWN_MM, _UNKNOWN_DILUTION = 0xFFFFFFFF, 0xFFFF
_UNKNOWN_SPEED = 32767
_UNKNOWN_HEADING = 36000
_MAX_SPEED = 1.25
_STEP_US = 80_000
"""Least step of a recorder's clock that is reported."""
_SAME_STEP_S, _SAME_SHARE, _SAME_STEP_US = 1.0, 0.25, 10_000_000
"""Steps that two vehicles' clocks show are one if they are as large as each other and as close; gains likewise."""
_GAIN, _GAINED_S = 1e-3, 0.1
"""Stamps that gain less on the vehicles' clocks, by second or in all, are those of a good crystal or late."""

Ints = NDArray[np.int64]


@dataclass(frozen=True, slots=True, kw_only=True)
class FleetTlog:
    """A telemetry log, opened."""

    tlog: Tlog
    t_us: Ints
    """(n,) Unix µs of each record, on one clock also where the recorder's was set."""
    autopilots: Mapping[int, int]
    """Component that is the autopilot, by system id: what others of that system report is not where it is."""
    aircraft: tuple[int, ...]
    """System ids by their heartbeats, ascending."""
    ground: tuple[int, ...]
    clock: str
    """Sentence on whose clock ``t_us`` is, and what shows that it is that of the flight."""
    tracks: Mapping[int, PlaceTrack]
    """Places of the vehicles, by system id, by arrival, Unix µs."""
    about_clock: tuple[str, ...] = ()
    """Sentence about the recorder's clock."""
    rivals: Mapping[int, str] = field(default_factory=lambda: MappingProxyType({}))
    """Sentence on another vehicle that has the same id, by system id."""
    judged: Mapping[int, RowTimes] = field(default_factory=lambda: MappingProxyType({}))
    """Times and positions of the vehicles as checked, by system id; rows that are on no path stay in the log."""

    def assumptions(self, without: Collection[int] = ()) -> tuple[str, ...]:
        """Return sentences on what was assumed of the log's clock and of all vehicles but some, with the file's
        name."""
        name = self.tlog.path.name
        of_vehicles = (
            f"{name}, system {i}: {text}"
            for i, judged in self.judged.items()
            if i not in without
            for text in (*judged.assumed, *place_words(self.tracks[i], "utc")[0])
        )
        of_ids = (f"{name}, system {i}: {text}" for i, text in self.rivals.items() if i not in without)
        return (*(f"{name}: {text}" for text in self.about_clock), *of_ids, *of_vehicles)

    def skipped(self, of: Collection[int]) -> dict[str, int]:
        """Count the positions of some vehicles that are on no path, by reason, and damaged bytes."""
        damaged = sum(damage.stop - damage.start for damage in self.tlog.index.damage)
        found = Counter({"damaged bytes": damaged} if damaged else {})
        for system_id in self.judged.keys() & set(of):
            found.update(self.judged[system_id].skipped)
        return dict(found)

    @property
    def system_ids(self) -> frozenset[int]:
        """Ids of all who send."""
        return frozenset(map(int, np.unique(self.tlog.index.system_id)))

    @property
    def unnamed(self) -> tuple[str, ...]:
        """Senders of positions that are neither aircraft nor ground vehicles, in words."""
        rows, _ = self.tlog.columns(_GLOBAL_POSITION)
        reporting = set(np.unique(self.tlog.index.system_id[rows]).tolist())
        return tuple(
            f"system {i}, which reports positions, and in no heartbeat that it drives or flies"
            for i in sorted(reporting.difference(self.aircraft, self.ground))
        )

    def places(self, system_id: int) -> PlaceTrack:
        """Positions of a vehicle by arrival, Unix µs."""
        return self.tracks[system_id]

    def rows(self, message_id: int, system_id: int) -> tuple[Ints, NDArray[np.void]]:
        """Records and columns of what a vehicle's autopilot sends of one kind, in the order of the file."""
        rows, wire = self.tlog.columns(message_id, system_id)
        mine = self.tlog.index.component_id[rows] == self.autopilots.get(system_id, 0)
        return rows[mine], wire[mine]

    def columns(self, message_id: int, system_id: int) -> tuple[Ints, NDArray[np.void]]:
        """Times and columns of the rows of :meth:`rows`."""
        rows, wire = self.rows(message_id, system_id)
        return self.t_us[rows], wire

    def records_of(self, system_id: int) -> Iterator[TlogRecord]:
        """The records of one system, by arrival."""
        rows = self.tlog.select(system_ids=(system_id,))
        packets = zip(self.t_us[rows].tolist(), self.tlog.packets(system_ids=(system_id,)), strict=True)
        return ((t_us, packet.raw) for t_us, packet in sorted(packets, key=lambda each: each[0]))

    def records(self, without: Collection[int]) -> Iterator[TlogRecord]:
        """All records but those of some systems, as they are, in the order of the file."""
        for t_us, packet in zip(self.t_us.tolist(), self.tlog.packets(), strict=True):
            if packet.system_id not in without:
                yield t_us, packet.raw


def open_fleet(path: Path) -> FleetTlog:
    """Open a telemetry log.

    Raises:
        TlogError: it cannot be read as one.
        ImportFileError: its times are not those of the flight.
    """
    tlog = Tlog.open(path)
    t_us, clock, about_clock = _on_one_clock(tlog)
    rows, wire = tlog.columns(_HEARTBEAT)
    senders = zip(tlog.index.system_id[rows].tolist(), tlog.index.component_id[rows].tolist(), strict=True)
    beats = zip(senders, wire["type"].tolist(), wire["autopilot"].tolist(), strict=True)
    heard: dict[int, dict[tuple[int, int], None]] = {}
    """Components and kinds of the vehicles, in the order in which they were first heard, by system id."""
    for (system_id, component_id), kind, autopilot in beats:
        if is_vehicle(kind, autopilot) and (is_aircraft(kind) or is_ground_vehicle(kind)):
            heard.setdefault(system_id, {})[component_id, kind] = None
    first = {system_id: next(iter(vehicles)) for system_id, vehicles in heard.items()}
    autopilots = {system_id: component_id for system_id, (component_id, _) in first.items()}
    kinds = {system_id: kind for system_id, (_, kind) in first.items()}
    fleet = FleetTlog(
        tlog=tlog,
        t_us=t_us,
        autopilots=autopilots,
        clock=clock,
        about_clock=about_clock,
        rivals={i: words for i, vehicles in heard.items() for words in _rivals(vehicles)},
        aircraft=tuple(sorted(i for i, kind in kinds.items() if is_aircraft(kind))),
        ground=tuple(sorted(i for i, kind in kinds.items() if is_ground_vehicle(kind))),
        tracks={},
    )
    return _with_tracks(fleet)


def _rivals(vehicles: Collection[tuple[int, int]]) -> Iterator[str]:
    """Return a sentence on where two vehicles have one system id, by the components and kinds of its heartbeats."""
    component_ids = sorted({component_id for component_id, _ in vehicles})
    kinds = list(dict.fromkeys(kind_name(kind) for _, kind in vehicles))
    first, _ = next(iter(vehicles))
    if len(component_ids) > 1:
        named = " and ".join(map(str, component_ids))
        yield f"components {named} are both its autopilot: two vehicles with one id? component {first} counts"
    elif len(kinds) > 1:
        yield f"its heartbeats are of a {' and of a '.join(kinds)}: two vehicles with one id? it counts as a {kinds[0]}"


def _with_tracks(fleet: FleetTlog) -> FleetTlog:
    """Return the log with the positions of all vehicles.

    Raises:
        ImportFileError: a vehicle's times are of no clock.
    """
    tracks, judged = dict[int, PlaceTrack](), dict[int, RowTimes]()
    for system_id in (*fleet.aircraft, *fleet.ground):
        places, own_us = _track(fleet, system_id)
        if len(places):
            rows, _ = fleet.rows(_GLOBAL_POSITION, system_id)
            places, judged[system_id] = _judged(fleet, system_id, places, rows, own_us)
        tracks[system_id] = places
    return replace(fleet, tracks=tracks, judged=judged)


def _judged(
    fleet: FleetTlog, system_id: int, places: PlaceTrack, rows: Ints, own_us: Ints
) -> tuple[PlaceTrack, RowTimes]:
    """Positions of a vehicle in order of time, and what was made of their times.

    Args:
        rows: (n,) records that they are of.
        own_us: (n,) by the vehicle's own clock.

    Raises:
        ImportFileError: their times are of no clock.
    """
    at = np.column_stack([places.lat_deg, places.lon_deg])
    whose, at_byte = f"{fleet.tlog.path.name}, system {system_id}", numbered("byte", fleet.tlog.index.offset[rows])
    # what is in it twice would be in the session twice
    check_one_clock(places.t_us, whose, at_byte)
    ordered = row_times(places.t_us, at, whose, at_byte, own_us=own_us, shared=True)
    places = replace(places.select(ordered.rows), t_us=ordered.t_us)
    return places.select(np.argsort(places.t_us, kind="stable")), ordered


def _track(fleet: FleetTlog, system_id: int) -> tuple[PlaceTrack, Ints]:
    """Reports of a vehicle, in the order of the file, and their times by its own clock, µs."""
    t_us, wire = fleet.columns(_GLOBAL_POSITION, system_id)
    v = np.column_stack([wire[name].astype(np.float64) for name in ("vx", "vy", "vz")])
    heading = np.radians(wire["hdg"] * 0.01)
    places = PlaceTrack(
        t_us=t_us,
        lat_deg=wire["lat"] * 1e-7,
        lon_deg=wire["lon"] * 1e-7,
        alt_m=wire["alt"] * 1e-3,
        height_m=wire["relative_alt"] * 1e-3,
        v_ned=np.where(np.abs(v) < _UNKNOWN_SPEED, v * 0.01, np.nan),
        heading=np.where(wire["hdg"] <= _UNKNOWN_HEADING, heading, np.nan),
        std_m=float("nan"),
    )
    return places, wire["time_boot_ms"].astype(np.int64) * 1000


def _on_one_clock(tlog: Tlog) -> tuple[Ints, str, tuple[str, ...]]:
    """Times of all records on the recorder's clock as it was for most of them, in words which, and where it was set.

    That it was set is told by the vehicles' own clocks, which went on.

    Raises:
        ImportFileError: the stamps run faster or slower than the vehicles' clocks.
    """
    if tlog.index.time_source == "none":
        return _without_stamps(tlog)
    t_us = tlog.index.t_us.astype(np.int64)
    clocks = sender_clocks(tlog, _STEP_US)
    known = [clock for clock in clocks if np.isfinite(clock.speed)]
    if not known:
        return t_us, "that of the station that recorded it; no vehicle's tells whether it is right", ()
    most = max(known, key=lambda clock: clock.samples)
    if not 1.0 / _MAX_SPEED < most.speed < _MAX_SPEED:
        raise ImportFileError(
            f"{tlog.path}: the vehicles' clocks run {most.speed:.2g} times as fast as the stamps, which are therefore "
            "not the times of the flight; give the log that was recorded in it"
        )
    alone = len({each.system_id for each in known}) == 1
    whose = "the recorder's clock" + f", or that of system {most.system_id}," * alone
    ahead_us, text = np.zeros_like(t_us), list[str]()
    for step in most.steps:
        same = [
            other
            for clock in known
            for other in clock.steps
            if abs(other.by_s - step.by_s) < min(_SAME_STEP_S, _SAME_SHARE * abs(step.by_s))
            and abs(int(t_us[other.row] - t_us[step.row])) < _SAME_STEP_US
        ]
        if len(same) * 2 < len(known):
            continue  # it was that vehicle's clock, which stood still or was started
        # the vehicle that reports first after it tells the place best
        first = min(same, key=lambda other: other.row)
        ahead_us[first.row :] += round(step.by_s * 1e6)
        text.append(f"{whose} was set by {step.by_s:+.2f} s at byte {first.offset}")
    beside = f"the clock of system {most.system_id} runs {most.speed:.4f} times as fast"
    clock = f"that of the station that recorded it: {beside}"
    gains = [each for each in known if abs(each.gain - most.gain) < _SAME_SHARE * abs(most.gain)]
    drifts: tuple[str, ...] = ()
    if abs(most.gain) > _GAIN and abs(most.gained_s) > _GAINED_S and len(gains) * 2 >= len(known):
        run = f"{abs(most.gain):.2%} {'faster' if most.gain > 0.0 else 'slower'}"
        apart = f"they drift apart by {abs(most.gained_s):.2f} s"
        drifts = (f"its stamps run {run} than the vehicles' clocks: {apart}",)
    if not text:
        return t_us, clock, drifts
    values, counts = np.unique(ahead_us, return_counts=True)
    kept_us = values[np.argmax(counts)]
    begins = int(tlog.index.offset[np.argmax(ahead_us == kept_us)])
    words = f"{', '.join(text)}: all times are on the clock that it has from byte {begins} on"
    return t_us - ahead_us + kept_us, clock, (words, *drifts)


def _without_stamps(tlog: Tlog) -> tuple[Ints, str, tuple[str, ...]]:
    """Return the same as ``_on_one_clock`` for a log that a station wrote as it received it, ``.rlog`` or ``.raw``.

    Raises:
        ImportFileError: no vehicle tells the date.
    """
    t_us = dated_by_senders(tlog)
    if not len(t_us):
        told = (tlog.columns("SYSTEM_TIME")[1]["time_unix_usec"] > 0).any()
        why = "the dates of its vehicles (SYSTEM_TIME) step" if told else "no vehicle tells the date (SYSTEM_TIME)"
        raise ImportFileError(
            f"{tlog.path}: its records have no time stamps, and {why}; give the .tlog of the same flight"
        )
    text = "no time stamps in it: times are by the vehicles' own clocks (SYSTEM_TIME)"
    return t_us, "the vehicles' own, by the dates that they tell", (text,)


def read_tlog_vehicles(path: Path) -> list[VehicleLog]:
    """The vehicles that report positions, by system id, on the clock of the station that recorded.

    Raises:
        ImportFileError: nobody reports one.
        TlogError: it is no telemetry log.
    """
    fleet = open_fleet(path)
    logs = [_vehicle_log(path, fleet, system_id) for system_id in sorted((*fleet.aircraft, *fleet.ground))]
    logs = [log for log in logs if len(log.places)]
    if not logs:
        raise ImportFileError(f"{path}: no vehicle reports a position in it")
    return logs


def _vehicle_log(path: Path, fleet: FleetTlog, system_id: int) -> VehicleLog:
    places, what = fleet.places(system_id), "positions"
    if not len(places):
        fleet, what = _with_fixes(fleet, system_id), "fixes of the receiver alone"
        places = fleet.places(system_id)
    attitudes, gimbal = _attitudes(fleet, system_id), _gimbal(fleet, system_id)
    judged = fleet.judged.get(system_id)
    found = (
        f"telemetry log, {len(places)} {what}",
        f"{len(attitudes)} attitudes",
        f"{len(gimbal)} attitudes of the gimbal",
    )
    return VehicleLog(
        source=path.name,
        clock="utc",
        dated=fleet.clock,
        system_id=system_id,
        flies=system_id in fleet.aircraft,
        places=replace(places.select(in_order(places.t_us)), std_m=_std_m(fleet, system_id)),
        attitudes=attitudes,
        gimbal=gimbal,
        notes=ImportNotes(
            found=found[: 3 if len(gimbal) else 2],
            assumed=(
                *fleet.about_clock,
                *filter(None, (fleet.rivals.get(system_id),)),
                *(judged.assumed if judged else ()),
            ),
            skipped=fleet.skipped((system_id,)),
        ),
    )


def _with_fixes(fleet: FleetTlog, system_id: int) -> FleetTlog:
    """Return the log with the positions by GPS_RAW_INT of a vehicle that estimates none.

    Raises:
        ImportFileError: their times are of no clock.
    """
    rows, wire = fleet.rows(_GPS_RAW, system_id)
    fixed = wire["fix_type"] >= _FIX_3D
    lost, rows, wire = int(np.count_nonzero(~fixed)), rows[fixed], wire[fixed]
    if not len(rows):
        return fleet
    t_us, own_us = fleet.t_us[rows], wire["time_usec"].astype(np.int64)
    places = PlaceTrack.of(t_us, wire["lat"] * 1e-7, wire["lon"] * 1e-7, alt_m=wire["alt"] * 1e-3)
    places, judged = _judged(fleet, system_id, places, rows, own_us if (np.diff(own_us) > 0).all() else t_us)
    if lost:
        judged = replace(judged, skipped={**judged.skipped, "times without a fix": lost})
    return replace(fleet, tracks={**fleet.tracks, system_id: places}, judged={**fleet.judged, system_id: judged})


def _std_m(fleet: FleetTlog, system_id: int) -> float:
    """Median of what the receiver estimates, else by its dilution; NaN where it tells neither."""
    _, wire = fleet.columns(_GPS_RAW, system_id)
    wire = wire[wire["fix_type"] >= _FIX_3D]
    known = (wire["h_acc"] > 0) & (wire["h_acc"] < _UNKNOWN_MM)
    if known.any():
        return float(np.median(wire["h_acc"][known])) * 1e-3
    eph = wire["eph"][wire["eph"] < _UNKNOWN_DILUTION]
    return M_PER_HDOP * float(np.median(eph)) * 0.01 if len(eph) else float("nan")


def _attitudes(fleet: FleetTlog, system_id: int) -> AngleTrack:
    t_us, wire = fleet.columns(_ATTITUDE, system_id)
    order = ascending(t_us)
    angles = np.column_stack([wire[name].astype(float) for name in ("roll", "pitch", "yaw")])
    return AngleTrack(t_us=t_us[order], angles=angles[order])


def _gimbal(fleet: FleetTlog, system_id: int) -> AngleTrack:
    """Gimbal attitudes by GIMBAL_DEVICE_ATTITUDE_STATUS, in the frame of its first report."""
    rows, wire = fleet.tlog.columns(_GIMBAL, system_id)
    if not len(rows):
        return AngleTrack.empty()
    t_us = fleet.t_us[rows]
    order = ascending(t_us)
    angles = np.array([euler_from_quaternion(*q) for q in wire["q"][order].astype(float).tolist()]).reshape(-1, 3)
    earth = yaw_frame(int(wire["flags"][0])) == "earth"
    return AngleTrack(t_us=t_us[order], angles=angles, yaw_from="north" if earth else "nose")
