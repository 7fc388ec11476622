"""Former names of functions, classes, attributes and arguments, which work with a warning until version 0.2.

Former names of whole modules are in :mod:`simrob_drake.former_names`.
"""

from __future__ import annotations

import sys
import warnings
from collections.abc import Callable, Mapping
from functools import wraps
from typing import Any, ParamSpec, TypeVar

P = ParamSpec("P")
R = TypeVar("R")


class _FormerAttribute:
    """Descriptor that gives the value of an attribute under its former name."""

    def __init__(self, former: str, present: str) -> None:
        """Create the descriptor of one former name and the present name of the same attribute."""
        self._former = former
        self._present = present

    def __get__(self, instance: object | None, owner: type) -> Any:
        """Value of the present attribute, of an object or of the class itself."""
        _warn(f"{owner.__name__}.{self._former}", f"{owner.__name__}.{self._present}")
        return getattr(owner if instance is None else instance, self._present)


def keep_former_attributes(owner: type, **present_names: str) -> None:
    """Keep the former names of the attributes and methods of a class, with a warning when one is used.

    A former name only reads the attribute; constructors and `_replace` take the present names.

    Args:
        owner: the class that has the present names.
        **present_names: present name by former name.
    """
    # Set from outside: type checkers then only accept the present names, and a NamedTuple allows no other statement.
    for former, present in present_names.items():
        setattr(owner, former, _FormerAttribute(former, present))


def former_names_of(module: str, present_names: Mapping[str, str]) -> Callable[[str], Any]:
    """Make the function ``__getattr__`` of a module whose functions or classes were renamed.

    Args:
        module: full name of the module.
        present_names: present name by former name, both of this module.
    """

    def find(name: str) -> Any:
        """Find the function or class of a former name."""
        present = present_names.get(name)
        # Python calls this function for every name that the module lacks, also for names that never existed.
        if present is None:
            raise AttributeError(f"module {module!r} has no attribute {name!r}")
        _warn(f"{module}.{name}", f"{module}.{present}")
        return getattr(sys.modules[module], present)

    return find


def former_argument(former: str, present: str) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Make a decorator for a function, one of whose arguments has got another name.

    Args:
        former: former name of the argument.
        present: its present name.
    """

    def decorate(function: Callable[P, R]) -> Callable[P, R]:
        """Make the function that accepts both names of the argument."""

        @wraps(function)
        def with_former_name(*args: P.args, **arguments: P.kwargs) -> R:
            """Call the function, with the present name in place of the former one."""
            # With both names, Python itself reports the former one as unknown.
            if former not in arguments or present in arguments:
                return function(*args, **arguments)
            _warn(f"the argument {former} of {function.__name__}()", present)
            renamed: dict[str, Any] = dict(arguments)
            renamed[present] = renamed.pop(former)
            return function(*args, **renamed)

        return with_former_name

    return decorate


def _warn(former: str, present: str) -> None:
    """Warn the code that used a former name, two callers above this function."""
    # Level 1 is this function, 2 the lookup of the former name, 3 the code that used it.
    warnings.warn(
        f"{former} is now {present}; the former name works until simrob_drake 0.2",
        DeprecationWarning,
        stacklevel=3,
    )
