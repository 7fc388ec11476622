"""The application that all commands hang on, how it is run, and what its errors become."""

from typing import Annotated, Any

import typer
from typer.core import TyperGroup
from typer.exceptions import TyperException

import simrob_drake
from simrob_drake.cli import ExitCode, legged, robots, simulink, stations
from simrob_drake.cli.interrupts import Interrupted
from simrob_drake.cli.screen import console, tell
from simrob_drake.errors import SimrobError


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
for name, command in {**stations.COMMANDS, **legged.COMMANDS, **robots.COMMANDS, **simulink.COMMANDS}.items():
    app.command(name)(command)


def run_command(arguments: list[str]) -> int:
    """Run a command and return its exit code; errors of the user go to the error stream in one line."""
    try:
        code = app(arguments, standalone_mode=False)
    except (SimrobError, TyperException) as problem:
        tell(getattr(problem, "format_message", problem.__str__)())  # usage errors name the option there
        return ExitCode.BAD_INPUT
    except Interrupted as interrupt:
        tell(str(interrupt))
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
