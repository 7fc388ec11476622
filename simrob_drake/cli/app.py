"""The application that all commands hang on, how it is run, and what its errors become."""

import os
import sys
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperGroup
from typer.exceptions import TyperException

import simrob_drake
from simrob_drake.cli import (
    ExitCode,
    engines,
    legged,
    linear,
    prove,
    pushes,
    robots,
    simulink,
    stations,
    sweep,
    teach,
    tune,
)
from simrob_drake.cli.interrupts import Interrupted
from simrob_drake.cli.screen import console, tell
from simrob_drake.errors import InvalidParameter, SimrobError


class _Commands(TyperGroup):
    """The commands; typer alone would leave without a word when a user interrupts one."""

    def invoke(self, ctx: Any) -> Any:
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt:
            raise Interrupted("interrupted") from None


app = typer.Typer(
    cls=_Commands,
    help="Build, control, program and watch robot stations.",
    add_completion=False,
    no_args_is_help=True,
    rich_markup_mode="markdown",  # what stands in brackets is a unit, and no markup
    pretty_exceptions_enable=False,
)
for room in (stations, linear, legged, sweep, tune, prove, pushes, robots, teach, simulink, engines):
    for name, command in room.COMMANDS.items():
        app.command(name)(command)


def run_command(arguments: list[str]) -> int:
    """Run a command and return its exit code; errors of the user go to the error stream in one line."""
    try:
        _check_surroundings(arguments)
        code = app(arguments, standalone_mode=False)
        sys.stdout.flush()
    except BrokenPipeError:  # who read the output, such as `head`, has enough of it
        _write_no_more()
        return ExitCode.DONE
    except OSError as problem:  # a full disk, a folder that is gone: what is expected is told where it happens
        _write_no_more()
        why = problem.strerror or str(problem)
        tell(f"{problem.filename}: {why}" if problem.filename else why)
        return ExitCode.BAD_INPUT
    except (SimrobError, TyperException) as problem:
        tell(getattr(problem, "format_message", problem.__str__)())  # usage errors name the option there
        return ExitCode.BAD_INPUT
    except Interrupted as interrupt:
        tell(str(interrupt))
        return ExitCode.INTERRUPTED
    return code if isinstance(code, int) else ExitCode.DONE


def _check_surroundings(arguments: list[str]) -> None:
    """Check what no command can do without: arguments that are text, and a working folder.

    Raises:
        InvalidParameter: one of them is none.
    """
    for argument in arguments:
        if not argument.isascii() and any("\ud800" <= letter <= "\udfff" for letter in argument):
            raise InvalidParameter("argument", ascii(argument), "text in UTF-8, names of files, too")
    try:
        os.getcwd()
    except OSError as problem:
        raise InvalidParameter("working folder", "gone", "one that is there; change to another") from problem


def _write_no_more() -> None:
    """Write nothing more to an output that does not take it, as Python does with what is left at its end."""
    sys.stdout = Path(os.devnull).open("w", encoding="utf-8")  # noqa: SIM115


@app.callback(invoke_without_command=True)
def version(
    show: Annotated[bool, typer.Option("--version", help="Show the version and exit.", is_eager=True)] = False,
) -> None:
    """Say which version this is."""
    if show:
        console.print(simrob_drake.__version__)
        raise typer.Exit
