"""Simulated flights, as recorded and as ``gcs import`` makes them of a drone's subtitles.

Boxes are modelled, no film is drawn.
"""

from __future__ import annotations

import shutil
import struct
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np

from gcs.importing.camera_choice import CameraOptions, choose_camera
from gcs.importing.film import ImportedFilm
from gcs.importing.fleet_clock import FilmBoxes, FilmedFleetLogs, find_fleet_clock
from gcs.importing.fleet_log import open_fleet
from gcs.importing.formats.dji_srt import log_of_cues
from gcs.importing.formats.subtitles import cues_of
from gcs.importing.messages import vehicle_records
from gcs.importing.smoothing import filled_in
from gcs.importing.vehicle_log import VehicleLog
from gcs.mission.mission import Clock, Mission, MissionVehicle
from gcs.session.metadata import mission_table
from infra.session_format import DETECTIONS, FRAMES, LOG, METADATA, TRUTH
from mavlink.tlog.log import Tlog
from sim.session import frame_times, write_session
from sim.telemetry.detections import DetectorModel
from sim.telemetry.sensors import Sensors
from sim.world.earth import to_geodetic
from sim.world.scenario import (
    UAV_ID,
    Gnss,
    Scenario,
    ScenarioAttitude,
    ScenarioCamera,
    ScenarioDetector,
    ScenarioFlight,
    ScenarioGround,
)
from sim.world.world import World
from vision.detect.detections import Detections

FlightKind = Literal["hover", "straight", "winding", "orbit"]
FLIGHTS: tuple[FlightKind, ...] = ("hover", "straight", "winding", "orbit")
LAYOUTS: dict[str, tuple[int, float]] = {"six decimals": (6, 0.1), "five decimals": (5, 0.1), "four decimals": (4, 1.0)}
"""Decimals of a degree, and seconds from one subtitle to the next."""
OWN_S = (0.1, 1.1)
"""By how much a vehicle's own clock is ahead."""
SEARCH_S = 0.25
"""Between frames in which the clock is searched."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordedFlight:
    """A flight of the simulator."""

    scenario: Scenario
    world: World
    session: Path
    """As the station would have recorded it."""

    def imported(self, layout: str, folder: Path, ahead_s: float | None, above_m: float | None = None) -> Path:
        """The session that an import makes.

        Args:
            layout: of ``LAYOUTS``.
            folder: must not exist.
            ahead_s: by how much the fleet's clock is ahead of the film's, which is searched; None: told to be none.
            above_m: only altitudes are known, and are so much too high, as those above an ellipsoid; None: heights.

        Raises:
            ImportFileError: the clock is not found.
        """
        t, stamps_us = frame_times(self.scenario)
        uav, home_m = self._log(*LAYOUTS[layout], int(stamps_us[0])), 0.0
        if above_m is not None:
            places, home_m = uav.places, self.scenario.altitude_m
            height_m = np.full(len(places), np.nan)
            uav = replace(uav, places=replace(places, alt_m=places.alt_m + above_m, height_m=height_m))
        camera = self.scenario.camera
        film = ImportedFilm(
            path=Path("film.mp4"),
            elapsed_us=stamps_us - stamps_us[0],
            width=camera.width,
            height=camera.height,
            created_us=0,
            model="",
        )
        fov_deg = float(np.degrees(2.0 * np.arctan(0.5 * camera.width / camera.fx)))
        pitch_deg = None if camera.pitch_deg == -90.0 else camera.pitch_deg
        chosen, log = choose_camera(
            film,
            replace(uav, places=filled_in(uav.places)),
            CameraOptions(fov_deg=fov_deg, pitch_deg=pitch_deg),
        )
        assert log is not None
        mission = Mission(
            uav=MissionVehicle(system_id=UAV_ID),
            ugv=tuple(MissionVehicle(system_id=i) for i in self.scenario.ugv_ids),
            camera=chosen.camera,
            clock=Clock(video_offset_s="auto"),
        )
        shift_us = 0 if ahead_s is None else round(ahead_s * 1e6)
        found_us = 0 if ahead_s is None else self._found_us(mission, log, shift_us, t, stamps_us)
        folder.mkdir()
        records = [(p.t_us + shift_us, p.raw) for p in self._tlog().packets(system_ids=self.scenario.ugv_ids)]
        records += vehicle_records(log, UAV_ID, int(stamps_us[0]) + found_us, flies=True, home_m=home_m)
        records.sort(key=lambda record: record[0])
        (folder / LOG).write_bytes(b"".join(struct.pack(">Q", t_us) + raw for t_us, raw in records))
        rows = "".join(f"{k},{stamp + found_us}\n" for k, stamp in enumerate(stamps_us.tolist()))
        (folder / FRAMES.name).write_text(FRAMES.header + rows)
        (folder / METADATA).write_text(mission_table(mission, {"format": 1}))
        for name in (DETECTIONS.name, TRUTH.name):
            shutil.copyfile(self.session / name, folder / name)
        return folder

    def with_own_clocks(self, folder: Path) -> Path:
        """The session, its ground vehicles' clocks ahead by 0.1 to 1.1 s, each by its own.

        Args:
            folder: must not exist.
        """
        ids = self.scenario.ugv_ids
        rng = np.random.default_rng(self.scenario.seed)
        ahead_us = dict(zip(ids, np.rint(rng.uniform(*OWN_S, len(ids)) * 1e6).astype(int).tolist(), strict=True))
        shutil.copytree(self.session, folder)
        records = sorted((p.t_us + ahead_us.get(p.system_id, 0), p.raw) for p in self._tlog().packets())
        (folder / LOG).write_bytes(b"".join(struct.pack(">Q", t_us) + raw for t_us, raw in records))
        return folder

    def _tlog(self) -> Tlog:
        return Tlog.open(self.session / LOG)

    def _log(self, decimals: int, step_s: float, zero_us: int) -> VehicleLog:
        """The UAV's, from the text of subtitles."""
        made = self.scenario
        t = np.arange(0.0, made.duration_s, step_s)
        p = Sensors(self.world).uav(t, "position").p_enu
        lat, lon, alt = to_geodetic(p, made.latitude_deg, made.longitude_deg, made.altitude_m)
        lines = []
        for k, now in enumerate(t.tolist()):
            place = f"[latitude: {lat[k]:.{decimals}f}] [longitude: {lon[k]:.{decimals}f}]"
            stamp = f"{int(now // 60):02d}:{int(now % 60):02d},{round(now % 1 * 1000):03d}"
            lines += [f"00:{stamp} --> 00:{stamp}", f"{place} [rel_alt: {p[k, 2]:.3f} abs_alt: {alt[k]:.3f}]", ""]
        return replace(log_of_cues("film.srt", cues_of(lines)), zero_us=zero_us)

    def _found_us(self, mission: Mission, log: VehicleLog, shift_us: int, t: np.ndarray, stamps_us: np.ndarray) -> int:
        shifted = self.session.parent / "fleet.tlog"
        packets = self._tlog().packets(system_ids=self.scenario.ugv_ids)
        shifted.write_bytes(b"".join(struct.pack(">Q", p.t_us + shift_us) + p.raw for p in packets))
        fleet = open_fleet(shifted)
        records = vehicle_records(log, UAV_ID, int(stamps_us[0]), flies=True, home_m=0.0)
        model, rows = DetectorModel(self.world), np.arange(0, len(t), round(SEARCH_S * self.scenario.fps))
        values = [model.detect(float(t[k])).values.T for k in rows]
        names = ("cx", "cy", "w", "h", "angle", "score", "heading")
        boxes = FilmBoxes(
            t_us=stamps_us[rows],
            boxes=[Detections(**dict(zip(names, each, strict=True))) for each in values],
            size=(self.scenario.camera.width, self.scenario.camera.height),
        )
        logs = FilmedFleetLogs(
            mission=mission,
            uav=lambda: records,
            uav_with_fleet=False,
            fleet={i: fleet.places(i) for i in fleet.ground},
        )
        return round(find_fleet_clock([boxes], logs, (-np.inf, np.inf)).ahead_s * 1e6)


