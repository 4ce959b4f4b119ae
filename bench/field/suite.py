"""Sessions of the families, played in worker processes."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Sequence
from concurrent.futures import as_completed
from dataclasses import dataclass, replace
from pathlib import Path

from bench.field.families import FAMILIES, Split, film_of, has_pixels, label_of, scenario_of, seeds_of
from bench.field.measure import Outcome, tally
from bench.field.product import identify
from bench.workers import one_threaded
from gcs.session.frame_tables import motion_row, read_detections
from infra.session_format import DETECTIONS, MOTION
from sim.render.film import Film
from sim.session import frame_times, write_session
from sim.world.scenario import FIRST_UGV_ID, Scenario
from sim.world.world import World
from vision.motion.estimator import MotionEstimator


def write_motion(scenario: Scenario, session: Path) -> None:
    """Write ``motion.csv`` beside the detections of a session, as a flight does that sees the frames.

    Frames are drawn and looked at one by one; none is kept.
    """
    film, estimator, boxes = Film(World(scenario)), MotionEstimator(), read_detections(session / DETECTIONS.name)
    rows = [MOTION.header]
    for frame, t in enumerate(frame_times(scenario)[0].tolist()):
        motion = estimator.update(film.image(t, frame), boxes.at(frame))
        if motion is not None:
            rows.append(motion_row(frame, motion))
    (session / MOTION.name).write_text("".join(rows), encoding="utf-8")


QUICK_S = 20.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Task:
    """One session to be played."""

    family: int
    hard: bool
    seed: int
    duration_s: float | None = None
    """Shorter than the family has it."""


def play(task: Task) -> Outcome:
    """Generate one session, let the product name it, count."""
    scenario = scenario_of(task.family, task.hard, task.seed)
    if task.duration_s is not None:
        scenario = replace(scenario, duration_s=min(task.duration_s, scenario.duration_s))
    film = film_of(task.family, task.hard, task.seed)
    if film is not None:
        film = replace(film, duration_s=scenario.duration_s)
    with tempfile.TemporaryDirectory(prefix="field-") as folder:
        session = Path(folder) / "session"
        write_session(scenario, session, film=film)
        if has_pixels(task.family, task.hard, task.seed):
            write_motion(scenario, session)
        played = identify(session, Path(folder) / "out", (scenario.camera.width, scenario.camera.height))
    nameless = _nameless(scenario)
    # lost frames count for time as well
    fps = len(played.cpu_ms) / scenario.duration_s
    return Outcome(
        family=task.family,
        hard=task.hard,
        seed=task.seed,
        label=label_of(task.family, task.hard, task.seed),
        vehicles=scenario.fleet_size,
        product=tally(played.matched, fps, nameless),
        afterwards=tally(played.afterwards, fps, nameless),
        wall_ms=played.wall_ms,
        cpu_ms=played.cpu_ms,
        faulty=frozenset(FIRST_UGV_ID + fault.vehicle for fault in scenario.faults),
        spoofed=_spoofed(scenario),
        accused=played.accused,
        mismatch_s=played.mismatch_s,
    )


def _nameless(scenario: Scenario) -> frozenset[int]:
    """System ids of the vehicles that nothing can name: who reports the place of another one for the whole flight.

    Without a delay both report alike, and nothing tells which of them is there.
    """
    lies = [
        fault
        for fault in scenario.faults
        if fault.kind in ("spoof", "copy") and fault.start_s <= 0.0 and fault.stop_s >= scenario.duration_s
    ]
    either = [fault.other for fault in lies if fault.size == 0.0]
    return frozenset(FIRST_UGV_ID + vehicle for vehicle in [*(fault.vehicle for fault in lies), *either])


def _spoofed(scenario: Scenario) -> frozenset[int]:
    spoofs = [fault for fault in scenario.faults if fault.kind in ("spoof", "copy")]
    return frozenset(FIRST_UGV_ID + vehicle for fault in spoofs for vehicle in (fault.vehicle, fault.other))


def tasks_of(
    *,
    split: Split = "report",
    quick: bool = False,
    families: Sequence[int] = (),
    versions: Sequence[bool] = (False, True),
) -> list[Task]:
    """The sessions of a run, the longest first.

    Args:
        split: tuning or reporting seeds.
        quick: one short session of each family and version.
        families: numbers; empty: all.
        versions: False standard, True hard.
    """
    most, duration_s = (1, QUICK_S) if quick else (None, None)
    tasks = [
        Task(family=family, hard=hard, seed=seed, duration_s=duration_s)
        for family in (families or FAMILIES)
        for hard in versions
        for seed in seeds_of(family, hard, split, most)
    ]
    return sorted(tasks, key=lambda task: task.family != 11)


def play_all(tasks: Sequence[Task], workers: int, report: Callable[[int, int], None]) -> list[Outcome]:
    """Play sessions in worker processes; outcomes by family, version and seed.

    Args:
        tasks: the sessions.
        workers: processes.
        report: called with the sessions that are played so far, and all there are.
    """
    outcomes = []
    with one_threaded(workers) as pool:
        for done in as_completed([pool.submit(play, task) for task in tasks]):
            outcomes.append(done.result())
            report(len(outcomes), len(tasks))
    return sorted(outcomes, key=lambda o: (o.family, o.hard, o.seed))
