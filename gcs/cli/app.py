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

from gcs.cli.output.console import (
    LogLevel,
    PlainStream,
    errors_as_exit_codes,
    hide_secrets,
    print_lines,
    print_note,
    start_log,
)
from gcs.errors import GcsError

_GROUPS: dict[str, dict[str, str]] = {
    "Fly and replay": {
        "fly": "Name the vehicles in a live video; record everything.",
        "replay": "Play, seek and step through a recording.",
        "demo": "Replay the bundled recording, or fly with a simulated fleet.",
        "doctor": "Show what this machine has for a flight, and what to mend.",
    },
    "Recordings": {
        "import": "Make a session of a flight that others recorded: film, logs, tables.",
        "identify": "Name the boxes of a recording, faster than real time.",
        "batch": "Name the boxes of many recordings; one page over all of them.",
        "export": "Write identities for other programs, or a film with names.",
        "report": "Write a page about a flight: who was named when and how surely.",
        "score": "Compare an identity log with the truth.",
        "tlog": "Look into telemetry logs; check, repair and cut them.",
    },
    "Workshop": {
        "sim": "Simulate a flight with truth, as a session or live; or put telemetry under a film.",
        "keys": "Make, list and check the keys that vehicles sign with.",
        "calibrate": "Measure a camera: focal length, centre, lens distortion.",
        "eval-detector": "Measure a detector on labelled images.",
        "train-detector": "Fine-tune the bundled detector on labelled images, in a checkout.",
    },
}
"""The line of ``--help`` for each command: to print it no command is imported."""
_FAMILIES: dict[str, dict[str, str]] = {
    "batch": {
        "run": "Name the boxes of many recordings, on this machine or a cluster.",
        "report": "Make one page over all flights of a batch, the worst first.",
    },
    "sim": {
        "run": "Simulate a flight with truth, as a session or live.",
        "from-tracks": "Put telemetry under an annotated film, as a session with truth.",
    },
}
"""Commands of two words, of which the second is imported when it is called."""
_MODULES = {
    "batch run": "batch.batch",
    "batch report": "batch.report",
    "eval-detector": "detectors.eval_detector",
    "export": "results.export",
    "import": "import_flight",
    "report": "results.report",
    "score": "results.score",
    "sim from-tracks": "from_tracks",
    "sim run": "sim",
    "train-detector": "detectors.train_detector",
}
"""Modules in ``gcs.cli`` of the commands whose module has another name; the function has the module's last one."""
_MOVED = {"bench": "benchmarks are run in a checkout now: python -m bench.{rest}"}
"""Commands that earlier releases had, with what to type now."""
_RENAMED = {
    "fly": {"--out": "--forward", "--tell": "--publish", "--show": "--stream"},
    "replay": {"--tell": "--publish", "--show": "--stream"},
}
"""Options of each command by their names in the release before, which are understood and answered with the new one."""
_OF_SCREENS = {
    "fly": ("--graphics", "--theme", "--fps", "--bell"),
    "replay": ("--graphics", "--theme", "--fps"),
}
"""Options by their names in the release before that are keys of ``--ui`` now."""
_WORDS = {
    "SECONDS": "--duration --listen --video-start --timeout --from --to --clock-within",
    "OFFSET": "--clock",
    "MINUTES": "--minutes",
    "GIB": "--memory",
    "METRES": "--gsd --height --square",
    "DEGREES": "--fov --pitch",
    "RATE": "--fps",
    "SHARE": "--score --rendered --min-confidence",
    "WIDTHxHEIGHT": "--frame-size",
    "COLUMNSxROWS": "--board",
    "NUMBER": "--jobs --retries --every --port --most --first-frame --team --vehicle --seed --steps --views",
    "ID": "--message --system",
    "ID=FILE": "--ugv",
    "URL": "--link --forward --telemetry --stream --publish --scheduler",
    "NAME": "--format --camera",
    "NAMES": "--classes --ignore --names",
    "FILE": "--list --mission --model --against --front --truth --identity --uav --tlog --lens --log --file",
    "VIDEO": "--video",
    "FOLDER": "--sessions --keys",
    "PATH": "--out",
}
"""Word that stands for the value of options, where an option has none of its own."""


