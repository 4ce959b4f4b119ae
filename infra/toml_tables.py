"""TOML tables as frozen dataclasses: every value is checked, an unknown key is refused with the nearest known name.

Types and limits are those that the dataclass declares for its fields (``msgspec.Meta``). Whatever is wrong is a
ValueError of one line that names in which file and table, which key, what it is, and what is needed.
"""

from __future__ import annotations

import dataclasses
import difflib
import re
import tomllib
from collections.abc import Mapping, Sequence
from typing import Any, TypeVar

import msgspec
import tomli_w
from msgspec import inspect

Kind = TypeVar("Kind")

MAX_TOML_BYTES = 256 << 10
"""Ten times what a mission with 255 vehicles, each with a comment, takes."""
_MAX_DEPTH = 16
"""Most levels of nesting; mission files have two, and unbounded nesting overflows the stack of recursive readers."""
_MAX_SHOWN = 100
"""Characters of a wrong value that a message repeats."""
_LONG_KEY = re.compile(rf"""(?<![\w"'-])(?:(?:[\w-]++|"[^"\n]*+"|'[^'\n]*+')[ \t]*+\.[ \t]*+){{{_MAX_DEPTH}}}""")
"""A dotted key of more parts than ``_MAX_DEPTH``: the parser needs time and memory quadratic in their number."""

_PLACE = re.compile(r"\.(\w+)|\[(\d+)\]")
"""Pattern of one step of the path in a msgspec error message, such as ``$.ugv[0].system_id``."""
_WHOLE_FLOAT = 2.0**53
"""Bound below which every whole number is exact as a float."""
_INSPECTED: dict[type, inspect.Type] = {}
_SINGULAR: Mapping[type, str] = {
    inspect.BoolType: "true or false",
    inspect.IntType: "a whole number",
    inspect.FloatType: "a number",
    inspect.StrType: "text in quotes",
}
_PLURAL: Mapping[type, str] = {
    inspect.IntType: "whole numbers",
    inspect.FloatType: "numbers",
    inspect.StrType: "texts",
    inspect.TupleType: "lists",
}


def parse_toml(data: bytes, where: str) -> dict[str, Any]:
    """Parse a TOML file's bytes; ``where``, such as the file's name, begins error messages.

    Raises:
        ValueError: not UTF-8, not TOML, nested too deeply, or with a number beyond 64 bits.
    """
    try:
        text = data.decode()
    except UnicodeDecodeError as error:
        raise ValueError(f"{where}: cannot be read as text: {error}") from error
    if _LONG_KEY.search(text):
        raise ValueError(f"{where}: a key has more than {_MAX_DEPTH} parts")
    try:
        table = tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # a number of thousands of digits is a bare ValueError
        raise ValueError(f"{where}: not valid TOML: {error}") from error
    level: list[Any] = [table]
    for _ in range(_MAX_DEPTH):
        level = [value for part in level for value in (part.values() if isinstance(part, dict) else part)]
        if any(type(value) is int and value.bit_length() > 63 for value in level):
            raise ValueError(f"{where}: not valid TOML: a whole number has more than 64 bits")
        level = [value for value in level if isinstance(value, dict | list)]
    if level:
        raise ValueError(f"{where}: more than {_MAX_DEPTH} tables or lists are nested in each other")
    return table


def toml_text(table: Mapping[str, Any]) -> str:
    """A table as TOML, with unprintable characters as escapes."""
    text = tomli_w.dumps(table)
    return text if text.replace("\n", "").isprintable() else "".join(map(_escaped, text))


def _escaped(character: str) -> str:
    if character.isprintable() or character == "\n":
        return character
    code = ord(character)
    if 0xD800 <= code < 0xE000:  # a surrogate: a byte of a path that is not UTF-8, which TOML cannot hold
        return "\N{REPLACEMENT CHARACTER}"
    return f"\\u{code:04x}" if code < 0x10000 else f"\\U{code:08x}"


def build(kind: type[Kind], table: object, where: str) -> Kind:
    """Build a dataclass, and those in its fields, from a parsed table.

    A whole number may be written as a float. A ValueError raised by a dataclass gets its place in the file in front.

    Raises:
        ValueError: not a table, an unknown or missing key, a value of another type or out of its limits.
    """
    form = _type_info(kind)
    values = _known_values(form, table, where)
    try:
        return msgspec.convert(values, kind)
    except msgspec.ValidationError as error:
        raise ValueError(_explained(error, form, values, where)) from None


def _type_info(kind: type) -> inspect.Type:
    """Type of a dataclass as msgspec knows it, asked once: it takes a millisecond, and a scenario has nine."""
    if kind not in _INSPECTED:
        _INSPECTED[kind] = inspect.type_info(kind)
    return _INSPECTED[kind]


def check_limits(part: object, where: str) -> None:
    """Check the numbers of a dataclass that was not built from a file, and of the dataclasses in its fields.

    Raises:
        ValueError: one is out of its limits.
    """
    for field in _fields(_type_info(type(part))).values():
        value = getattr(part, field.name)
        if dataclasses.is_dataclass(value):
            check_limits(value, f"{where}: [{field.name}]")
        elif _is_number(value) and (complaint := _out_of_limits(field.name, value, field.type)):
            raise ValueError(f"{where}: {complaint}")


