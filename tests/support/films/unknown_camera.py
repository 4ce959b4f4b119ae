"""A film of a driving fleet by a camera that nothing describes, as the search for it takes it, with the truth."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from assoc.camera_search.inputs import FilmedFleet, KnownMount, MountKind

STEP_S = 0.4
R_GIMBAL_CAM = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
R_ENU_NED = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])


def euler(yaw, pitch, roll):
    """(3, 3) Rz(yaw) Ry(pitch) Rx(roll), radians."""
    (cy, sy), (cp, sp), (cr, sr) = ((np.cos(a), np.sin(a)) for a in (yaw, pitch, roll))
    return (
        np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
        @ np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
        @ np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    )


@dataclass(frozen=True, kw_only=True)
class CameraFilm:
    """What is true of a film; each of its errors may be turned."""

    seed: int = 0
    across_deg: float = 70.0
    pitch_deg: float = -60.0
    yaw_deg: float = 0.0
    kind: MountKind = "stabilized"
    vehicles: int = 7
    strangers: int = 0
    outside: int = 0
    """Vehicles that report and are never in view."""
    height_m: float = 60.0
    length_s: float = 8.0
    speed_mps: float = 3.0
    turns: bool = True
    """False: all drive straight on, each its way."""
    sway_deg: float = 2.0
    """Of the UAV's body, 1σ."""
    white_m: float = 0.3
    bias_m: float = 0.8
    height_error_m: float = 0.0
    box_px: float = 2.0
    """Noise of a box's centre in a picture of 1920 px."""
    missed: float = 0.05
    heading_known: bool = True

    @property
    def focal(self) -> float:
        """φ, widths."""
        return float(0.5 / np.tan(np.deg2rad(self.across_deg) / 2.0))

    def film(self, *, focal_known: bool = False, mount_known: bool = False) -> tuple[FilmedFleet, np.ndarray]:
        """The film, and (T,) true vehicle of each track, −1 a stranger."""
        rng = np.random.default_rng(self.seed)
        t = np.arange(0.0, self.length_s + 1e-9, STEP_S)
        yaw_uav = rng.uniform(-np.pi, np.pi) + 0.03 * t
        sway = np.deg2rad(self.sway_deg) * np.stack([np.sin(0.9 * t + 1.0), np.sin(0.7 * t)], axis=1)
        body = np.stack([R_ENU_NED @ euler(y, a, b) for y, (a, b) in zip(yaw_uav, sway, strict=True)])
        level = np.stack([R_ENU_NED @ euler(y, 0.0, 0.0) for y in yaw_uav])
        mount = euler(np.deg2rad(self.yaw_deg), np.deg2rad(self.pitch_deg), 0.0)
        base = {"stabilized": level, "fixed": body, "gimbal": level}[self.kind]
        R = base @ (mount @ R_GIMBAL_CAM)
        p = np.tile([10.0, -20.0, self.height_m], (len(t), 1)) + 0.4 * np.stack([np.sin(t), np.cos(t), 0 * t], axis=1)
        # where in the picture each is at first, then it drives
        count = self.vehicles + self.strangers
        ground = np.stack([self._way(rng, t, R[0], p[0]) for _ in range(count)], axis=1)
        d = np.concatenate([ground, np.zeros((*ground.shape[:2], 1))], axis=2) - p[:, None]
        ray = d @ R
        picture = self.focal * ray[..., :2] / np.where(ray[..., 2:] > 0.0, ray[..., 2:], np.nan)
        inside = (np.abs(picture[..., 0]) < 0.5) & (np.abs(picture[..., 1]) < 0.28)
        found = inside & (rng.random(inside.shape) > self.missed)
        picture = picture + rng.normal(0.0, self.box_px / 1920.0, picture.shape)
        bias = rng.normal(0.0, self.bias_m, (self.vehicles, 2))
        reported = ground[:, : self.vehicles] + bias + rng.normal(0.0, self.white_m, (len(t), self.vehicles, 2))
        far = [p[0, :2] + 300.0 + np.outer(t, rng.normal(0.0, 3.0, 2)) for _ in range(self.outside)]
        reported = np.concatenate([reported, *(way[:, None] for way in far)], axis=1)
        order = rng.permutation(count)
        truth = np.where(order < self.vehicles, order, -1)
        gimbal = self.kind == "gimbal"
        attitude = base @ mount if gimbal else body
        film = FilmedFleet(
            t=t,
            picture=np.where(found[..., None], picture, np.nan)[:, order],
            vehicle_enu=reported,
            R_enu_base=attitude if self.heading_known else np.tile(R_ENU_NED, (len(t), 1, 1)),
            p_enu=p + np.array([0.0, 0.0, self.height_error_m]),
            ground_z=0.0,
            heading_known=self.heading_known,
            focal=self.focal if focal_known else np.nan,
            mount=KnownMount(
                kind=self.kind,
                pitch=0.0 if gimbal else np.deg2rad(self.pitch_deg + 3.0),
                yaw=0.0 if gimbal else np.deg2rad(self.yaw_deg - 4.0),
            )
            if mount_known or gimbal
            else None,
        )
        return film, truth

    def _way(self, rng, t, R, p):
        """(B, 2) of one that begins in view."""
        while True:
            x, y = rng.uniform(-0.4, 0.4), rng.uniform(-0.2, 0.24)
            d = R @ np.array([x, y, self.focal])
            if d[2] < -0.15 * np.linalg.norm(d):
                break
        start = p[:2] - d[:2] * p[2] / d[2]
        heading = rng.uniform(0, 2 * np.pi) + (rng.normal(0.0, 0.25) * t if self.turns else 0.0)
        speed = (
            self.speed_mps
            * rng.uniform(0.5, 1.5)
            * (1.0 + (0.4 * np.sin(rng.uniform(0.3, 0.8) * t) if self.turns else 0.0))
        )
        v = speed * np.stack([np.cos(heading + 0 * t), np.sin(heading + 0 * t)])
        return start + STEP_S * np.cumsum(v, axis=1).T
