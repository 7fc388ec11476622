"""Packages of the extras, which most users do without."""

import re
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.metadata import PackageNotFoundError, requires
from importlib.util import find_spec

from simrob_drake.base.errors import SimrobError
from simrob_drake.base.messages import message

DISTRIBUTION = "simrob-drake"
"""Name of the distribution of this package, as pip knows it."""


def install_line(extra: str) -> str:
    """Return the command that installs what an extra brings, by the packages' names: it works for a checkout, too."""
    try:
        lines = [line.partition(";") for line in requires(DISTRIBUTION) or ()]
    except PackageNotFoundError:  # run from a folder that was not installed
        lines = []
    named = [name.strip() for name, _, where in lines if re.search(rf"extra == ['\"]{extra}['\"]", where)]
    return " ".join(["pip install", *(f'"{name}"' for name in named or (f"{DISTRIBUTION}[{extra}]",))])


def lacking(what: str, extra: str) -> str:
    """Return what is said where a package of an extra is not there that something needs."""
    return message(
        "base.needs_extra",
        "{what} needs the extra {extra}: {install_line}",
        what=what,
        extra=extra,
        install_line=install_line(extra),
    )


def require(what: str, package: str, extra: str) -> None:
    """Check that a package of an extra is there, without importing it; raises SimrobError: it is not."""
    if find_spec(package) is None:
        raise SimrobError(lacking(what, extra))


@contextmanager
def needed(what: str, extra: str) -> Iterator[None]:
    """Tell of the ``extra`` that brings packages which ``what`` needs, where an import fails; raises SimrobError."""
    try:
        yield
    except ImportError as problem:
        raise SimrobError(lacking(what, extra)) from problem
