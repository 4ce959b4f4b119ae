"""The mission file: who flies, what camera films, how clocks relate. TOML in, frozen dataclasses out.

Every key has a default but the vehicles' ids; an unknown key is refused with the nearest name, since a misspelt key
would otherwise fly with the default. Angles are degrees in the file (``_deg``), everything inside the program is
radians.
"""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from msgspec import Meta

from gcs.errors import ConfigError
from gcs.limits import Limits, Share
from gcs.mission.fence import Fence
from gcs.mission.mast import MAST_ID, Mast, check_mount
from infra.files.safe_open import read_small
from infra.session_format import METADATA
from infra.toml_tables import MAX_TOML_BYTES, build, parse_toml
from vision.camera.intrinsics import Intrinsics
from vision.camera.lens_file import NUMBERS, read_lens
from vision.errors import CameraError

BUNDLED = "bundled"
"""Word in place of a path for the model that comes with the program."""
NO_KEYS = "none"
"""Word in place of a folder of keys: signatures are not looked at."""

SystemId = Annotated[int, Meta(ge=1, le=255)]
Pixels = Annotated[int, Meta(ge=16, le=16384)]
"""Width or height of an image; none is smaller or larger."""
FocalPx = Annotated[float, Meta(ge=1.0, le=1e6)]
Number = Annotated[float, Meta(ge=-1e9, le=1e9)]
"""Number that any computation survives."""
DeviceId = Annotated[int, Meta(ge=0, le=255)]
MessageId = Annotated[int, Meta(ge=0, le=0xFFFFFF)]
"""MAVLink 2 has three bytes for it."""
_NOTES = "session"
"""The table that the recorder adds to session.toml; it describes, it does not steer."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MissionVehicle:
    """One vehicle of the mission."""

    system_id: SystemId
    """MAVLink system id, 1..255."""
    name: str = ""
    """Name that operators use; ``UAV`` or ``UGV-<id>`` when empty."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Camera:
    """The UAV's camera and how it hangs. A pinhole with OpenCV's five distortion coefficients, by numbers or by a lens
    file; with neither, as the UAV reports it."""

    lens: str = ""
    """Path of a lens file, relative to the mission file, instead of the numbers below."""
    name: str = ""
    """Name of the camera; a lens file's name when empty."""
    width: Pixels | None = None
    height: Pixels | None = None
    fx: FocalPx | None = None
    fy: FocalPx | None = None
    cx: Number | None = None
    cy: Number | None = None
    distortion: Annotated[tuple[Number, ...], Meta(min_length=5, max_length=5, description="k1 k2 p1 p2 k3")] = (
        *(0.0, 0.0, 0.0, 0.0, 0.0),
    )
    """k1 k2 p1 p2 k3."""
    zoom: Annotated[float, Meta(ge=0.1, le=200.0)] = 1.0
    """Fixed digital zoom of the video against what is described above."""
    zoom_max: Annotated[float, Meta(ge=1.0, le=200.0)] = 1.0
    """Zoom at 100 % of what CAMERA_SETTINGS reports; 1: its reports are not followed."""
    device: DeviceId = 0
    """Camera of the UAV to listen to, by device id 1-6 or component id; 0: the first."""
    gimbal: DeviceId = 0
    """Gimbal of the UAV, the same way; 0: the camera's, else the first."""
    mount: Literal["stabilized", "fixed", "gimbal"] = "stabilized"
    """``stabilized``: a gimbal holds the horizon, yaw follows the body; ``fixed`` to the body; ``gimbal``: turned in
    flight, as the gimbal reports, and as ``stabilized`` until it does."""
    roll_deg: Annotated[float, Meta(ge=-180.0, le=180.0)] = 0.0
    """Roll of the mount, deg; with a gimbal the angle by which the image is turned against it."""
    pitch_deg: Annotated[float, Meta(ge=-180.0, le=90.0)] = -90.0
    """-90 looks straight down; below that the picture's top looks backwards."""
    yaw_deg: Annotated[float, Meta(ge=-360.0, le=360.0)] = 0.0
    """Relative to the body's nose."""

    def __post_init__(self) -> None:
        missing = [name for name in NUMBERS if getattr(self, name) is None]
        if self.lens and (len(missing) < len(NUMBERS) or any(self.distortion)):
            raise ValueError("lens replaces width, height, fx, fy, cx, cy and distortion; leave those out")
        if not self.lens and 0 < len(missing) < len(NUMBERS):
            raise ValueError(f"{missing[0]} is missing; give {', '.join(NUMBERS)}, or a lens file, or none")

    @property
    def intrinsics(self) -> Intrinsics | None:
        """Intrinsics that the numbers describe, None without numbers."""
        width, height, fx, fy, cx, cy = (getattr(self, name) for name in NUMBERS)
        if width is None:
            return None
        return Intrinsics(width=width, height=height, fx=fx, fy=fy, cx=cx, cy=cy, distortion=np.array(self.distortion))


