"""Scenarios as TOML: a table for each group of knobs, arrays of tables for occlusions, blackouts and faults."""

from __future__ import annotations

import dataclasses
import difflib
import tomllib
import types
import typing
from pathlib import Path
from typing import Any

import tomli_w

from sim.errors import ScenarioError
from sim.world.scenario import Scenario

__all__ = ["load_scenario", "save_scenario", "scenario_from_dict"]


def load_scenario(path: Path) -> Scenario:
    """Read a scenario; keys that are left out keep their defaults.

    Raises:
        ScenarioError: if the file cannot be read, is no TOML, or has an unknown key, a wrong type or a bad value.
    """
    try:
        with path.open("rb") as file:
            return scenario_from_dict(tomllib.load(file))
    except OSError as error:
        raise ScenarioError(f"{path}: cannot be read: {error.strerror}") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ScenarioError(f"{path}: is not valid TOML: {error}") from error
    except ScenarioError as error:
        raise ScenarioError(f"{path}: {error}") from error


def save_scenario(scenario: Scenario, path: Path) -> None:
    """Write every knob; the same scenario always gives the same bytes."""
    path.write_bytes(tomli_w.dumps(dataclasses.asdict(scenario)).encode())


def scenario_from_dict(values: dict[str, Any]) -> Scenario:
    """A scenario from nested tables.

    Raises:
        ScenarioError: on an unknown key (with the nearest known one), a wrong type or a value out of range.
    """
    scenario: Scenario = _build(Scenario, values, "")
    return scenario


def _build(kind: type[Any], values: object, where: str) -> Any:  # noqa: ANN401 - the field decides
    if not isinstance(values, dict):
        raise ScenarioError(f"{where}: must be a table")
    known = typing.get_type_hints(kind)
    for key in values:
        if key not in known:
            near = difflib.get_close_matches(key, known, n=1, cutoff=0.0)
            raise ScenarioError(f"{_dotted(where, key)}: no such key; did you mean {near[0]}?")
    required = {f.name for f in dataclasses.fields(kind) if f.default is f.default_factory is dataclasses.MISSING}
    if missing := sorted(required - values.keys()):
        raise ScenarioError(f"{where}: {missing[0]} is missing")
    return kind(**{key: _convert(known[key], value, _dotted(where, key)) for key, value in values.items()})


def _convert(kind: Any, value: object, where: str) -> Any:  # noqa: ANN401 - the field decides
    if dataclasses.is_dataclass(kind):
        return _build(typing.cast("type[Any]", kind), value, where)
    origin, arguments = typing.get_origin(kind), typing.get_args(kind)
    if origin is tuple:
        return _convert_tuple(arguments, value, where)
    if origin is typing.Literal:
        if value not in arguments:
            raise ScenarioError(f"{where} = {value!r}: must be one of {', '.join(map(str, arguments))}")
        return value
    if kind is float and isinstance(value, int) and not isinstance(value, bool):
        return float(value)
    if type(value) is not kind:
        wanted = {float: "a number", int: "a whole number", bool: "true or false", str: "a string"}[kind]
        raise ScenarioError(f"{where} = {value!r}: must be {wanted}")
    return value


def _convert_tuple(arguments: tuple[Any, ...], value: object, where: str) -> tuple[Any, ...]:
    if not isinstance(value, list):
        raise ScenarioError(f"{where} = {value!r}: must be an array")
    kinds = (arguments[0],) * len(value) if isinstance(arguments[-1], types.EllipsisType) else arguments
    if len(kinds) != len(value):
        raise ScenarioError(f"{where} = {value!r}: must have {len(kinds)} values")
    return tuple(_convert(kind, item, f"{where}[{i}]") for i, (kind, item) in enumerate(zip(kinds, value, strict=True)))


def _dotted(where: str, key: str) -> str:
    return f"{where}.{key}" if where else key
