"""Former names of arguments, which are still accepted, with a DeprecationWarning, until version 0.2."""

import warnings
from collections.abc import Callable
from functools import wraps
from typing import Any, ParamSpec, TypeVar

from simrob_drake.base.messages import message

P = ParamSpec("P")
R = TypeVar("R")


def former_argument(former: str, present: str) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Make a decorator for a function, one of whose arguments has got another name.

    Args:
        former: former name of the argument.
        present: its present name.
    """

    def decorate(function: Callable[P, R]) -> Callable[P, R]:
        """Let a function accept the former name, too."""

        @wraps(function)
        def with_former_name(*args: P.args, **arguments: P.kwargs) -> R:
            """Call the function, with the present name in place of the former one."""
            if former in arguments and present not in arguments:
                text = message(
                    "base.former_argument",
                    "the argument {former} of {function}() is now {present}; the former name goes in 0.2",
                    former=former,
                    function=function.__name__,
                    present=present,
                )
                warnings.warn(text, DeprecationWarning, stacklevel=2)
                renamed: dict[str, Any] = dict(arguments)
                renamed[present] = renamed.pop(former)
                return function(*args, **renamed)
            return function(*args, **arguments)

        return with_former_name

    return decorate
