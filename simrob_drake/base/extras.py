"""Packages of the extras: optional dependencies of this package, which most users do not need."""

import re
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.metadata import PackageNotFoundError, requires
from importlib.util import find_spec
from typing import TYPE_CHECKING

from simrob_drake.base.errors import SimrobError
from simrob_drake.base.messages import message
from simrob_drake.base.renaming import former_names_of

DISTRIBUTION = "simrob-drake"
"""Name of the distribution of this package, as pip knows it."""


def install_line(extra: str) -> str:
    """Command that installs the packages of an extra.

    It names these packages, not the extra, so that it also works in a checkout. If this package is not installed, its
    extras are not known, and the command names the extra.
    """
    try:
        requirements = requires(DISTRIBUTION) or ()
    except PackageNotFoundError:  # run from a folder that was not installed
        requirements = ()
    packages = []
    for requirement in requirements:
        # Such as: mujoco>=3.1; extra == "mujoco"
        package, _, marker = requirement.partition(";")
        if re.search(rf"extra == ['\"]{extra}['\"]", marker):
            packages.append(package.strip())
    # No requirement has this marker, or the metadata of the package is missing.
    if not packages:
        packages = [f"{DISTRIBUTION}[{extra}]"]
    # Quotes, since a shell reads the > of a version as a redirection, and the brackets of an extra as a pattern.
    names = " ".join(f'"{package}"' for package in packages)
    return f"pip install {names}"


def lacking(what: str, extra: str) -> str:
    """Message that something needs an extra, with the command that installs it.

    Args:
        what: beginning of the message, before "needs the extra": a noun such as "a video", or more words, such as
            "arm.xml is an MJCF file, which".
        extra: name of the extra.
    """
    return message(
        "base.needs_extra",
        "{what} needs the extra {extra}: {install_line}",
        what=what,
        extra=extra,
        install_line=install_line(extra),
    )


def require(what: str, package: str, extra: str) -> None:
    """Check that a package of an extra is installed, without importing it.

    Args:
        what: what needs the package, for the error.
        package: name under which it is imported.
        extra: name of the extra.

    Raises:
        SimrobError: the package is not installed.
    """
    if find_spec(package) is None:
        raise SimrobError(lacking(what, extra))


@contextmanager
def importing_extra(what: str, extra: str) -> Iterator[None]:
    """Context manager for imports of packages of an extra.

    Args:
        what: what needs the packages, for the error.
        extra: name of the extra.

    Raises:
        SimrobError: an import in the body failed. The message names the extra.
    """
    try:
        yield
    except ImportError as problem:
        raise SimrobError(lacking(what, extra)) from problem


if not TYPE_CHECKING:
    # The type checker does not see the former names, so that this package cannot use them.
    __getattr__ = former_names_of(__name__, {"needed": "importing_extra"})
