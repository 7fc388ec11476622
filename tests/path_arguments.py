"""Checks of functions that take a file or a folder, as a text or a path."""

from collections.abc import Callable
from typing import Any

import pytest

from simrob_drake.base.errors import InvalidParameter


def check_refusal(call: Callable[[Any], Any]) -> None:
    """Check that values which are no paths are refused in one line."""
    for value in (5, ["a.urdf"]):
        with pytest.raises(
            InvalidParameter,
            match=r"^(file|path|urdf|folder|source|target) is .*; it must be a path",
        ):
            call(value)
