"""Practising: a simulated fleet of this computer gets into trouble, and out of it, when the operator asks."""

from __future__ import annotations

import socket
from collections.abc import Callable, Collection, Sequence

from gcs.station import SIMULATION_OVER
from sim.practice import OF_AIRCRAFT, OF_CAMERAS, OF_SIGNING, OF_THE_FLEET, TROUBLES

_ANSWER_S = 0.05
"""Time within which the system tells that nobody has a port of this computer any more."""


class PractisedFleet:
    """Asks the fleet's simulator, by datagrams to a port of this computer.

    Args:
        port: of the simulator, which has it as long as it runs.
        on_event: called with a system id, 0 for none, and words when a trouble begins or ends, and when all is over.
        films: system ids of aircraft with a camera.
        signs: whether signatures count in the flight.

    Attributes:
        over: True once the simulator has ended that ran before.
    """

    def __init__(
        self, port: int, on_event: Callable[[int, str], None], films: Collection[int] = (), *, signs: bool = True
    ) -> None:
        self._port, self._on_event, self._films = port, on_event, films
        self._keys = [key for key in TROUBLES if signs or key not in OF_SIGNING]
        self._on: set[tuple[str, int]] = set()
        self._runs = self.over = False

    def troubles(self, system_id: int) -> Sequence[tuple[str, str]]:
        """A key and words for each that a vehicle may have, with whether it has it."""
        return [
            (key, f"{TROUBLES[key]}{' – is on, ends it' if self._of(key, system_id) in self._on else ''}")
            for key in self._keys
            if key not in OF_AIRCRAFT or system_id in self._films
        ]

    def toggle(self, key: str, system_id: int) -> None:
        """Begin or end a trouble."""
        trouble = self._of(key, system_id)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as outlet:
            outlet.sendto((f"{key} {trouble[1]}" if trouble[1] else key).encode(), ("127.0.0.1", self._port))
        self._on ^= {trouble}
        if key == "reboot":
            self._on.discard(trouble)  # it is over at once
        ends = trouble not in self._on and key != "reboot"
        self._on_event(trouble[1], f"practised{', ended' if ends else ''}: {TROUBLES[key]}")

    def look(self) -> None:
        """Find out whether the simulator still runs, and report once when it has ended."""
        ran, self._runs = self._runs, self._is_heard()
        self.over = not self._runs and (ran or self.over)
        if ran and self.over:
            self._on_event(0, SIMULATION_OVER)

    def _is_heard(self) -> bool:
        """Tell whether the simulator has its port; nothing is no trouble, and is passed over there."""
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            probe.settimeout(_ANSWER_S)
            probe.connect(("127.0.0.1", self._port))
            probe.send(b"")
            try:
                probe.recv(1)
            except TimeoutError:
                return True
            except ConnectionRefusedError:
                return False
        return True

    def _of(self, key: str, system_id: int) -> tuple[str, int]:
        concerns_none = key in OF_THE_FLEET or (key in OF_CAMERAS and system_id not in self._films)
        return key, 0 if concerns_none else system_id