def scenario(kind: FlightKind, seed: int, length_s: float) -> Scenario:
    """Three to eight vehicles under a UAV that hovers, follows along a road, or flies round them."""
    rng = np.random.default_rng((seed, FLIGHTS.index(kind)))
    moving = kind in ("straight", "winding")
    grounds = {"hover": "open", "straight": "straight", "winding": "curved", "orbit": "open"}
    return Scenario(
        name=kind,
        seed=seed,
        duration_s=length_s,
        ground=ScenarioGround(
            kind=grounds[kind],  # type: ignore[arg-type]
            vehicles=int(rng.integers(3, 9)),
            speed_mps=float(rng.uniform(2.0, 6.0)),
            spacing_m=float(rng.uniform(7.0, 12.0)),
            road_deg=float(rng.uniform(0.0, 360.0)),
        ),
        flight=ScenarioFlight(
            height_m=float(rng.uniform(40.0, 70.0)),
            follow=moving or kind == "orbit",
            sway_m=float(rng.uniform(0.3, 2.0)),
            yaw_deg=float(rng.uniform(-180.0, 180.0)),
            yaw_rate_dps=float(rng.choice([-4.0, 4.0])) if kind == "orbit" else 0.0,
        ),
        camera=ScenarioCamera(pitch_deg=-55.0 if kind == "orbit" else -90.0),
        gnss=Gnss(uav_bias_m=float(rng.uniform(0.2, 1.5)), bias_m=float(rng.uniform(0.3, 1.0))),
        attitude=ScenarioAttitude(
            tilt_pitch_deg=float(rng.normal(0.0, 0.5)),
            tilt_roll_deg=float(rng.normal(0.0, 0.5)),
        ),
        detector=ScenarioDetector(miss=0.05, clutter=float(rng.choice([0.0, 0.2]))),
    )


def recorded(kind: FlightKind, seed: int, length_s: float, folder: Path, *, others: bool = False) -> RecordedFlight:
    """Fly and record into ``folder/flown``; with ``others`` the film is that of another flight."""
    made = scenario(kind, seed, length_s)
    film = replace(scenario(kind, seed + 100_000, length_s), camera=made.camera) if others else None
    world = write_session(made, folder / "flown", film=film)
    return RecordedFlight(scenario=made, world=world, session=folder / "flown")
