"""Height and slope of the ground where the vehicles drive, from all that reports it.

Unknown are the height g of the ground at a point c, its slope s, and u, by how much the vehicles' altitudes are higher
than the UAV's all together. In ENU metres, with vehicle j at (p, z) and its own error b_j:

    z_j = g + s·(p_j − c) + u + b_j + noise        u ~ N(0, σ_u²), b_j ~ N(0, σ_j²), s ~ N(0, σ_s²)
    below the UAV  = g + s·(p_uav − c) + noise     by a rangefinder, or by the autopilot's map of the terrain
    take-off = g + e                               e ~ 0.8 N(0, 1²) + 0.15 N(0, 15²) + 0.05 N(0, 40²)

Errors are constant over a flight, more or less, so that more samples of a vehicle make its b_j no smaller, but they
show how the ground rises where it drives. With a terrain file all heights are above its own.

Where sources disagree, the film decides: the fleet's formation and its motion have the right size for one height alone.
So it does where altitudes are the only source, which may count from the ellipsoid and the UAV's from the sea. What the
film contradicts is left out from then on (:meth:`GroundHeight.compare_with_film`). Altitudes of vehicles that are off
all together still show the slope.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gcs.fold.ground.surface import GAP_M, OUTLIER_STDS, GroundSurface, HeightSource, Relief
from gcs.fold.ground.vehicle_relief import VehicleRelief
from gcs.snapshot import Event
from mavlink.state import FleetState, UavState

FloatArray = NDArray[np.float64]

UAV_ALTITUDE_STD_M = 4.0
"""1σ of what the UAV's altitude is off by, by its receiver's height at the start."""
SLOPE_STD = 0.03
"""1σ of the slope per axis: what vehicles drive on in formation."""
RELIEF_SLOPE_STD = 0.005
"""Equivalent of ``SLOPE_STD`` about a terrain file, whose own error is a height that changes over kilometres."""
FILE_STD_M = 5.0
"""1σ of a terrain file's height against the UAV's altitude: a map's own error, and another sea level or none."""
FILE = HeightSource(name="the terrain file", z=0.0, std_m=FILE_STD_M)
TAKEOFF, FOOT, ALTITUDES, FILM = "the take-off", "the mission's height_m", "the vehicles' altitudes", "the film"
FILM_STD_M = 2.0
"""Least 1σ of the ground by the film: focal lengths are off by per cents."""
ON_FILE_STD_M = 2.0
"""1σ of the ground, above the relief, by the place of the take-off: a barometer's drift and a file's errors."""
TAKEOFF_M = 2.0
"""Height above its home, m, up to which a UAV is where it took off."""
RELIEF_STD_M = 1.0
"""1σ of a sample, a second apart, about the plane: bumps, and the noise of an altitude."""
RANGE_STD_M, TERRAIN_STD_M = 2.0, 5.0
"""1σ of the ground by a rangefinder, which sees bushes and ditches, and by a map with a grid of 30 or 100 m."""
HOME_STDS_M, HOME_SHARES = np.array([1.0, 15.0, 40.0]), np.array([0.8, 0.15, 0.05])
"""1σ of the ground about the plane that the UAV took off from, and how often: a field, a slope, and a hill."""
HOME_ALONE_STD_M = 6.0
"""1σ of the ground while nothing but that plane is known."""
UNKNOWN_VAR = 1e8
"""Variance of a height that nothing is known of, m²."""
MEMORY_S = 20.0
"""Time constant with which samples lose weight: the ground where the fleet was before is not where it is now."""
LONGEST_SAMPLE_S = 1.0
"""Time that the first sample of a vehicle counts for, and one after a gap."""
FIND_EVERY_US = 300_000
"""Least time between two fits of the plane: reports come a few times a second."""
SMOOTHING_S = 2.0
"""Time constant with which the ground follows what is found: one vehicle more must not move it by a step."""
OUTLIER_M = 15.0
"""Distance from the median, metres, at which an altitude is left out; or ``OUTLIER_STDS`` from the plane of the
others."""
FLYING_M, MIN_HEIGHT_M = 10.0, 3.0
"""A UAV this far above its home is at least that far above the ground where it is, metres."""
DATUMS_M = (36.0, -36.0)
"""Offsets of altitudes that nothing else confirms: in most places the geoid is up to 60 m from the ellipsoid.
The identifier tries 12 and 24 m beside each."""
GUESS_M, GUESS_STD_M = 50.0, 25.0
"""A UAV's height above the ground where the only altitudes put it into the ground, and 1σ."""
GUESS = "a guess"
GAP_LASTS_US = 3_000_000
"""Time that a difference lasts before it is reported: filters start, and reports come one after the other."""
REPORT_GAP_M = 10.0
"""Change of a source's difference since it was last reported with which it is reported again, m."""


