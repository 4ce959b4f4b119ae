"""Numbers of the identifier, each with what it does when changed."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["IdentifierParams"]


@dataclass(frozen=True, slots=True, kw_only=True)
class IdentifierParams:
    """Priors and limits. Defaults hold for small ground vehicles seen from 20–120 m."""

    threshold: float = 0.7
    """Least probability for a name. Raise → fewer names, fewer wrong ones."""
    window_s: float = 20.0
    """How far back the camera's pose is fitted. Raise → steadier pose, slower frames."""
    calm_window_s: float = 8.0
    """The same while nothing is in doubt: what is older is settled. Raise → slower frames."""
    block_s: float = 1.0
    """Residuals are summarised in blocks of this length."""
    frame_step_s: float = 0.09
    """Frames closer together than this are thinned in the history."""
    every_s: float = 0.25
    """Time between full updates; labels are still given on every frame."""
    bias_m: float = 1.5
    """Prior 1σ per axis of a vehicle's slowly wandering position error; learnt from confident pairs."""
    bias_tau_s: float = 60.0
    """Its correlation time."""
    mean_floor_m: float = 0.12
    """1σ of what block means never resolve: box centre against antenna, lens."""
    pixel_std: float = 1.5
    """1σ of a box centre, pixels."""
    yaw_std_deg: float = 7.0
    """Prior 1σ of the camera's heading error. Raise → starts from worse compasses, more ambiguity."""
    yaw_rate_std_deg_s: float = 0.05
    """Prior 1σ of its drift."""
    tilt_std_deg: float = 1.2
    """Prior 1σ of pitch and roll errors."""
    position_std_m: float = 1.3
    """Prior 1σ per axis of the camera's horizontal position error."""
    height_std_m: float = 1.0
    """Prior 1σ of the camera's height above the ground."""
    time_offset_std_s: float = 0.06
    """Prior 1σ of video time minus telemetry time. Give that of the next when the offset is unknown."""
    unknown_offset_std_s: float = 0.35
    """The same of a stream whose offset nobody knows, and of one that has shown to be farther off than was taken."""
    prior_log_odds: float = 2.5
    """ln odds, before any evidence, that a vehicle close enough is the one in view. Lower → more boxes stay
    unnamed at first."""
    in_view_log_odds: float = 4.0
    """What those odds gain for a vehicle that should be in view and lose for one that should not: in view
    its own box would be missing if this were another's. Raise → fewer boxes unnamed, more strangers named."""
    patience: float = 1.2
    """What each block adds for a vehicle that should be in view, nats: receivers wander in ways that no model
    has. Raise → names are kept longer under bad GNSS, strangers that drive alike too."""
    increment_max: float = 8.0
    """Most that one block may say for or against a pair, nats."""
    switch_rate: float = 1e-10
    """Chance per second that an undisturbed track jumps to another vehicle."""
    switch_rate_close: float = 1e-8
    """The same while another box is near or the track is not being seen."""
    switch_rate_leap: float = 0.05
    """The same in a second in which the track moved further than a vehicle can, or across a hole in it."""
    close_m: float = 3.0
    """Boxes nearer than this may be swapped by a tracker."""
    gap_max_s: float = 0.6
    """Longest hole in a track that is bridged by interpolation."""
    interloper: float = 0.003
    """Chance that a track is a stranger who drives like one of ours, where no more is seen than is expected."""
    interloper_seen: float = 0.1
    """The same for 30 s after a track was judged none of ours; in between by the share of tracks that is left over."""
    hypotheses: int = 6
    """Joint hypotheses of pose and assignment that are kept."""
