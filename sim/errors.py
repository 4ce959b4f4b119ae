"""Errors of the simulator.

SimError
├── ScenarioError        a scenario that cannot be simulated: unknown key, wrong type, value out of range, no room
├── AnnotationError      labels of a film that cannot be used: unknown layout, no track, not of this film
├── UnusedLabelError     one label that is not used; raised and counted while labels are read
├── SessionWriteError    a session folder that cannot be written
└── PlayError            a live simulation that cannot begin: bad address, truth file in the way
"""

from __future__ import annotations


class SimError(Exception):
    """Base of all errors of the simulator."""


class ScenarioError(SimError):
    """A scenario that cannot be simulated; the text names the key and what is accepted."""


class AnnotationError(SimError):
    """Labels of a film that cannot be used; the text names the file and what is accepted."""


class UnusedLabelError(SimError):
    """One label that is not used; the text is the reason by which it is counted."""


class SessionWriteError(SimError):
    """A session folder that cannot be written; the text names the path."""


class PlayError(SimError):
    """A live simulation that cannot begin; the text names the address or path."""
