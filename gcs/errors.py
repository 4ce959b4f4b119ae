"""Errors at the level of the application.

GcsError
├── ConfigError     a mission or session file that cannot be used
├── SessionError    a folder that is no session, or cannot be written
├── ImportFileError what others recorded and cannot be used
├── FlightError     a job of a flight that fails again and again
├── BatchError      flights of a batch, or what is to hold its results, that cannot be used
│   ├── StoreError      a store of files that does not answer, or refuses
│   └── ClusterError    a cluster that is not to be had, or that lost a flight
└── ScoreError      an identity log or truth file that cannot be compared
"""

from __future__ import annotations


class GcsError(Exception):
    """Base; the message is one line: what, where, and what to do."""


class ConfigError(GcsError):
    """A mission file with an unknown key, a wrong value, or no such file."""


class SessionError(GcsError):
    """A session that is missing something, or would be overwritten."""


class ImportFileError(GcsError):
    """A file from another program that cannot be read as what it should be, or files that do not fit each other."""


class FlightError(GcsError):
    """A job of a flight that fails again and again; the flight itself goes on."""


class BatchError(GcsError):
    """Flights that are not to be told apart or cannot be read, or an output folder that holds something else."""


class StoreError(BatchError):
    """A store of files that does not answer, or refuses: to try again may help."""


class ClusterError(BatchError):
    """A cluster that is not to be had, or whose workers ended one after another with a flight."""


class ScoreError(GcsError):
    """Files that cannot be scored against each other."""
