"""Differences between the supported versions of Drake. The rest of the package asks here, and nowhere else.

``pyproject.toml`` supports every version from `OLDEST` on. A difference can be removed when the oldest supported
version is as new as the difference; ``tests/test_drake_versions.py`` fails then, and says which one.
"""

import sys
from importlib.metadata import version
from typing import NamedTuple

OLDEST = (1, 51)
"""Oldest supported version of Drake, as in ``pyproject.toml``."""

INSTALLED = tuple(int(number) for number in version("drake").split(".")[:2])
"""Version of Drake that is installed, major and minor number."""


class DrakeChange(NamedTuple):
    """Something that newer versions of Drake do, and older ones do not.

    Attributes:
        since: first version that does it.
        reason: what it does.
    """

    since: tuple[int, int]
    reason: str

    @property
    def is_there(self) -> bool:
        """Whether the installed version does it."""
        return self.since <= INSTALLED


# A coupling of two joints works on every version. One of more joints, such as the fingers of a hand on one tendon,
# needs the newer constraint.
TENDONS = DrakeChange(
    (1, 56), "constraints on the sum of more than two joints, AddTendonConstraint"
)
# :class:`simrob_drake.blocks.block.Block` has this method because of that exception, which each block costs in a step.
SEARCH_FOR_DERIVATIVES = DrakeChange(
    (1, 56),
    "it looks for DoCalcTimeDerivatives in a block's Python class, and finding none costs a C++ exception",
)

KEEPS_PYTHON_BLOCKS = sys.version_info < (3, 12)
"""Whether a block in Python keeps its diagram for ever. Drake does so on Python 3.11, and not on newer versions of
Python (measured with Drake 1.51.1 on Python 3.11 and 3.13)."""
