"""What can go wrong at the level of the application.

GcsError
├── ConfigError     a mission or session file that cannot be used
├── SessionError    a folder that is no session, or cannot be written
├── ImportFileError what others recorded and cannot be used
├── FlightError     a job of a flight that fails again and again
└── ScoreError      an identity log or truth file that cannot be compared
"""

from __future__ import annotations

__all__ = ["ConfigError", "FlightError", "GcsError", "ImportFileError", "ScoreError", "SessionError"]


class GcsError(Exception):
    """Base; the message is one line: what, where, and what to do."""


class ConfigError(GcsError):
    """A mission file with an unknown key, a wrong value, or no such file."""


class SessionError(GcsError):
    """A session that is missing something, or would be overwritten."""


class ImportFileError(GcsError):
    """A file of others that cannot be read as what it should be, or files that do not fit each other."""


class FlightError(GcsError):
    """A job of a flight that fails again and again; the flight itself goes on."""


class ScoreError(GcsError):
    """Files that cannot be scored against each other."""
