"""Errors of the simulator.

SimError
├── ScenarioError   a scenario that cannot be played: unknown key, wrong type, value out of range, no room
└── SessionError    a session folder that cannot be written
"""

from __future__ import annotations

__all__ = ["ScenarioError", "SessionError", "SimError"]


class SimError(Exception):
    """Base of all errors of the simulator."""


class ScenarioError(SimError):
    """A scenario that cannot be played; the text names the key and what is accepted."""


class SessionError(SimError):
    """A session folder that cannot be written; the text names the path."""
