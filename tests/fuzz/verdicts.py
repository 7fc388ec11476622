"""What may become of a case, and what became of one."""

import sys
import traceback
from collections.abc import Callable, Mapping
from pathlib import Path

from simrob_drake.base.errors import SimrobError
from simrob_drake.base.files import NotRead, content_of
from simrob_drake.cli import ExitCode
from simrob_drake.cli.app import run_command
from simrob_drake.extensions.learning.environment import StationEnvironment
from simrob_drake.extensions.pendant.own_files import MOST, keep
from simrob_drake.extensions.tuning.proof import Proof
from simrob_drake.extensions.tuning.study import Study
from simrob_drake.programs.program import Program
from tests.fuzz.cases import Case

ALLOWED = ("done", "refused", "diverged", "lossy")
_CODES = {
    ExitCode.DONE: "done",
    ExitCode.BAD_INPUT: "refused",
    ExitCode.DIVERGED: "diverged",
    ExitCode.BEYOND: "lossy",  # an import that lost mechanics, and says so
}
_LONGEST = 2100
TRACEBACK = 98
"""Exit code of a case that raised what no user should see."""


def _task(file: str) -> None:
    environment = StationEnvironment(file)
    environment.reset(seed=1)
    environment.step(environment.action_space.sample())


def _upload(file: str) -> None:
    """Keep an uploaded file as the pendant does; raises SimrobError: it is refused, or no browser would send it."""
    try:
        content = content_of(file, 2 * MOST)
    except NotRead as problem:
        raise SimrobError(f"{file}: {problem}") from problem
    keep({Path(file).name: content}, Path("taught"))


_LOADERS: Mapping[str, Callable[[str], object]] = {
    "program": Program.load,
    "study": Study.read,
    "proof": lambda folder: Proof.of(folder, 1).cases(),
    "task": _task,
    "upload": _upload,
}
"""What reads files that no command reads, or none without minutes of work."""


def run(case: Case) -> int:
    """Run a case in the working folder, and return its exit code."""
    name, *rest = case.arguments
    try:
        if name not in _LOADERS:
            return run_command(case.arguments)
        _LOADERS[name](rest[0])
        return ExitCode.DONE
    except SimrobError as problem:  # of what is loaded in Python alone
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
