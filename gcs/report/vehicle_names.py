"""The words that stand for a vehicle: on a picture its name where that is shown right and is its alone, else its id."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

from gcs.snapshot import Event, Snapshot
from infra.plain_text import plain

LONGEST_NAME: Final = 40
"""Letters; a longer name is a line of text, not a label."""
SIGNS: Final = "?~+"
"""Characters that say how sure a name is, or count labels: a name that begins or ends with one would be misread."""
SUMMED_UP: Final = r"(\d+ more, most often: )"


@dataclass(frozen=True, slots=True, kw_only=True)
class ShownName:
    """Names that may be written for a vehicle."""

    short: str
    """Short name: the system id, ``UAV`` for the only aircraft; never the same for two."""
    name: str
    """Name of the vehicle, else the same as ``short``."""
    legend: str
    """Meaning of ``short``, empty where that is clear from the name itself, or the name cannot be shown."""


def shown_names(snapshot: Snapshot, shows: Callable[[str], bool]) -> Mapping[int, ShownName]:
    """Names that may be written for every vehicle of the table and every named box.

    Args:
        snapshot: Names may be words from a mission file, of any length and in any writing.
        shows: Whether a picture can show all letters of a text.
    """
    aircraft = {row.system_id for row in snapshot.vehicles if row.role == "uav"}
    uavs = aircraft if len(aircraft) == 1 else set[int]()
    ids = {row.system_id for row in snapshot.vehicles} | {box.system_id for box in snapshot.boxes if box.system_id}
    names = {row.system_id: row.name for row in snapshot.vehicles}
    names |= {system_id: snapshot.name_of(system_id) for system_id in ids - names.keys()}
    names = {system_id: plain(name[: LONGEST_NAME + 1]).strip() for system_id, name in names.items()}
    shorts = {system_id: "UAV" if system_id in uavs else str(system_id) for system_id in ids}
    often = Counter(names.values())
    reserved = set(shorts.values())
    shown = {}
    for system_id, name in names.items():
        short = shorts[system_id]
        right = 0 < len(name) <= LONGEST_NAME and "\N{REPLACEMENT CHARACTER}" not in name and shows(name)
        own = right and often[name] == 1 and name not in reserved - {short} and name.strip(SIGNS) == name
        clear = right and name.strip(SIGNS) and not _ends_with_id(name, short) and system_id not in uavs
        legend = f"{short} = {name}" if clear else ""
        use_name = own and system_id not in uavs
        shown[system_id] = ShownName(short=short, name=name if use_name else short, legend=legend)
    return shown


def _ends_with_id(name: str, short: str) -> bool:
    return name.endswith(short) and not name[: -len(short)][-1:].isdigit()


def text_with_sender(event: Event, name_of: Callable[[int], str]) -> str:
    """An event's text with the name of its vehicle, unless it has it; a vehicle's own words always as such."""
    if not event.system_id:
        return event.text
    name = name_of(event.system_id)
    if event.kind != "text":
        return event.text if name in event.text else f"{name}: {event.text}"
    prefix = rf"{re.escape(name)}( \((contested|unsigned)\))? says: "
    # a flood is summed up by this program; older recordings have the words alone
    return event.text if re.match(f"{SUMMED_UP}?{prefix}", event.text) else f"{name} says: {event.text}"
