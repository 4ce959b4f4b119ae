"""Vehicles whose positions contradict the video, from when that is seen until their reports fit the picture again."""

from __future__ import annotations

import math
from collections.abc import Collection

from assoc.records import Identities
from gcs.certainty import CONFIRMED
from gcs.health.vehicle_alarms import APART_M, APART_S, APART_STDS, FITS_S, FOLLOWED_S, LEFT_S
from mavlink.state import FleetState

FITS = 0.75
"""Share of the distance from which on a vehicle is contradicted: one that is nearer to its box fits."""
FRESH_S = 2.0
"""An older report fits nothing."""
PROVEN_S = 6.0
"""Time after which a vehicle that surely was one box is none of those beside it: wrong names are shorter."""
FEW = 2
"""Most vehicles that report wrong places at once where none fits."""
UNPROVED_S = 1.0
"""Time after which a contradiction that the identifier alone sees counts: a box may be missed meanwhile."""


class Contradictions:
    """Measures how far vehicles are from their boxes, and remembers who was contradicted.

    A name that is lost by it ends nothing: of a vehicle without one it counts how far it reports to be from the box
    that surely was it, also for its end. What the identifier alone takes for a contradiction for a second stands while
    it does so.

    Attributes:
        standing: system ids of vehicles whose reports contradict the video or one another, or did and have not fitted
            since.
        suspected: those, and those whose reports do now, for too short a time yet.
        withheld: those of them that lost their names meanwhile, and do not fit: they get none.
        left: tracks that were never seen together with the box that surely was one of those, and may be it: no
            strangers.
    """

    def __init__(self) -> None:
        self.standing: frozenset[int] = frozenset()
        self.suspected: frozenset[int] = frozenset()
        self.withheld: frozenset[int] = frozenset()
        self.left: frozenset[int] = frozenset()
        self._frame_us = 0
        self._proved: frozenset[int] = frozenset()
        self._lost: frozenset[int] = frozenset()
        """Vehicles that stay contradicted until they fit, and those of them that lost their names."""
        self._apart_us: dict[int, int] = {}
        self._left_us: dict[int, int] = {}
        self._fits_us: dict[int, int] = {}
        self._conflict_us: dict[int, int] = {}
        """Times since which each vehicle is far from its box, far from the one that it was, at its box, and in conflict
        by the identifier."""
        self._cleared: set[int] = set()
        """Vehicles that the identifier suspects, and whose boxes surely were them where they report to be."""
        self._was: dict[int, int] = {}
        """The track that surely was a vehicle when it last was at its box."""
        self._home_us: dict[int, tuple[int, int]] = {}
        """Times since which a vehicle surely was that track, and when last."""
        self._beside: dict[int, dict[int, int]] = {}
        """Tracks that were seen beside that one since the vehicle was accused, and when last: it is none of them while
        they are followed."""

    def update(
        self,
        t_us: int,
        identities: Identities | None,
        state: FleetState,
        seen: Collection[int],
        stated: Collection[int],
    ) -> None:
        """Take in one frame.

        Args:
            t_us: its time.
            identities: as found, None without a camera pose, which begins and ends nothing. A frame behind a gap
                begins nothing.
            state: the fleet then.
            seen: tracks that were detected in it.
            stated: vehicles that the operator has named a box: their names are not withheld.
        """
        followed, self._frame_us = t_us - self._frame_us <= FOLLOWED_S * 1e6, t_us
        if identities is None or not followed:
            self._apart_us, self._left_us, self._conflict_us = {}, {}, {}
        if identities is None:
            self._fits_us = {}
            return
        self._leave_out(state.system_id.tolist())
        std_m = dict(zip(state.system_id.tolist(), state.std_m.tolist(), strict=True))
        limit_m = {vehicle: APART_M + APART_STDS * std_m[vehicle] for vehicle in std_m}
        columns = ("track_id", "system_id", "confidence", "residual_m", "position_age_s")
        fits, apart, moved, sure = set[int](), set[int](), set[int](), dict[int, int]()
        for track, vehicle, confidence, away_m, age_s in zip(
            *(getattr(identities, name).tolist() for name in columns), strict=True
        ):
            # a box that is predicted goes on to fit, and proves nothing else
            if vehicle not in limit_m or not (track in seen or vehicle in self._fits_us):
                continue
            if track in self._beside.get(vehicle, ()) and vehicle not in stated:
                moved.add(vehicle)  # it reports to be where another one's box is, which may be silent
            elif away_m > limit_m[vehicle] and track in seen:
                apart.add(vehicle)
            elif away_m <= FITS * limit_m[vehicle] and age_s < FRESH_S:
                fits.add(vehicle)
                if confidence >= CONFIRMED:
                    sure[vehicle] = track
        left, former_m = self._beside_former(identities, seen, limit_m)
        at_former = {vehicle for vehicle, away_m in former_m.items() if away_m <= limit_m[vehicle]}
        nameless = std_m.keys() - set(identities.system_id.tolist())
        fits |= {vehicle for vehicle in at_former & nameless if former_m[vehicle] <= FITS * limit_m[vehicle]}
        # where most are elsewhere it is the camera that is
        left = left if len(left) <= len(fits) else set()
        # of two that report one place the one that was there before is right
        self._cleared = ((self._cleared | at_former) & set(identities.conflict)) - apart - left
        # where several send in its name none of them is its word
        conflict = set(identities.conflict) - self._cleared - state.contested
        apart, left = apart - state.contested, left - state.contested
        # likewise, and in frames that are far apart the identifier may follow nobody
        conflict = conflict if followed and len(conflict) <= max(len(fits), FEW) else set()
        self._apart_us = _since(self._apart_us, apart, t_us)
        self._left_us = _since(self._left_us, left, t_us)
        self._fits_us = _since(self._fits_us, fits, t_us)
        self._conflict_us = _since(self._conflict_us, conflict, t_us)
        at_home = _lasting(self._fits_us, t_us, FITS_S)
        for vehicle in at_home & sure.keys():
            began_us, last_us = self._home_us.get(vehicle, (t_us, t_us))
            stays = self._was.get(vehicle) == sure[vehicle] and t_us - last_us <= FOLLOWED_S * 1e6
            self._was[vehicle], self._home_us[vehicle] = sure[vehicle], (began_us if stays else t_us, t_us)
        accused = _lasting(self._apart_us, t_us, APART_S) | _lasting(self._left_us, t_us, LEFT_S)
        # without a box that surely was it, it may be another that was taken for it
        accused |= _at_one_place(conflict, state) | (conflict & self._was.keys())
        self._proved = (self._proved - at_home) | accused
        self.standing = self._proved | _lasting(self._conflict_us, t_us, UNPROVED_S)
        self.suspected = self.standing | conflict | apart | left
        self._lost = self._proved & (self._lost | nameless | moved)
        self.withheld = self._lost - fits - set(stated)
        self._note_beside(t_us, set(identities.track_id.tolist()), set(seen))

    def _leave_out(self, fleet: Collection[int]) -> None:
        """Forget vehicles that are none of the fleet any more."""
        self._proved, self._lost = self._proved.intersection(fleet), self._lost.intersection(fleet)
        self._was = {vehicle: track for vehicle, track in self._was.items() if vehicle in fleet}

    def _note_beside(self, t_us: int, tracks: set[int], seen: set[int]) -> None:
        """Take in which tracks are seen beside those that the accused surely were for long."""
        for vehicle in self._proved & self._was.keys():
            began_us, last_us = self._home_us[vehicle]
            if last_us - began_us >= PROVEN_S * 1e6 and self._was[vehicle] in seen:
                self._beside.setdefault(vehicle, {}).update(dict.fromkeys(seen - {self._was[vehicle]}, t_us))
        self._beside = {
            vehicle: {
                track: t_us if track in seen else last_us
                for track, last_us in beside.items()
                if t_us - last_us < FOLLOWED_S * 1e6
            }
            for vehicle, beside in self._beside.items()
            if vehicle in self._proved
        }
        contradicted = self.withheld & self._beside.keys()
        self.left = frozenset[int]().union(*(tracks - self._beside[vehicle].keys() for vehicle in contradicted))

    def _beside_former(
        self, identities: Identities, seen: Collection[int], limit_m: dict[int, float]
    ) -> tuple[set[int], dict[int, float]]:
        """Vehicles beside the boxes that surely were them.

        Returns:
            Those without a name that report to be far from that box, and from all others; how far from that box each
            reports to be, m.
        """
        rows = {track: row for row, track in enumerate(identities.track_id.tolist())}
        named, found = identities.system_id.tolist(), identities.candidates
        taken = set(named)
        # a track that ended, or surely is another vehicle now, tells nothing of the one that it was
        for vehicle, track in list(self._was.items()):
            row = rows.get(track)
            other = row is not None and named[row] not in (0, vehicle) and identities.confidence[row] >= CONFIRMED
            if row is None or other:
                del self._was[vehicle]
            if other:  # the tracker exchanged the two
                self._beside.pop(vehicle, None)
        away_m: dict[int, dict[int, float]] = {}
        for track, row in rows.items():
            if track not in seen:
                continue
            columns = (found.system_id[row].tolist(), found.distance_m[row].tolist(), found.report_age_s[row].tolist())
            for vehicle, distance_m, age_s in zip(*columns, strict=True):
                if age_s < FRESH_S and named[row] in (0, vehicle):
                    away_m.setdefault(vehicle, {})[track] = distance_m
        compared = {v: away_m[v] for v, track in self._was.items() if track in away_m.get(v, {})}
        left = {v for v, away in compared.items() if v not in taken and min(away.values()) > limit_m[v]}
        return left, {v: away[self._was[v]] for v, away in compared.items()}


def _at_one_place(vehicles: Collection[int], state: FleetState) -> set[int]:
    """Return those of some vehicles that report to be where another of them is."""
    place = dict(zip(state.system_id.tolist(), state.p_enu[:, :2].tolist(), strict=True))
    return {
        vehicle
        for vehicle in vehicles
        for other in vehicles
        if vehicle != other and math.dist(place[vehicle], place[other]) < APART_M
    }


def _since(before_us: dict[int, int], vehicles: Collection[int], t_us: int) -> dict[int, int]:
    """Return the time since which each of some vehicles has been among them."""
    return {vehicle: before_us.get(vehicle, t_us) for vehicle in vehicles}


def _lasting(since_us: dict[int, int], t_us: int, least_s: float) -> set[int]:
    return {vehicle for vehicle, began_us in since_us.items() if t_us - began_us >= least_s * 1e6}
