"""``gcs``: the commands, put together.

A command's module is imported when the command is called: a look into a log waits for no video library.
"""

from __future__ import annotations

import gc
import sys
from importlib import import_module
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, Any, TextIO, cast

import typer
from typer.core import TyperGroup
from typer.main import get_command

from gcs.cli.output.console import LogLevel, PlainStream, errors_as_exit_codes, hide_secrets, print_lines, start_log
from gcs.errors import GcsError

__all__ = ["app", "main"]

_COMMANDS: dict[str, str] = {
    "fly": "Name the vehicles in a live video; record everything.",
    "replay": "Play, seek and step through a recording.",
    "identify": "Name the boxes of a recording, faster than real time.",
    "batch": "Name the boxes of many recordings, on this machine or a cluster.",
    "batch report": "Make one page over all flights of a batch, the worst first.",
    "import": "Make a session of a flight that others recorded: film, logs, tables.",
    "export": "Write identities for other programs, or a film with names.",
    "report": "Write a page about a flight: who was named when and how surely.",
    "score": "Compare an identity log with the truth.",
    "tlog": "Look into telemetry logs; check, repair and cut them.",
    "keys": "Make, list and check the keys that vehicles sign with.",
    "calibrate": "Measure a camera: focal length, centre, lens distortion.",
    "eval-detector": "Measure a detector on labelled images.",
    "train-detector": "Fine-tune the bundled detector on labelled images.",
    "sim": "Simulate a flight with truth, as a session or live.",
    "sim from-tracks": "Put telemetry under an annotated film, as a session with truth.",
    "doctor": "Show what this machine has for a flight, and what to mend.",
    "demo": "Replay the bundled recording.",
}
"""The line of ``--help`` for each: to print it no command is imported."""
_GROUPS = ("tlog", "keys")
_MODULES = {
    "batch": "batch.batch",
    "batch report": "batch.report",
    "eval-detector": "detectors.eval_detector",
    "export": "results.export",
    "import": "import_flight",
    "report": "results.report",
    "score": "results.score",
    "train-detector": "detectors.train_detector",
}
"""In ``gcs.cli``, of commands whose module has another name; the function has the module's last one."""
_MOVED = {"bench": "benchmarks are run in a checkout now: python -m bench.{rest}"}
"""What earlier releases had, with what to type now."""


class _CommandTable(TyperGroup):
    """Module ``gcs.cli.NAME`` holds command NAME, with _ for -, as a function of that name, or a group as ``app``.

    Of a command of two words NAME is the second; the first is also a command by itself. ``_MODULES`` has the others.
    """

    def list_commands(self, ctx: object) -> list[str]:
        return list(_COMMANDS)

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:  # noqa: ANN401
        if args and args[0] in _MOVED:
            raise GcsError(_MOVED[args[0]].format(rest=" ".join(args[1:]) or "NAME"))
        two = " ".join(args[:2])
        return super().resolve_command(ctx, [two, *args[2:]] if two in _COMMANDS else args)

    def get_command(self, ctx: object, cmd_name: str) -> Any:  # noqa: ANN401  (the command class of whatever typer is built on)
        if cmd_name not in _COMMANDS:
            return None
        name = _MODULES.get(cmd_name, cmd_name.split()[-1].replace("-", "_"))
        module = import_module(f"gcs.cli.{name}")
        if cmd_name in _GROUPS:
            return get_command(module.app)
        single = typer.Typer(add_completion=False, rich_markup_mode=None)
        single.command(cmd_name)(getattr(module, name.rpartition(".")[2]))
        return get_command(single)

    def format_commands(self, ctx: object, formatter: Any) -> None:  # noqa: ANN401
        with formatter.section("Commands"):
            formatter.write_dl(list(_COMMANDS.items()))


app = typer.Typer(
    name="gcs",
    cls=_CommandTable,
    help="Rollcall: tells identical ground vehicles apart from the air.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)


def _print_version(wanted: bool) -> None:
    if wanted:
        print_lines(f"rollcall-gcs {version('rollcall-gcs')}")
        raise typer.Exit


@app.callback()
def _root(
    show_version: Annotated[
        bool, typer.Option("--version", is_eager=True, callback=_print_version, help="Print the version.")
    ] = False,
    log_level: Annotated[
        LogLevel | None, typer.Option("--log-level", help="Least level of what is logged.", show_default=False)
    ] = None,
    log_file: Annotated[
        Path | None, typer.Option("--log-file", help="Log what the program does to the end of a file; else to stderr.")
    ] = None,
) -> None:
    """Rollcall: tells identical ground vehicles apart from the air."""
    if log_level or log_file:
        start_log(log_level, log_file)


def main() -> None:
    """Entry point of the ``gcs`` command."""
    # Frames make many small objects and no cycles: collecting as rarely as this saves a tenth of the time.
    gc.freeze()
    gc.set_threshold(50_000, 20, 100)
    hide_secrets(sys.argv[1:])
    sys.stderr = cast(TextIO, PlainStream(sys.stderr, sys.argv))
    with errors_as_exit_codes():
        app()
