"""Errors of MAVLink.

MavlinkError
├── LinkError        a link cannot be opened or written
├── TlogError        a telemetry log cannot be read or written
├── SigningError     a key, or what is remembered of signed streams, that cannot be used
└── GeodesyError     a place on Earth that does not exist
"""

from __future__ import annotations


class MavlinkError(Exception):
    """Base of everything this package raises on purpose."""


class LinkError(MavlinkError):
    """A link cannot be opened or written; the message names the URL and what to do."""


class TlogError(MavlinkError):
    """A telemetry log cannot be read or written; the message names the file and why."""


class SigningError(MavlinkError):
    """A key, or what is remembered of signed streams, cannot be used; the message names the file and what to do."""


class GeodesyError(MavlinkError):
    """Latitude, longitude or altitude is not a number or out of range."""