class GroundHeight:
    """Height and slope of the ground below a flight, frame by frame."""

    def __init__(self, *, takeoff_known: bool = True, home: str = TAKEOFF) -> None:
        """Args:
        takeoff_known: whether the UAV's height above its take-off is more than what altitudes tell.
        home: what its height is counted from, in words.
        """
        self._takeoff_known, self._home = takeoff_known, home
        self.ground: GroundSurface | None = None
        self.step_m = 0.0
        """Step by which it rose at once, with the last update."""
        self._found: GroundSurface | None = None
        self._found_us = 0
        """Height that was found last, and when; ``ground`` follows it."""
        self._relief: Relief | None = None
        self._bumps = VehicleRelief(0)
        self._outside_reported = False
        self._takeoff_en: FloatArray | None = None
        self._t_us = 0
        self._moments = np.zeros((0, 4, 4))
        """(n, 4, 4) decaying Σ x xᵀ of each vehicle, x = (1, east, north, up)."""
        self._since_us: dict[str, int] = {}
        """Time since which a source differs from what is used."""
        self._reported_m: dict[str, float] = {}
        """Amount by which a source differed when that was reported."""
        self._left_out: set[str] = set()
        """Sources that the film contradicts."""
        self._film: tuple[HeightSource, FloatArray] | None = None
        """The ground by the film, and where, once it contradicts all other sources."""
        self._news: list[str] = []
        """Texts of warnings about them that were not reported yet."""
        self._divided_reported = self._jumps = False
        """True: it was reported that the vehicles' altitudes differ; and the next ground is taken at once."""

    def _home_z(self, uav: UavState) -> float:
        """Height of the plane that the UAV took off from, NaN unknown."""
        return float(uav.p_enu[2] - uav.height_m) if self._takeoff_known else math.nan

    def below(self, uav: UavState) -> GroundSurface:
        """The ground; the plane of the UAV's home while nothing else is known, else a guess."""
        return self.ground or find_ground(np.zeros((0, 4, 4)), np.zeros(0), self._home_z(uav), uav.p_enu)

    def update(self, state: FleetState, relief: Relief | None = None) -> Sequence[Event]:
        """Take in the altitudes of one moment; returns what an operator should know.

        Args:
            state: the fleet.
            relief: heights of a terrain file, to which all others are then relative; None without one.
        """
        uav = state.uav
        if not math.isfinite(uav.p_enu[2]):
            return ()
        home_z = self._home_z(uav)
        if math.isfinite(home_z) and abs(uav.height_m) < TAKEOFF_M:
            self._takeoff_en = uav.p_enu[:2]
        used = state.valid & np.isfinite(state.up_std_m)
        takeoff_en = uav.p_enu[:2] if self._takeoff_en is None else self._takeoff_en
        places = np.concatenate([uav.p_enu[None, :2], takeoff_en[None], state.p_enu[:, :2]])
        rise = relief.heights(places) if relief is not None else np.zeros(len(places))
        covered = bool(np.isfinite(rise[:2]).all() and np.isfinite(rise[2:][used]).all())
        if not covered:
            relief, rise = None, np.zeros(len(places))
        n, dt = len(state.system_id), (state.t_us - self._t_us) * 1e-6
        if len(self._moments) != n or dt < 0.0 or (relief is None) != (self._relief is None):
            self._moments, dt = np.zeros((n, 4, 4)), LONGEST_SAMPLE_S
        self._t_us, self._relief = state.t_us, relief
        above = state.p_enu - rise[2:, None] * np.array([0.0, 0.0, 1.0])
        x = np.column_stack([np.ones(n), np.where(used[:, None], above, 0.0)]) * used[:, None]
        self._moments *= math.exp(-dt / MEMORY_S)
        first = self._moments[:, 0, 0] == 0.0
        weight = np.where(first, LONGEST_SAMPLE_S, min(dt, LONGEST_SAMPLE_S))
        self._moments += weight[:, None, None] * x[:, :, None] * x[:, None, :]
        std_m = np.where(used, state.up_std_m, np.nan)
        uav_enu, home_z = uav.p_enu - rise[0] * np.array([0.0, 0.0, 1.0]), home_z - float(rise[1])
        measured = self._measured(uav, rise, home_z, relief)
        found, ago_us = self._found, state.t_us - self._found_us
        if (
            found is None
            or self._jumps
            or not 0 <= ago_us < FIND_EVERY_US
            or (found.relief is None) != (relief is None)
        ):
            found = find_ground(self._moments, std_m, home_z, uav_enu, measured, relief, self._left_out, self._home)
            self._found, self._found_us = found, state.t_us
            if self._leave_out_above(uav):
                found = find_ground(self._moments, std_m, home_z, uav_enu, measured, relief, self._left_out, self._home)
                self._found = found
            if found.divided and not self._divided_reported:
                self._divided_reported = True
                self._news.append(f"{ALTITUDES} contradict each other: they are not used for the height of the ground")
        ground = self._follow(found, dt)
        if len(self._bumps.heights_m) != n or self.step_m:
            # bumps are what differs from the mean above the same ground
            self._bumps = VehicleRelief(n)
        plane = ground.height_at(np.where(used[:, None], state.p_enu, 0.0))
        self._bumps.update(np.where(used, state.p_enu[:, 2] - plane, np.nan), dt)
        bumps = dict(zip(state.system_id.tolist(), self._bumps.heights_m.tolist(), strict=True))
        self.ground = replace(ground, bumps=bumps)
        uav_id = state.vehicles[0].system_id
        news, self._news = self._news, []
        return (
            *(Event(t_us=state.t_us, level="warning", kind="camera", text=text, system_id=uav_id) for text in news),
            *self._outside(state.t_us, covered, uav_id),
            *self._gaps(state.t_us, float(uav.p_enu[2]), found, uav_id),
        )

    def _measured(
        self, uav: UavState, rise: FloatArray, home_z: float, relief: Relief | None
    ) -> list[tuple[HeightSource, FloatArray]]:
        """Heights of the ground that something measures, each with its place (2,).

        Args:
            uav: it and what it reports.
            rise: of the relief below it, and where it took off.
            home_z: of the plane that it took off from, above the relief.
            relief: of a terrain file.
        """
        measured = [(replace(source, z=source.z - float(rise[0])), uav.p_enu[:2]) for source in _below_uav(uav)]
        if relief is not None and self._takeoff_en is not None and math.isfinite(home_z):
            measured.append((HeightSource(name=self._home, z=home_z, std_m=ON_FILE_STD_M), self._takeoff_en))
        if self._film is not None:
            source, place_en = self._film
            measured.append((replace(source, z=source.z - float(rise[1])), place_en))
        return measured

    def _follow(self, found: GroundSurface, dt: float) -> GroundSurface:
        """The ground, moved towards what is found, ``dt`` seconds later; at once where a source was left out."""
        before, jumps = self.ground, self._jumps
        self.step_m, self._jumps = 0.0, False
        if before is None:
            return found
        if jumps:
            self.step_m = found.z - float(before.height_at(found.at[None])[0])
            return found
        return _blend(before, found, 1.0 - math.exp(-dt / SMOOTHING_S))

    def compare_with_film(self, error_m: float, std_m: float) -> None:
        """Leave out the sources that the film contradicts; the next ground is taken at once.

        Args:
            error_m: by how much the camera is higher above the ground than by ``ground``, as the film shows.
            std_m: 1σ of that.
        """
        if self.ground is None or self._found is None:
            return
        z = self.ground.z - error_m
        if all(source.contradicts(z, std_m) for source in self._found.sources):
            self._film = HeightSource(name=FILM, z=z, std_m=max(std_m, FILM_STD_M)), self._found.at
        self._leave_out(lambda source: source.contradicts(z, std_m), z, FILM)

    def _leave_out_above(self, uav: UavState) -> bool:
        """Leave out sources by which a UAV that flies is in the ground; whether there are any."""
        uav_z, before = float(uav.p_enu[2]), len(self._left_out)
        if not math.isfinite(self._home_z(uav)):
            sources = self._found.sources if self._found else ()
            if len(sources) == 1 and sources[0].z > uav_z - MIN_HEIGHT_M:
                self._left_out.add(sources[0].name)
                self._news.append(
                    f"{sources[0].name} put the UAV into the ground: another datum? Their level is not used, "
                    f"{GUESS_M:.0f} m above the ground is guessed until the film tells"
                )
        elif uav.height_m > FLYING_M:
            self._leave_out(lambda source: source.z > uav_z - MIN_HEIGHT_M, uav_z - uav.height_m, self._home)
        return len(self._left_out) > before

    def _leave_out(self, is_wrong: Callable[[HeightSource], bool], z: float, witness: str) -> None:
        """Leave out sources, unless nothing would be left; ``z``: the ground by what contradicts them."""
        sources = self._found.sources if self._found else ()
        wrong = [source for source in sources if is_wrong(source)]
        if len(wrong) == len(sources) and self._film is None:
            return
        for source in wrong:
            self._left_out.add(source.name)
            self._since_us.pop(source.name, None)
            off = f"{abs(source.z - z):.0f} m too {'high' if source.z > z else 'low'} by {witness}"
            if source.name == ALTITUDES:
                self._news.append(f"{source.name} are {off}: another datum? Their level is not used")
            else:
                self._news.append(f"{source.name} is {off}: it is not used for the height of the ground")
        self._jumps |= bool(wrong)

    def _outside(self, t_us: int, covered: bool, uav_id: int) -> Sequence[Event]:
        """An event once the fleet is where the terrain file has no heights."""
        if covered or self._outside_reported:
            return ()
        self._outside_reported = True
        text = "the terrain file has no heights where the fleet is: it is not used there"
        return (Event(t_us=t_us, level="warning", kind="camera", text=text, system_id=uav_id),)

    def _gaps(self, t_us: int, uav_z: float, found: GroundSurface, uav_id: int) -> Sequence[Event]:
        """An event for sources that differ from what is used by more than they may."""
        new = []
        for source in found.sources:
            gap_m = source.z - found.z
            if abs(gap_m) < max(GAP_M, OUTLIER_STDS * min(source.std_m, found.std_m)):
                self._since_us.pop(source.name, None)
                continue
            lasts_us = t_us - self._since_us.setdefault(source.name, t_us)
            if lasts_us >= GAP_LASTS_US and abs(gap_m - self._reported_m.get(source.name, 0.0)) > REPORT_GAP_M:
                self._reported_m[source.name] = gap_m
                new.append(source)
        if not new:
            return ()
        heights = ", ".join(f"{source.name} {uav_z - source.z:.0f} m" for source in found.sources)
        text = f"sources of the height above ground disagree: {heights}; {uav_z - found.z:.0f} m is used"
        return (Event(t_us=t_us, level="warning", kind="camera", text=text, system_id=uav_id),)


