"""The application that all commands hang on, how it is run, and what its errors become.

A command is imported when it is called: what is said of all of them, ``simrob --help``, is read in their files.
"""

import ast
import os
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import typer
from rich.text import Text
from typer.core import TyperCommand, TyperGroup
from typer.exceptions import TyperException

import simrob_drake
from simrob_drake.cli import ExitCode
from simrob_drake.cli.screen import Interrupted, console, errors, tell
from simrob_drake.errors import InvalidParameter, SimrobError, shortened

_MODULES = {
    **dict.fromkeys(("listing", "stations", "linear", "legged"), "Stations"),
    **dict.fromkeys(("robots", "teach"), "Robots"),
    **dict.fromkeys(("sweep", "tune", "pushes"), "Many runs"),
    **dict.fromkeys(("simulink", "engines"), "Exchange and other engines"),
    "exercises": "Teaching",
}  # those with commands, and under which title the help has them, in its order


class _Entry(NamedTuple):
    module: str
    title: str
    function: str
    help: str


@cache
def _entries() -> dict[str, _Entry]:
    """Return where each command is, and what it says of itself, by its name."""
    found = {}
    for module, title in _MODULES.items():
        tree = ast.parse(Path(__file__).with_name(f"{module}.py").read_text(encoding="utf-8"))
        helps = {node.name: ast.get_docstring(node) or "" for node in tree.body if isinstance(node, ast.FunctionDef)}
        table = next(node for node in tree.body if isinstance(node, ast.AnnAssign) and _name(node.target) == "COMMANDS")
        assert isinstance(table.value, ast.Dict)
        for key, value in zip(table.value.keys, table.value.values, strict=True):
            function = _name(value)
            found[str(ast.literal_eval(key or value))] = _Entry(module, title, function, helps[function])
    return found


def _name(node: ast.expr) -> str:
    return node.id if isinstance(node, ast.Name) else ""


def _typer(**more: Any) -> typer.Typer:
    # markdown: what stands in brackets is a unit, and no markup
    return typer.Typer(rich_markup_mode="markdown", pretty_exceptions_enable=False, **more)


def _shown(parameters: list[Any]) -> list[Any]:
    """Return parameters as the help shows them: flags, which take no value, without a type."""
    for parameter in parameters:
        if getattr(parameter, "is_flag", False):
            parameter.metavar = ""
    return parameters


class _Command(TyperCommand):
    """A command whose help shows the types of values alone."""

    def get_params(self, ctx: Any) -> list[Any]:
        return _shown(super().get_params(ctx))


class _Group(TyperGroup):
    """Commands below one name, whose help shows the types of values alone."""

    def get_params(self, ctx: Any) -> list[Any]:
        return _shown(super().get_params(ctx))


class _Commands(_Group):
    """The commands; typer alone would leave without a word when a user interrupts one."""

    def __init__(self, **options: Any) -> None:
        """Know the names and helps of the commands alone."""
        named = {
            name: TyperCommand(name, help=entry.help, rich_help_panel=entry.title) for name, entry in _entries().items()
        }
        super().__init__(**{**options, "commands": named})

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Return the command that is called, whole."""
        name, command, rest = super().resolve_command(ctx, args)
        return name, command and whole_command(str(name)), rest

    def invoke(self, ctx: Any) -> Any:
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt:
            raise Interrupted("interrupted") from None


def whole_command(name: str) -> Any:
    """Return a command of ``simrob`` by its name, with all of its options."""
    entry = _entries()[name]
    alone, module = _typer(add_completion=False), import_module(f"simrob_drake.cli.{entry.module}")
    function, parts = getattr(module, entry.function), getattr(module, "SUBCOMMANDS", {}).get(name, {})
    if parts:
        alone.callback(cls=_Group, no_args_is_help=True)(function)
        for part, own in parts.items():
            alone.command(part, cls=_Command)(own)
    else:
        alone.command(name, cls=_Command)(function)
    return typer.main.get_command(alone)


app = _typer(
    cls=_Commands,
    help="Build, control, program and watch robot stations.",
    no_args_is_help=True,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def load(arguments: list[str]) -> None:
    """Import what the command of some arguments needs."""
    if arguments and (entry := _entries().get(arguments[0])):
        import_module(f"simrob_drake.cli.{entry.module}")


def run_command(arguments: list[str]) -> int:
    """Run a command and return its exit code; errors of the user go to the error stream in one line."""
    try:
        _check_surroundings(arguments)
        with _own_warnings():
            code = app(arguments, standalone_mode=False)
        sys.stdout.flush()
    except BrokenPipeError:  # who read the output, such as `head`, has enough of it
        _write_no_more()
        return ExitCode.DONE
    except OSError as problem:  # a full disk, a folder that is gone: what is expected is told where it happens
        _write_no_more()
        why = problem.strerror or str(problem)
        tell(f"{shortened(str(problem.filename), 1000)}: {why}" if problem.filename else why)
        return ExitCode.BAD_INPUT
    except (SimrobError, TyperException) as problem:
        if message := getattr(problem, "format_message", problem.__str__)():  # usage errors name the option there
            tell(message)  # none where help was shown instead
        return ExitCode.BAD_INPUT
    except Interrupted as interrupt:
        tell(str(interrupt))
        return ExitCode.INTERRUPTED
    return code if isinstance(code, int) else ExitCode.DONE


@contextmanager
def _own_warnings() -> Iterator[None]:
    """Tell the package's own warnings in one line each, while the work goes on; others as Python does."""
    with warnings.catch_warnings():
        otherwise = warnings.showwarning

        def show(message: Warning | str, category: type[Warning], *place: Any, **more: Any) -> None:
            if category.__module__.startswith(f"{simrob_drake.__name__}."):
                label = getattr(category, "label", "warning")
                errors.print(Text.assemble((label, "yellow"), f" {message}"))
            else:
                otherwise(message, category, *place, **more)

        warnings.showwarning = show
        yield


def _check_surroundings(arguments: list[str]) -> None:
    """Check what each command needs, or raise InvalidParameter: arguments that are text, and a working folder."""
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
