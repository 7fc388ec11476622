"""What a command leaves with."""

from __future__ import annotations

from enum import IntEnum


class ExitCode(IntEnum):
    """The exit codes of ``simrob``; a monitor's stop is a success, a block that fails a divergence."""

    DONE = 0
    BAD_INPUT = 2
    DIVERGED = 3
    INTERRUPTED = 130
