"""The camera's rotation at each frame: telemetry's attitude and the motion of the tracked vehicles in the image, fused.

Attitude comes at 4–50 Hz, with noise, some milliseconds late, and between two samples a body that sways goes where no
interpolation sees it. The boxes of one frame see any rotation at once, for it moves all of them, but by themselves they
drift. An extended Kalman filter has both: its state is

    x = (ξ, β, δ, g₁, v₁, g₂, v₂, …)

with the error ξ of the rotation R that maps the camera frame (OpenCV: x right, y down, z forward) into the world,
R_true = R Exp ξ, the rate β of a sway that telemetry does not show, the lag δ of telemetry behind the video, and place
g and velocity v of up to ``MAX_TRACKS`` vehicles on the ground, which drive straight but for white acceleration. From
frame to frame R turns by a share of what telemetry turns, and by β; where the images themselves show the turn, by that
alone. A sample of attitude measures R at its own time, and the box of a track measures R and the vehicle's place
together. A constant error of telemetry turns the places, too: it cannot be seen here, and the identifier estimates it.

How far telemetry is to be trusted is learnt: the share of its turning that is the camera's, how much of the turning it
misses, and the noise of its samples, which is scaled until innovations are as large as the filter expects them (R.
Mehra, "On the identification of variances and adaptive Kalman filtering", IEEE Trans. Automatic Control 15(2), 1970,
doi:10.1109/TAC.1970.1099422).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vision.motion.fused_evidence import ReportedRotation, SeenTracks
from vision.motion.rotation import turned_by, vector_of

Floats = NDArray[np.float64]
IntArray = NDArray[np.int64]
MAX_TRACKS = 12
"""Vehicles in the state: more hardly make the rotation better, and cost grows with their cube."""
LOST_US = 600_000
"""A vehicle that was not seen for this long is given up."""
LONGEST_US = 1_000_000
"""Longest pause between two frames; after a longer one the filter starts again."""
ACCELERATION = 1.5
"""Square root of the spectral density of the vehicles' acceleration, m/s^1.5: drivers brake and turn."""
FIRST_SPEED = 6.0
"""1σ of the velocity of a vehicle just seen, m/s."""
SWAY, SWAY_S = np.deg2rad(3.0), 0.4
"""1σ and correlation time of the sway of a body about level, where no attitude is sent."""
TURN, MIN_TURN, MAX_TURN = np.deg2rad(0.3), np.deg2rad(0.01), np.deg2rad(6.0)
"""1σ of what is missed of a frame's rotation: to begin with, and the limits of what is learnt."""
RATE, MIN_RATE, MAX_RATE, RATE_S = np.deg2rad(5.0), np.deg2rad(0.1), np.deg2rad(60.0), 0.12
"""1σ of what is missed of β, rad/s: to begin with, and the limits of what is learnt; and its correlation time."""
SAMPLE, MIN_SAMPLE, MAX_SAMPLE = np.deg2rad(0.3), np.deg2rad(0.05), np.deg2rad(3.0)
"""1σ of the noise of a sample: to begin with, and the limits of what is learnt."""
LAG_S, LAG_WANDER = 0.04, 1e-3
"""1σ of the lag, s, also of one that was searched for, and of its change in one second."""
MEMORY = 40.0
"""Innovations over which noise is learnt."""
MAX_SURPRISE = 10.0
"""Squared innovations count at most this many times what was expected: one wild frame teaches little."""
OUTLIER, STRAYED = 3.0, 8.0
"""A box this many σ from where it should be weighs less: a track may have gone on with another vehicle. This many, and
its vehicle is taken again."""
TELLING = 3
"""Boxes that show how the camera turned; where there are fewer, their vehicles may have moved."""
STEEP = 0.06
"""Sine of the least angle below the horizon at which a box tells a place on the ground."""
XI, BETA, LAG, BASE = slice(0, 3), slice(3, 6), 6, 7
"""Indices of ξ, β and δ in the state; the vehicles follow, four states each."""


def image_jacobians(d: Floats, R: Floats) -> tuple[Floats, Floats, Floats]:
    """Pixels of places, over the focal length, and how they depend on the camera's rotation and on the places.

    Args:
        d: (k, 3) from the camera to the places, in its frame.
        R: (3, 3) the camera's rotation.

    Returns:
        u (k, 2) = d_xy / d_z; ∂u/∂ξ (k, 2, 3); ∂u/∂g (k, 2, 2) by a place's first two world coordinates.
    """
    # d = Exp(−ξ) Rᵀ (g − p):  ∂d/∂ξ = [d]×,  ∂d/∂g = Rᵀ
    u = d[:, :2] / d[:, 2:]
    by_d = np.zeros((len(d), 2, 3))
    by_d[:, 0, 0] = by_d[:, 1, 1] = 1.0 / d[:, 2]
    by_d[:, :, 2] = -u / d[:, 2:]
    return u, by_d @ _cross(d), by_d @ R.T[:, :2]