def _below_uav(uav: UavState) -> tuple[HeightSource, ...]:
    """The ground below the UAV as what it carries measures it."""
    # d along the body's vertical axis: the ground is d cos(tilt) lower; R_enu_body[2, 2] = −cos(tilt)
    upright = -float(uav.R_enu_body[2, 2]) if uav.attitude_valid else 1.0
    found = (
        HeightSource(name="the rangefinder", z=float(uav.p_enu[2]) - uav.range_m * upright, std_m=RANGE_STD_M),
        HeightSource(
            name="the autopilot's terrain map",
            z=float(uav.p_enu[2]) - uav.terrain_height_m,
            std_m=TERRAIN_STD_M,
        ),
    )
    return tuple(source for source in found if math.isfinite(source.z))


def find_ground(
    moments: FloatArray,
    std_m: FloatArray,
    home_z: float,
    uav_enu: FloatArray,
    measured: Sequence[tuple[HeightSource, FloatArray]] = (),
    relief: Relief | None = None,
    left_out: Collection[str] = (),
    home: str = TAKEOFF,
) -> GroundSurface:
    """The most probable ground; all heights are above the relief where there is one.

    Args:
        moments: (n, 4, 4) Σ x xᵀ of each vehicle's samples, x = (1, east, north, up), metres.
        std_m: (n,) 1σ of its altitude, NaN where it has none now.
        home_z: Height of the plane that the UAV took off from, NaN unknown.
        uav_enu: (3,) where the UAV is.
        measured: Heights of the ground at places (2,).
        relief: Heights of a terrain file.
        left_out: names of sources that do not count; of the vehicles' altitudes only their level does not.
        home: what the UAV's height is counted from, in words.
    """
    slope_std = SLOPE_STD if relief is None else RELIEF_SLOPE_STD
    known = np.flatnonzero((moments[:, 0, 0] > 0.0) & np.isfinite(std_m))
    mean = moments[known, 0, 1:] / moments[known, 0, :1]
    level = home_z if math.isfinite(home_z) else float(uav_enu[2]) - GUESS_M
    near = _near_median(mean[:, 2], level)
    divided = len(mean) > 2 and 2 * int(np.count_nonzero(near)) <= len(mean)
    known, mean = (known[:0], mean[:0]) if divided else (known[near], mean[near])
    at = mean[:, :2].mean(axis=0) if len(known) else uav_enu[:2].copy()
    plane, cov = np.array([level, 0.0, 0.0]), np.diag([UNKNOWN_VAR, slope_std**2, slope_std**2])
    while len(known):
        fitted, fitted_cov = _fit_plane(moments[known], std_m[known], np.array([*at, level]), slope_std)
        fitted[0] += level
        gap = np.abs(mean[:, 2] - fitted[0] - (mean[:, :2] - at) @ fitted[1:])
        gap /= np.hypot(std_m[known], RELIEF_STD_M)
        if gap.max() < OUTLIER_STDS:
            plane, cov = fitted, fitted_cov
            break
        kept = np.arange(len(known)) != gap.argmax()
        known, mean = known[kept], mean[kept]
    cov[0, 0] += UNKNOWN_VAR if ALTITUDES in left_out else UAV_ALTITUDE_STD_M**2
    sources = []
    if len(known) and ALTITUDES not in left_out:
        sources.append(HeightSource(name=ALTITUDES, z=float(plane[0]), std_m=math.sqrt(cov[0, 0])))
    for source, place_en in (*measured, *([(FILE, at)] if relief is not None else [])):
        if source.name in left_out:
            continue
        h = np.array([1.0, *(place_en - at)])
        there = float(plane[0] + source.z - h @ plane)
        sources.append(
            HeightSource(name=source.name, z=there, std_m=math.hypot(source.std_m, slope_std * np.hypot(*h[1:])))
        )
        plane, cov = _with_height(plane, cov, h, source)
    z, var = float(plane[0]), float(cov[0, 0])
    datums_m: tuple[float, ...] = ()
    if math.isnan(home_z):
        if not sources:
            sources.append(HeightSource(name=GUESS, z=level, std_m=GUESS_STD_M))
            z, var = level, GUESS_STD_M**2
        if [source.name for source in sources] in ([ALTITUDES], [GUESS]):
            datums_m = tuple(m for m in DATUMS_M if uav_enu[2] - z + m > MIN_HEIGHT_M)
    elif home not in [*left_out, *(source.name for source in sources)]:
        sources.append(HeightSource(name=home, z=home_z, std_m=float(HOME_STDS_M[0])))
        z, var = _with_home(z, var, home_z)
    rise = float(relief.heights(at[None])[0]) if relief is not None else 0.0
    above_sea = tuple(replace(source, z=source.z + rise) for source in sources)
    return GroundSurface(
        at=at,
        z=z + rise,
        slope=plane[1:],
        std_m=math.sqrt(var),
        sources=above_sea,
        datums_m=datums_m,
        relief=relief,
        divided=divided,
    )


