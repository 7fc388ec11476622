"""Texts of ``--help`` in the language of the output.

Helps of options are messages where the options are declared. The help of a command is the docstring of its function,
so it becomes a message here: its id is ``<package>.command_<name>``. Typer takes plain texts, so all of them are
translated before typer makes a command of a function.
"""

import inspect
from collections.abc import Callable, Sequence
from copy import copy
from functools import wraps
from typing import Annotated, Any, get_args, get_origin

from typer.models import ParameterInfo

from simrob_drake.base.messages import Message, join_texts, message, translate

_PROGRAM = "simrob "
_EXAMPLES_FOLLOW = "For example:"
_FOR_EXAMPLE = message("cli.help_for_example", "For example:")

_OPTIONS_OF_TYPER = {
    "help": message("cli.help_help", "Show this message and exit."),
    "install_completion": message("cli.help_install_completion", "Install completion for the current shell."),
    "show_completion": message(
        "cli.help_show_completion",
        "Show completion for the current shell, to copy it or customize the installation.",
    ),
}
"""Helps of the options that typer adds, by the names of their parameters."""

_WORDS_OF_TYPER = {
    "ARGUMENTS_PANEL_TITLE": message("cli.help_arguments", "Arguments"),
    "OPTIONS_PANEL_TITLE": message("cli.help_options", "Options"),
    "COMMANDS_PANEL_TITLE": message("cli.help_commands", "Commands"),
    # Typer fills the braces that remain.
    "DEFAULT_STRING": message("cli.help_default", "[default: {value}]", value="{}"),
    "ENVVAR_STRING": message("cli.help_variable", "[env var: {name}]", name="{}"),
    "REQUIRED_LONG_STRING": message("cli.help_required", "[required]"),
}
"""Words around the helps, by the names of typer's constants."""

_USAGE = message("cli.help_usage", "Usage:")
_OPTIONS_IN_USAGE = message("cli.help_options_in_usage", "[OPTIONS]")
_COMMAND_IN_USAGE = message("cli.help_command_in_usage", "COMMAND [ARGS]...")


def command_message(name: str, docstring: str, package: str) -> Message:
    """Make the help of a command from the docstring of its function.

    Args:
        name: name of the command, of one or two words.
        docstring: its paragraphs are sentences, or command lines as examples, which are the same in each language.
        package: first word of the message's id.
    """
    paragraphs = docstring.split("\n\n")
    is_example = [paragraph.strip().startswith(_PROGRAM) for paragraph in paragraphs]
    sentences = [
        paragraph
        for paragraph, is_command in zip(paragraphs, is_example, strict=True)
        if not is_command and paragraph != _EXAMPLES_FOLLOW
    ]
    examples = [paragraph for paragraph, is_command in zip(paragraphs, is_example, strict=True) if is_command]
    template = "\n\n".join(sentences).replace("{", "{{").replace("}", "}}")
    text = Message(f"{package}.command_{name.replace(' ', '_')}", template, {})
    return join_texts([text, _FOR_EXAMPLE, _as_block(examples)], "\n\n") if examples else text


def _as_block(examples: Sequence[str]) -> str:
    """Mark up examples as one block, in which each command keeps a line of its own.

    A block by indentation alone is lost: typer takes away an indentation that all lines after the first have.

    Args:
        examples: command lines; several in one text have line breaks between them.
    """
    lines = [line.strip() for example in examples for line in example.splitlines()]
    return "\n".join(["```text", *lines, "```"])


def with_translated_options(function: Callable[..., Any]) -> Callable[..., Any]:
    """Give the function of a command the helps of its options in the language of the output."""

    @wraps(function)
    def run_command(**options: Any) -> Any:
        """Run the command."""
        return function(**options)

    # Typer reads names, types and helps of options from the signature.
    signature = inspect.signature(function, eval_str=True)
    translated = [
        parameter.replace(annotation=_translate_annotation(parameter.annotation), kind=inspect.Parameter.KEYWORD_ONLY)
        for parameter in signature.parameters.values()
    ]
    vars(run_command)["__signature__"] = signature.replace(parameters=translated)
    return run_command


def _translate_annotation(annotation: Any) -> Any:
    """Translate the help in an annotation ``Annotated[type, typer.Option(...)]``. Other annotations stay."""
    if get_origin(annotation) is not Annotated:
        return annotation
    value_type, *notes = get_args(annotation)
    own_notes = []
    for note in notes:
        own_note = copy(note)
        if isinstance(note, ParameterInfo) and note.help:
            own_note.help = translate(note.help)
        own_notes.append(own_note)
    return Annotated[(value_type, *own_notes)]


def shown_parameters(parameters: Sequence[Any]) -> list[Any]:
    """Prepare parameters for the help: flags have no type, and typer's own options are in the output's language."""
    for parameter in parameters:
        if getattr(parameter, "is_flag", False):
            parameter.metavar = ""
        if parameter.name in _OPTIONS_OF_TYPER:
            parameter.help = translate(_OPTIONS_OF_TYPER[parameter.name])
    return list(parameters)


def write_usage(command: Any, context: Any, formatter: Any) -> None:
    """Write the line with the usage of a command, in the language of the output.

    Args:
        command: the command, as typer has it.
        context: typer's context of the call.
        formatter: what collects the help.
    """
    command.options_metavar = translate(_OPTIONS_IN_USAGE)
    if hasattr(command, "subcommand_metavar"):
        command.subcommand_metavar = translate(_COMMAND_IN_USAGE)
    pieces = " ".join(command.collect_usage_pieces(context))
    formatter.write_usage(context.command_path, pieces, prefix=f"{translate(_USAGE)} ")


def translate_frames() -> None:
    """Set the words that typer writes around helps, such as the titles of frames, in the language of the output."""
    # Only a help needs this module, which takes long to import.
    from typer import rich_utils

    for constant, word in _WORDS_OF_TYPER.items():
        setattr(rich_utils, constant, translate(word))
