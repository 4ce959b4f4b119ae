"""The flights on which screens are checked, and the sizes of the screens."""

from __future__ import annotations

from types import MappingProxyType

from bench.screens.flights import Script
from sim.world.scenario import ScenarioFault

SIZES = ((60, 20), (80, 24), (100, 30), (120, 40), (160, 48))
NAMES = MappingProxyType({11: "Hauler North 7", 12: "UGV-1", 13: "UGV-16", 14: "Bravo", 15: "漢字-15", 16: "Bravo-2"})
"""Names with spaces, wide letters, and names with which others begin."""
WHILE_S = (5.0, 11.0)
"""When most troubles are."""

SCRIPTS: tuple[Script, ...] = (
    *(Script(name=f"{fps:g} frames/s", fps=fps, latency_s=0.3 if fps < 10 else 0.06) for fps in (1, 2, 5, 15, 30)),
    Script(name="hiccups of 0.4, 0.8 and 1.6 s", no_frames=((3.0, 3.4), (6.0, 6.8), (10.0, 11.6))),
    Script(name="no frames for 6 s", no_frames=(WHILE_S,)),
    Script(name="the video starts after 8 s", no_frames=((-5.0, 8.0),)),
    Script(name="two vehicles switched off and on", silent={11: WHILE_S, 13: WHILE_S}, restarted=(11, 13)),
    Script(name="nothing received for 6 s", silent={0: WHILE_S}),
    Script(name="a vehicle lost for two minutes", silent={12: (10.0, 150.0)}, seconds=135.0, fps=2, poll_us=1_000_000),
    Script(name="a second sender of one system id", impostor=WHILE_S),
    Script(
        name="positions that cannot be right",
        faults=(
            ScenarioFault(vehicle=0, kind="jump", start_s=5.0, stop_s=11.0, size=400.0),
            ScenarioFault(vehicle=1, kind="zero", start_s=5.0, stop_s=11.0),
            ScenarioFault(vehicle=2, kind="spoof", start_s=5.0, stop_s=11.0, other=3),
        ),
    ),
    Script(name="a flood of texts", texts=WHILE_S),
    Script(name="a flood of events", events=WHILE_S),
    Script(name="the disk fails", disk_fails=WHILE_S),
    Script(name="names with which others begin", names=NAMES),
    Script(name="40 vehicles", vehicles=40, ground="open", fps=10),
    Script(
        name="40 vehicles, all at once",
        vehicles=40,
        ground="open",
        fps=5,
        latency_s=0.3,
        names=NAMES,
        no_frames=((7.0, 9.0), (12.0, 15.0)),
        silent={12: (4.0, 12.0), 20: (8.0, 99.0)},
        restarted=(12,),
        impostor=WHILE_S,
        texts=(6.0, 14.0),
        events=(6.0, 14.0),
        disk_fails=(10.0, 12.0),
    ),
)
