"""Expand xacro files with xacro itself, where it is installed: as a Python package or as a program."""

import importlib.util
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from simrob_drake.errors import shortened
from simrob_drake.importer.report import ImportReport

XACRO = "xacro:"
"""What stands before the names of xacro's elements."""

TIME_LIMIT = 30.0
"""Of an expansion [s]: a xacro can call itself for ever."""

MAX_OUTPUT = 20_000_000  # bytes
_RUN_PACKAGE = "import sys, xacro; sys.exit(xacro.main())"


def expanded(path: Path, report: ImportReport) -> str:
    """Return the text of a xacro file's expansion.

    It runs in a process of its own with a time limit: a xacro evaluates expressions and includes other files.

    Raises:
        InvalidModel: xacro is not installed, complains, or does not end.
    """
    command = _command()
    if command is None:
        by_hand = f"expand it: xacro {path.name} > {path.stem}_plain.urdf"  # never onto the file itself
        raise report.refusal("", f"is a xacro file; install xacro (pip install xacro) or {by_hand}")
    with tempfile.TemporaryFile() as output, tempfile.TemporaryFile() as errors:
        try:
            done = subprocess.run(
                [*command, str(path.absolute())],
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=errors,
                timeout=TIME_LIMIT,
                check=False,
            )
        except subprocess.TimeoutExpired as problem:
            raise report.refusal("", f"xacro did not end within {TIME_LIMIT:g} s") from problem
        except OSError as problem:
            raise report.refusal("", f"xacro cannot be run: {problem.strerror or problem}") from problem
        errors.seek(0)
        complaint = errors.read(MAX_OUTPUT).decode("utf-8", errors="replace")
        if done.returncode != 0:
            raise report.refusal("", f"xacro cannot expand it: {_said(complaint)}")
        output.seek(0)
        text = output.read(MAX_OUTPUT + 1).decode("utf-8", errors="replace")
    if len(text) > MAX_OUTPUT:
        raise report.refusal("", f"expands to more than {MAX_OUTPUT // 1_000_000} MB")
    return text.lstrip()


def _command() -> list[str] | None:
    package = importlib.util.find_spec("xacro")
    if package is not None and package.origin is not None:  # a robot's folder of that name has no origin
        return [sys.executable, "-P", "-c", _RUN_PACKAGE]
    program = shutil.which("xacro")
    return None if program is None else [program]


def _said(complaint: str) -> str:
    """Return what xacro says first, or at the end of a traceback."""
    lines = [line.strip() for line in complaint.splitlines() if line.strip()]
    if not lines:
        return "no reason given"
    if lines[0].startswith("Traceback"):
        return shortened(lines[-1], 300)
    start = next((index for index, line in enumerate(lines) if line.startswith("error")), 0)  # after its warnings
    return shortened(" ".join(lines[start:]), 300)
