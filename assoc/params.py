"""Parameters of the identifier, each with its unit, its reason and the effect of changing it."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

MANY_PAIRS = 400
"""Pairs of track and vehicle that one update weighs within a frame's time, for example 20 × 20. Beyond it updates come
less often, fewer starts are searched and pairs that are far apart are not compared."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ScheduleParams:
    """Schedule of updates of the estimate. Frames between two updates get the names of the last one."""

    every_s: float = 0.25
    """Time between updates, seconds. Lower → faster reaction, more processor time."""
    slowest_factor: float = 4.0
    """Most by which that time is stretched for more pairs than ``MANY_PAIRS``."""
    begun_factor: float = 0.25
    """Share of that time after which an update is due when a track begins: it should get a name quickly."""
    young_factor: float = 0.5
    """Share of that time while a track is younger than ``young_s``."""
    young_s: float = 0.5
    """Age up to which a track counts as young, seconds."""
    idle_factor: float = 3.0
    """Factor on that time while the search is locked: the answer hardly changes then."""
    residual_jump_m: float = 1.5
    """Growth of a named track's distance to its report between two frames, metres, above which an update is due at
    once."""
    residual_jump_stds: float = 5.0
    """Growth, in 1σ of the reports' white noise, that is needed besides while the search is locked: two of them differ
    by it once in 500 times."""
    full_rate_s: float = 3.0
    """Time after such a jump during which ``idle_factor`` is not applied, seconds."""
    rewind_s: float = 1.0
    """A frame that is older than the newest one by more than this, seconds, is another video: everything is reset."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SearchParams:
    """Share of the space of poses and assignments that one update searches."""

    hypotheses: int = 6
    """Joint hypotheses of pose and assignment that are kept."""
    start_hypotheses: int = 3
    """Number of hypotheses that the next update starts from."""
    spread_every: int = 6
    """Every n-th update also starts from the prior's mean, turned and shifted in time."""
    shift_every: int = 3
    """Every n-th update tries the whole image shifted onto other vehicles; with more pairs than ``MANY_PAIRS``, every
    n-th update starts from the best hypothesis and one other, the rest from the best alone."""
    shifts: int = 8
    """Shifted starts that are tried."""
    shifts_many: int = 2
    """Shifted starts that are tried among more pairs than ``MANY_PAIRS``."""
    swaps: int = 6
    """Exchanges of two vehicles that are tried on the best hypothesis."""
    swaps_locked: int = 2
    """Exchanges of two vehicles that are tried while the search is locked."""
    extrapolated_max_s: float = 3.0
    """Reports older than this, seconds, are not extrapolated to a pair's first comparison."""
    heading_std: float = float(np.deg2rad(9.0))
    """1σ of an image heading against a reported heading, radians: compass and detector together."""
    recent_s: float = 1.5
    """A track takes part until this long after it was seen last, seconds: a missed box must not free its name."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LockParams:
    """Conditions under which the search counts as locked: the last answer is refined and nothing else is tried."""

    confidence: float = 0.97
    """Probability from which a track's answer counts as certain."""
    share: float = 0.7
    """Share of the tracks that must be certain if not all are."""
    least_tracks: float = 3.0
    """Least number of certain tracks then: two determine the pose, the third confirms it."""
    hypothesis_share: float = 0.9
    """Posterior weight that the best hypothesis must then have."""
    after_s: float = 4.0
    """Least time since the first frame and since the last score drop, seconds."""
    score_drop: float = 12.0
    """A fall of a seen track's best score by this much from one update to the next, nats, unlocks the search."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LearningParams:
    """Learning from answers, and how certain these must be."""

    confidence: float = 0.9
    """Probability above which an answer is learnt from."""
    least_age_s: float = 1.5
    """Age from which a track is learnt from, seconds: first answers are corrected most."""
    noise_confidence: float = 0.8
    """Probability above which a pair is used to learn the size of the position biases."""
    noise_every_s: float = 3.0
    """Time between two steps of learning them, seconds."""
    clutter_age_s: float = 2.5
    """Age from which a track that is surely none of ours counts as clutter, seconds."""
    clutter_memory_s: float = 30.0
    """Time after that in which clutter is expected, seconds."""
    spare_tracks: float = 0.5
    """Tracks beyond the vehicles expected in view that do not count as clutter: the expectation is uncertain."""
    offset_tension: float = 1.5
    """Number of σ of its prior by which the clock offset may be off while the search is locked."""
    offset_tension_s: float = 3.0
    """Time beyond that limit, seconds, after which the prior is widened to ``unknown_offset_std_s``."""


@dataclass(frozen=True, slots=True, kw_only=True)
class IdentifierParams:
    """Priors and limits. Defaults hold for small ground vehicles seen from 20–120 m."""

    threshold: float = 0.7
    """Least probability for a name. Raise → fewer names, fewer wrong ones."""
    window_s: float = 20.0
    """Time over which the camera's pose is fitted, seconds. Raise → steadier pose, slower frames."""
    locked_window_s: float = 8.0
    """Equivalent of ``window_s`` while the search is locked: what is older is settled. Raise → slower frames."""
    block_s: float = 1.0
    """Residuals are summarised in blocks of this length, seconds."""
    frame_step_s: float = 0.09
    """Frames closer together than this, seconds, are thinned in the history."""
    bias_m: float = 1.5
    """Prior 1σ per axis of a vehicle's slowly wandering position error, metres; learnt from confident pairs."""
    bias_tau_s: float = 60.0
    """Correlation time of the bias, seconds."""
    mean_floor_m: float = 0.12
    """Least 1σ of a block mean, metres, however many samples: box centre against antenna, lens distortion."""
    pixel_std: float = 1.5
    """1σ of a box centre, pixels."""
    yaw_std_deg: float = 7.0
    """Prior 1σ of the camera's heading error. Raise → starts from worse compasses, more ambiguity."""
    yaw_rate_std_deg_s: float = 0.05
    """Prior 1σ of that error's drift."""
    tilt_std_deg: float = 1.2
    """Prior 1σ of pitch and roll errors."""
    position_std_m: float = 1.3
    """Prior 1σ per axis of the camera's horizontal position error, metres."""
    height_std_m: float = 1.0
    """Prior 1σ of the camera's height above the ground, metres."""
    time_offset_std_s: float = 0.06
    """Prior 1σ of video time minus telemetry time, seconds; ``unknown_offset_std_s`` where the offset is unknown."""
    unknown_offset_std_s: float = 0.35
    """Equivalent of ``time_offset_std_s`` for a stream whose offset is unknown or proved to be far from its prior."""
    prior_log_odds: float = 2.5
    """ln odds, before any evidence, that a track close to a vehicle's report is that vehicle. Lower → more boxes stay
    unnamed at first."""
    in_view_log_odds: float = 4.0
    """Added to those odds for a vehicle that should be in view, subtracted for one that should not: a vehicle in view
    has a box of its own. Raise → fewer boxes unnamed, more clutter named."""
    in_view_bonus: float = 1.2
    """Evidence of each block for a vehicle that should be in view, nats: position errors wander in ways that no model
    has. Raise → names are kept longer under bad GNSS, but also on clutter that moves alike."""
    increment_max: float = 8.0
    """Most that one block may count for or against a pair, nats."""
    switch_rate: float = 1e-10
    """Chance per second that an undisturbed track jumps to another vehicle."""
    switch_rate_close: float = 1e-8
    """Equivalent of ``switch_rate`` while another box is near or the track is not being seen."""
    switch_rate_leap: float = 0.05
    """Equivalent of ``switch_rate`` in a second in which the track moved further than a vehicle can, or over a gap in
    it."""
    close_m: float = 3.0
    """Boxes nearer than this, metres, may be swapped by a tracker."""
    stated: float = 40.0
    """Weight of an operator's statement for a vehicle, or against all, nats: as much as five blocks can contradict.
    Raise → reports that contradict it need longer to win."""
    gap_max_s: float = 0.6
    """Longest gap in a track that is bridged by interpolation, seconds."""
    clutter: float = 0.003
    """Chance that a track which moves like one of our vehicles is none, while no more is seen than expected."""
    clutter_seen: float = 0.1
    """Equivalent of ``clutter`` for ``clutter_memory_s`` after a track was judged none of ours; else between both by
    surplus tracks."""
    stitch_confidence: float = 0.8
    """Probability of its name from which a lost track may be continued by its vehicle's report."""
    predicted_floor_m2: float = 0.1
    """Variance per axis of a box centre about its vehicle's position, m², when a lost track is continued."""
    predicted_speed_std_mps: float = 0.7
    """1σ of a vehicle's speed while its report is extrapolated to continue a lost track."""
    schedule: ScheduleParams = field(default_factory=ScheduleParams)
    search: SearchParams = field(default_factory=SearchParams)
    lock: LockParams = field(default_factory=LockParams)
    learning: LearningParams = field(default_factory=LearningParams)