def ground_jacobians(ray: Floats, R: Floats, height: float) -> tuple[Floats, Floats, Floats]:
    """Places where rays meet level ground, and how they depend on the camera's rotation and on the rays.

    Args:
        ray: (k, 3) in the camera's frame, all falling.
        R: (3, 3) the camera's rotation.
        height: of the camera above the ground, metres.

    Returns:
        Places g (k, 2) from the camera's foot; ∂g/∂ξ (k, 2, 3); ∂g/∂u (k, 2, 2) by a ray's first two coordinates.
    """
    # g = s d with d = R ray, s = −h / d_z:  ∂g/∂d = s (I − d e_zᵀ / d_z), first two rows;  ∂d/∂ξ = −R [ray]×
    d = ray @ R.T
    s = -height / d[:, 2]
    by_d = np.zeros((len(d), 2, 3))
    by_d[:, 0, 0] = by_d[:, 1, 1] = s
    by_d[:, :, 2] = -s[:, None] * d[:, :2] / d[:, 2:]
    return s[:, None] * d[:, :2], -by_d @ R @ _cross(ray), by_d @ R[:, :2]


def _cross(v: Floats) -> Floats:
    """(k, 3, 3) matrices [v]× of vectors (k, 3)."""
    K = np.zeros((len(v), 3, 3))
    K[:, 0, 1], K[:, 0, 2], K[:, 1, 2] = -v[:, 2], v[:, 1], -v[:, 0]
    K[:, 1, 0], K[:, 2, 0], K[:, 2, 1] = v[:, 2], -v[:, 1], v[:, 0]
    return K