def _with_words(command: Any) -> Any:  # noqa: ANN401
    """Return a command with words for the values of its options, and the arguments' names without their types."""
    words = {option: word for word, options in _WORDS.items() for option in options.split()}
    for param in (param for each in (command, *getattr(command, "commands", {}).values()) for param in each.params):
        if param.param_type_name == "argument":
            param.display_type_rich = lambda ctx: None
        elif not param.is_flag:
            param.metavar = param.metavar or next((words[name] for name in param.opts if name in words), None)
    return command


def _single(name: str) -> Any:  # noqa: ANN401
    """Command NAME: a function of the module's last name in ``gcs.cli``; ``_MODULES`` has those called otherwise."""
    module = _MODULES.get(name, name.replace("-", "_"))
    single = typer.Typer(add_completion=False, rich_markup_mode=None)
    single.command(name.split()[-1])(getattr(import_module(f"gcs.cli.{module}"), module.rpartition(".")[2]))
    return _with_words(get_command(single))


class _TwoWords(TyperGroup):
    """Commands of one first word."""

    def list_commands(self, ctx: object) -> list[str]:
        return list(_FAMILIES[str(self.name)])

    def get_command(self, ctx: object, cmd_name: str) -> Any:  # noqa: ANN401
        return _single(f"{self.name} {cmd_name}") if cmd_name in _FAMILIES[str(self.name)] else None

    def format_commands(self, ctx: object, formatter: Any) -> None:  # noqa: ANN401
        with formatter.section("Commands"):
            formatter.write_dl(list(_FAMILIES[str(self.name)].items()))


class _CommandTable(TyperGroup):
    """All commands: of one word, of a family, or of a group that its module has as ``app``."""

    def list_commands(self, ctx: object) -> list[str]:
        return [name for commands in _GROUPS.values() for name in commands]

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:  # noqa: ANN401
        if args and args[0] in _MOVED:
            raise GcsError(
                _MOVED[args[0]].format(rest=" ".join(word for word in args[1:] if word != "--help") or "NAME")
            )
        return super().resolve_command(ctx, as_spelt_now(args))

    def get_command(self, ctx: object, cmd_name: str) -> Any:  # noqa: ANN401
        if cmd_name in _FAMILIES:
            return _TwoWords(name=cmd_name, help=_line(cmd_name), no_args_is_help=True, rich_markup_mode=None)
        if cmd_name in ("tlog", "keys"):
            return _with_words(get_command(import_module(f"gcs.cli.{cmd_name}").app))
        return _single(cmd_name) if _line(cmd_name) else None

    def format_commands(self, ctx: object, formatter: Any) -> None:  # noqa: ANN401
        width = max(map(len, self.list_commands(ctx)))
        for title, commands in _GROUPS.items():
            with formatter.section(title):
                formatter.write_dl([(name.ljust(width), line) for name, line in commands.items()])


def _line(name: str) -> str:
    return next((commands[name] for commands in _GROUPS.values() if name in commands), "")


def as_spelt_now(args: list[str]) -> list[str]:
    """Arguments as this release spells them; each that the release before spelt otherwise is answered with a note."""
    if not args:
        return args
    first, second = args[0], args[1] if len(args) > 1 else "--help"
    if first in _FAMILIES and second != "--help" and second not in _FAMILIES[first]:
        print_note(f"gcs {first} is now gcs {first} run; without the word it goes on for this release")
        return [first, "run", *args[1:]]
    renamed, now, rest = _RENAMED.get(first, {}), [], iter(args)
    for arg in rest:
        name, equals, value = arg.partition("=")
        if name in _OF_SCREENS.get(first, ()):
            key = name.removeprefix("--")
            arg = f"--ui={key}={value if equals else 'true' if key == 'bell' else next(rest, '')}"
            print_note(f"{name} is now --ui {key}=VALUE; the old word goes on for this release")
        elif name in renamed:
            print_note(f"{name} is now {renamed[name]}; the old word goes on for this release")
            arg = renamed[name] + equals + value
        now.append(arg)
    return now


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
        Path | None,
        typer.Option(
            "--log-file", metavar="FILE", help="Log what the program does to the end of a file; else to stderr."
        ),
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
