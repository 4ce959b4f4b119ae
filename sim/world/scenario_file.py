"""Scenarios as TOML: a table for each group of knobs, arrays of tables for occlusions, blackouts and faults."""

from __future__ import annotations

import dataclasses
from pathlib import Path

from infra.files.safe_open import read_small
from infra.toml_tables import MAX_TOML_BYTES, build, parse_toml, toml_text
from sim.errors import ScenarioError
from sim.world.scenario import Scenario


def load_scenario(path: Path) -> Scenario:
    """Read a scenario; keys that are left out keep their defaults.

    Raises:
        ScenarioError: if the file cannot be read, is no TOML, or has an unknown key, a wrong type or a bad value.
    """
    try:
        table = parse_toml(read_small(path, MAX_TOML_BYTES), str(path))
    except OSError as error:
        raise ScenarioError(f"{path}: cannot be read: {error.strerror}") from error
    except ValueError as error:
        raise ScenarioError(str(error)) from error
    return parse_scenario(table, str(path))


def save_scenario(scenario: Scenario, path: Path) -> None:
    """Write every knob; the same scenario always gives the same bytes."""
    table = dataclasses.asdict(scenario)
    if not scenario.views:
        del table["views"]  # as flights with one camera have always been written
    path.write_bytes(toml_text(table).encode())


def parse_scenario(table: object, where: str) -> Scenario:
    """Check a parsed TOML table and build the scenario.

    Raises:
        ScenarioError: on an unknown key (with the nearest known one), a wrong type or a value out of range.
    """
    try:
        return build(Scenario, table, where)
    except ScenarioError as error:
        raise ScenarioError(f"{where}: {error}") from None
    except ValueError as error:
        raise ScenarioError(str(error)) from None
