"""Packages of the extras, which most users do without."""

from collections.abc import Iterator
from contextlib import contextmanager

from simrob_drake.errors import SimrobError


@contextmanager
def needed(what: str, extra: str) -> Iterator[None]:
    """Say how to get the packages that something needs, where their import fails.

    Args:
        what: needs them.
        extra: of this package, which brings them.

    Raises:
        SimrobError: one is missing.
    """
    try:
        yield
    except ImportError as problem:
        raise SimrobError(f'{what} needs other packages: pip install "simrob-drake[{extra}]"') from problem
