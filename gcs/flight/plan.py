"""The plan of a flight, and what is opened by it."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from gcs.errors import GcsError
from gcs.flight.listening import open_ingest
from gcs.flight.video import AUTO, check_source
from gcs.fold.detector_factory import open_mission_detector
from gcs.mission.mission import Mission
from mavlink.ingest.ingest import Ingest
from vision.detect.detector import Detector

LOOK_THREADS = min(os.cpu_count() or 1, 2)
"""Threads of the detector: the newest frame is looked at alone, and soon."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FlightPlan:
    """Plan of what to listen to, and where to keep it."""

    mission: Mission
    links: tuple[str, ...]
    video: str
    """Empty: no camera; ``auto``, and ``IF_OFFERED`` where nobody asked: the stream that the UAV offers, once it does.
    Further cameras are those views of the mission that name one."""
    sessions: Path
    forward: tuple[str, ...] = ()
    """Outputs to which packets go on as they came."""
    command: bool = False
    """True if this station may send: heartbeats, requests for rates, and commands to the UAV."""
    accept_late: tuple[int, ...] = ()
    """Vehicles whose signed packets are accepted without a proof that they are made now."""
    spare: tuple[str, ...] = ()
    """Links that nobody asked for: they count once something came over them."""
    origins: Mapping[str, str] = field(default_factory=dict)
    """Origin of each part of the mission in words, for the file that it may be saved in."""
    practise_port: int = 0
    """UDP port at which a simulated fleet of this computer takes troubles, 0 none."""

    def __post_init__(self) -> None:
        """Check what a camera on a mast cannot be asked for.

        Raises:
            GcsError: it is asked for it.
        """
        if self.command and self.mission.mast:
            raise GcsError("--command is for a UAV; the first camera of this mission is on a mast")
        views = self.mission.views
        for place, video in self.videos.items():
            if video == AUTO and views[place].mast:
                name = views[place].name_of(views[place].uav.system_id)
                raise GcsError(f'{name}: its video is "auto", and no aircraft offers that of a mast; give its address')

    @property
    def videos(self) -> dict[int, str]:
        """Videos of the cameras that fly by their place in the mission; the first one's may be empty."""
        return {0: self.video} | {place: view.video for place, view in enumerate(self.mission.view, 1) if view.video}


def open_detector(plan: FlightPlan) -> Detector | None:
    """Detector that looks at the frames of all cameras, None without any.

    Raises:
        VideoError: a video could never be opened.
        ModelError: the detector cannot be.
    """
    for source in plan.videos.values():
        check_source(source)
    choice = plan.mission.detector
    return open_mission_detector(choice, threads=LOOK_THREADS) if any(plan.videos.values()) else None


def open_links(plan: FlightPlan, log: Path) -> Ingest:
    """The links, recorded into a log.

    Raises:
        LinkError: one cannot be opened.
    """
    mission = plan.mission
    return open_ingest(
        plan.links,
        log,
        signing=mission.signing,
        forward=plan.forward,
        command=plan.command,
        accept_late=plan.accept_late,
        uav=mission.uav.system_id,
        system_ids=mission.system_ids,
    )
