"""Language of what the command line writes: its own words, messages and errors."""

import inspect
from collections.abc import Callable
from contextvars import ContextVar
from functools import wraps
from typing import Annotated, Any, Literal

import typer

from simrob_drake.base.messages import SOURCE_LANGUAGE, in_language

LANGUAGE_VARIABLE = "SIMROB_LANGUAGE"
"""Environment variable for users who want the same language always."""

OutputLanguage = Annotated[
    Literal["en", "es"],
    typer.Option("--language", envvar=LANGUAGE_VARIABLE, help="Language of what is written on the screen."),
]
"""Option of a command that writes in several languages."""

_language: ContextVar[str] = ContextVar("language", default=SOURCE_LANGUAGE)


def set_language(language: str) -> None:
    """Set the language of all that is written from now on.

    Args:
        language: code of the language, such as ``es``.
    """
    _language.set(language)


def translate(text: str) -> str:
    """Translate a message into the language of the output. A plain text is returned as it is."""
    return in_language(text, _language.get())


def with_output_language(command: Callable[..., Any]) -> Callable[..., Any]:
    """Give a command the option ``--language``, the language of all that it writes, errors included."""

    @wraps(command)
    def called(*, output_language: str, **options: Any) -> Any:
        set_language(output_language)
        return command(**options)

    # Typer makes the options of a command from its signature.
    own = inspect.Parameter(
        "output_language", inspect.Parameter.KEYWORD_ONLY, default=SOURCE_LANGUAGE, annotation=OutputLanguage
    )
    signature = inspect.signature(command, eval_str=True)
    vars(called)["__signature__"] = signature.replace(parameters=[*signature.parameters.values(), own])
    return called
