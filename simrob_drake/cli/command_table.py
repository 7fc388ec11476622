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

_LAST_TITLE = "Extensions"
_TITLES = {
    "listing": "Stations",
    "stations": "Stations",
    "checking": "Stations",
    "legged": "Stations",
    "robots": "Robots",
    "exporting": "Exchange and other engines",
    "extensions": _LAST_TITLE,
}
"""Modules of this package with commands, and the title under which the help lists their commands, in this order.

Commands of extensions come under titles of their own, or join those of the core. The last title stays the last one.
"""


class CommandEntry(NamedTuple):
    """A command as it is known before its module is imported.

    Attributes:
        title: title of the help under which the command is listed.
        module: name of the module.
        function: name of the function in the module.
        help: docstring of the function.
        addition: the extension's announcement of the command; None for a command of the core.
    """

    title: str
    module: str
    function: str
    help: str
    addition: Addition | None = None


@cache
def core_commands() -> dict[str, CommandEntry]:
    """Find the commands of the core by name, in the tables ``COMMANDS`` of this package's modules."""
    found = {}
    for name, title in _TITLES.items():
        tree = ast.parse(Path(__file__).with_name(f"{name}.py").read_text(encoding="utf-8"))
        helps = _docstrings(tree)
        for command, function in _command_table(tree).items():
            found[command] = CommandEntry(title, f"simrob_drake.cli.{name}", function, helps[function])
    return found


register_core_names("commands", core_commands)


@cache
def all_commands() -> dict[str, CommandEntry]:
    """Find all commands by name, in the order of the help: title by title."""
    found = core_commands() | _extension_commands()
    titles = list(dict.fromkeys(entry.title for entry in found.values()))
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
    """Import the functions of the commands below a command of an extension, by the second word of their names."""
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
    """Find the commands that installed extensions add, by name; without the commands below others."""
    found = {}
    titles = {installed.name: installed.extension.title for installed in installed_extensions() if installed.extension}
    announced = {name: addition for name, addition in additions("commands").items() if " " not in name}
    helps = _helps_of_modules(addition.target.partition(":")[0] for addition in announced.values())
    for name, addition in announced.items():
        module, _, function = addition.target.partition(":")
        problem = f"A command of {addition.package}, which cannot be read: see `simrob extensions --check`."
        known = helps[module]
        found[name] = CommandEntry(
            title=titles[addition.extension],
            module=module,
            function=function,
            help=problem if known is None else known.get(function, f"A command of {addition.package}."),
            addition=addition,
        )
    return found


def _helps_of_modules(modules: Iterable[str]) -> dict[str, Mapping[str, str] | None]:
    """Read the docstrings of modules' functions, by module and function, without an import of the modules.

    A module without a source that can be read has None.
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
    """Read the table ``COMMANDS`` of a module: names of functions by names of commands."""
    for node in tree.body:
        if not isinstance(node, ast.AnnAssign) or _name(node.target) != "COMMANDS":
            continue
        if isinstance(node.value, ast.Dict):
            keys = [ast.literal_eval(key) for key in node.value.keys if key is not None]
            return dict(zip(keys, map(_name, node.value.values), strict=True))
    return {}


def _name(node: ast.expr) -> str:
    """Name that an expression of the source consists of; empty for other expressions."""
    return node.id if isinstance(node, ast.Name) else ""
