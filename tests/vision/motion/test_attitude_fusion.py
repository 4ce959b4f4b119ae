"""The camera's rotation from coarse, late, noisy attitude and the boxes of driving vehicles, against a known sway."""

import math
from dataclasses import dataclass, field

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from vision.motion import lag_search
from vision.motion.attitude_fusion import AttitudeFusion
from vision.motion.fused_evidence import ReportedRotation, SeenTracks
from vision.motion.lag_search import LagSearch
from vision.motion.rotation import CameraTurn

FOCAL_PX = 1400.0
HEIGHT_M = 45.0
STEP_S = 0.005
DOWN = np.array([[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]])


@dataclass(frozen=True, kw_only=True)
class Sway:
    """A camera that sways about straight down over vehicles on curved ways, and what is reported of it."""

    seconds: float = 14.0
    sway_deg: float = 2.5
    tau_s: float = 0.25
    attitude_hz: float = 4.0
    fps: float = 10.0
    vehicles: int = 7
    lag_s: float = 0.03
    tilt_noise_deg: float = 0.1
    yaw_noise_deg: float = 0.3
    bias_deg: float = 1.5
    box_px: float = 1.0
    known: bool = True
    pixels_deg: float = 0.0
    """Noise of the turn that the pixels show from frame to frame; 0: they show none."""
    searched: bool = False
    """Whether the lag is searched for, too."""
    found_s: list = field(default_factory=list)
    """Lags that the search found."""
    right_from_s: float = math.inf
    """From when on telemetry is not late any more."""
    swapped_s: float = -1.0
    """When two tracks go on with one another's vehicle."""

    def fly(self):
        """(frames, 3) errors in degrees about east, north and up by telemetry alone, then by the fusion; the filter."""
        rng = np.random.default_rng(5)
        n = round((self.seconds + 4.0) / STEP_S)
        noise = rng.normal(0.0, 1.0, (n, 3))
        for _ in range(3):  # three poles: a smooth sway
            keep = np.exp(-STEP_S / self.tau_s)
            for k in range(1, n):
                noise[k] = keep * noise[k - 1] + (1.0 - keep) * noise[k]
        noise *= np.radians(self.sway_deg) * np.array([1.0, 1.0, 0.4]) / noise[200:].std(axis=0)
        true = CubicSpline(STEP_S * np.arange(n) - 2.0, noise)
        bias = np.radians(self.bias_deg) * np.array([1.0, -0.7, 2.0])
        sampled = np.arange(-2.0, self.seconds + 1.0, 1.0 / self.attitude_hz)
        spread = np.radians([self.tilt_noise_deg, self.tilt_noise_deg, self.yaw_noise_deg])
        samples = true(sampled) + bias + rng.normal(0.0, 1.0, (len(sampled), 3)) * spread
        stamped = sampled + np.where(sampled < self.right_from_s, self.lag_s, 0.0)

        def reported(t):
            turn = [np.interp(t, stamped, column) for column in samples.T] if self.known else np.zeros(3)
            return Rotation.from_rotvec(turn).as_matrix() @ DOWN

        ways = rng.uniform(0.0, 2.0 * np.pi, self.vehicles), rng.uniform(-12.0, 12.0, (self.vehicles, 2))
        fusion, search, alone, fused, before = AttitudeFusion(), LagSearch(), [], [], -1.0
        for t in np.arange(0.0, self.seconds, 1.0 / self.fps):
            R = Rotation.from_rotvec(true(t)).as_matrix() @ DOWN
            p = np.array([3.0 * t, 0.0, HEIGHT_M])
            angle = ways[0] + 0.15 * t
            place = ways[1] + 25.0 * np.column_stack([np.sin(angle), np.cos(angle)]) + p[:2]
            d = np.column_stack([place, np.zeros(len(place))]) - p
            ray = d @ R
            ray = ray / ray[:, 2:] + rng.normal(0.0, self.box_px / FOCAL_PX, (len(d), 3)) * (1.0, 1.0, 0.0)
            ids = np.arange(1, self.vehicles + 1)
            if 0.0 <= self.swapped_s <= t:
                ids[:2] = ids[1::-1]
            late = fusion.lag_s
            times = stamped[(stamped > before + late) & (stamped <= t + late)] if before >= 0.0 else ()
            turn = None
            if self.pixels_deg and before >= 0.0:
                noise = np.radians(self.pixels_deg) * rng.normal(0.0, 1.0, 3)
                R_later_earlier = R.T @ Rotation.from_rotvec(true(before)).as_matrix() @ DOWN
                vector = Rotation.from_matrix(R_later_earlier).as_rotvec() + noise
                turn = CameraTurn(vector=vector, cov=np.eye(3) * np.radians(self.pixels_deg) ** 2)
            now = ReportedRotation(
                R_enu_cam=reported(t + late),
                known=self.known,
                sample_us=tuple(round((s - late) * 1e6) + 10**9 for s in times) if self.known else (),
                samples_enu_cam=tuple(reported(s) for s in times) if self.known else (),
                seen_turn=turn,
            )
            seen = SeenTracks(track_id=ids, ray=ray, noise=np.full(len(ids), 1.5 / FOCAL_PX))
            t_us = round(t * 1e6) + 10**9
            estimate = fusion.update(t_us, now, p, 0.0, seen)
            self._search(search, fusion, t_us, (stamped, reported), (p, seen))
            before = t
            for errors, found in ((alone, reported(t)), (fused, estimate)):
                errors.append(np.degrees(Rotation.from_matrix(found @ R.T).as_rotvec()))
        settled = round(4.0 * self.fps)
        return np.array(alone)[settled:], np.array(fused)[settled:], fusion

    def _search(self, search, fusion, t_us, telemetry, looked):
        if not self.searched:
            return
        (stamped, reported), (p, seen) = telemetry, looked
        since_us, until_us = search.samples_wanted(t_us)
        for s in stamped[(stamped > (since_us - 10**9) * 1e-6) & (stamped <= (until_us - 10**9) * 1e-6)]:
            search.add_sample(round(s * 1e6) + 10**9, reported(s))
        search.add_frame(t_us, p, 0.0, seen)
        if (lag_s := search.found(t_us, fusion.lag_s)) is not None:
            fusion.begin_at_lag(lag_s)
            self.found_s.append(lag_s)


