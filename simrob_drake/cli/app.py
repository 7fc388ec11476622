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
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import typer
from rich.text import Text
from typer.core import TyperCommand, TyperGroup
from typer.exceptions import TyperException

import simrob_drake
from simrob_drake.base.errors import InvalidParameter, SimrobError, shortened
from simrob_drake.base.extension import additions, load_addition, register_core_names
from simrob_drake.cli import ExitCode
from simrob_drake.cli.screen import Interrupted, console, errors, tell

_MODULES = {
    **dict.fromkeys(("listing", "stations", "linear", "legged"), "Stations"),
    **dict.fromkeys(("robots", "teach"), "Robots"),
    **dict.fromkeys(("sweep", "tune", "pushes"), "Many runs"),
    **dict.fromkeys(("simulink", "engines"), "Exchange and other engines"),
    "exercises": "Teaching",
    "extensions": "Extensions",
}
"""Modules of this package with commands, and the title under which the help lists them, in this order."""

_EXTENSION_TITLE = "Commands of extensions"


class _Entry(NamedTuple):
    """A command as it is known before its module is imported.

    Attributes:
        module: name of the module.
        title: title of the help under which the command is listed.
        function: name of the function in the module.
        help: docstring of the function.
    """

    module: str
    title: str
    function: str
    help: str


@cache
def _entries() -> dict[str, _Entry]:
    """Find all commands by name, those of the core first. No module of a command is imported."""
    return _core_entries() | _extension_entries()


def _core_entries() -> dict[str, _Entry]:
    """Find the commands in the tables ``COMMANDS`` of this package's modules."""
    found = {}
    for name, title in _MODULES.items():
        tree = ast.parse(Path(__file__).with_name(f"{name}.py").read_text(encoding="utf-8"))
        helps = _docstrings(tree)
        table = next(node for node in tree.body if isinstance(node, ast.AnnAssign) and _name(node.target) == "COMMANDS")
        assert isinstance(table.value, ast.Dict)
        for key, value in zip(table.value.keys, table.value.values, strict=True):
            function = _name(value)
            module = f"simrob_drake.cli.{name}"
            found[str(ast.literal_eval(key or value))] = _Entry(module, title, function, helps[function])
    return found


def _extension_entries() -> dict[str, _Entry]:
    """Find the commands that installed extensions add."""
    found = {}
    for name, addition in additions("commands").items():
        module, _, function = addition.target.partition(":")
        found[name] = _Entry(module, _EXTENSION_TITLE, function, _help_of(module, function, addition.package))
    return found


def _help_of(module: str, function: str, package: str) -> str:
    """Read the docstring of a command's function from the source of its module, which is not imported.

    A sentence with the name of the package takes its place if there is no docstring, or no source that can be read.
    """
    try:
        spec = find_spec(module)
        source = Path(spec.origin).read_text(encoding="utf-8") if spec and spec.origin else ""
        return _docstrings(ast.parse(source)).get(function, f"A command of {package}.")
    except (ImportError, OSError, SyntaxError, ValueError):
        return f"A command of {package}, which cannot be read: see `simrob extensions`."


def _docstrings(tree: ast.Module) -> dict[str, str]:
    """Docstrings of the functions of a module, by name."""
    return {node.name: ast.get_docstring(node) or "" for node in tree.body if isinstance(node, ast.FunctionDef)}


register_core_names("commands", _core_entries)


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
    alone = _typer(add_completion=False)
    function = _function_of(name, entry)
    parts = getattr(import_module(entry.module), "SUBCOMMANDS", {}).get(name, {})
    if parts:
        alone.callback(cls=_Group, no_args_is_help=True)(function)
        for part, own in parts.items():
            alone.command(part, cls=_Command)(own)
    else:
        alone.command(name, cls=_Command)(function)
    return typer.main.get_command(alone)


def _function_of(name: str, entry: _Entry) -> Any:
    """Import the function of a command.

    Raises:
        BrokenExtension: an extension adds the command, and its function cannot be imported.
    """
    addition = additions("commands").get(name)
    if addition is not None:
        return load_addition(addition)
    return getattr(import_module(entry.module), entry.function)


app = _typer(
    cls=_Commands,
    help="Build, control, program and watch robot stations.",
    no_args_is_help=True,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def load(arguments: list[str]) -> None:
    """Import what the command of some arguments needs."""
    if arguments and (entry := _entries().get(arguments[0])):
        import_module(entry.module)


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
