"""The commands of ``simrob`` by name, those of the core and those of installed extensions.

Names and helps are read from the source of the modules. A module with commands is imported when one of its commands is
called, so that ``simrob --help`` imports none of them.
"""

import ast
from collections.abc import Iterable, Mapping
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
from simrob_drake.base.messages import message
from simrob_drake.cli.help import command_message

_PACKAGE = "cli"  # first word of the ids of messages about the core's commands

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
    found = {}
    for module, title in _TITLES.items():
        source = Path(__file__).with_name(f"{module}.py").read_text(encoding="utf-8")
        tree = ast.parse(source)
        helps = _docstrings(tree)
        for command, function in _command_table(tree).items():
            found[command] = CommandEntry(
                title=title,
                module=f"simrob_drake.cli.{module}",
                function=function,
                help=command_message(command, helps[function], _PACKAGE),
            )
    return found


register_core_names("commands", core_commands)


@cache
def all_commands() -> dict[str, CommandEntry]:
    """Find all commands by name, in the order of the help: title by title."""
    found = core_commands() | _extension_commands()
    titles = list(dict.fromkeys(entry.title for entry in found.values()))
    # The last title of the core comes after the titles of extensions.
    titles.remove(_LAST_TITLE)
    titles.append(_LAST_TITLE)
    return dict(sorted(found.items(), key=lambda item: titles.index(item[1].title)))


def find_command(name: str) -> CommandEntry | None:
    """Find a command by name. Extensions are looked for only if the core has no such command."""
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
    found = {}
    titles = {installed.name: installed.extension.title for installed in installed_extensions() if installed.extension}
    announced = {name: addition for name, addition in additions("commands").items() if " " not in name}
    helps_of_modules = _helps_of_modules(addition.target.partition(":")[0] for addition in announced.values())
    for name, addition in announced.items():
        module, _, function = addition.target.partition(":")
        helps = helps_of_modules[module]
        text: str
        if helps is None:
            text = message(
                "cli.command_cannot_be_read",
                "A command of {package}, which cannot be read: see `simrob extensions --check`.",
                package=addition.package,
            )
        elif function in helps:
            text = command_message(name, helps[function], addition.extension)
        else:
            # A function that the module itself imports has no docstring in the source of the module.
            text = message("cli.command_of_package", "A command of {package}.", package=addition.package)
        found[name] = CommandEntry(
            title=titles[addition.extension], module=module, function=function, help=text, addition=addition
        )
    return found


def _helps_of_modules(modules: Iterable[str]) -> dict[str, Mapping[str, str] | None]:
    """Read the docstrings of modules' functions from the sources, without an import of the modules.

    Args:
        modules: full names of the modules; a name may occur several times.

    Returns:
        the docstring of each function, by module and function; None for a module whose source cannot be read.
    """
    found: dict[str, Mapping[str, str] | None] = {}
    for module in dict.fromkeys(modules):
        try:
            spec = find_spec(module)
            source = Path(spec.origin).read_text(encoding="utf-8") if spec and spec.origin else None
            found[module] = None if source is None else _docstrings(ast.parse(source))
        except (ImportError, OSError, SyntaxError, ValueError):
            found[module] = None
    return found


def _docstrings(tree: ast.Module) -> dict[str, str]:
    """Docstrings of the functions of a module, by name."""
    return {node.name: ast.get_docstring(node) or "" for node in tree.body if isinstance(node, ast.FunctionDef)}


def _command_table(tree: ast.Module) -> dict[str, str]:
    """Read the table ``COMMANDS`` of a module: names of functions by names of commands.

    Args:
        tree: source of the module. The table is an assignment ``COMMANDS = {"NAME": FUNCTION}``, with or without a
            type. If there is no such assignment, the result is empty.

    Raises:
        ValueError: the table contains the entries of another one (``**OTHER``), which the source does not name.
    """
    for node in tree.body:
        if isinstance(node, ast.AnnAssign):
            targets: list[ast.expr] = [node.target]
        elif isinstance(node, ast.Assign):
            targets = node.targets
        else:
            continue
        is_table = any(_name(target) == "COMMANDS" for target in targets)
        if is_table and isinstance(node.value, ast.Dict):
            table = dict[str, str]()
            for key, function in zip(node.value.keys, node.value.values, strict=True):
                if key is None:  # an entry **OTHER
                    raise ValueError("COMMANDS contains **; each command must be written in the table itself")
                table[ast.literal_eval(key)] = _name(function)
            return table
    return {}


def _name(node: ast.expr) -> str:
    """Name that an expression of the source consists of; empty for other expressions."""
    return node.id if isinstance(node, ast.Name) else ""
