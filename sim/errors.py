"""Errors of the simulator.

SimError
├── ScenarioError        a scenario that cannot be simulated: unknown key, wrong type, value out of range, no room
├── SessionWriteError    a session folder that cannot be written
└── PlayError            a live simulation that cannot begin: bad address, truth file in the way
"""

from __future__ import annotations

__all__ = ["PlayError", "ScenarioError", "SessionWriteError", "SimError"]


class SimError(Exception):
    """Base of all errors of the simulator."""


class ScenarioError(SimError):
    """A scenario that cannot be simulated; the text names the key and what is accepted."""


class SessionWriteError(SimError):
    """A session folder that cannot be written; the text names the path."""


class PlayError(SimError):
    """A live simulation that cannot begin; the text names the address or path."""
