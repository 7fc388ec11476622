"""Texts of ``--help`` in the language of the output.

Helps of options are messages where the options are declared. The help of a command is the docstring of its function,
so it becomes a message here: its id is ``<package>.command_<name>``. Typer takes plain texts, so all of them are
translated before typer makes a command of a function.

Typer also adds texts of its own around the helps, such as "Usage:". They are replaced by messages, too.
"""

import inspect
from collections.abc import Callable, Sequence
from copy import copy
from functools import wraps
from typing import Annotated, Any, get_args, get_origin

from typer.models import ParameterInfo

from simrob_drake.base.messages import Message, join_texts, message, translate

_PROGRAM = "simrob "
"""Beginning of a command line. A paragraph of a docstring that begins with it is an example."""

_EXAMPLES_FOLLOW = "For example:"
"""Paragraph in front of the examples of a docstring. It is translated once, not with each help."""

_FOR_EXAMPLE = message("cli.help_for_example", "For example:")

_OPTIONS_OF_TYPER = {
    "help": message("cli.help_help", "Show this message and exit."),
    "install_completion": message(
        "cli.help_install_completion", "Install completion for the current shell."
    ),
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
        docstring: its paragraphs are sentences, or command lines as examples.
        package: first word of the message's id: "cli", or the name of an extension.

    Returns:
        the sentences as one message to translate, then the examples, which are the same in each language.
    """
    sentences = list[str]()
    examples = list[str]()
    for paragraph in docstring.split("\n\n"):
        if paragraph.strip().startswith(_PROGRAM):
            examples.append(paragraph)
        elif paragraph != _EXAMPLES_FOLLOW:
            sentences.append(paragraph)
    # The message has no fields, so braces of the docstring are text.
    template = "\n\n".join(sentences).replace("{", "{{").replace("}", "}}")
    # Ids have no spaces, and the name of a command below another one has.
    identifier = f"{package}.command_{name.replace(' ', '_')}"
    text = Message(identifier, template, {})
    if not examples:
        return text
    return join_texts([text, _FOR_EXAMPLE, _as_block(examples)], "\n\n")


def _as_block(examples: Sequence[str]) -> str:
    """Mark up examples as one block, in which each command keeps a line of its own.

    Indentation, the other mark-up of a block in markdown, gets lost: typer removes an indentation that all lines after
    the first have in common.

    Args:
        examples: command lines; several in one text have line breaks between them.
    """
    lines = [line.strip() for example in examples for line in example.splitlines()]
    return "\n".join(["```text", *lines, "```"])


def with_translated_options(function: Callable[..., Any]) -> Callable[..., Any]:
    """Wrap the function of a command, so that the helps of its options are in the language of the output.

    Args:
        function: the function. Its parameters have annotations ``Annotated[type, typer.Option(...)]``, whose helps may
            be messages.
    """

    @wraps(function)
    def run_command(**options: Any) -> Any:
        """Run the command."""
        return function(**options)

    # Typer reads names, types and helps of options from the signature.
    signature = inspect.signature(function, eval_str=True)
    translated = list[inspect.Parameter]()
    for parameter in signature.parameters.values():
        annotation = _translate_annotation(parameter.annotation)
        # `run_command` takes keywords only.
        translated.append(
            parameter.replace(annotation=annotation, kind=inspect.Parameter.KEYWORD_ONLY)
        )
    vars(run_command)["__signature__"] = signature.replace(parameters=translated)
    return run_command


def _translate_annotation(annotation: Any) -> Any:
    """Translate the help in an annotation ``Annotated[type, typer.Option(...)]``. Other annotations stay."""
    if get_origin(annotation) is not Annotated:
        return annotation
    value_type, *notes = get_args(annotation)
    translated_notes = []
    for note in notes:
        # Several commands share the object, and another help may be written in another language: change a copy.
        translated_note = copy(note)
        if isinstance(note, ParameterInfo) and note.help:
            translated_note.help = translate(note.help)
        translated_notes.append(translated_note)
    return Annotated[(value_type, *translated_notes)]


def prepare_for_help(parameters: Sequence[Any]) -> list[Any]:
    """Change parameters for the help: remove the types of flags, translate the helps of typer's own options.

    Args:
        parameters: arguments and options of a command, as typer has them. They are changed in place.

    Returns:
        the same parameters.
    """
    for parameter in parameters:
        if getattr(parameter, "is_flag", False):
            # Typer would show a type next to a flag, which takes no value.
            parameter.metavar = ""
        if parameter.name in _OPTIONS_OF_TYPER:
            parameter.help = translate(_OPTIONS_OF_TYPER[parameter.name])
    return list(parameters)


def write_usage(command: Any, context: Any, formatter: Any) -> None:
    """Write the line with the usage of a command, in the language of the output.

    Args:
        command: the command, as typer has it. Its words for options and commands are translated in place.
        context: typer's context of the call.
        formatter: typer's formatter, which collects the lines of the help.
    """
    command.options_metavar = translate(_OPTIONS_IN_USAGE)
    # Only a group of commands has a word for the command that follows.
    if hasattr(command, "subcommand_metavar"):
        command.subcommand_metavar = translate(_COMMAND_IN_USAGE)
    pieces = " ".join(command.collect_usage_pieces(context))
    formatter.write_usage(context.command_path, pieces, prefix=f"{translate(_USAGE)} ")


def translate_frames() -> None:
    """Set the words that typer writes around helps, such as the titles of frames, in the language of the output."""
    # Only a help needs this module, which takes long to import.
    from typer import rich_utils

    # Typer has no parameters for these words: its functions read them from constants of the module.
    for constant, word in _WORDS_OF_TYPER.items():
        setattr(rich_utils, constant, translate(word))
