"""Passwords in addresses: passed to who opens them, concealed everywhere else.

User name and password come before an @. Cameras take them as values too, in the query or in the path
(``/user=admin&password=…``), and stores sign an address in its query, so every value is one, and so is a long word in
the query or behind a #; but not in the path of a store, where values are names of folders. What RTMP has behind the
application is a stream's key, and a long mixture of letters and digits at the end of an RTSP path may be one, but not
a camera's name for its stream. Addresses of datagrams have none.

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
"""Schemes whose path's last part may be a key."""
_LAST = re.compile(r"(?<=/)[^/=]+(?=/*$)")
_LONG_ENOUGH, _LONG_VALUE, _LONG_KEY, _NO_NAME = 4, 8, 10, 20
"""Shorter passwords, values and keys occur in any text by chance; a value with its name is found whatever it is, and a
key with its whole path. From the last on it is taken for a key even if parts of it look like words."""
_MIXED = re.compile(r"(?=.*[0-9]).*[A-Za-z]")
_WORD = "[A-Za-z][a-z]{2,}(?:[A-Z][a-z]+)*"
_NAMES_A_STREAM = re.compile(rf"{_WORD}[0-9]{{0,3}}|(?:.*[_.-])?{_WORD}(?:[_.-].*)?")
"""``videostream1``, ``h264Preview_01_main``: a word that is numbered, or one among others."""
_NO_NAME_GOES_ON = r"(?![\w-]|\.\w)"
_KEY_BEGINS, _KEY_ENDS = r"(?:(?<![^\W_])|(?<=%2[Ff]))", r"(?![^\W_])"
_Form = tuple[int, str, str, str]
_hidden: list[_Form] = []
"""Secrets: minus its length, itself, the pattern that finds it, and what stands in its place."""


def concealed(address: str) -> str:
    """An address as it may be shown, logged and recorded."""
    scheme, user, at, path, query = _parts(address)
    shown = _values(_IN_QUERY, query) if scheme else query
    _, key = _key(scheme, path)
    in_path = path if not scheme or _is_store(scheme) else _values(_VALUE, path)
    in_path = _LAST.sub(_MARK, in_path) if key else in_path
    return f"{scheme}{_MARK if user else ''}{at}{in_path}{shown}"


def secrets_of(address: str) -> tuple[str, ...]:
    """The parts that :func:`concealed` leaves out."""
    user, values, (_, key) = _secrets(address)
    return tuple(secret for secret in (user, *(value for _, value in values), key) if secret)


def conceal_in(text: str, address: str) -> str:
    """Text from other programs, such as FFmpeg's messages, without the secrets of an address."""
    return _replaced(text, sorted(_forms(address)))


def hide(address: str) -> None:
    """Have ``conceal`` take the secrets of an address out of all text from now on; nothing where it has none."""
    for form in _forms(address):
        if form not in _hidden:
            insort(_hidden, form)


def conceal(text: str) -> str:
    """Text without the secrets of all addresses that were hidden."""
    return _replaced(text, _hidden)


def _replaced(text: str, forms: list[_Form]) -> str:
    for _, secret, pattern, shown in forms:
        if secret in text:
            text = shown.join(re.split(pattern, text))
    return text


def _forms(address: str) -> set[_Form]:
    """Patterns to look for, the longest first when sorted, and what to put there."""
    user, values, (before, key) = _secrets(address)
    if not user and not values and not key:
        return set()
    passwords = {part for part in (user, user.partition(":")[2]) if len(part) >= _LONG_ENOUGH}
    passwords |= {value for _, value in values if len(value) >= _LONG_VALUE}
    is_short = 0 < len(key) < _LONG_VALUE
    found = [("", address, _NO_NAME_GOES_ON if is_short else "", concealed(address))]
    found += [("", f"{name}{form}", "", f"{name}{_MARK}") for name, value in values if name for form in _both(value)]
    found += [("", form, "", _MARK) for password in passwords for form in _both(password)]
    if is_short:
        found += [(_KEY_BEGINS, f"{before}{form}", _NO_NAME_GOES_ON, f"{before}{_MARK}") for form in _both(key)]
    elif key:
        found += [(_KEY_BEGINS, form, _KEY_ENDS, _MARK) for form in _both(key)]
    return {(-len(secret), secret, f"{a}{re.escape(secret)}{b}", shown) for a, secret, b, shown in found}


def _both(secret: str) -> set[str]:
    """A secret as it stands in the address, and as it is meant."""
    return {secret, unquote(secret)}


def _secrets(address: str) -> tuple[str, list[tuple[str, str]], tuple[str, str]]:
    """User and password, values with the ``name=`` before them or nothing, and a key with the path before it."""
    scheme, user, _, path, query = _parts(address)
    if not scheme:
        return user, [], ("", "")
    found = [] if _is_store(scheme) else _VALUE.findall(path)
    found = [(name, value) for name, value in (*found, *_IN_QUERY.findall(query)) if _is_secret(name, value)]
    return user, [(f"{name}=" if name else "", value) for name, value in found], _key(scheme, path)


def _key(scheme: str, path: str) -> tuple[str, str]:
    """The key at the end of a stream's path, with the path before it; both empty where there is none."""
    found = _LAST.search(path) if scheme.removesuffix("://").lower() in _KEYED else None
    if found is None:
        return "", ""
    behind_an_application = scheme.lower().startswith("rtmp") and path.count("/", 0, found.start()) > 1
    is_key = behind_an_application or _is_random(found[0])
    return (path[path.index("/") + 1 : found.start()], found[0]) if is_key else ("", "")


def _is_random(last: str) -> bool:
    """Tell a key from a camera's name for its stream."""
    if len(last) < _LONG_KEY or not _MIXED.match(last):
        return False
    return len(last) >= _NO_NAME or not _NAMES_A_STREAM.fullmatch(last)


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