@dataclass(frozen=True, slots=True, kw_only=True)
class Clock:
    """Relation of the video's clock to the telemetry's."""

    video_offset_s: Annotated[float, Meta(ge=-60.0, le=60.0)] | Literal["auto"] = 0.0
    """Video time minus telemetry time; ``auto`` has it estimated."""

    @property
    def declared_offset_s(self) -> float:
        """Video time minus telemetry time as far as it is declared, 0 where it is estimated."""
        return 0.0 if self.video_offset_s == "auto" else float(self.video_offset_s)


@dataclass(frozen=True, slots=True, kw_only=True)
class DetectorChoice:
    """Choice of the network that finds vehicles."""

    model: str = ""
    """Path of an ONNX file, relative to the mission file; empty: the bundled model."""
    score: Share = 0.3
    """Boxes from here on count; weaker ones, from 0.1 on, only continue tracks that are confirmed."""
    classes: tuple[str, ...] = ()
    """Names of a YOLO model's classes that count; empty: those that sound like road vehicles."""
    imgsz: Annotated[int, Meta(ge=0, le=8192)] = 0
    """Longest side, px, of the input of a YOLO model of any size; 0: by the model's metadata, else 1024."""
    tiled: bool = True
    """Large images are looked at by a YOLO model in tiles where vehicles would become too small."""
    providers: tuple[str, ...] = ()
    """onnxruntime's execution providers, best first; empty: the CPU."""
    front: str = ""
    """Network that finds the fronts of boxes without one: path of an ONNX file, relative to the mission file, or
    ``bundled``; empty: none."""
    front_sure: Share = 0.8
    """Fronts of a lower probability are left unknown."""


@dataclass(frozen=True, slots=True, kw_only=True)
class IdentityChoice:
    """Choice of when a box gets a name."""

    threshold: Share = 0.7
    """A name is shown and written at this confidence or above."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Links:
    """Sources of telemetry and video in flight; the command line overrides both."""

    telemetry: tuple[str, ...] = ()
    video: str = ""
    forward: tuple[str, ...] = ()
    """Links on which packets go out again, as they came, to other programs."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SigningChoice:
    """Choice of the signatures that are required."""

    keys: str = ""
    """Folder of keys, relative to the mission file; empty: the user's own, where there is one; ``none``: no keys."""
    unsigned: tuple[MessageId, ...] = (109,)
    """Ids of messages that may come unsigned, 109 is a modem's RADIO_STATUS; none about a vehicle can be."""
    keyless: Literal["refused", "open"] = "refused"
    """Treatment of systems that have no key while others have."""

    @property
    def folder(self) -> Path | None:
        """Folder of the keys, None for flights without."""
        return Path(self.keys) if self.keys not in ("", NO_KEYS) else None


@dataclass(frozen=True, slots=True, kw_only=True)
class MapChoice:
    """Choice of what is under the map."""

    tiles: str = ""
    """Path of an MBTiles file, relative to the mission file; empty: nothing."""
    terrain: str = ""
    """Path of a GeoTIFF of elevations, likewise; empty: none."""
    takeoff_known: bool = True
    """False: the UAV's height above its take-off was made from altitudes, so that it is no second witness of them."""


