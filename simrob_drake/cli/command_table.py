"""The commands of ``simrob`` by name, those of the core and those of installed extensions.

A module with commands has a table ``COMMANDS`` of functions by command, and the docstring of each function is the help
of its command. Both are read from the source of the module by Python's parser :mod:`ast`. The module is imported only
when one of its commands is called: modules load Drake and scipy, and ``simrob --help`` would take seconds.
"""

import ast
from collections.abc import Mapping
from functools import cache
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

from simrob_drake.base.extension import (
    Addition,
    additions,
    installed_extensions,
    load_addition,
    register_core_names,
)
from simrob_drake.base.messages import Message, message
from simrob_drake.cli.help import command_message

_PACKAGE = "cli"
"""First word of the ids of messages about the core's commands."""

_LAST_TITLE = message("cli.title_extensions", "Extensions")
_STATIONS = message("cli.title_stations", "Stations")
_TITLES = {
    "listing": _STATIONS,
    "stations": _STATIONS,
    "plotting": _STATIONS,
    "checking": _STATIONS,
    "legged": _STATIONS,
    "robots": message("cli.title_robots", "Robots"),
    "exporting": message("cli.title_exchange", "Exchange and other engines"),
    "extensions": _LAST_TITLE,
}
"""Modules of this package with commands, and the title under which the help lists their commands, in this order.

Commands of extensions come under titles of their own, or join those of the core. The last title stays the last one.
"""


class CommandEntry(NamedTuple):
    """Title, help and place of a command, for which its module need not be imported.

    Attributes:
        title: title of the help under which the command is listed.
        module: name of the module.
        function: name of the function in the module.
        help: docstring of the function, as a message.
        addition: the extension's announcement of the command; None for a command of the core.
    """

    title: str
    module: str
    function: str
    help: str
    addition: Addition | None = None

    @property
    def package(self) -> str:
        """First word of the ids of the messages about the command: its extension, or this package."""
        return _PACKAGE if self.addition is None else self.addition.extension


@cache
def core_commands() -> dict[str, CommandEntry]:
    """Find the commands of the core by name, in the tables ``COMMANDS`` of this package's modules."""
    entries = {}
    for module, title in _TITLES.items():
        source = Path(__file__).with_name(f"{module}.py").read_text(encoding="utf-8")
        tree = ast.parse(source)
        helps = _docstrings(tree)
        for command, function in _command_table(tree).items():
            entries[command] = CommandEntry(
                title=title,
                module=f"simrob_drake.cli.{module}",
                function=function,
                help=command_message(command, helps[function], _PACKAGE),
            )
    return entries


# An extension that adds a command of one of these names is reported, and its command is not used.
register_core_names("commands", core_commands)


@cache
def all_commands() -> dict[str, CommandEntry]:
    """Find all commands by name, in the order of the help: title by title."""
    entries = core_commands() | _extension_commands()
    titles = list(dict.fromkeys(entry.title for entry in entries.values()))
    # The last title of the core comes after the titles of extensions.
    titles.remove(_LAST_TITLE)
    titles.append(_LAST_TITLE)
    commands_by_title = dict[str, CommandEntry]()
    for title in titles:
        commands_by_title |= {
            command: entry for command, entry in entries.items() if entry.title == title
        }
    return commands_by_title


def find_command(name: str) -> CommandEntry | None:
    """Find a command by name. Returns None if there is no such command."""
    # The search for extensions takes time, so it is made only for a name that the core does not have.
    return core_commands().get(name) or all_commands().get(name)


def command_function(entry: CommandEntry) -> Any:
    """Import the function of a command.

    Raises:
        BrokenExtension: an extension adds the command, and its function cannot be imported.
    """
    if entry.addition is not None:
        return load_addition(entry.addition)
    return getattr(import_module(entry.module), entry.function)


def subcommand_functions(name: str) -> dict[str, Any]:
    """Import the functions of the commands below a command of an extension, by the second word of their names.

    The function of ``course check``, for example, is found for the name ``course``, with the key ``check``.

    Args:
        name: name of the command, of one word. A command of the core has none below it, and the result is empty.

    Raises:
        BrokenExtension: a function cannot be imported.
    """
    if name in core_commands():
        return {}
    below = f"{name} "
    return {
        full_name.removeprefix(below): load_addition(addition)
        for full_name, addition in additions("commands").items()
        if full_name.startswith(below)
    }


def extensions_left_out() -> list[str]:
    """Names of the installed extensions that are left out, whose commands are missing."""
    return [installed.name for installed in installed_extensions() if installed.problem]


