"""What may become of a case, and what became of one."""

import sys
import traceback
from pathlib import Path

from simrob_drake.cli import ExitCode
from simrob_drake.cli.app import run_command
from simrob_drake.errors import SimrobError
from simrob_drake.programs.program import Program
from tests.fuzz.cases import Case

ALLOWED = ("done", "refused", "diverged")
_CODES = {ExitCode.DONE: "done", ExitCode.BAD_INPUT: "refused", ExitCode.DIVERGED: "diverged"}
_LONGEST = 2100
TRACEBACK = 98
"""Exit code of a case that raised what no user should see."""


def run(case: Case) -> int:
    """Run a case in the working folder, and return its exit code."""
    try:
        if case.arguments[0] != "program":
            return run_command(case.arguments)
        Program.load(Path(case.arguments[1]))
        return ExitCode.DONE
    except SimrobError as problem:  # of a program of legs
        print(f"simrob: {problem}", file=sys.stderr)
        return ExitCode.BAD_INPUT
    except BaseException:  # Drake's SystemExit, too
        traceback.print_exc()
        return TRACEBACK


def ended(code: int, told: str) -> str:
    """Return a word of `ALLOWED`, or what is wrong with an exit code and the text on the error stream."""
    lines = told.strip().splitlines()
    if code not in _CODES or "Traceback" in told:
        return f"exit code {code}: {lines[-1][:300] if lines else ''}"
    if code == ExitCode.BAD_INPUT:
        ours = [line for line in lines if line.startswith("simrob: ")]
        if len(ours) != 1 or lines[-1] != ours[0] or len(ours[0]) > _LONGEST:
            return f"refused in {len(ours)} lines of {len(told)} letters: {told[:200]!r}"
    return _CODES[ExitCode(code)]
