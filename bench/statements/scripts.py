"""The flights of which statements are checked. Vehicles 11, 12, … are 0, 1, … in the simulator's faults."""

from __future__ import annotations

from bench.again.scripted import InjectedFaults
from bench.statements.flights import FlightScript, OperatorAct
from sim.world.scenario import Occlusion, ScenarioFault

__all__ = ["SCRIPTS"]


def _fault(system_id: int, kind: str, start_s: float, stop_s: float = 1e9, **more: float) -> ScenarioFault:
    return ScenarioFault(vehicle=system_id - 11, kind=kind, start_s=start_s, stop_s=stop_s, **more)  # type: ignore[arg-type]


SCRIPTS: tuple[FlightScript, ...] = (
    FlightScript(name="all is well", outside=1),
    FlightScript(name="one silent for the rest", seconds=40.0, faults=(_fault(12, "silent", 8.0),)),
    FlightScript(
        name="three silent, one by one, two come back",
        seconds=45.0,
        faults=(_fault(11, "silent", 6.0), _fault(12, "silent", 10.0, 30.0), _fault(13, "silent", 14.0, 20.0)),
    ),
    FlightScript(
        name="one silent, its box on a new track, and stated",
        seconds=36.0,
        faults=(_fault(12, "silent", 5.0, 30.0),),
        occlusions=(Occlusion(vehicle=1, t_s=10.0, duration_s=4.0),),
        acts=(OperatorAct(at_s=22.0, kind="state", of=12, says=12),),
    ),
    FlightScript(name="never on the air", faults=(_fault(14, "silent", -9.0), _fault(15, "silent", -9.0, 15.0))),
    FlightScript(name="late by 3 s", seconds=30.0, faults=(_fault(13, "lag", 8.0),)),
    FlightScript(name="frozen", seconds=30.0, faults=(_fault(12, "frozen", 8.0),)),
    FlightScript(name="lying by 15 m", seconds=35.0, faults=(_fault(13, "jump", 8.0),)),
    FlightScript(name="lying by 30 m", seconds=45.0, faults=(_fault(14, "jump", 8.0, size=30.0),)),
    FlightScript(name="drifting away", seconds=40.0, faults=(_fault(11, "drift", 5.0, size=1.0),)),
    FlightScript(name="in the place of another", seconds=30.0, faults=(_fault(11, "spoof", 8.0, other=2),)),
    FlightScript(name="without a fix", seconds=30.0, faults=(_fault(11, "zero", 8.0, 20.0),)),
    FlightScript(
        name="refused: signed with another key", injected=InjectedFaults(signed=True, wrong_keys=frozenset((12,)))
    ),
    FlightScript(name="the video stops for 8 s", injected=InjectedFaults(no_video=((8.0, 16.0),))),
    FlightScript(
        name="the video comes and goes",
        seconds=60.0,
        injected=InjectedFaults(no_video=tuple((float(t), t + 2.5) for t in range(6, 36, 5))),
    ),
    FlightScript(name="no telemetry for 6 s", seconds=30.0, injected=InjectedFaults(no_telemetry=(8.0, 14.0))),
    FlightScript(
        name="the operator states and marks",
        seconds=30.0,
        faults=(_fault(12, "silent", 5.0),),
        acts=(
            OperatorAct(at_s=9.0, kind="mark", of=12, text="it went behind the barn"),
            OperatorAct(at_s=10.0, kind="state", of=12, says=12),
            OperatorAct(at_s=16.0, kind="undo", of=12),
            OperatorAct(at_s=18.0, kind="state", of=13, says=14),
        ),
    ),
    FlightScript(
        name="stated while silent, beside one that lies",
        outside=1,
        faults=(_fault(12, "silent", 6.0, 15.0), _fault(13, "jump", 8.0, size=25.0)),
        acts=(OperatorAct(at_s=10.0, kind="state", of=12, says=12),),
    ),
    FlightScript(
        name="a silent, a lying and a refused one",
        seconds=45.0,
        vehicles=6,
        faults=(_fault(11, "silent", 8.0, 35.0), _fault(14, "jump", 10.0, size=20.0)),
        injected=InjectedFaults(signed=True, wrong_keys=frozenset((16,))),
        acts=(OperatorAct(at_s=20.0, kind="mark", text="three are in doubt"),),
    ),
)