def _extension_commands() -> dict[str, CommandEntry]:
    """Find the commands that installed extensions add, by name.

    Commands of two words, which are below another command, are left out.
    """
    titles = {
        installed.name: installed.extension.title
        for installed in installed_extensions()
        if installed.extension
    }
    # Docstrings of each module, which is read once although it may have several commands.
    docstrings_of_modules = dict[str, Mapping[str, str] | None]()
    entries = {}
    for name, addition in additions("commands").items():
        if " " in name:
            continue
        # The target of an addition is written "package.module:function", as in entry points of Python.
        module, _, function = addition.target.partition(":")
        if module not in docstrings_of_modules:
            docstrings_of_modules[module] = _docstrings_of_module(module)
        entries[name] = CommandEntry(
            title=titles[addition.extension],
            module=module,
            function=function,
            help=_help_of_addition(name, addition, docstrings_of_modules[module]),
            addition=addition,
        )
    return entries


def _help_of_addition(
    name: str, addition: Addition, docstrings: Mapping[str, str] | None
) -> Message:
    """Make the help of a command of an extension, for the list of commands.

    Args:
        name: name of the command.
        addition: the extension's announcement of the command.
        docstrings: docstrings of the functions in the module of the command, by name. None if the source of the module
            cannot be read.
    """
    if docstrings is None:
        return message(
            "cli.command_cannot_be_read",
            "A command of {package}, which cannot be read: see `simrob extensions --check`.",
            package=addition.package,
        )
    _, _, function = addition.target.partition(":")
    # The function is written in the module itself, which is the usual case.
    if function in docstrings:
        return command_message(name, docstrings[function], addition.extension)
    # A function that the module itself imports has no docstring in the source of the module.
    return message("cli.command_of_package", "A command of {package}.", package=addition.package)


def _docstrings_of_module(module: str) -> dict[str, str] | None:
    """Read the docstrings of a module's functions from its source, without an import of the module.

    Args:
        module: full name of the module.

    Returns:
        the docstring of each function, by name. None if the source of the module cannot be read.
    """
    try:
        spec = find_spec(module)
        if spec is None or not spec.origin:
            return None
        source = Path(spec.origin).read_text(encoding="utf-8")
        return _docstrings(ast.parse(source))
    # `find_spec` imports the packages above the module, whose code may raise anything, and the source may be damaged.
    # `simrob extensions --check` reports the reason; the list of commands must not fail because of it.
    except (Exception, SystemExit):
        return None


def _docstrings(tree: ast.Module) -> dict[str, str]:
    """Docstrings of the functions of a module, by name."""
    return {
        node.name: ast.get_docstring(node) or ""
        for node in tree.body
        if isinstance(node, ast.FunctionDef)
    }


def _command_table(tree: ast.Module) -> dict[str, str]:
    """Read the table ``COMMANDS`` of a module: names of functions by names of commands.

    Args:
        tree: source of the module. The table is an assignment ``COMMANDS = {"NAME": FUNCTION}``, with or without a
            type. If there is no such assignment, the result is empty.

    Raises:
        ValueError: the table contains the entries of another one (``**OTHER``), which the source does not name.
    """
    for node in tree.body:
        # COMMANDS: dict[...] = {...}
        if isinstance(node, ast.AnnAssign):
            targets: list[ast.expr] = [node.target]
        # COMMANDS = {...}, or A = COMMANDS = {...}
        elif isinstance(node, ast.Assign):
            targets = node.targets
        else:
            continue
        is_table = any(_name(target) == "COMMANDS" for target in targets)
        if is_table and isinstance(node.value, ast.Dict):
            return _functions_by_command(node.value)
    return {}


def _functions_by_command(table: ast.Dict) -> dict[str, str]:
    """Read the entries ``"NAME": FUNCTION`` of a table of commands.

    Raises:
        ValueError: the table contains the entries of another one (``**OTHER``).
    """
    functions = dict[str, str]()
    for key, function in zip(table.keys, table.values, strict=True):
        # The parser gives an entry **OTHER without a key.
        if key is None:
            raise ValueError(
                "COMMANDS contains **; each command must be written in the table itself"
            )
        functions[ast.literal_eval(key)] = _name(function)
    return functions


def _name(node: ast.expr) -> str:
    """Name of a variable or function that is the whole expression, such as ``run``. Empty for other expressions."""
    return node.id if isinstance(node, ast.Name) else ""
