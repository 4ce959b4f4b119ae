"""A world whose vehicles and camera move as in an annotated film."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim.annotated.camera_guess import GuessedCamera
from sim.annotated.camera_path import follow_camera, hovering
from sim.annotated.ground_tracks import GroundTrack, ground_motion, ground_tracks
from sim.annotated.tracks import AnnotatedTracks
from sim.errors import AnnotationError
from sim.world.actors import Actors, choose_roles
from sim.world.camera import view_from
from sim.world.error_draws import FlightErrors
from sim.world.motion import time_grid
from sim.world.scenario import Scenario, ScenarioCamera, ScenarioFlight, ScenarioGround
from sim.world.view import Scene
from sim.world.world import LEAD_S, TAIL_S, World, random_stream

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class FilmWorld:
    """World that was made of a film."""

    world: World
    """World of the team alone; the others are seen and report nothing."""
    team: tuple[GroundTrack, ...]
    """In the order of the world's vehicles."""
    labelled: tuple[GroundTrack, ...]
    """All that are labelled and stand on the ground."""

    @property
    def vehicles(self) -> int:
        """How many are labelled and stand on the ground."""
        return len(self.labelled)


def film_world(
    tracks: AnnotatedTracks,
    t: FloatArray,
    camera: GuessedCamera,
    size: tuple[int, int],
    motions: Sequence[FloatArray | None] | None,
    errors: FlightErrors,
    *,
    team: int,
    chosen: Sequence[int] = (),
    seed: int = 1,
) -> FilmWorld:
    """Put the film's vehicles on the ground and its camera above them.

    Args:
        tracks: labels.
        t: (T,) seconds of the images, the first at 0.
        size: width and height of the images, px.
        motions: T homographies from the image before, None where unknown; None for a camera that stands still.
        team: how many vehicles are ours: the longest seen of those that move, then of the others.
        chosen: numbers of vehicles in the label file that are ours instead.

    Raises:
        AnnotationError: no such vehicle, or none at all.
    """
    scenario = _scenario(camera, size, t, errors, seed, vehicles=max(1, len(chosen) or team))
    flight = hovering(scenario, t) if motions is None else follow_camera(scenario, t, motions)
    views = {frame: view_from(scenario, flight.at(t[frame])) for frame in np.unique(tracks.frame).tolist()}
    found = ground_tracks(tracks, t, views)
    ours = _chosen(found, chosen) if chosen else _longest_seen(found, team)
    if not ours:
        raise AnnotationError("not one labelled vehicle stands on the ground; is --pitch right?")
    scenario = _scenario(camera, size, t, errors, seed, vehicles=len(ours))
    motion = ground_motion(ours, time_grid(-LEAD_S, scenario.duration_s + TAIL_S))
    actors = Actors(roles=choose_roles(scenario, random_stream(scenario, "cast")), motion=motion, scene=Scene())
    return FilmWorld(world=World(scenario, actors=actors, flight=flight), team=tuple(ours), labelled=tuple(found))


def _scenario(
    camera: GuessedCamera, size: tuple[int, int], t: FloatArray, errors: FlightErrors, seed: int, vehicles: int
) -> Scenario:
    step_s = float(np.median(np.diff(t))) if len(t) > 1 else 1.0
    return Scenario(
        name="film",
        seed=seed,
        duration_s=float(t[-1]) + step_s,
        fps=1.0 / step_s,
        ground=ScenarioGround(vehicles=vehicles),
        flight=ScenarioFlight(height_m=camera.height_m),
        camera=ScenarioCamera(
            width=size[0],
            height=size[1],
            fx=camera.focal_px,
            fy=camera.focal_px,
            cx=0.5 * size[0],
            cy=0.5 * size[1],
            # the attitude is the camera's own: what its pixels show of its turns is all that is known
            mount="fixed",
            pitch_deg=camera.pitch_deg,
        ),
        gnss=errors.gnss,
        attitude=errors.attitude,
        timing=errors.timing,
    )


def _longest_seen(tracks: list[GroundTrack], team: int) -> list[GroundTrack]:
    order = sorted(tracks, key=lambda track: (not track.moved, -len(track.frames), track.track))
    return sorted(order[:team], key=lambda track: track.track)


def _chosen(tracks: list[GroundTrack], chosen: Sequence[int]) -> list[GroundTrack]:
    known = {track.track: track for track in tracks}
    missing = [number for number in chosen if number not in known]
    if missing:
        raise AnnotationError(
            f"vehicle {missing[0]} has no label that can be used; there are {', '.join(map(str, sorted(known)[:20]))}"
            + (" …" if len(known) > 20 else "")
        )
    return [known[number] for number in dict.fromkeys(chosen)]