def _near_median(z: FloatArray, home_z: float) -> NDArray[np.bool_]:
    """Mask of the altitudes that agree with most of them; of two, the one nearer to the home plane is the median."""
    votes = np.append(z, home_z) if len(z) == 2 else z
    return np.asarray(np.abs(z - np.median(votes)) < OUTLIER_M) if len(z) else np.zeros(0, np.bool_)


def _fit_plane(
    moments: FloatArray, std_m: FloatArray, about: FloatArray, slope_std: float
) -> tuple[FloatArray, FloatArray]:
    """Height above a point and slope (3,) of the plane through some vehicles, and their covariance (3, 3).

    With y = (1, e, n) about the point, w samples of unit weight and b_j ~ N(0, σ_j²) integrated out, a vehicle adds

        A = (Σ y yᵀ − k Σy Σyᵀ) / σ²,    a = (Σ y z − k Σy Σz) / σ²,    k = 1 / (w + σ²/σ_j²)

    Args:
        moments: (n, 4, 4) of each.
        std_m: (n,) σ_j.
        about: (3,) the point.
        slope_std: 1σ of the slope per axis.
    """
    shift = np.eye(4)
    shift[1:, 0] = -about
    m = shift @ moments @ shift.T
    k = 1.0 / (m[:, 0, 0] + (RELIEF_STD_M / std_m) ** 2)
    within = (m - k[:, None, None] * m[:, :, :1] * m[:, :1, :]).sum(axis=0) / RELIEF_STD_M**2
    covariance = np.linalg.inv(within[:3, :3] + np.diag([0.0, slope_std**-2, slope_std**-2]))
    return covariance @ within[:3, 3], covariance