def _fields(kind: inspect.Type) -> dict[str, inspect.Field]:
    """The fields of a dataclass by name; none for any other type."""
    return {field.name: field for field in kind.fields} if isinstance(kind, inspect.DataclassType) else {}


def _options(kind: inspect.Type) -> tuple[inspect.Type, ...]:
    """The types a value may have: the members of a union except None, else the type itself; metadata removed."""
    parts = kind.types if isinstance(kind, inspect.UnionType) else (kind,)
    plain = (part.type if isinstance(part, inspect.Metadata) else part for part in parts)
    return tuple(part for part in plain if not isinstance(part, inspect.NoneType))


def _step(kind: inspect.Type, name: str) -> inspect.Type:
    """The type of a field, or of the items of a list where the name is empty."""
    for option in _options(kind):
        if name and name in _fields(option):
            return _fields(option)[name].type
        if not name and isinstance(option, inspect.VarTupleType):
            return option.item_type
        if not name and isinstance(option, inspect.TupleType):
            return option.item_types[0]
    return inspect.AnyType()


def _known_values(kind: inspect.Type, value: object, where: str) -> object:
    """The value with whole floats as integers; a ValueError if a table in it has an unknown key."""
    for option in _options(kind):
        if isinstance(option, inspect.DataclassType):
            if not isinstance(value, Mapping):
                raise ValueError(f"{where} must be a table of keys and values")
            fields = _fields(option)
            _refuse_unknown(value, tuple(fields), where)
            return {
                name: _known_values(fields[name].type, part, _place(where, name, fields[name].type))
                for name, part in value.items()
            }
    if isinstance(value, list):
        item = _step(kind, "")
        numbered = _fields(item)
        return [
            _known_values(item, part, f"{where} number {k + 1}" if numbered else where) for k, part in enumerate(value)
        ]
    if isinstance(value, float) and abs(value) < _WHOLE_FLOAT and value.is_integer():
        return int(value)
    return value


def _place(where: str, name: str, kind: inspect.Type) -> str:
    """``where`` extended by a table's name; unchanged for other values, which messages name by their key."""
    if any(isinstance(option, inspect.DataclassType) for option in _options(kind)):
        return f"{where}: [{name}]"
    return f"{where}: [[{name}]]" if _fields(_step(kind, "")) else where


def _refuse_unknown(table: Mapping[str, object], known: Sequence[str], where: str) -> None:
    for key in table:
        if key not in known:
            near = difflib.get_close_matches(key, known, n=1)
            hint = f"did you mean {near[0]}?" if near else f"known are {', '.join(known)}"
            raise ValueError(f"{where}: unknown key {_shown(key)}; {hint}")


def _explained(error: msgspec.ValidationError, kind: inspect.Type, value: Any, where: str) -> str:  # noqa: ANN401 - TOML
    """Message for an invalid value: its place, the value, and what is needed instead."""
    text, _, path = str(error).rpartition(" - at `$")
    name = ""
    of_field: tuple[inspect.Type, Any] = kind, value
    for key, index in _PLACE.findall(path):
        if key:
            kind, value, name = _step(kind, key), value[key], key
            where = _place(where, key, kind)
            of_field = kind, value
        else:
            kind, value = _step(kind, ""), value[int(index)]
            where += f" number {int(index) + 1}" if _fields(kind) else ""
    if isinstance(error.__cause__, ValueError):
        return f"{where}: {error.__cause__}"
    if missing := re.search(r"missing required field `(\w+)`", text or str(error)):
        return f"{where}: {missing[1]} is missing"
    if _is_number(value) and (complaint := _out_of_limits(name, value, kind)):
        return f"{where}: {complaint}"
    kind, value = of_field
    return f"{where}: {name} is {_shown(value)}; {_needed(kind)} is needed"


def _out_of_limits(name: str, value: float, kind: inspect.Type) -> str:
    """Message for a number beyond its limits; empty if it is within them or of another type."""
    for option in _options(kind):
        if isinstance(option, inspect.FloatType) or (isinstance(option, inspect.IntType) and isinstance(value, int)):
            least, most = option.ge, option.le
            if least is not None and most is not None and not least <= value <= most:
                return f"{name} is {_shown(value)}; it must lie between {least:g} and {most:g}"
    return ""


def _needed(kind: inspect.Type) -> str:
    """Description of the values that a field accepts."""
    if isinstance(kind, inspect.Metadata):
        return f"{_needed(kind.type)} ({(kind.extra_json_schema or {}).get('description', '')})"
    if isinstance(kind, inspect.UnionType):
        return " or ".join(_needed(part) for part in kind.types if not isinstance(part, inspect.NoneType))
    if isinstance(kind, inspect.LiteralType):
        return " or ".join(map(repr, kind.values))
    if isinstance(kind, inspect.VarTupleType):
        return f"a list of {_count(kind.min_length)}{_PLURAL.get(type(kind.item_type), 'tables')}"
    if isinstance(kind, inspect.TupleType):
        return f"a list of {_count(len(kind.item_types))}{_PLURAL.get(type(kind.item_types[0]), 'tables')}"
    return _SINGULAR.get(type(kind), "a table of keys and values")


def _count(number: int | None) -> str:
    return f"{number} " if number else ""


def _shown(value: object) -> str:
    """The value as messages show it, shortened."""
    text = repr(value)
    return text if len(text) <= _MAX_SHOWN else text[:_MAX_SHOWN] + "…"


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)
