"""Every command with its arguments and options, from what typer knows of them: a page a command."""

from collections.abc import Iterator
from enum import Enum
from inspect import isclass
from typing import Any, get_args

from typer.main import get_command

from docs.site.texts import Page, cell, markdown, sentence, table
from simrob_drake.cli.app import app, whole_command

FOLDER = "reference/commands"
TYPES = {"int": "whole number", "float": "number", "str": "text", "Path": "path"}


def commands() -> dict[str, str]:
    """Return the title of the group in which the help has each command, by its name."""
    group: Any = get_command(app)
    return {name: group.get_command(None, name).rich_help_panel for name in group.list_commands(None)}


def _values(annotation: Any) -> str:
    if inner := [each for each in get_args(annotation) if each is not type(None)]:
        return ", ".join(_values(each) for each in inner)
    if isclass(annotation) and issubclass(annotation, Enum):
        return ", ".join(f"`{choice.value}`" for choice in annotation)
    return TYPES.get(annotation.__name__, annotation.__name__) if isclass(annotation) else f"`{annotation}`"


def _shown(parameter: Any) -> str:
    """Return what stands for a parameter's value in the usage."""
    return str(parameter.metavar or parameter.name.upper()).replace("|", " or ")


def _row(parameter: Any, *, is_option: bool) -> list[str]:
    names = [*parameter.opts, *parameter.secondary_opts] if is_option else [_shown(parameter)]
    flag = getattr(parameter, "is_flag", False)
    value = _shown(parameter) if is_option and parameter.metavar else _values(parameter.type_descriptor.annotation)
    default = parameter.default if isinstance(parameter.default, int | float | str) and not flag else None
    given = "required" if parameter.required else f"`{default}`" if default not in (None, "") else ""
    return [
        ", ".join(f"`{name}`" for name in names),
        "" if flag else value,
        given,
        cell(parameter.help or ""),
    ]


def _description(command: Any, name: str) -> list[str]:
    """Return what a command does, how it is called, and its arguments and options."""
    arguments = [each for each in command.params if each.param_type_name == "argument"]
    options = [each for each in command.params if each.param_type_name == "option" and each.name != "help"]
    words = [
        "simrob",
        name,
        *(["COMMAND"] if hasattr(command, "commands") else []),
        *map(_shown, arguments),
        *(["[OPTIONS]"] if options else []),
    ]
    parts = [markdown(command.help), f"```text\n{' '.join(words)}\n```"]
    for kind, parameters in (("argument", arguments), ("option", options)):
        if parameters:
            rows = [_row(each, is_option=kind == "option") for each in parameters]
            parts += [
                f"**{kind.capitalize()}s**",
                table([kind, "value", "default", "what it is"], rows),
            ]
    return parts


def command_page(name: str, title: str) -> Page:
    """Return the page of a command, and of those below it."""
    command = whole_command(name)
    parts = [f"# simrob {name}", f"Group: {title}.", *_description(command, name)]
    for below, one in getattr(command, "commands", {}).items():
        parts += [f"## simrob {name} {below}", *_description(one, f"{name} {below}")]
    return Page(f"{FOLDER}/{name}.md", "\n\n".join(parts) + "\n")


def pages() -> Iterator[Page]:
    """Yield the list of all commands, and the page of each."""
    rows = []
    for name, title in commands().items():
        rows.append([f"[`simrob {name}`]({name}.md)", title, sentence(whole_command(name).help)])
        yield command_page(name, title)
    yield Page(f"{FOLDER}/index.md", "# Commands\n\n" + table(["command", "group", "what it does"], rows))
