"""Packages of the extra ``tune``, and others, which most users do without."""

from collections.abc import Iterator
from contextlib import contextmanager

from simrob_drake.errors import SimrobError


@contextmanager
def needed(what: str, packages: str = "simrob-drake[tune]") -> Iterator[None]:
    """Say how to get the packages that something needs, where their import fails.

    Raises:
        SimrobError: one is missing.
    """
    try:
        yield
    except ImportError as problem:
        raise SimrobError(f'{what} needs other packages: pip install "{packages}"') from problem