@dataclass(frozen=True, slots=True, kw_only=True)
class View:
    """A further camera over the same fleet, on an aircraft of its own or on a mast."""

    system_id: Annotated[int, Meta(ge=0, le=255)] = 0
    """MAVLink system id of the aircraft that carries it; of one on a mast, from ``MAST_ID`` on, by its mission."""
    name: str = ""
    """Name that operators call that aircraft by; ``UAV-<id>`` when empty."""
    mast: Mast | None = None
    """The mast that it is on; None: on an aircraft."""
    camera: Camera | None = None
    """Camera of the view; None: as the aircraft reports it."""
    clock: Clock = field(default_factory=Clock)
    video: str = ""
    """Source of its video in flight, as ``[links] video``; the command line overrides it."""

    def __post_init__(self) -> None:
        if self.mast is None and not self.system_id:
            raise ValueError("system_id is missing; give that of the aircraft that carries the camera, or its mast")
        if self.mast is not None and 0 < self.system_id < MAST_ID:
            raise ValueError("system_id is of an aircraft; a camera on a mast has none")
        check_mount(self.mast, self.camera.mount if self.camera else "")


@dataclass(frozen=True, slots=True, kw_only=True)
class Mission:
    """Configuration of a flight or a replay: who flies, and how."""

    uav: MissionVehicle = MissionVehicle(system_id=MAST_ID)
    """The aircraft with the first camera."""
    ugv: tuple[MissionVehicle, ...]
    mast: Mast | None = None
    """The mast that the first camera is on; None: on ``uav``."""
    camera: Camera | None = None
    """None: taken from the UAV's CAMERA_INFORMATION or CAMERA_FOV_STATUS once received."""
    clock: Clock = field(default_factory=Clock)
    view: tuple[View, ...] = ()
    """The other cameras; ``uav`` or ``mast``, ``camera`` and ``clock`` are the first."""
    detector: DetectorChoice = field(default_factory=DetectorChoice)
    identity: IdentityChoice = field(default_factory=IdentityChoice)
    links: Links = field(default_factory=Links)
    signing: SigningChoice = field(default_factory=SigningChoice)
    limits: Limits = field(default_factory=Limits)
    fence: tuple[Fence, ...] = ()
    map: MapChoice = field(default_factory=MapChoice)

    def __post_init__(self) -> None:
        check_mount(self.mast, self.camera.mount if self.camera else "")
        if self.mast:
            object.__setattr__(self, "uav", replace(self.uav, name=self.uav.name or self.mast.name))
        numbered = (
            view if view.system_id else replace(view, system_id=MAST_ID + k) for k, view in enumerate(self.view, 1)
        )
        object.__setattr__(self, "view", tuple(numbered))
        ids = Counter(self.system_ids)
        twice = sorted(i for i, count in ids.items() if count > 1)
        if twice:
            raise ValueError(f"system id {twice[0]} is given to two vehicles; every vehicle needs its own")
        strangers = sorted({i for fence in self.fence for i in fence.vehicles} - set(ids))
        if strangers:
            raise ValueError(f"a fence is for system id {strangers[0]}, which is no vehicle of this mission")
        called = Counter(map(self.name_of, self._cameras))
        if alike := sorted(name for name, count in called.items() if count > 1):
            raise ValueError(f"two cameras are called {alike[0]}; give each aircraft and mast a name of its own")

    @property
    def ugv_ids(self) -> tuple[int, ...]:
        """System ids of the ground vehicles, in the order of the file."""
        return tuple(v.system_id for v in self.ugv)

    @property
    def system_ids(self) -> tuple[int, ...]:
        """System ids of all who fly and drive: the aircraft with cameras first."""
        return (*(each for each in self._cameras if each < MAST_ID), *self.ugv_ids)

    @property
    def _cameras(self) -> tuple[int, ...]:
        """System ids of what carries a camera, masts too, in the order of the file."""
        return (self.uav.system_id, *(view.system_id for view in self.view))

    @property
    def views(self) -> tuple[Mission, ...]:
        """The mission as each camera has it: with that one as the first, and the others as further views."""
        uav = self.uav
        first = View(
            system_id=uav.system_id,
            name=self.name_of(uav.system_id),
            mast=self.mast,
            camera=self.camera,
            clock=self.clock,
            video=self.links.video,
        )
        every = (first, *self.view)
        return tuple(
            replace(
                self,
                uav=MissionVehicle(system_id=view.system_id, name=self.name_of(view.system_id)) if k else uav,
                mast=view.mast,
                camera=view.camera,
                clock=view.clock,
                links=replace(self.links, video=view.video),
                view=every[:k] + every[k + 1 :],
            )
            for k, view in enumerate(every)
        )

    @property
    def follows_gimbal(self) -> bool:
        """True if the camera's direction is the gimbal's reported one."""
        return self.camera is None or self.camera.mount == "gimbal"

    @property
    def tiles(self) -> Path | None:
        """File of the map's tiles, None without any."""
        return Path(self.map.tiles) if self.map.tiles else None

    @property
    def terrain(self) -> Path | None:
        """File of the ground's elevations, None without any."""
        return Path(self.map.terrain) if self.map.terrain else None

    def name_of(self, system_id: int) -> str:
        """Name of a vehicle of this mission, a default for any other id."""
        for vehicle in (self.uav, *self.ugv):
            if vehicle.system_id == system_id:
                return vehicle.name or usual_name(system_id, films=vehicle is self.uav)
        for view in self.view:
            if view.system_id == system_id:
                on_mast = view.mast.name or usual_name(system_id, films=True) if view.mast else ""
                return view.name or on_mast or f"UAV-{system_id}"
        return usual_name(system_id, films=False)


