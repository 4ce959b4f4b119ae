"""Passwords in the address of a video: passed to FFmpeg, concealed everywhere else.

User name and password come before an @, and cameras take them as values too, in the query or in the path
(``/user=admin&password=…``), so every value is one. Addresses of datagrams have none.
"""

from __future__ import annotations

import re
from urllib.parse import unquote

__all__ = ["conceal_in", "concealed", "secrets_of"]

_MARK = "***"
_SCHEME = re.compile(r"[A-Za-z][A-Za-z0-9+.-]*://")
_FORGOTTEN = re.compile(r"[^/@]+:[^@]*@")
"""A user and a password where the scheme is missing."""
_VALUE = re.compile(r"([\w.-]*)=([^&;/?#]+)")
_TAIL = re.compile(r"[^&;/?#]*")
_HARMLESS = ("codec", "pkt_size")
"""Values that describe how datagrams are read."""
_LONG_ENOUGH = 4
"""Shorter values occur in any text by chance."""


def concealed(address: str) -> str:
    """An address as it may be shown, logged and recorded."""
    scheme, user, at, rest = _parts(address)
    shown = _VALUE.sub(lambda m: m[0] if m[1] in _HARMLESS else f"{m[1]}={_MARK}", rest) if scheme else rest
    return f"{scheme}{_MARK if user else ''}{at}{shown}"


def secrets_of(address: str) -> tuple[str, ...]:
    """The parts that :func:`concealed` leaves out."""
    scheme, user, _, rest = _parts(address)
    values = [m[2] for m in _VALUE.finditer(rest) if m[1] not in _HARMLESS] if scheme else []
    return (user, *values) if user else tuple(values)


def conceal_in(text: str, address: str) -> str:
    """Text of others, such as FFmpeg's messages, without the secrets of an address."""
    text = text.replace(address, concealed(address))
    parts = {part for secret in secrets_of(address) for part in (secret, secret.partition(":")[2])}
    secrets = {form for part in parts for form in (part, unquote(part)) if len(form) >= _LONG_ENOUGH}
    for secret in sorted(secrets, key=len, reverse=True):
        text = text.replace(secret, _MARK)
    return text


def _parts(address: str) -> tuple[str, str, str, str]:
    """Scheme with its ://, user and password, the @ behind them, and the rest.

    A password may hold what it should not, a / or an @: what comes before the last @ is user and password. An
    @ behind a = may be in a value, which then ends further on.
    """
    scheme = _SCHEME.match(address)
    if scheme is None and not _FORGOTTEN.match(address):
        return "", "", "", address
    start = scheme.end() if scheme else 0
    user, at, rest = address[start:].rpartition("@")
    if "=" in user:
        tail = _TAIL.match(rest)
        end = tail.end() if tail else 0
        user, at, rest = user + at + rest[:end], "", rest[end:]
    return address[:start], user, at, rest
