"""Options of the screens: ``[ui]`` of the user's own ``config.toml``, and ``--ui`` of the command line over it."""

from __future__ import annotations

import tomllib
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Annotated, Literal

import msgspec
import typer

from gcs.errors import ConfigError
from infra.files.safe_open import read_small
from infra.toml_tables import MAX_TOML_BYTES, build, parse_toml

Graphics = Literal["auto", "pixels", "blocks", "sextants", "octants"]
ThemeName = Literal["dark", "light", "high-contrast"]
MAX_FPS = 12.0
"""Highest frame rate, as the screens have it, which are not loaded for it."""
Ui = Annotated[
    list[str] | None,
    typer.Option(
        "--ui",
        metavar="KEY=VALUE",
        help="Option of the screens, over [ui] of ~/.config/rollcall/config.toml; may be repeated. theme: dark, light "
        "or high-contrast. graphics, how the terminal shows video: pixels (kitty, sixel, iTerm2), blocks, or sextants "
        "or octants where its fonts have them; auto, the finest that it is known to show. fps: maximum frame rate of "
        "video and map, for slow lines. bell=true: ring at every new alarm.",
    ),
]


@dataclass(frozen=True, slots=True, kw_only=True)
class ScreenOptions:
    """Options of the screens."""

    graphics: Graphics = "auto"
    """The way the terminal shows video; auto: the finest that it is known to show."""
    theme: ThemeName = "dark"
    """Colours to begin with."""
    fps: Annotated[float, msgspec.Meta(ge=0.1, le=MAX_FPS)] = MAX_FPS
    """Highest frame rate of video and map, 1/s."""
    bell: bool = False
    """True to ring the terminal's bell at every new alarm."""


@dataclass(frozen=True, slots=True, kw_only=True)
class UserConfig:
    """The user's file, ``config.toml``."""

    ui: ScreenOptions = field(default_factory=ScreenOptions)
    """``[ui]``"""


def screen_options(given: Sequence[str] | None) -> ScreenOptions:
    """Options of the screens by the user's file, if there is one, and the command line.

    Raises:
        ConfigError: the file cannot be read, or either has a key or a value that there is none of.
    """
    try:
        options = _of_user()
        given_values = dict(map(_parse, given or ()))
        return build(ScreenOptions, msgspec.to_builtins(options) | given_values, "--ui") if given else options
    except (OSError, ValueError) as error:
        raise ConfigError(str(error)) from error


def _of_user() -> ScreenOptions:
    from gcs.mission.mission import config_folder  # missions take 0.2 s to load, and --help does without

    try:
        path = config_folder() / "config.toml"
        data = read_small(path, MAX_TOML_BYTES)
    except (FileNotFoundError, RuntimeError):  # a user without a home
        return ScreenOptions()
    return build(UserConfig, parse_toml(data, str(path)), str(path)).ui


def _parse(given: str) -> tuple[str, object]:
    """Key and value; a value that is no number and no truth is text, without quotes as shells leave it."""
    key, equals, value = given.partition("=")
    if not equals:
        raise ValueError(f"--ui {given}: write KEY=VALUE, such as theme=light")
    try:
        return key.strip(), tomllib.loads(f"value = {value}")["value"]
    except (ValueError, RecursionError):
        return key.strip(), value