def usual_name(system_id: int, *, films: bool) -> str:
    """Name of a vehicle that was given none."""
    if system_id >= MAST_ID:
        return f"Mast-{system_id - MAST_ID + 1}" if system_id > MAST_ID else "Mast"
    return "UAV" if films else f"UGV-{system_id}"


def load_table(path: Path) -> dict[str, Any]:
    """Read a TOML file.

    Raises:
        ConfigError: no such file, or not TOML.
    """
    try:
        data = read_small(path, MAX_TOML_BYTES)
    except FileNotFoundError:
        raise ConfigError(f"{path}: no such file; give a mission file, or see README for one to start from") from None
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read as text: {error.strerror}") from error
    try:
        return parse_toml(data, str(path))
    except ValueError as error:
        raise ConfigError(str(error)) from None


def load_mission(path: Path) -> Mission:
    """Read a mission or session file; paths in it become absolute, so that they hold wherever it is written again.

    Links and signing of a session file do not count.

    Raises:
        ConfigError: no such file, not TOML, an unknown key, a wrong or missing value.
    """
    table = load_table(path)
    mission = parse_mission(table, str(path))
    if _came_with_a_recording(path, table):
        mission = _without_reach(mission, path)
    camera = _with_lens(mission.camera, path.parent, f"{path}: [camera]")
    views = [replace(v, camera=_with_lens(v.camera, path.parent, f"{path}: [view.camera]")) for v in mission.view]
    signing = replace(mission.signing, keys=keys_folder(mission.signing.keys, path.parent))
    shown = replace(mission.map, tiles=_beside(path, mission.map.tiles), terrain=_beside(path, mission.map.terrain))
    detector = _placed(mission.detector, path.parent)
    return replace(mission, detector=detector, camera=camera, view=tuple(views), signing=signing, map=shown)


def load_mast(path: Path) -> View:
    """Read a camera on a mast from a file of its own, with what a ``[[view]]`` has; its clock is unknown unless told.

    Raises:
        ConfigError: no such file, not TOML, an unknown key, a wrong or missing value.
    """
    table = load_table(path)
    if "mast" not in table:
        raise ConfigError(f"{path}: needs [mast]: where the camera is, and which way it looks")
    _check_pitch(table, f"{path}: [camera]")
    try:
        view = build(View, table, str(path))
    except ValueError as error:
        raise ConfigError(str(error)) from None
    clock = view.clock if "clock" in table else replace(view.clock, video_offset_s="auto")
    return replace(view, clock=clock, camera=_with_lens(view.camera, path.parent, f"{path}: [camera]"))


def unheeded_links(path: Path) -> tuple[str, ...]:
    """Addresses in the file of a recording, which do not count; none of a mission file.

    Raises:
        ConfigError: as of :func:`load_mission`.
    """
    table = load_table(path)
    if not _came_with_a_recording(path, table):
        return ()
    mission = parse_mission(table, str(path))
    links, videos = mission.links, [view.video for view in mission.view]
    return (*links.telemetry, *filter(None, (links.video, *videos)), *links.forward)


def _came_with_a_recording(path: Path, table: Mapping[str, Any]) -> bool:
    return path.name == METADATA or _NOTES in table


