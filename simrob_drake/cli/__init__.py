"""The command line: ``simrob list | run | walk | act | check | linearize | diagram | import | view | station | teach``.

Exit codes: 0 done, a monitor's stop included; 2 bad input, with one line on the error stream that says what, where and
what would be right; 3 the simulation diverged, with the partial result saved; 4 an import lost mechanics,
with ``--strict`` a result has warnings, or an answer misses a point; 130 the user interrupted it. What was simulated
until then is saved; what was being written is finished, unless the user interrupts again.

Whatever else fails is told in one line, too, with exit code 2; ``SIMROB_DEBUG=1`` shows its traceback before that.
"""

from enum import IntEnum


class ExitCode(IntEnum):
    """Exit codes of ``simrob``.

    A run that a monitor stops is a success (DONE). A run in which a block fails counts as one that diverged.
    """

    DONE = 0
    BAD_INPUT = 2
    DIVERGED = 3
    BEYOND = 4
    INTERRUPTED = 130
