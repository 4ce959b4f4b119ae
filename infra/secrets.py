"""Passwords in addresses: passed to who opens them, concealed everywhere else.

User name and password come before an @. Cameras take them as values too, in the query or in the path
(``/user=admin&password=…``), and stores sign an address in its query, so every value is one, and so is a long word in
the query or behind a #; but not in the path of a store, where values are names of folders. What RTMP has behind the
application is a stream's key, and a long word at the end of an RTSP path may be one. Addresses of datagrams have none.

What is shown, logged and written goes through ``conceal``, which knows the addresses that were hidden.
"""

from __future__ import annotations

import re
from bisect import insort
from urllib.parse import unquote

_MARK = "***"
_SCHEME = re.compile(r"(?:[A-Za-z][A-Za-z0-9+.-]*::)*[A-Za-z][A-Za-z0-9+.-]*://")
_STORES = ("s3", "s3a", "gs", "gcs", "abfs", "abfss", "az", "adl", "oci", "memory", "file", "local")
_FORGOTTEN = re.compile(r"[^/@]+:[^@]*@")
"""A user and a password where the scheme is missing."""
_VALUE = re.compile(r"([\w.-]*)=([^&;/?#]+)")
_IN_QUERY = re.compile(r"(?<=[?&#])(?:([^?=&#]*)=)?([^&#]+)")
_TAIL = re.compile(r"[^&;/?#]*")
_HARMLESS = ("codec", "pkt_size")
"""Values that describe how datagrams are read."""
_KEYED = ("rtmp", "rtmps", "rtsp", "rtsps")
"""Where the path's last part may be a key."""
_LAST = re.compile(r"(?<=/)[^/=]+(?=/*$)")
_LONG_ENOUGH, _LONG_VALUE, _LONG_KEY = 4, 8, 10
"""Shorter passwords, values and words occur in any text by chance; a value with its name is found whatever it is."""
_hidden: list[tuple[int, str, str]] = []
"""Secrets: minus its length, itself, and what stands in its place."""


def concealed(address: str) -> str:
    """An address as it may be shown, logged and recorded."""
    scheme, user, at, path, query = _parts(address)
    shown = _values(_IN_QUERY, query) if scheme else query
    key = _key(scheme, path)
    in_path = path if not scheme or _is_store(scheme) else _values(_VALUE, path)
    in_path = _LAST.sub(_MARK, in_path) if key else in_path
    return f"{scheme}{_MARK if user else ''}{at}{in_path}{shown}"


def secrets_of(address: str) -> tuple[str, ...]:
    """The parts that :func:`concealed` leaves out."""
    user, values = _secrets(address)
    return (user, *(value for _, value in values)) if user else tuple(value for _, value in values)


def conceal_in(text: str, address: str) -> str:
    """Text of others, such as FFmpeg's messages, without the secrets of an address."""
    return _replaced(text, sorted(_forms(address)))


def hide(address: str) -> None:
    """Have ``conceal`` take the secrets of an address out of all text from now on; nothing where it has none."""
    for form in _forms(address):
        if form not in _hidden:
            insort(_hidden, form)


def conceal(text: str) -> str:
    """Text without the secrets of all addresses that were hidden."""
    return _replaced(text, _hidden)


def _replaced(text: str, forms: list[tuple[int, str, str]]) -> str:
    for _, secret, shown in forms:
        text = text.replace(secret, shown)
    return text


def _forms(address: str) -> set[tuple[int, str, str]]:
    """Patterns to look for, the longest first when sorted, and what to put there."""
    user, values = _secrets(address)
    if not user and not values:
        return set()
    forms = {address: concealed(address)}
    passwords = {part for part in (user, user.partition(":")[2]) if len(part) >= _LONG_ENOUGH}
    passwords |= {value for _, value in values if len(value) >= _LONG_VALUE}
    for before, value in values:
        forms |= {f"{before}{form}": f"{before}{_MARK}" for form in (value, unquote(value)) if before}
    for password in passwords:
        forms |= dict.fromkeys((password, unquote(password)), _MARK)
    return {(-len(secret), secret, shown) for secret, shown in forms.items()}


def _secrets(address: str) -> tuple[str, list[tuple[str, str]]]:
    """User and password, and values with what stands before them: ``name=``, the ``/`` of a key, or nothing."""
    scheme, user, _, path, query = _parts(address)
    if not scheme:
        return user, []
    found = [] if _is_store(scheme) else _VALUE.findall(path)
    found = [(name, value) for name, value in (*found, *_IN_QUERY.findall(query)) if _is_secret(name, value)]
    keys = [("/", key) for key in [_key(scheme, path)] if key]
    return user, [*((f"{name}=" if name else "", value) for name, value in found), *keys]


def _key(scheme: str, path: str) -> str:
    """The key at the end of a stream's path, empty where there is none."""
    found = _LAST.search(path) if scheme.removesuffix("://").lower() in _KEYED else None
    if found is None:
        return ""
    behind_an_application = scheme.lower().startswith("rtmp") and path.count("/", 0, found.start()) > 1
    return found[0] if behind_an_application or len(found[0]) >= _LONG_KEY else ""


def _values(pattern: re.Pattern[str], text: str) -> str:
    def shown(found: re.Match[str]) -> str:
        name = found[1] or ""
        return (f"{name}=" if name else "") + _MARK if _is_secret(name, found[2]) else found[0]

    return pattern.sub(shown, text)


def _is_secret(name: str, value: str) -> bool:
    return name not in _HARMLESS if name else len(value) >= _LONG_VALUE


def _is_store(scheme: str) -> bool:
    return scheme.removesuffix("://").rpartition("::")[2] in _STORES


def _parts(address: str) -> tuple[str, str, str, str, str]:
    """Scheme with its ://, user and password, the @ behind them, the rest to the ?, and what is from there on.

    A password may hold what it should not, a / or an @: what comes before the last @ is user and password. An
    @ behind a = may be in a value, which then ends further on.
    """
    scheme = _SCHEME.match(address)
    if scheme is None and not _FORGOTTEN.match(address):
        return "", "", "", address, ""
    start = scheme.end() if scheme else 0
    user, at, rest = address[start:].rpartition("@")
    if "=" in user:
        tail = _TAIL.match(rest)
        end = tail.end() if tail else 0
        user, at, rest = user + at + rest[:end], "", rest[end:]
    # names in a store may hold a #
    query = re.search(r"\?" if _is_store(address[:start]) else "[?#]", rest)
    end = query.start() if query else len(rest)
    return address[:start], user, at, rest[:end], rest[end:]