def quick(errors):
    """(3,) what changes within seconds: the constant part is for the identifier."""
    return (errors - errors.mean(axis=0)).std(axis=0)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("options", "limit_deg"),
    [
        ({}, 0.13),
        ({"fps": 30.0, "tau_s": 0.15}, 0.13),
        ({"attitude_hz": 20.0, "tau_s": 0.15}, 0.13),
        ({"attitude_hz": 10.0, "fps": 30.0, "lag_s": 0.06}, 0.12),
        ({"vehicles": 3}, 0.15),
    ],
    ids=["4 Hz", "4 Hz, 30 frames/s", "20 Hz, quick", "late", "3 vehicles"],
)
def test_a_sway_between_the_samples_is_seen_in_the_boxes(options, limit_deg):
    alone, fused, _ = Sway(**options).fly()
    assert quick(fused)[:2].max() < limit_deg
    assert quick(fused)[:2].max() < 0.4 * quick(alone)[:2].max()


@pytest.mark.slow
def test_the_lag_of_attitude_is_found():
    for lag_s in (0.0, 0.06):
        assert Sway(lag_s=lag_s, attitude_hz=20.0).fly()[2].lag_s == pytest.approx(lag_s, abs=0.01)


@pytest.mark.slow_but_first
@pytest.mark.parametrize("lag_s", [-3.0, -0.5, 0.6])
@pytest.mark.parametrize("tau_s", [0.25, 0.4])
def test_attitude_that_is_far_off_in_time_is_searched_for(lag_s, tau_s):
    sway = Sway(lag_s=lag_s, tau_s=tau_s, attitude_hz=10.0, searched=True)
    _, fused, fusion = sway.fly()
    assert sway.found_s == pytest.approx([lag_s], abs=0.1)
    assert fusion.lag_s == pytest.approx(lag_s, abs=0.03)
    assert quick(fused[-40:])[:2].max() < 0.2


@pytest.mark.slow_but_first
@pytest.mark.parametrize(
    "options",
    [
        {"lag_s": 0.06},
        {"sway_deg": 0.1, "lag_s": 0.5},
        {"vehicles": 1, "lag_s": 0.5},
        {"vehicles": 0, "lag_s": 0.5},
        {"attitude_hz": 0.2},
    ],
    ids=["near", "steady camera", "one vehicle", "no vehicle", "hardly any attitude"],
)
def test_no_lag_is_found_where_none_shows(options):
    sway = Sway(searched=True, **options)
    sway.fly()
    assert not sway.found_s