def _with_height(
    plane: FloatArray, cov: FloatArray, h: FloatArray, source: HeightSource
) -> tuple[FloatArray, FloatArray]:
    """Kalman update of the plane (3,) by its height h·plane at one place; left out where it contradicts the rest."""
    innovation, var = source.z - h @ plane, h @ cov @ h + source.std_m**2
    if innovation**2 > OUTLIER_STDS**2 * var:
        return plane, cov
    gain = cov @ h / var
    return plane + gain * innovation, cov - np.outer(gain, h @ cov)


def _with_home(z: float, var: float, home_z: float) -> tuple[float, float]:
    """Mean and variance of the ground's height: N(z, var) times the mixture about the home plane."""
    if var >= UNKNOWN_VAR:
        return home_z, HOME_ALONE_STD_M**2
    total = var + HOME_STDS_M**2
    log_share = np.log(HOME_SHARES) - 0.5 * np.log(total) - 0.5 * (home_z - z) ** 2 / total
    share = np.exp(log_share - log_share.max())
    share /= share.sum()
    # product of N(z, var) and N(home, S²): mean (z S² + home var) / (var + S²), variance var S² / (var + S²)
    means = (z * HOME_STDS_M**2 + home_z * var) / total
    mean = float(share @ means)
    return mean, float(share @ (var * HOME_STDS_M**2 / total + (means - mean) ** 2))


def _blend(before: GroundSurface, now: GroundSurface, share: float) -> GroundSurface:
    """The plane before moved towards the one that is found now."""
    z, slope = float(before.height_at(now.at[None])[0]), before.slope
    return GroundSurface(
        at=now.at,
        z=z + share * (now.z - z),
        slope=slope + share * (now.slope - slope),
        std_m=math.hypot(now.std_m, (1.0 - share) * (now.z - z)),
        sources=now.sources,
        datums_m=now.datums_m,
        relief=now.relief,
    )
