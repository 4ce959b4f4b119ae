"""The conditions of the published experiments, and what every method makes of one of them."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np

from bench.paper.films import Window, false_box_road, field, film, paper_road, windows
from bench.paper.methods import METHODS, ConditionNoise, MethodAnswer, identify
from sim.world.scenario import Scenario

ROADS, ROTATIONS = ("straight", "curved"), (0.0, 90.0, 180.0)
FRAMES = 12
TOPOLOGY = ("topology", "topology signed", "TTS", "TTS one step")
CONTINUOUS = "identifier, continuous"


@dataclass(frozen=True, slots=True, kw_only=True)
class Condition:
    """One point of an experiment: the flights, the noise, who is asked."""

    experiment: str
    case: str
    rotation_deg: float = 0.0
    noise: ConditionNoise
    methods: tuple[str, ...]
    flights: tuple[Scenario, ...]
    frames: int = FRAMES
    boxes: int = 6
    visible: int = 6
    most: int
    """Windows used."""
    wander: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class Count:
    """Boxes of labelled frames that a method got right in a condition."""

    experiment: str
    case: str
    rotation_deg: float
    sigma_m: float
    sigma_topology: float
    method: str
    frames: int
    """Labelled frames of all windows."""
    ours: int
    """Boxes on vehicles of ours."""
    named: int
    """Boxes of any kind that were given a vehicle."""
    right: int
    false: int
    """Boxes on none of our vehicles."""
    excluded: int
    """Boxes among these that were given no vehicle."""

    @property
    def precision(self) -> float:
        """TP / (TP + FP), %."""
        return 100.0 * self.right / self.named if self.named else float("nan")

    @property
    def recall(self) -> float:
        """Boxes of ours that were named rightly, %."""
        return 100.0 * self.right / self.ours if self.ours else float("nan")

    @property
    def fper(self) -> float:
        """False boxes left out, %."""
        return 100.0 * self.excluded / self.false if self.false else float("nan")


def conditions(quick: bool) -> list[Condition]:
    """Everything that is measured.

    Args:
        quick: A few noise levels, one flight each.
    """
    return [*_false(quick), *_field(quick), *_figure7(quick), *_figure9(quick), *_figure8(quick)]


def _levels(start: float, stop: float, step: float, quick: bool) -> list[float]:
    values = np.arange(start, stop + step / 2.0, step).tolist()
    return [values[0], values[len(values) // 2], values[-1]] if quick else values


def _asked(yes: bool) -> tuple[str, ...]:
    """The identifier takes most of the time: it is asked at fewer noise levels than the others."""
    return ("identifier",) if yes else ()


def _figure7(quick: bool) -> list[Condition]:
    """Projection against white noise on the relative coordinates."""
    return [
        _on_road(
            ("figure 7", road, rotation),
            ConditionNoise(position_m=sigma, topology=0.0),
            ("projection", "mean residual", *_asked(rotation == 0.0 or sigma % 1.0 == 0.0)),
            quick,
        )
        for road, rotation, sigma in product(ROADS, ROTATIONS, _levels(0.0, 4.0, 0.25, quick))
    ]


def _figure8(quick: bool) -> list[Condition]:
    """Topology and TTS against noise on positions and angles; figure 10 takes its rows without rotation."""
    return [
        _on_road(
            ("figure 8", road, rotation),
            ConditionNoise(position_m=sigma, topology=sigma, heading_deg=sigma),
            (*TOPOLOGY, *_asked(rotation == 0.0 and sigma % 2.0 == 0.0)),
            quick,
        )
        for road, rotation, sigma in product(ROADS, ROTATIONS, _levels(0.0, 10.0, 1.0, quick))
    ]


def _figure9(quick: bool) -> list[Condition]:
    """Both fused, each with noise of its own."""
    return [
        _on_road(
            ("figure 9", road, rotation),
            ConditionNoise(position_m=sigma, topology=sigma + 0.5, heading_deg=sigma + 0.5),
            ("projection", "topology", "fusion", *_asked(rotation == 0.0 and sigma % 0.75 == 0.25)),
            quick,
        )
        for road, rotation, sigma in product(ROADS, ROTATIONS, _levels(0.25, 4.0, 0.25, quick))
    ]


def _on_road(where: tuple[str, str, float], noise: ConditionNoise, methods: tuple[str, ...], quick: bool) -> Condition:
    """A condition by its experiment, road and rotation: four flights, in windows of more than 1000 frames."""
    experiment, road, rotation = where
    return Condition(
        experiment=experiment,
        case=road,
        rotation_deg=rotation,
        noise=noise,
        methods=methods,
        flights=tuple(paper_road(road, rotation, seed) for seed in range(1, 2 if quick else 5)),
        most=4 if quick else 84,
    )


def _false(quick: bool) -> list[Condition]:
    """Six vehicles, seven boxes; more than 1800 frames over the two kinds of false box."""
    return [
        Condition(
            experiment="false box",
            case=kind,
            noise=ConditionNoise(position_m=sigma, topology=sigma),
            methods=("projection", "topology", "TTS", "TTS one step", "identifier"),
            flights=tuple(false_box_road(kind, seed) for seed in range(1, 2 if quick else 9)),
            boxes=7,
            most=4 if quick else 77,
        )
        for kind in ("look-alike", "still")
        for sigma in (0.25, 1.0)
    ]


def _field(quick: bool) -> list[Condition]:
    """Three vehicles and a person, receivers that wander: cold windows, and whole flights."""
    noise = ConditionNoise(position_m=0.0, topology=0.0)
    flights = tuple(field(seed) for seed in range(1, 2 if quick else 13))
    cold = ("projection", "topology", "TTS", "TTS one step", "mean residual", "identifier")
    plans = (("12 frames", 12, cold), ("36 frames", 36, ("identifier",)), ("flights", 240, (CONTINUOUS,)))
    return [
        Condition(
            experiment="field",
            case=name,
            noise=noise,
            methods=methods,
            flights=flights,
            frames=frames,
            boxes=4,
            visible=3,
            most=10_000,
            wander=True,
        )
        for name, frames, methods in plans
    ]


def evaluate(condition: Condition) -> list[Count]:
    """Ask every method about every window of a condition."""
    cut = [window for scenario in condition.flights for window in _cut(condition, scenario)]
    # spread over the flights, not the first ones alone
    chosen = [cut[i] for i in np.unique(np.linspace(0, len(cut) - 1, min(condition.most, len(cut))).astype(int))]
    counts = []
    for method in condition.methods:
        answers = [(window, answer) for window in chosen for answer in _ask(method, window, condition.noise)]
        counts.append(_count(condition, method, answers, len(chosen) * condition.frames))
    return counts


def _cut(condition: Condition, scenario: Scenario) -> list[Window]:
    return windows(
        film(scenario),
        condition.frames,
        scenario.seed,
        boxes=condition.boxes,
        visible=condition.visible,
        wander=condition.wander,
    )


def _ask(method: str, window: Window, noise: ConditionNoise) -> list[MethodAnswer]:
    """One answer for the last frame; of the continuous identifier one for every frame."""
    return identify(window, noise) if method == CONTINUOUS else [METHODS[method](window, noise)]


def _count(condition: Condition, method: str, answers: list[tuple[Window, MethodAnswer]], frames: int) -> Count:
    truth = np.concatenate([window.vehicle for window, _ in answers]) if answers else np.empty(0, np.int64)
    said = np.concatenate([answer.vehicle for _, answer in answers]) if answers else np.empty(0, np.int64)
    ours = truth >= 0
    return Count(
        experiment=condition.experiment,
        case=condition.case,
        rotation_deg=condition.rotation_deg,
        sigma_m=condition.noise.position_m,
        sigma_topology=condition.noise.topology,
        method=method,
        frames=frames,
        ours=int(np.sum(ours)),
        named=int(np.sum(said >= 0)),
        right=int(np.sum((said == truth) & ours)),
        false=int(np.sum(~ours)),
        excluded=int(np.sum((said < 0) & ~ours)),
    )
