"""The application that all commands hang on, how it is run, and what its errors become."""

from __future__ import annotations

import sys
from typing import Annotated

import typer
from typer.exceptions import TyperException

import simrob_drake
from simrob_drake.cli import robots, stations
from simrob_drake.cli.exit_codes import ExitCode
from simrob_drake.cli.screen import console
from simrob_drake.errors import SimrobError

app = typer.Typer(
    help="Build, control, program and watch robot stations.",
    add_completion=False,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
)
for name, command in {**stations.COMMANDS, **robots.COMMANDS}.items():
    app.command(name)(command)


def main() -> None:
    """Run the command line and leave with its exit code."""
    sys.exit(run_command(sys.argv[1:]))


def run_command(arguments: list[str]) -> int:
    """Run a command and return its exit code; errors of the user go to the error stream in one line."""
    try:
        code = app(arguments, standalone_mode=False)
    except (SimrobError, TyperException) as problem:
        tell = getattr(problem, "format_message", problem.__str__)  # usage errors name the option there
        print(f"simrob: {' '.join(tell().split())}", file=sys.stderr)
        return ExitCode.BAD_INPUT
    except KeyboardInterrupt:
        print("simrob: interrupted", file=sys.stderr)
        return ExitCode.INTERRUPTED
    return code if isinstance(code, int) else ExitCode.DONE


@app.callback(invoke_without_command=True)
def version(
    show: Annotated[bool, typer.Option("--version", help="Show the version and exit.", is_eager=True)] = False,
) -> None:
    """Say which version this is."""
    if show:
        console.print(simrob_drake.__version__)
        raise typer.Exit
