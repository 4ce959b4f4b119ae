"""A camera above vehicles on winding ways, an hour of their reports, and a film of a minute: plain arrays."""

from dataclasses import dataclass, replace

import numpy as np

from assoc.clock_search.inputs import CameraPath, FleetLog, film_tracks
from assoc.records import Observation

FOCAL_PX, WIDTH, HEIGHT = 1200.0, 1920, 1080
FILM_S, FPS = 40.0, 5.0


def looking_down(yaw):
    """(k, 3, 3) rotations of cameras with the image's up at these headings."""
    c, s, o = np.cos(yaw), np.sin(yaw), np.zeros_like(yaw)
    return np.stack([np.stack([c, -s, o], -1), np.stack([-s, -c, o], -1), np.stack([o, o, o - 1.0], -1)], -2)


@dataclass
class FilmedFleet:
    """n vehicles whose ways do not repeat, seen from 60 m; ``ahead_s`` is the offset of the fleet's clock."""

    n: int = 4
    seed: int = 1
    ahead_s: float = 0.0
    period_s: float | None = None
    """Of ways that repeat."""
    still: bool = False
    bias_m: float = 0.5
    uav_mps: float = 0.0

    def __post_init__(self):
        rng = np.random.default_rng(self.seed)
        self.start = np.stack([np.linspace(-18, 18, self.n), rng.uniform(-8, 8, self.n)], 1)
        self.w = rng.uniform(0.05, 0.45, (self.n, 2, 5))
        if self.period_s:
            self.w = np.maximum(np.rint(self.w * self.period_s / (2 * np.pi)), 1) * 2 * np.pi / self.period_s
        self.size = 0.0 if self.still else 2.6 * rng.uniform(0.5, 1.0, self.w.shape)
        self.phase = rng.uniform(0, 7, self.w.shape)
        self.bias = rng.normal(0, self.bias_m, (self.n, 2))

    def at(self, t):
        """(k, n, 2) places at times (k,) of the film's clock."""
        drift = np.asarray(t)[:, None, None] * np.array([self.uav_mps, 0.0])
        swing = np.sum(self.size * np.sin(np.asarray(t)[:, None, None, None] * self.w + self.phase), axis=-1)
        return self.start + swing + drift

    def uav(self, t):
        """(k, 3) where the UAV is."""
        t = np.asarray(t)
        return np.stack([self.uav_mps * t + np.sin(0.3 * t), np.cos(0.2 * t), np.full(len(t), 60.0)], -1)

    def film(self, yaw=0.4, clutter=0, missed=0.05, length_s=FILM_S):
        """What the camera sees: one track a vehicle, and boxes of nothing that stand still."""
        rng = np.random.default_rng(self.seed + 1000)
        strangers = rng.uniform(-20, 20, (clutter, 2))

        def frame(t):
            p = np.concatenate([self.at([t])[0], strangers + self.uav([t])[0, :2] * (self.uav_mps > 0)])
            d = np.concatenate([p, np.zeros((len(p), 1))], 1) - self.uav([t])[0]
            ray = d @ looking_down(np.array([yaw + 0.03 * np.sin(t)]))[0]
            ray = ray / ray[:, 2:]
            ray[:, :2] += rng.normal(0, 1.0 / FOCAL_PX, (len(p), 2))
            inside = np.all(np.abs(ray[:, :2]) < np.array([WIDTH, HEIGHT]) / FOCAL_PX / 2, axis=1)
            rows = np.flatnonzero(inside & (rng.random(len(p)) >= missed))
            return Observation(
                t_us=round(t * 1e6),
                track_id=rows + 1,
                ray_cam=ray[rows],
                front_cam=np.full((len(rows), 3), np.nan),
                gap_s=np.zeros(len(rows)),
                score=np.full(len(rows), 0.8),
            )

        return film_tracks(((k / FPS, frame(k / FPS)) for k in range(int(length_s * FPS))), length_s)

    def path(self, yaw=0.4, heading_known=True, ahead_s=0.0, log_s=(-30.0, 90.0)):
        """The camera's path as the UAV reports it: 3° and 0.7 m off."""
        t = np.arange(*log_s, 0.2)
        turned = yaw + 0.03 * np.sin(t) + np.deg2rad(3.0) if heading_known else 0.03 * np.sin(t)
        return CameraPath(
            t=t + ahead_s,
            R_enu_cam=looking_down(turned),
            p_enu=self.uav(t) + np.array([0.6, -0.4, 0.3]),
            ground_z=0.0,
            px_rad=1.0 / FOCAL_PX,
            heading_known=heading_known,
            half_view=(WIDTH / FOCAL_PX / 2, HEIGHT / FOCAL_PX / 2),
        )

    def log(self, start=-1200.0, stop=2400.0, rate_hz=1.0):
        """The reports of an hour, on the fleet's clock."""
        rng = np.random.default_rng(self.seed + 2000)
        t = np.arange(start, stop, 1.0 / rate_hz)
        parts = []
        for vehicle in range(self.n):
            now = t + 0.13 * vehicle
            p = self.at(now)[:, vehicle] + self.bias[vehicle] + rng.normal(0, 0.3, (len(t), 2))
            kept = rng.random(len(t)) > 0.05
            parts.append((now[kept] + self.ahead_s, np.full(kept.sum(), vehicle), p[kept]))
        at, vehicle, p = (np.concatenate(column) for column in zip(*parts, strict=True))
        return FleetLog(n=self.n, t=at, vehicle=vehicle, p_enu=p)


def without(log, start, stop):
    """A log without the reports of a time."""
    kept = (log.t < start) | (log.t >= stop)
    return replace(log, t=log.t[kept], vehicle=log.vehicle[kept], p_enu=log.p_enu[kept])
