"""The command line: ``simrob list | run | walk | act | check | linearize | diagram | import | view | station | teach``.

A command ends with one of these exit codes:

* 0: the command is done. A run that a monitor stopped counts as done.
* 2: the input is wrong. One line on the error stream says what, where and what would be right.
* 3: the simulation diverged, or a block failed. The result up to this time is saved.
* 4: an import has lost parts of the file; a result has warnings, with ``--strict``; or a course answer is wrong.
* 130: the user interrupted the command. The result up to this time is saved. Files that are being written are
  finished, unless the user interrupts once more.

An unexpected error is reported in one line, too, with the exit code 2. With ``SIMROB_DEBUG=1`` its traceback is shown
before this line.
"""

from enum import IntEnum


class ExitCode(IntEnum):
    """Exit codes of ``simrob``.

    A run that a monitor stops is a success (DONE). A run in which a block fails counts as one that diverged.
    """

    DONE = 0
    # Python itself ends with 1 after an error, and shells and typer use 2 for a wrong call.
    BAD_INPUT = 2
    DIVERGED = 3
    BEYOND = 4
    # Shells report a program that a signal ended as 128 plus the number of the signal, and SIGINT is 2.
    INTERRUPTED = 130