def _without_reach(mission: Mission, path: Path) -> Mission:
    """Return the table without what opens addresses, decides who is believed or loads what came along: a recording may
    be anybody's.

    Raises:
        ConfigError: a network lies beside it.
    """
    folder = path.parent.absolute()
    for network in (mission.detector.model, mission.detector.front):
        if network not in ("", BUNDLED) and Path(os.path.normpath(folder / network)).is_relative_to(folder):
            raise ConfigError(
                f"{path}: [detector]: {network} came with the recording and is not opened; where you trust it, name it "
                "in a mission file of your own, with --mission"
            )
    views = tuple(replace(view, video="") for view in mission.view)
    return replace(mission, links=Links(), signing=SigningChoice(), view=views)


def _beside(path: Path, name: str) -> str:
    """A file that a mission file names, as an absolute path; empty for none."""
    return str((path.parent / Path(name).expanduser()).absolute()) if name else ""


def config_folder() -> Path:
    """Folder of the user's own files."""
    return Path(os.environ.get("XDG_CONFIG_HOME") or "~/.config").expanduser() / "rollcall"


def user_keys() -> Path:
    """Return the folder of a user's keys when the mission names none."""
    return config_folder() / "keys"


def keys_folder(text: str = "", folder: Path = Path()) -> str:
    """Folder that ``[signing] keys`` of a file in a folder means: a path, the user's own if there is one, or none."""
    if text == NO_KEYS:
        return text
    if not text:
        return str(user_keys()) if user_keys().is_dir() else ""
    return str((folder / Path(text).expanduser()).absolute())


def _placed(choice: DetectorChoice, folder: Path) -> DetectorChoice:
    """Return the table with absolute paths: a file's are relative to where it lies."""

    def place(text: str) -> str:
        return str((folder / text).absolute()) if text else ""

    front = choice.front if choice.front == BUNDLED else place(choice.front)
    return replace(choice, model=place(choice.model), front=front)


def _with_lens(camera: Camera | None, folder: Path, where: str) -> Camera | None:
    """Return the table with the numbers of its lens file in place of the file's name, so that a session needs no other
    file."""
    if camera is None or not camera.lens:
        return camera
    try:
        lens = read_lens(folder / camera.lens)
    except (CameraError, ValueError) as error:  # a path with a NUL in it is a ValueError
        raise ConfigError(f"{where}: lens {error}") from error
    numbers: dict[str, Any] = {name: getattr(lens, name) for name in NUMBERS}
    distortion = tuple(lens.distortion.tolist())
    return replace(camera, lens="", name=camera.name or Path(camera.lens).name, distortion=distortion, **numbers)


def _check_pitch(table: object, where: str) -> None:
    """Refuse a camera on a mast that looks straight down since nobody said how far down it looks.

    Raises:
        ConfigError: it is one.
    """
    if isinstance(table, Mapping) and "mast" in table:
        camera = table.get("camera", {})
        if isinstance(camera, Mapping) and "pitch_deg" not in camera:
            raise ConfigError(
                f"{where}: pitch_deg is missing: how far above the horizon the camera on the mast looks, -: below"
            )


def parse_mission(table: Mapping[str, Any], where: str) -> Mission:
    """Check a parsed TOML table and build the mission.

    Raises:
        ConfigError: an unknown key, a wrong or missing value, no vehicles.
    """
    if ("uav" in table) == ("mast" in table) or not table.get("ugv"):
        raise ConfigError(f"{where}: needs [uav], or [mast] instead, and at least one [[ugv]] with a system_id")
    if not isinstance(table["ugv"], list):
        raise ConfigError(f"{where}: write [[ugv]] with two brackets, once for each ground vehicle")
    parts = {name: part for name, part in table.items() if name != _NOTES}
    if isinstance(parts.get("fence"), Mapping):
        parts["fence"] = [parts["fence"]]  # one may be written as [fence]
    _check_pitch(parts, f"{where}: [camera]")
    for view in parts["view"] if isinstance(parts.get("view"), list) else ():
        _check_pitch(view, f"{where}: [view.camera]")
    try:
        return build(Mission, parts, where)
    except ValueError as error:
        raise ConfigError(str(error)) from None
