"""Errors in how a command is called, such as a missing argument, as messages of this project.

Typer finds these errors, and has an English text for each. The functions here make the message from the class of
typer's error and from its attributes, such as ``param``, so that the message exists in each language. They do not read
typer's text, which may change with its next version.
"""

from typing import Any

from pydantic import ValidationError
from typer.exceptions import TyperException

from simrob_drake.base.errors import nearest, quote_value, shorten
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
    # The classes are private in typer, so they are compared by name, base classes included.
    class_names = {own_class.__name__ for own_class in type(problem).__mro__}
    # MissingParameter is derived from BadParameter, so it comes first.
    if "MissingParameter" in class_names:
        return _missing_argument(problem)
    if "NoSuchOption" in class_names:
        return _unknown_option(problem)
    if "BadOptionUsage" in class_names:
        return _misused_option(problem)
    # Pydantic checks the values of arguments and options for typer.
    if "BadParameter" in class_names and isinstance(problem.__cause__, ValidationError):
        return _wrong_value(problem, problem.__cause__.errors()[0])
    # The text is empty if a group of commands was called without one: typer has shown its help.
    return problem.format_message()


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
        arguments=shorten(" ".join(arguments)),
    )


def _missing_argument(problem: Any) -> Message:
    """Message for a missing argument, with the first example of the command's help.

    A command without an example refers to its help instead.

    Args:
        problem: typer's error, with the context of the command in ``ctx``.
    """
    command = command_name(problem.ctx)
    help_text = problem.ctx.command.help or ""
    lines = [line.strip() for line in help_text.splitlines()]
    # Examples are lines of the help that begin with the command.
    examples = [line for line in lines if line.startswith(f"{command} ")]
    example = examples[0] if examples else f"{command} --help"
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
        finding: the problem that pydantic found in the value: an entry of ``ValidationError.errors()``.
    """
    described = finding
    choices = problem.param.type_descriptor.choices
    if choices:
        # The message for a literal lists its choices, so the finding becomes one about a literal.
        quoted_choices = ", ".join(f"'{choice}'" for choice in choices)
        described = {**finding, "type": "literal_error", "ctx": {"expected": quoted_choices}}
    # Typer's own sentence is English only, and names types of Python.
    text = value_problem(described)
    value = finding.get("input")
    if value is not None:
        text = message(
            "base.problem_of_value",
            "{problem} (it is {value})",
            problem=text,
            value=quote_value(value),
        )
    return compound("{name}: {problem}", name=_name_of(problem), problem=text)


def _unknown_option(problem: Any) -> Message:
    """Message for an option that a command does not have.

    It suggests the option of a similar name that the command has, or lists all of its options if none is similar.

    Args:
        problem: typer's error, with the option in ``option_name`` and the context of the command in ``ctx``. Without a
            context, none is suggested.
    """
    names = list[str]()
    if problem.ctx is not None:
        for parameter in problem.ctx.command.params:
            names += parameter.opts
    # The names of arguments have no dash.
    options = [name for name in names if name.startswith("-")]
    return message(
        "cli.unknown_option",
        "there is no option {option}{suggestion}",
        option=shorten(problem.option_name),
        suggestion=nearest(problem.option_name, options),
    )


def _misused_option(problem: Any) -> Message:
    """Message for an option without its value, or for a flag with a value.

    Args:
        problem: typer's error, with the option in ``option_name`` and the context of the command in ``ctx``.
    """
    option = problem.option_name
    flag_names = list[str]()
    for parameter in problem.ctx.command.params:
        # Arguments have no such attribute.
        if getattr(parameter, "is_flag", False):
            flag_names += parameter.opts
    if option in flag_names:
        return message("cli.option_takes_no_value", "{option} takes no value", option=option)
    return message("cli.option_needs_value", "{option} needs a value", option=option)


def command_name(context: Any) -> str:
    """Name with which a command is called, such as ``simrob course check``.

    Args:
        context: typer's context of the command, whose parents are the commands above it.
    """
    names = list[str]()
    # The context without a parent is that of `simrob` itself. Its name depends on how Python was started.
    while context.parent is not None:
        names.insert(0, context.info_name)
        context = context.parent
    return " ".join([_PROGRAM, *names])


def _name_of(problem: Any) -> str:
    """Name of the argument or option of an error, as the help shows it, without quotes."""
    parameter = problem.param
    # Python's name of an argument is not what the help shows, such as `set_` for --set.
    options = [name for name in parameter.opts if name.startswith("-")]
    return options[0] if options else str(parameter.display_name_raw)
