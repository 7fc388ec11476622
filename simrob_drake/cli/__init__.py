"""The command line: ``simrob list | run | check | diagram | import | view | station``.

Exit codes: 0 done, a monitor's stop included; 2 bad input, with one line on the error stream that says what, where and
what would be right; 3 the simulation diverged, 130 the user interrupted it, both with the partial result saved.
"""

from __future__ import annotations

from simrob_drake.cli.app import main, run_command

__all__ = ["main", "run_command"]
