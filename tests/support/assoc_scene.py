"""A small drone-over-vehicles world for tests of the identifier: plain arrays, no simulator."""

from dataclasses import dataclass

import numpy as np

from assoc.evidence.blocks import Blocks
from assoc.evidence.likelihood import Noise
from assoc.geometry.ground import THETA
from assoc.records import CameraState, Observation, VehicleReports

T0_US = 1_700_000_000_000_000
FOCAL_PX = 1200.0


def camera(p=(0.0, 0.0, 40.0), yaw=0.0, attitude_known=True):
    """Straight down, image up = yaw."""
    c, s = np.cos(yaw), np.sin(yaw)
    R = np.array([[c, -s, 0.0], [-s, -c, 0.0], [0.0, 0.0, -1.0]])
    return CameraState(
        R_enu_cam=R,
        p_enu=np.array(p, float),
        ground_z=0.0,
        px_rad=1 / FOCAL_PX,
        attitude_known=attitude_known,
        position_known=True,
        stabilized=True,
    )


@dataclass
class Fleet:
    """n vehicles that drive winding paths; strangers stand still at given places."""

    n: int = 4
    seed: int = 0
    spacing_m: float = 9.0
    white_m: float = 0.2
    bias_m: float = 0.4
    headings: bool = True
    strangers: tuple[tuple[float, float], ...] = ()
    rate_hz: float = 5.0

    def __post_init__(self):
        rng = np.random.default_rng(self.seed)
        self.start = np.stack([np.arange(self.n) * self.spacing_m - 4.5 * (self.n - 1), rng.uniform(-6, 6, self.n)], 1)
        self.phase, self.size = rng.uniform(0, 6, self.n), rng.uniform(2.5, 5.0, self.n)
        self.bias = rng.normal(0, self.bias_m, (self.n, 2))

    def at(self, t):
        """(n, 2) positions and (n, 2) velocities."""
        w = 0.6
        a = self.phase + w * t
        p = self.start + self.size[:, None] * np.stack([np.sin(a), np.sin(0.7 * a)], 1)
        v = self.size[:, None] * w * np.stack([np.cos(a), 0.7 * np.cos(0.7 * a)], 1)
        return p, v

    def observation(self, t, view, track_id, rng, pixel=0.5):
        """What the true camera sees, tracks in the order: vehicles, strangers."""
        p, v = self.at(t)
        p = np.concatenate([p, np.array(self.strangers).reshape(-1, 2)])
        heading = np.arctan2(v[:, 0], v[:, 1]) if self.headings else np.full(self.n, np.nan)
        heading = np.concatenate([heading, np.full(len(self.strangers), 0.3 if self.headings else np.nan)])
        ahead = p + np.stack([np.sin(heading), np.cos(heading)], 1)

        def rays(q):
            d = np.concatenate([q, np.zeros((len(q), 1))], 1) - view.p_enu
            d = d @ view.R_enu_cam
            return d / d[:, 2:]

        ray = rays(p)
        noise = np.concatenate([rng.normal(0, pixel / FOCAL_PX, (len(p), 2)), np.zeros((len(p), 1))], 1)
        return Observation(
            t_us=T0_US + round(t * 1e6),
            track_id=np.asarray(track_id, np.int64),
            ray_cam=ray + noise,
            front_cam=rays(ahead) + noise,
            gap_s=np.zeros(len(p)),
            score=np.full(len(p), 0.8),
        )

    def reports(self, start, stop, rng):
        """Reports sampled in [start, stop)."""
        step = 1.0 / self.rate_hz
        rows = []
        for k in range(int(np.ceil(start / step - 1e-9)), int(np.ceil(stop / step - 1e-9))):
            p, v = self.at(k * step)
            p = p + self.bias + rng.normal(0, self.white_m, p.shape)
            rows += [(k * step, j, *p[j], *v[j]) for j in range(self.n)]
        r = np.array(rows, float).reshape(-1, 6)
        zero = np.zeros((len(r), 1))
        return VehicleReports(
            t_us=T0_US + np.rint(r[:, 0] * 1e6).astype(np.int64),
            vehicle=r[:, 1].astype(np.int64),
            p_enu=np.concatenate([r[:, 2:4], zero], 1),
            v_enu=np.concatenate([r[:, 4:6], zero], 1),
            heading=np.arctan2(r[:, 4], r[:, 5]) if self.headings else np.full(len(r), np.nan),
            std_m=np.full(len(r), np.nan),
        )


def play(identifier, fleet, seconds, *, told=None, true=None, ids=None, vehicles=None, fps=10.0, seed=1):
    """Run a fleet through an identifier.

    Args:
        identifier: The one under test.
        fleet: The world.
        seconds: How long.
        told: Camera as telemetry has it; default the true one.
        true: Camera as it is.
        ids: Function t → track ids; default 1, 2, ….
        vehicles: (n,) permutation: report j is told as vehicle ``vehicles[j]``; None leaves them.
        fps: Frames per second.
        seed: Of the noise.

    Returns:
        List of (t, Identities).
    """
    rng = np.random.default_rng(seed)
    true = true or camera()
    told = told or true
    m = fleet.n + len(fleet.strangers)
    answers, heard = [], -1.0
    for k in range(int(seconds * fps)):
        t = k / fps
        r = fleet.reports(heard, t, rng)
        heard = t
        if vehicles is not None:
            r = VehicleReports(
                t_us=r.t_us,
                vehicle=np.asarray(vehicles, np.int64)[r.vehicle],
                p_enu=r.p_enu,
                v_enu=r.v_enu,
                heading=r.heading,
                std_m=r.std_m,
            )
        track_id = np.arange(1, m + 1) if ids is None else ids(t)
        answers.append((t, identifier.update(fleet.observation(t, true, track_id, rng), told, r)))
    return answers


BIAS_STD_M, DECAY, WHITE_VAR = 1.3, 0.9, 0.09


def noise(**changes):
    values = {
        "white_var": WHITE_VAR,
        "bias_std": BIAS_STD_M,
        "decay": DECAY,
        "floor_var": 0.0,
        "pixel_var": 0.0,
        "height": np.sqrt(500.0),
        "increment_max": 1e9,
        "in_view_bonus": np.zeros(1),
    }
    return Noise(**(values | changes))


def blocks_of(samples):
    """Blocks of residuals in metres: samples[b][i][j] is (k, 2), for track i and vehicle j."""
    shape = (len(samples), len(samples[0]), len(samples[0][0]))
    count, scatter, mean = np.zeros(shape), np.zeros(shape), np.zeros((*shape, 2))
    for at in np.ndindex(shape):
        r = samples[at[0]][at[1]][at[2]]
        if len(r):
            count[at], mean[at] = len(r), r.mean(axis=0)
            scatter[at] = np.sum((r - r.mean(axis=0)) ** 2)
    return Blocks(
        first=0,
        count=count,
        mean=mean,
        scatter=scatter,
        log_null=np.zeros(shape),
        extra_var=np.zeros(shape),
        jump_var=np.zeros((shape[0], shape[2])),
        box_var=np.zeros(shape[:2]),
        jacobian=np.zeros((*shape[:2], 2, THETA)),
        heading=np.zeros(shape[1:]),
        theta=np.zeros(THETA),
    )