def test_a_lag_that_was_found_is_taken_back_when_film_and_telemetry_agree_again():
    sway = Sway(lag_s=-1.5, right_from_s=12.0, seconds=32.0, attitude_hz=10.0, searched=True)
    fusion = sway.fly()[2]
    assert sway.found_s == pytest.approx([-1.5, 0.0], abs=0.1)
    assert fusion.lag_s == pytest.approx(0.0, abs=0.05)


def test_many_tracks_cost_no_more_than_a_few():
    longest = []
    original = lag_search._residuals

    def counted(path, frames, tracks, lags):
        longest.append(len(tracks))
        return original(path, frames, tracks, lags)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(lag_search, "_residuals", counted)
        Sway(vehicles=60, seconds=8.0, searched=True).fly()
    assert longest and max(longest) == lag_search.MAX_TRACKS


def test_good_attitude_is_not_made_worse():
    good = {"attitude_hz": 50.0, "sway_deg": 0.3, "tilt_noise_deg": 0.02, "yaw_noise_deg": 0.02, "lag_s": 0.0}
    alone, fused, _ = Sway(**good).fly()
    assert quick(fused).max() < 1.2 * quick(alone).max() + 0.02


def test_noisy_attitude_is_smoothed_by_the_boxes():
    alone, fused, _ = Sway(attitude_hz=20.0, yaw_noise_deg=1.0, tilt_noise_deg=0.5, sway_deg=1.0).fly()
    assert (quick(fused) < 0.7 * quick(alone)).all()


def test_without_vehicles_it_is_what_telemetry_has():
    alone, fused, _ = Sway(vehicles=0, attitude_hz=50.0, sway_deg=1.0).fly()
    assert quick(fused)[:2].max() < 1.3 * quick(alone)[:2].max()


@pytest.mark.slow
def test_tracks_that_are_exchanged_do_not_turn_the_camera():
    steady, swapped = Sway().fly()[1], Sway(swapped_s=8.0).fly()[1]
    assert np.abs(swapped - steady).max() < 0.35
    assert np.abs(swapped - steady)[-20:].max() < 0.1


@pytest.mark.slow
def test_without_attitude_the_boxes_hold_the_camera_near_level():
    alone, fused, _ = Sway(known=False).fly()
    change = np.diff(fused, axis=0).std(axis=0)[:2], np.diff(alone, axis=0).std(axis=0)[:2]
    assert (change[0] < 0.6 * change[1]).all()
    assert np.abs(fused[:, :2]).max() < 5.0


def test_after_a_pause_it_begins_at_what_is_reported():
    R = Rotation.from_rotvec([0.0, 0.0, 0.3]).as_matrix() @ DOWN
    fusion = AttitudeFusion()
    none = SeenTracks(track_id=np.zeros(0, np.int64), ray=np.zeros((0, 3)), noise=np.zeros(0))
    p = np.array([0.0, 0.0, HEIGHT_M])
    fusion.update(10**9, ReportedRotation(R_enu_cam=DOWN, known=True), p, 0.0, none)
    turned = ReportedRotation(R_enu_cam=R, known=True)
    assert fusion.update(10**9 + 5_000_000, turned, p, 0.0, none) == pytest.approx(R)
    fusion.restart()
    assert fusion.predicted(10**9 + 5_100_000, ReportedRotation(R_enu_cam=DOWN, known=True)) == pytest.approx(DOWN)


@pytest.mark.slow_but_first
@pytest.mark.parametrize("options", [{}, {"fps": 30.0, "tau_s": 0.15}, {"attitude_hz": 20.0, "lag_s": 0.06}])
def test_a_sway_is_seen_in_the_pixels_also_without_vehicles(options):
    alone, fused, _ = Sway(vehicles=0, pixels_deg=0.02, **options).fly()
    assert quick(fused).max() < 0.1
    assert quick(fused)[:2].max() < 0.3 * quick(alone)[:2].max()


@pytest.mark.slow
def test_without_attitude_the_pixels_carry_the_cameras_turning():
    blind = Sway(known=False).fly()[1]
    seen = Sway(known=False, pixels_deg=0.02).fly()[1]
    assert np.diff(seen, axis=0).std() < 0.3 * np.diff(blind, axis=0).std()
    assert np.abs(seen[:, :2]).max() < 3.0
