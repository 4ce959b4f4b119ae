"""``gcs``: the commands, put together."""

from __future__ import annotations

import gc
from importlib.metadata import version
from typing import Annotated

import typer

from gcs.cli import bench, demo, export, fly, identify, replay, score, sim, tlog
from gcs.cli.console import explained, say

__all__ = ["app", "main"]

app = typer.Typer(
    name="gcs",
    help="Rollcall: tells identical ground vehicles apart from the air.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)


@app.callback()
def _root(
    show_version: Annotated[bool, typer.Option("--version", is_eager=True, help="Print the version.")] = False,
) -> None:
    if show_version:
        say(f"rollcall-gcs {version('rollcall-gcs')}")
        raise typer.Exit


app.command("fly")(fly.fly)
app.command("replay")(replay.replay)
app.command("identify")(identify.identify)
app.command("export")(export.export)
app.command("score")(score.score)
app.command("sim")(sim.sim)
app.command("demo")(demo.demo)
app.command(
    "bench",
    context_settings={"allow_extra_args": True, "ignore_unknown_options": True, "help_option_names": []},
)(bench.bench)
app.add_typer(tlog.app, name="tlog")


def main() -> None:
    """Entry point of the ``gcs`` command."""
    # Frames make many small objects and no cycles: collecting as rarely as this saves a tenth of the time.
    gc.freeze()
    gc.set_threshold(50_000, 20, 100)
    with explained():
        app()
