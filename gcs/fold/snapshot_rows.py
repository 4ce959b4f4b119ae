"""Rows of the snapshot for what a frame shows: boxes with their names, vehicles with their standing."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from assoc.geometry.ground import OFFSET, PITCH, YAW
from assoc.identification.identifier import Identifier
from assoc.records import Identities
from gcs.certainty import CONFIRMED
from gcs.fold.candidates import doubt_words
from gcs.fold.turn import Look
from gcs.mission.mission import Mission
from gcs.snapshot import NAN, Box, Candidate, Health, Snapshot, Standing, VehicleRow
from mavlink.geodesy import LocalFrame
from mavlink.state import FleetState, VehicleStatus
from vision.camera.camera import ground
from vision.detect.detections import Detections
from vision.track.tracks import Tracks

FloatArray = NDArray[np.float64]
EVIDENCE = (
    *("system_id", "runner_up"),
    *("confidence", "runner_up_confidence", "residual_m", "position_age_s"),
    *("projection", "topology", "fused"),
)
OF_STATUS = tuple(each.name for each in fields(VehicleStatus))


def boxes_of(
    look: Look,
    identities: Identities | None,
    origin: LocalFrame | None,
    *,
    candidates: Sequence[tuple[Candidate, ...]],
    named_since: Callable[[int, int], int],
    stated: Mapping[int, int],
    number_of: Callable[[int], int],
    score: float,
) -> tuple[Box, ...]:
    """Boxes of a look: those that tracks took, with their names, then strong ones that no track took.

    Where the boxes of a vehicle's front and rear were put together its track has the one, and the other has its name.

    Args:
        look: The detector's, whose boxes these are.
        identities: In the order of its tracks, None without a camera pose.
        origin: Of the local frame, None unknown.
        candidates: Who each track may be, in the order of the identities.
        named_since: Since when a track has had the name of a system id, or 0 for none.
        stated: The system id, or 0 for none of ours, that the operator stated, by track.
        number_of: The number of what a track is, the same for all cameras; 0 of a flight with one.
        score: Weaker boxes that no track took are not shown.
    """
    places = _places(look.detections)
    # the last entry answers for -1, unseen
    taken, others = (np.append(of, -1)[look.tracks.detection] for of in (look.joined.first, look.joined.second))
    rows = _tracked(look.tracks, taken.tolist(), places, identities)
    for row in rows:
        name = row.get("system_id", 0)
        row["since_us"] = named_since(row["track_id"], name)
        row["number"] = number_of(row["track_id"])
        row["stated"] = stated.get(row["track_id"]) == name
    for row, found in zip(rows, candidates, strict=False):
        row["candidates"] = found
    rows += [
        rows[k] | places[other] | {"track_id": 0, "number": 0} for k, other in enumerate(others.tolist()) if other >= 0
    ]
    untracked = sorted(
        set(np.flatnonzero(look.detections.score >= score).tolist()) - {*taken.tolist(), *others.tolist()}
    )
    rows += [places[k] | {"track_id": 0} for k in untracked]
    if (view := look.view) is not None and rows:
        centre = np.array([[row["cx"], row["cy"]] for row in rows])
        level = ground(view.intrinsics, view.pose, centre, view.ground_z)
        p_enu = view.ground.below_level(level, view.pose.p_enu)
        nowhere = np.full(len(rows), np.nan)
        lat, lon, _ = origin.to_geodetic(p_enu) if origin else (nowhere, nowhere, nowhere)
        columns = (p_enu, lat.tolist(), lon.tolist(), view.place_std_m(p_enu).tolist())
        for row, p, lat_deg, lon_deg, std_m in zip(rows, *columns, strict=True):
            uv = look.uv.get(row.get("system_id", 0))
            residual_px = NAN if uv is None else math.hypot(row["cx"] - uv[0], row["cy"] - uv[1])
            row |= {
                "p_enu": p,
                "place_std_m": std_m,
                "lat_deg": lat_deg,
                "lon_deg": lon_deg,
                "residual_px": residual_px,
            }
    return tuple(Box(**row) for row in rows)


def _rows(source: Detections | Tracks | Identities, names: tuple[str, ...]) -> list[dict[str, Any]]:
    """Arrays of equal length as one dictionary a row."""
    columns = [getattr(source, name).tolist() for name in names]
    return [dict(zip(names, values, strict=True)) for values in zip(*columns, strict=True)]


def _places(source: Detections | Tracks) -> list[dict[str, Any]]:
    return _rows(source, ("cx", "cy", "w", "h", "angle", "heading", "score"))


def _tracked(
    tracks: Tracks, seen: list[int], detected: list[dict[str, Any]], identities: Identities | None
) -> list[dict[str, Any]]:
    """Boxes of the tracks: as detected in this frame, or as predicted when coasting; with names and evidence.

    Args:
        tracks: After the frame.
        seen: The row that each took among those that were detected, −1 none.
        detected: The frame's boxes.
        identities: In the order of the tracks, None without a camera pose.
    """
    predicted = _places(tracks) if min(seen, default=0) < 0 else []
    places = [detected[at] if at >= 0 else predicted[k] for k, at in enumerate(seen)]
    state, looked_for = _rows(tracks, ("track_id", "heading")), (tracks.missed_s > 0.0).tolist()
    rows = [
        place | own | {"coasting": at < 0, "in_turn": at < 0 and not missed}
        for place, own, at, missed in zip(places, state, seen, looked_for, strict=True)
    ]
    if identities is not None:
        evidence, none = _rows(identities, EVIDENCE), identities.candidates.none_of_ours.tolist()
        doubts = doubt_words(identities)
        rows = [
            row | known | {"none_of_ours": p, "doubt": doubt}
            for row, known, p, doubt in zip(rows, evidence, none, doubts, strict=True)
        ]
    return rows


def vehicle_rows(
    mission: Mission,
    state: FleetState,
    boxes: tuple[Box, ...],
    expected_px: Mapping[int, tuple[float, float]] | None,
    size: tuple[int, int],
    *,
    suspected: Collection[int] = (),
) -> tuple[VehicleRow, ...]:
    """The fleet table, UAV first.

    Args:
        mission: Who flies.
        state: The fleet now.
        boxes: Of the last frame that was looked at, while they are held.
        expected_px: Where the vehicles' reports put them in the image plane, by system id; those behind the camera are
            not in it. None when the camera's pose is unknown.
        size: Width and height of the image, px.
        suspected: Vehicles whose positions contradict the video now: without a box nobody knows where they are, nor
            where those are that doubt their own positions.

    Returns:
        Their rows, which have no standing yet.
    """
    by_name = {box.system_id: box for box in reversed(boxes) if box.system_id}
    rows = []
    for k, status in enumerate(state.vehicles):
        is_uav = k == 0
        box = None if is_uav else by_name.get(status.system_id)
        uv = (expected_px or {}).get(status.system_id)
        unseen = is_uav or expected_px is None or not state.valid[k - 1]
        lies = box is None and (status.system_id in suspected or bool(status.doubted_for))
        in_view = None if unseen or lies else uv is not None and _inside(uv, size)
        rows.append(
            VehicleRow(
                **{name: getattr(status, name) for name in OF_STATUS},
                name=mission.name_of(status.system_id),
                role="uav" if is_uav else "ugv",
                p_enu=state.uav.p_enu if is_uav else state.p_enu[k - 1],
                heading=state.uav.yaw if is_uav else float(state.heading[k - 1]),
                std_m=float("nan") if is_uav else float(state.std_m[k - 1]),
                in_view=in_view,
                expected_px=uv,
                track_id=box.track_id if box else 0,
                confidence=box.confidence if box else float("nan"),
                stated=box is not None and box.stated,
            )
        )
    return tuple(rows)


def with_standings(
    snapshot: Snapshot, doubted: Collection[int], standing_since: Callable[[int, Standing], int], *, lapsed: bool
) -> tuple[VehicleRow, ...]:
    """The fleet table with the standing of each vehicle.

    Args:
        snapshot: With rows without standings.
        doubted: Vehicles on whose names nobody is to act, by its alarms.
        standing_since: Since when a vehicle has had a standing.
        lapsed: The last frame came so long ago that nothing is known of what the camera sees.
    """
    by_name = {box.system_id: box for box in reversed(snapshot.boxes) if box.system_id}
    rows = []
    for row in snapshot.vehicles:
        standing = standing_of(row, by_name.get(row.system_id), snapshot.conflicts, doubted, lapsed=lapsed)
        since_us = standing_since(row.system_id, standing)
        rows.append(replace(row, standing=standing, standing_since_us=since_us))
    return tuple(rows)


def _inside(uv: tuple[float, float], size: tuple[int, int]) -> bool:
    return bool(0 <= uv[0] < size[0] and 0 <= uv[1] < size[1])


def standing_of(
    row: VehicleRow, box: Box | None, conflicts: Collection[int], doubted: Collection[int], *, lapsed: bool
) -> Standing:
    """Standing of a vehicle: how sure the box with its name is, or why no box has it.

    Args:
        row: its own.
        box: The one with its name, None without one.
        conflicts: Vehicles whose reports contradict the video or one another.
        doubted: Vehicles on whose names nobody is to act: they are not confirmed.
        lapsed: The last frame came so long ago that nothing is known of what the camera sees.
    """
    if box is not None:
        if box.coasting and not box.in_turn:
            return "coasting"
        sure = box.confidence >= CONFIRMED and row.system_id not in doubted
        return "confirmed" if sure else "tentative"
    if row.position_state in ("never", "lost", "refused", "contested"):
        return "no position"
    if row.system_id in conflicts or (row.doubted_for and row.role == "ugv"):
        return "misplaced"
    if row.in_view is False:
        return "out of view"
    return "no new frame" if lapsed else "unidentified"


def with_camera_errors(
    health: Health, identifier: Identifier, offset_s: float, *, looked_share: float, guessed: bool, differ: str = ""
) -> Health:
    """Health with the estimated errors of the camera's clock, heading and pitch, and whether it is mirrored.

    Args:
        health: How the program is doing.
        identifier: Knows the errors.
        offset_s: By how much the mission declares the video's clock to be ahead of telemetry's.
        looked_share: Share of the picture that was looked at.
        guessed: Whether which way the camera looks is a guess, so that nothing follows from a film that does not fit.
        differ: What another camera names differently.
    """
    theta, std = identifier.pose_correction, identifier.pose_correction_std
    return replace(
        health,
        time_offset_s=offset_s + float(theta[OFFSET]),
        time_offset_std_s=float(std[OFFSET]),
        yaw_offset=float(theta[YAW]) if np.isfinite(std[YAW]) else math.nan,
        yaw_offset_std=float(std[YAW]),
        pitch_offset=float(theta[PITCH]),
        pitch_offset_std=float(std[PITCH]),
        mirrored=identifier.mirrored,
        looked_share=looked_share,
        views_differ=differ,
        fit=math.nan if guessed else identifier.fit_probability,
    )
