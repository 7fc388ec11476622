"""Language of what the command line writes: its own words, messages and errors."""

import inspect
import os
from collections.abc import Callable, Sequence
from functools import wraps
from itertools import pairwise
from typing import Annotated, Any, Literal, get_args

import typer

from simrob_drake.base.messages import SOURCE_LANGUAGE, message, set_output_language

_OPTION = "--language"

LANGUAGE_VARIABLE = "SIMROB_LANGUAGE"
"""Environment variable for users who want the same language always."""

_Language = Literal["en", "es"]

OutputLanguage = Annotated[
    _Language,
    typer.Option(
        _OPTION,
        envvar=LANGUAGE_VARIABLE,
        help=message("cli.help_output_language", "Language of the output on the screen."),
    ),
]
"""Option of a command that writes in several languages."""


def requested_language(arguments: Sequence[str]) -> str:
    """Find the language in the arguments of ``simrob`` before they are parsed.

    Helps and errors of usage are written in this language, although parsing may have failed.

    Args:
        arguments: the arguments, such as ``["run", "--language", "es"]``. Without the option, the environment variable
            counts. An unknown language counts as the one of the source, in which the error about it is written.
    """
    requested = os.environ.get(LANGUAGE_VARIABLE, SOURCE_LANGUAGE)
    # The last of several options counts, as for typer.
    for argument, following in pairwise([*arguments, ""]):
        name, equals, value = argument.partition("=")
        if name == _OPTION:
            # "--language=es" or "--language es".
            requested = value if equals else following
    return requested if requested in get_args(_Language) else SOURCE_LANGUAGE


def with_output_language(command: Callable[..., Any]) -> Callable[..., Any]:
    """Give a command the option ``--language``, the language of all that it writes, errors included."""

    @wraps(command)
    def run_in_language(*, output_language: str, **options: Any) -> Any:
        """Set the language of the output, then run the command."""
        set_output_language(output_language)
        return command(**options)

    # Typer makes the options of a command from its signature.
    own = inspect.Parameter(
        "output_language",
        inspect.Parameter.KEYWORD_ONLY,
        default=SOURCE_LANGUAGE,
        annotation=OutputLanguage,
    )
    # Annotations are texts in modules that postpone their evaluation.
    signature = inspect.signature(command, eval_str=True)
    vars(run_in_language)["__signature__"] = signature.replace(
        parameters=[*signature.parameters.values(), own]
    )
    return run_in_language
