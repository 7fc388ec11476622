"""Language of what the command line writes: its own words, messages and errors."""

import inspect
from collections.abc import Callable
from functools import wraps
from typing import Annotated, Any, Literal

import typer

from simrob_drake.base.messages import SOURCE_LANGUAGE, set_output_language

LANGUAGE_VARIABLE = "SIMROB_LANGUAGE"
"""Environment variable for users who want the same language always."""

OutputLanguage = Annotated[
    Literal["en", "es"],
    typer.Option("--language", envvar=LANGUAGE_VARIABLE, help="Language of what is written on the screen."),
]
"""Option of a command that writes in several languages."""


def with_output_language(command: Callable[..., Any]) -> Callable[..., Any]:
    """Give a command the option ``--language``, the language of all that it writes, errors included."""

    @wraps(command)
    def run_in_language(*, output_language: str, **options: Any) -> Any:
        """Set the language of the output, then run the command."""
        set_output_language(output_language)
        return command(**options)

    # Typer makes the options of a command from its signature.
    own = inspect.Parameter(
        "output_language", inspect.Parameter.KEYWORD_ONLY, default=SOURCE_LANGUAGE, annotation=OutputLanguage
    )
    signature = inspect.signature(command, eval_str=True)
    vars(run_in_language)["__signature__"] = signature.replace(parameters=[*signature.parameters.values(), own])
    return run_in_language