class AttitudeFusion:
    """The filter, fed with one frame after the other.

    Attributes:
        lag_s: by how much telemetry's attitude is late; it is to be asked for this much after the frame's time.
    """

    def __init__(self) -> None:
        self.lag_s = 0.0
        self._t_us = 0
        self._R: Floats = np.eye(3)
        self._reported: ReportedRotation | None = None
        self._ground_z, self._lag_var = 0.0, LAG_S**2
        self._turn_var: Floats = np.full(3, TURN**2)
        self._rate_var: Floats = np.full(3, RATE**2)
        self._turned: Floats = np.full((2, 3), TURN**2)
        """(2, 3) means of the camera's turning times telemetry's, and of telemetry's squared, about the axes of ENU."""
        self._followed: Floats = np.ones(3)
        self._sample_var: Floats = np.full(3, SAMPLE**2)
        self._forget()

    def _forget(self) -> None:
        self._x: Floats = np.zeros(BASE)
        self._P: Floats = np.zeros((BASE, BASE))
        self._track_id: IntArray = np.zeros(0, np.int64)
        self._seen_us: IntArray = np.zeros(0, np.int64)

    def rotation(self, t_us: int) -> tuple[Floats, float] | None:
        """The camera's rotation (3, 3) at the last frame, and how many seconds before this one that was; None: none."""
        dt_us = t_us - self._t_us
        return (self._R, dt_us * 1e-6) if self._reported is not None and 0 < dt_us <= LONGEST_US else None

    def restart(self) -> None:
        """Forget all places, as they are given in another frame from now on; what was learnt of telemetry stays."""
        self._reported = None

    def begin_at_lag(self, lag_s: float) -> None:
        """Begin again with a lag, seconds, that is known from elsewhere."""
        self.lag_s, self._lag_var, self._reported = lag_s, LAG_S**2, None
        self._sample_var = np.full(3, SAMPLE**2)

    def predicted(self, t_us: int, reported: ReportedRotation) -> Floats:
        """(3, 3) the camera's rotation at a frame before its boxes are seen."""
        if self._reported is None or not self._continues(t_us, reported):
            return reported.R_enu_cam
        if reported.seen_turn is not None:
            # R_enu_later = R_enu_earlier R_later_earlierᵀ
            return self._R @ turned_by(-reported.seen_turn.vector)
        dt = (t_us - self._t_us) * 1e-6
        turn = self._R.T @ (self._followed * self._turn(reported)) + _lasting(dt)[0] * self._x[BETA]
        return self._R @ turned_by(turn)

    def update(self, t_us: int, reported: ReportedRotation, p_enu: Floats, ground_z: float, seen: SeenTracks) -> Floats:
        """Take in a frame.

        Args:
            t_us: its time, Unix µs.
            reported: telemetry's rotation.
            p_enu: (3,) the camera, metres.
            ground_z: height of the ground, metres.
            seen: the frame's boxes.

        Returns:
            (3, 3) the camera's rotation.
        """
        before, dt = self._R, (t_us - self._t_us) * 1e-6
        if self._continues(t_us, reported):
            turn = self._turn(reported)
            self._predict(t_us, dt, reported)
            self._level(p_enu, ground_z)
            boxes = self._see(t_us, p_enu, ground_z, seen, learn=reported.seen_turn is None)
            telling = boxes >= TELLING or reported.seen_turn is not None
            self._hold_on(reported, before, dt, telling=telling)
            if telling and reported.seen_turn is None:
                self._learn_turning(before, turn)
        else:
            self._begin(reported)
        self._t_us, self._reported, self._ground_z = t_us, reported, ground_z
        self._admit(t_us, p_enu, ground_z, seen)
        return self._R

    def _continues(self, t_us: int, reported: ReportedRotation) -> bool:
        last = self._reported
        return last is not None and last.known == reported.known and 0 < t_us - self._t_us <= LONGEST_US

    def _turn(self, reported: ReportedRotation) -> Floats:
        """(3,) by how much the camera turned since the last frame by telemetry, about the axes of ENU."""
        assert self._reported is not None
        return self._R @ vector_of(self._reported.R_enu_cam.T @ reported.R_enu_cam)

    def _begin(self, reported: ReportedRotation) -> None:
        self._forget()
        self._R = reported.R_enu_cam
        self._P[XI, XI] = np.eye(3) * (self._sample_var.max() if reported.known else SWAY**2)
        self._P[BETA, BETA] = np.diag(self._rate_var)
        self._P[LAG, LAG] = self._lag_var

    def _predict(self, t_us: int, dt: float, reported: ReportedRotation) -> None:
        """Turn as telemetry turns, move on the vehicles, and drop those not seen for long."""
        before, self._R = self._R, self.predicted(t_us, reported)
        self._keep(t_us - self._seen_us <= LOST_US)
        turn, (moved_s, left) = before.T @ self._R, _lasting(dt)
        g, v = _places(len(self._track_id))
        F = np.eye(len(self._x))
        # R Exp(ξ) T = R T Exp(Tᵀ ξ)
        F[XI, XI] = turn.T
        F[BETA, BETA] = left * turn.T
        if reported.seen_turn is None:
            F[XI, BETA] = moved_s * turn.T
        F[g, v] = dt
        self._x = F @ self._x
        P = F @ self._P @ F.T
        if reported.seen_turn is None:
            P[XI, XI] += self._R.T @ (self._turn_var[:, None] * self._R)
        else:
            P[XI, XI] += reported.seen_turn.cov
        P[BETA, BETA] += (1.0 - left * left) * self._R.T @ (self._rate_var[:, None] * self._R)
        P[LAG, LAG] += LAG_WANDER**2 * dt
        # ∫ of white acceleration (Bar-Shalom, Li, Kirubarajan 2001, section 6.2.2)
        q = ACCELERATION**2
        P[g, g] += q * dt**3 / 3.0
        P[g, v] += q * dt**2 / 2.0
        P[v, g] += q * dt**2 / 2.0
        P[v, v] += q * dt
        self._P = P

    def _level(self, p_enu: Floats, ground_z: float) -> None:
        """Vehicles stay where they are seen when the ground turns out to be higher or lower than it was taken to be."""
        if ground_z != self._ground_z and p_enu[2] > self._ground_z:
            share = (p_enu[2] - ground_z) / (p_enu[2] - self._ground_z)
            vehicles = self._x[BASE:].reshape(-1, 2, 2)
            vehicles[:, 0] = p_enu[:2] + share * (vehicles[:, 0] - p_enu[:2])
            vehicles[:, 1] *= share

    def _see(self, t_us: int, p_enu: Floats, ground_z: float, seen: SeenTracks, *, learn: bool) -> int:
        """Correct by the boxes of the vehicles in the state; how many there are."""
        _, place, row = np.intersect1d(self._track_id, seen.track_id, assume_unique=True, return_indices=True)
        to = np.empty((len(place), 3))
        to[:, :2], to[:, 2] = self._x[BASE:].reshape(-1, 4)[place, :2] - p_enu[:2], ground_z - p_enu[2]
        d = to @ self._R
        ahead = d[:, 2] > STEEP * np.sqrt(np.sum(d * d, axis=1))
        place, row, d = place[ahead], row[ahead], d[ahead]
        if not len(place):
            return 0
        u, by_xi, by_place = image_jacobians(d, self._R)
        H = np.zeros((len(d), 2, len(self._x)))
        H[:, :, XI] = by_xi
        for axis in (0, 1):
            H[np.arange(len(d)), :, BASE + 4 * place + axis] = by_place[:, :, axis]
        off, noise = seen.ray[row, :2] - u, seen.noise[row]
        strayed = self._correct_by_boxes(H, off, noise, learn=learn)
        self._seen_us[place] = t_us
        keep = np.ones(len(self._track_id), dtype=bool)
        keep[place[strayed]] = False
        self._keep(keep)
        return len(place)

    def _correct_by_boxes(self, H: Floats, off: Floats, noise: Floats, *, learn: bool) -> NDArray[np.bool_]:
        """Correct by residuals (k, 2) with derivatives (k, 2, n) and noise (k,); which of them are far off."""
        k = len(off)
        H_all, var = H.reshape(2 * k, -1), np.repeat(noise * noise, 2)
        PH = self._P @ H_all.T
        S = H_all @ PH
        distance = np.zeros(k)
        for _ in range(2):
            gain = np.linalg.solve(S + np.diag(var), PH.T).T
            step = gain @ off.ravel()
            rest = (off.ravel() - H_all @ step).reshape(k, 2)
            distance = np.sqrt(np.sum(rest * rest, axis=1)) / noise
            if distance.max() <= OUTLIER:
                break
            var = np.repeat((noise * np.maximum(distance / OUTLIER, 1.0) ** 2) ** 2, 2)
        after = self._P - gain @ PH.T
        if learn:
            self._learn_turn(step[XI], after)
        self._apply(step, after)
        return distance > STRAYED

    def _learn_turn(self, step: Floats, after: Floats) -> None:
        """Learn how much of the camera's turning is missed, from a step of ξ (3,) and the covariance after it."""
        prior, post = self._about_enu(self._P[XI, XI]), self._about_enu(after[XI, XI])
        # E dξ² = P − P⁺
        share = np.maximum(1.0 - post / prior, 1e-3)
        self._turn_var = _scaled(
            self._turn_var, (self._R @ step) ** 2 / share, prior, share * self._turn_var, MIN_TURN, MAX_TURN
        )

    def _learn_turning(self, before: Floats, turn: Floats) -> None:
        """Learn what share of telemetry's turning is the camera's, by regression about each axis of ENU, and the rate.

        Args:
            before: (3, 3) the rotation at the last frame.
            turn: (3,) telemetry's since then.
        """
        turned = self._R @ vector_of(before.T @ self._R)
        self._turned += np.stack([turned * turn, turn * turn]) / MEMORY - self._turned / MEMORY
        self._followed = np.clip(self._turned[0] / self._turned[1], 0.0, 1.0)
        rate_var = (self._R @ self._x[BETA]) ** 2 + self._about_enu(self._P[BETA, BETA])
        # E β² = β̂² + P
        self._rate_var = np.clip(self._rate_var + (rate_var - self._rate_var) / MEMORY, MIN_RATE**2, MAX_RATE**2)

    def _hold_on(self, reported: ReportedRotation, before: Floats, dt: float, *, telling: bool) -> None:
        """Correct by telemetry's samples, or where there is no attitude towards level.

        Args:
            before: (3, 3) the rotation at the last frame.
            dt: seconds since then.
            telling: whether the boxes show how the camera turned, so that the lag can be seen.
        """
        H = np.zeros((3, len(self._x)))
        H[:, XI] = self._R
        if not reported.known:
            # the sway is zero on average: its mean over t has the variance 2 σ² τ / t
            z = self._R @ vector_of(self._R.T @ reported.R_enu_cam)
            self._correct(z[:2], H[:2], np.full(2, SWAY**2 * max(2.0 * SWAY_S / dt, 1.0)))
            return
        if not reported.sample_us:
            return
        turned = vector_of(before.T @ self._R)
        z = np.zeros(3)
        for t_us, R in zip(reported.sample_us, reported.samples_enu_cam, strict=True):
            share = (t_us - self._t_us) * 1e-6 / dt
            # z = Log(R(t)ᵀ R_sample) = ξ − ω δ, in ENU
            at = before @ turned_by(share * turned)
            z += at @ vector_of(at.T @ R) / len(reported.sample_us)
        H[:, LAG] = -(self._R @ turned) / dt if telling else 0.0
        var = self._sample_var / len(reported.sample_us)
        S = H @ self._P @ H.T + np.diag(var)
        self._sample_var = _scaled(self._sample_var, z * z, np.diag(S), var, MIN_SAMPLE, MAX_SAMPLE)
        self._correct(z, H, var)
        self._lag_var = float(self._P[LAG, LAG])

    def _correct(self, z: Floats, H: Floats, var: Floats) -> None:
        PH = self._P @ H.T
        gain = np.linalg.solve(H @ PH + np.diag(var), PH.T).T
        self._apply(gain @ z, self._P - gain @ PH.T)

    def _apply(self, step: Floats, P: Floats) -> None:
        self._R = self._R @ turned_by(step[XI])
        self.lag_s += float(step[LAG])
        self._x = self._x + step
        self._x[XI] = self._x[LAG] = 0.0
        self._P = 0.5 * (P + P.T)

    def _about_enu(self, P: Floats) -> Floats:
        """(3,) variances about the axes of ENU of a vector with this covariance (3, 3) in the camera's frame."""
        return np.asarray(np.einsum("ij,jk,ik->i", self._R, P, self._R))

    def _keep(self, wanted: NDArray[np.bool_]) -> None:
        if wanted.all():
            return
        states = np.concatenate([np.ones(BASE, dtype=bool), np.repeat(wanted, 4)])
        self._x, self._P = self._x[states], self._P[np.ix_(states, states)]
        self._track_id, self._seen_us = self._track_id[wanted], self._seen_us[wanted]

    def _admit(self, t_us: int, p_enu: Floats, ground_z: float, seen: SeenTracks) -> None:
        """Take vehicles that are not in the state yet, as far as there is room."""
        new = np.flatnonzero((seen.track_id[:, None] != self._track_id).all(axis=1))
        if not len(new):
            return
        d = seen.ray[new] @ self._R.T
        low = d[:, 2] < -STEEP * np.linalg.norm(d, axis=1)
        new = new[low][: MAX_TRACKS - len(self._track_id)]
        k = len(new)
        if not k:
            return
        g, by_xi, by_ray = ground_jacobians(seen.ray[new], self._R, p_enu[2] - ground_z)
        n, states = len(self._x), np.zeros((k, 4))
        states[:, :2] = p_enu[:2] + g
        by_state = np.zeros((k, 4, n))
        by_state[:, :2, XI] = by_xi
        A = by_state.reshape(4 * k, n)
        own = np.zeros((k, 4, k, 4))
        own[np.arange(k), :2, np.arange(k), :2] = (
            by_ray @ by_ray.transpose(0, 2, 1) * seen.noise[new][:, None, None] ** 2
        )
        own[np.arange(k), 2:, np.arange(k), 2:] = FIRST_SPEED**2 * np.eye(2)
        AP = A @ self._P
        P = np.block([[self._P, AP.T], [AP, AP @ A.T + own.reshape(4 * k, 4 * k)]])
        self._x, self._P = np.concatenate([self._x, states.ravel()]), P
        self._track_id = np.concatenate([self._track_id, seen.track_id[new]])
        self._seen_us = np.concatenate([self._seen_us, np.full(k, t_us, np.int64)])


def _scaled(variance: Floats, squared: Floats, expected: Floats, part: Floats, least: float, most: float) -> Floats:
    """A learnt variance (3,) after one more innovation; that about east and north is one.

    Args:
        variance: as it was.
        part: how much of that is due to what is learnt.
        least: standard deviation, likewise ``most``.
    """
    surprise = np.minimum(squared / expected, MAX_SURPRISE)
    gain = part / expected * (surprise - 1.0) / MEMORY
    gain[:2] = gain[:2].mean()
    return np.clip(variance * (1.0 + gain), least**2, most**2)


def _lasting(dt: float) -> tuple[float, float]:
    """∫ e^(−t/τ) over ``dt``, and what is left of β after it."""
    left = float(np.exp(-dt / RATE_S))
    return RATE_S * (1.0 - left), left


def _places(k: int) -> tuple[IntArray, IntArray]:
    """Indices of the places and the velocities of k vehicles in the state, (2k,) each."""
    first = BASE + 4 * np.arange(k, dtype=np.int64)[:, None] + np.arange(2)
    return first.ravel(), first.ravel() + 2
