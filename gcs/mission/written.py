"""A mission as the text of a mission file: what it says, with where each part came from as comments."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Mapping
from dataclasses import is_dataclass, replace
from pathlib import Path
from typing import Any

from gcs.errors import ConfigError
from gcs.mission.mission import NO_KEYS, Mission, MissionVehicle, View, keys_folder, load_mission
from infra.files.safe_open import create
from infra.toml_tables import toml_text

MISSION_FILE = "mission.toml"
_MAX_FILES = 1000
_PARTS = ("camera", "clock", "detector", "identity", "limits")
_DEFAULTS = Mission(uav=MissionVehicle(system_id=1), ugv=())


def mission_tables(mission: Mission) -> dict[str, Any]:
    """Tables of a mission, as TOML has them; without addresses and folders of keys, which are of one computer."""
    films = _vehicle(mission, mission.uav.system_id)
    table: dict[str, Any] = (
        {"mast": _values(replace(mission.mast, name=mission.uav.name))} if mission.mast else {"uav": films}
    )
    table["ugv"] = [_vehicle(mission, i) for i in mission.ugv_ids]
    for name in _PARTS:
        if (part := getattr(mission, name)) is not None:
            table[name] = _values(part)
    if mission.view:
        table["view"] = [_view(view) for view in mission.view]
    if mission.fence:
        table["fence"] = [_values(fence) for fence in mission.fence]
    if mission.map != _DEFAULTS.map:
        table["map"] = _values(mission.map)
    signing = mission.signing
    table["signing"] = {"unsigned": list(signing.unsigned), "keyless": signing.keyless}
    if signing.keys == NO_KEYS:
        table["signing"]["keys"] = NO_KEYS
    return table


def mission_text(mission: Mission, origins: Mapping[str, str]) -> str:
    """A mission file of a mission: each part under a comment, and nothing that is as without it.

    Args:
        mission: with links, which are written too.
        origins: where a part comes from, one line each: by system id, name of the table (``camera``, ``links``) or,
            under the empty name, of the whole.
    """
    tables, usual = mission_tables(mission), mission_tables(_DEFAULTS)
    if (keys := mission.signing.keys) not in ("", keys_folder()):
        tables["signing"]["keys"] = keys
    first = "mast" if mission.mast else "uav"
    blocks = [_comment(origins.get("")), _block(f"[{first}]", tables[first], origins.get(str(mission.uav.system_id)))]
    blocks += [_block("[[ugv]]", each, origins.get(str(each["system_id"]))) for each in tables["ugv"]]
    if mission.camera is None:
        blocks.append(_comment(origins.get("camera")))
    for name, values in tables.items():
        if name not in (first, "ugv", "view", "fence") and values != usual.get(name):
            blocks.append(_block(f"[{name}]", values, origins.get(name)))
    for each, view in zip(tables.get("view", ()), mission.view, strict=True):
        each |= {"video": view.video} if view.video else {}
        parts = {name: each.pop(name) for name in ("mast", "camera", "clock") if name in each}
        blocks.append(_block("[[view]]", each, origins.get(str(view.system_id))) or "[[view]]\n")
        blocks += [_block(f"[view.{name}]", part, None) for name, part in parts.items()]
    blocks += [_block("[[fence]]", each, origins.get("fence")) for each in tables.get("fence", ())]
    blocks.append(_block("[links]", _values(mission.links), origins.get("links")))
    return "\n".join(block for block in blocks if block)


def save_mission(mission: Mission, origins: Mapping[str, str], folder: Path) -> tuple[Path, bool]:
    """Write a mission as ``mission.toml``, else under the next free name; never over a file.

    An address in it may have a password: nobody but the user may read it.

    Returns:
        The file, and whether it is new: one that has this mission already is enough.

    Raises:
        OSError: it cannot be made.
    """
    for k in range(1, _MAX_FILES):
        path = folder / (MISSION_FILE if k == 1 else f"mission-{k}.toml")
        if path.is_file():
            with contextlib.suppress(ConfigError):
                if load_mission(path) == mission:
                    return path, False
        try:
            fd = create(path)
        except FileExistsError:
            continue
        os.fchmod(fd, 0o600)
        with os.fdopen(fd, "w", encoding="utf-8") as file:
            file.write(mission_text(mission, origins))
        return path, True
    raise FileExistsError(f"{folder}: a thousand missions are saved here")


def _values(part: Any) -> dict[str, Any]:  # noqa: ANN401 - any part of a mission
    """Values of a part of a mission; what it leaves open is left out."""
    return {
        name: _values(value) if is_dataclass(value) else list(value) if isinstance(value, tuple) else value
        for name in part.__slots__
        if (value := getattr(part, name)) not in ("", None, ())
    }


def _view(view: View) -> dict[str, Any]:
    values = _values(replace(view, video=""))
    if view.mast:  # its number is of its place alone
        del values["system_id"]
    return values


def _vehicle(mission: Mission, system_id: int) -> dict[str, Any]:
    return {"system_id": system_id, "name": mission.name_of(system_id)}


def _block(heading: str, values: Mapping[str, Any], origin: str | None) -> str:
    return f"{_comment(origin)}{heading}\n{toml_text(values)}" if values else ""


def _comment(origin: str | None) -> str:
    """A comment of one line; what is heard may be in it, and a line break would end it."""
    text = "".join(c if c.isprintable() else " " for c in origin or "")
    return f"# {text}\n" if text else ""
