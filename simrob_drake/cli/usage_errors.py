"""Errors in how a command is called, such as a missing argument, as messages of this project.

Typer finds these errors. Its classes and the attributes of its errors decide which message is shown, never its
English text.
"""

from typing import Any

from pydantic import ValidationError
from typer.exceptions import TyperException

from simrob_drake.base.errors import nearest, quoted, shortened
from simrob_drake.base.messages import Message, compound, message
from simrob_drake.base.value_problems import value_problem

_PROGRAM = "simrob"


def usage_problem(problem: TyperException) -> str:
    """Describe an error in how a command is called.

    Args:
        problem: the error of typer, or of a class derived from it.

    Returns:
        what is wrong and what would be right; typer's own text for a kind of error without a message. Empty if the
        help was shown instead.
    """
    # The classes are private in typer, so their names tell them apart.
    kinds = {kind.__name__ for kind in type(problem).__mro__}
    if "MissingParameter" in kinds:
        return _missing(problem)
    if "NoSuchOption" in kinds:
        return _unknown_option(problem)
    if "BadOptionUsage" in kinds:
        return _misused_option(problem)
    if "BadParameter" in kinds and isinstance(problem.__cause__, ValidationError):
        return _wrong_value(problem, problem.__cause__.errors()[0])
    return problem.format_message()  # empty for a group of commands that was called without one: typer shows its help


def unexpected_arguments(command: str, arguments: list[str]) -> Message:
    """Message for arguments that a command does not take.

    Args:
        command: name of the command, such as ``simrob run``.
        arguments: the arguments that are too many.
    """
    return message(
        "cli.unexpected_arguments",
        "{command} does not take the {count:argument|arguments} {arguments}; {command} --help lists what it takes",
        command=command,
        count=len(arguments),
        arguments=shortened(" ".join(arguments)),
    )


def _missing(problem: Any) -> Message:
    """Message for a missing argument, with the first example of the command's help.

    Args:
        problem: typer's error, with the context of the command in ``ctx``.
    """
    command = command_name(problem.ctx)
    lines = [line.strip() for line in (problem.ctx.command.help or "").splitlines()]
    example = next((line for line in lines if line.startswith(f"{command} ")), f"{command} --help")
    return message(
        "cli.missing_argument",
        "{command} needs {argument}; for example: {example}",
        command=command,
        argument=_name_of(problem),
        example=example,
    )


def _wrong_value(problem: Any, finding: Any) -> Message:
    """Message for a value that an argument or option does not take.

    Args:
        problem: typer's error, with the argument or option in ``param``.
        finding: the problem that pydantic found in the value.
    """
    choices = problem.param.type_descriptor.choices
    if choices:
        finding = {
            **finding,
            "type": "literal_error",
            "ctx": {"expected": ", ".join(f"'{choice}'" for choice in choices)},
        }
    text = value_problem(finding)
    value = finding.get("input")
    if value is not None:
        text = message("base.problem_of_value", "{problem} (it is {value})", problem=text, value=quoted(value))
    return compound("{name}: {problem}", name=_name_of(problem), problem=text)


def _unknown_option(problem: Any) -> Message:
    """Message for an option that a command does not have, with the nearest one that it has."""
    context = problem.ctx
    options = [] if context is None else [name for own in context.command.params for name in own.opts]
    return message(
        "cli.unknown_option",
        "there is no option {option}{suggestion}",
        option=shortened(problem.option_name),
        suggestion=nearest(problem.option_name, [name for name in options if name.startswith("-")]),
    )


def _misused_option(problem: Any) -> Message:
    """Message for an option without its value, or for a flag with one."""
    option = problem.option_name
    flags = [name for own in problem.ctx.command.params if getattr(own, "is_flag", False) for name in own.opts]
    if option in flags:
        return message("cli.option_takes_no_value", "{option} takes no value", option=option)
    return message("cli.option_needs_value", "{option} needs a value", option=option)


def command_name(context: Any) -> str:
    """Name with which a command is called, such as ``simrob course check``.

    Args:
        context: typer's context of the command, whose parents are the commands above it.
    """
    names = list[str]()
    while context.parent is not None:
        names.insert(0, context.info_name)
        context = context.parent
    return " ".join([_PROGRAM, *names])


def _name_of(problem: Any) -> str:
    """Name of the argument or option of an error, as the help shows it, without quotes."""
    parameter = problem.param
    options = [name for name in parameter.opts if name.startswith("-")]
    return options[0] if options else str(parameter.display_name_raw)
