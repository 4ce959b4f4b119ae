"""Tables of a TOML file into frozen dataclasses: every value checked, an unknown key refused with the nearest name."""

from __future__ import annotations

import difflib
import re
import tomllib
from collections.abc import Mapping
from dataclasses import MISSING, fields
from types import UnionType
from typing import Any, Literal, TypeGuard, Union, get_args, get_origin, get_type_hints

import tomli_w

from gcs.errors import ConfigError

__all__ = ["MOST_TOML_BYTES", "Ranges", "build", "parse_toml", "refuse_unknown", "toml_text"]

MOST_TOML_BYTES = 256 << 10
"""Ten times what a mission with 255 vehicles, each with a comment, takes."""
_MOST_DEPTH = 16
"""Tables in tables; ours have two levels, and what is nested without end ends the programs that go through it."""
_MOST_SHOWN = 100
"""Letters of a wrong value that a message repeats."""
_LONG_KEY = re.compile(rf"""(?<![\w"'-])(?:(?:[\w-]++|"[^"\n]*+"|'[^'\n]*+')[ \t]*+\.[ \t]*+){{{_MOST_DEPTH}}}""")
"""A key of so many parts: the parser takes the square of their number in time and memory."""

Ranges = Mapping[tuple[type, str], tuple[float, float]]
"""Least and most of numbers, and of each in a list of them, by dataclass and key."""


def parse_toml(data: bytes, where: str) -> dict[str, Any]:
    """Parse a TOML file's bytes; ``where`` goes into messages.

    Raises:
        ConfigError: not UTF-8, not TOML, nested too deeply, or with a number beyond 64 bits.
    """
    try:
        text = data.decode()
        if _LONG_KEY.search(text):
            raise ConfigError(f"{where}: a key has more than {_MOST_DEPTH} parts")
        table = tomllib.loads(text)
    except UnicodeDecodeError as error:
        raise ConfigError(f"{where}: cannot be read as text: {error}") from error
    except (ValueError, RecursionError) as error:  # a number of thousands of digits is a bare ValueError
        raise ConfigError(f"{where}: not valid TOML: {error}") from error
    level: list[Any] = [table]
    for _ in range(_MOST_DEPTH):
        level = [value for part in level for value in (part.values() if isinstance(part, dict) else part)]
        if any(type(value) is int and value.bit_length() > 63 for value in level):
            raise ConfigError(f"{where}: not valid TOML: a whole number has more than 64 bits")
        level = [value for value in level if isinstance(value, dict | list)]
    if level:
        raise ConfigError(f"{where}: more than {_MOST_DEPTH} tables or lists are nested in each other")
    return table


def toml_text(table: Mapping[str, Any]) -> str:
    """A table as TOML; letters that cannot be printed stand in it as escapes, which other programs read as well."""
    text = tomli_w.dumps(table)
    return text if text.replace("\n", "").isprintable() else "".join(map(_escaped, text))


def _escaped(letter: str) -> str:
    if letter.isprintable() or letter == "\n":
        return letter
    code = ord(letter)
    if 0xD800 <= code < 0xE000:  # a byte of a path that is no UTF-8: no text can hold it
        return "\N{REPLACEMENT CHARACTER}"
    return f"\\u{code:04x}" if code < 0x10000 else f"\\U{code:08x}"


def build(kind: type, table: object, where: str, ranges: Ranges) -> Any:  # noqa: ANN401 - of the kind given
    """Check a parsed table and build the dataclass; ``where`` goes into messages.

    Raises:
        ConfigError: not a table, an unknown or missing key, a value of another type or out of range.
    """
    if not isinstance(table, Mapping):
        raise ConfigError(f"{where} must be a table of keys and values")
    known = {f.name: f for f in fields(kind)}
    refuse_unknown(table, tuple(known), where)
    missing = [n for n, f in known.items() if n not in table and f.default is MISSING and f.default_factory is MISSING]
    if missing:
        raise ConfigError(f"{where}: {missing[0]} is missing")
    return kind(**{name: _value(kind, name, value, where, ranges) for name, value in table.items()})


def _value(kind: type, name: str, value: object, where: str, ranges: Ranges) -> object:
    """Check one value against the type that the dataclass declares."""
    wanted = get_type_hints(kind)[name]
    options = get_args(wanted) if get_origin(wanted) in (Union, UnionType) else (wanted,)
    choices = [choice for option in options if get_origin(option) is Literal for choice in get_args(option)]
    limits = ranges.get((kind, name), (-1e9, 1e9))
    if (choices and value in choices) or (str in options and isinstance(value, str)):
        return value
    if isinstance(value, list) and tuple[str, ...] in options and all(isinstance(v, str) for v in value):
        return tuple(value)
    if isinstance(value, list) and tuple[int, ...] in options and all(map(_is_whole, value)):
        return tuple(int(_in_range(name, v, limits, where)) for v in value)
    if isinstance(value, list) and tuple[float, ...] in options and len(value) == 5 and all(map(_is_number, value)):
        return tuple(_in_range(name, v, limits, where) for v in value)
    if int in options and _is_whole(value):
        return int(_in_range(name, value, limits, where))
    if float in options and _is_number(value):
        return _in_range(name, value, limits, where)
    needed = " or ".join(map(repr, choices)) or next((_NEEDED[o] for o in options if o in _NEEDED), "a number")
    if choices and float in options:
        needed = f"a number or {needed}"
    raise ConfigError(f"{where}: {name} is {_shown(value)}; {needed} is needed")


def _shown(value: object) -> str:
    said = repr(value)
    return said if len(said) <= _MOST_SHOWN else said[:_MOST_SHOWN] + "…"


_NEEDED: dict[object, str] = {
    int: "a whole number",
    str: "text in quotes",
    tuple[float, ...]: "a list of 5 numbers (k1 k2 p1 p2 k3)",
    tuple[str, ...]: "a list of texts",
    tuple[int, ...]: "a list of whole numbers",
}


def _in_range(name: str, value: float, limits: tuple[float, float], where: str) -> float:
    least, most = limits
    if not least <= value <= most:
        raise ConfigError(f"{where}: {name} is {float(value)}; it must lie between {least:g} and {most:g}")
    return float(value)


def _is_number(value: object) -> TypeGuard[float]:
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= 1e300


def _is_whole(value: object) -> TypeGuard[float]:
    return _is_number(value) and float(value).is_integer()


def refuse_unknown(table: Mapping[str, Any], known: tuple[str, ...], where: str) -> None:
    """Refuse a key that is not known.

    Raises:
        ConfigError: naming the nearest one.
    """
    for key in table:
        if key not in known:
            near = difflib.get_close_matches(key, known, n=1)
            hint = f"did you mean {near[0]}?" if near else f"known are {', '.join(known)}"
            raise ConfigError(f"{where}: unknown key {_shown(key)}; {hint}")
