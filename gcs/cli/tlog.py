"""``gcs tlog``: look into telemetry logs and cut them."""

from __future__ import annotations

import typer

__all__ = ["app"]

app = typer.Typer(help="Look into telemetry logs and cut them.", no_args_is_help=True, rich_markup_mode=None)
