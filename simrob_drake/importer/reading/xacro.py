"""Expand xacro files with xacro itself, where it is installed."""

import importlib.util
import json
import subprocess
import sys
import tempfile
from pathlib import Path

from simrob_drake.errors import shortened
from simrob_drake.importer.options import ImportOptions
from simrob_drake.importer.report import ImportReport

XACRO = "xacro:"
"""What stands before the names of xacro's elements."""

TIME_LIMIT = 20.0
"""Of an expansion [s]: a xacro can call itself for ever."""

MAX_OUTPUT = 20_000_000  # bytes


def expanded(path: Path, options: ImportOptions, report: ImportReport) -> str:
    """Return the text of a xacro file's expansion, which runs in a process of its own.

    Raises:
        InvalidModel: xacro is not installed, complains, or does not end.
    """
    if not _is_installed():
        raise report.refusal("", 'is a xacro file, which needs another package: pip install "simrob-drake[xacro]"')
    given = {"mesh_path": [str(folder) for folder in options.mesh_path], "arguments": _arguments(options, report)}
    module = "simrob_drake.importer.reading.expansion"
    command = [sys.executable, "-P", "-X", "utf8", "-m", module, str(path.absolute()), json.dumps(given)]
    with tempfile.TemporaryFile() as output, tempfile.TemporaryFile() as errors:
        try:
            done = subprocess.run(
                command, stdin=subprocess.DEVNULL, stdout=output, stderr=errors, timeout=TIME_LIMIT, check=False
            )
        except subprocess.TimeoutExpired as problem:
            raise report.refusal("", f"xacro did not end within {TIME_LIMIT:g} s") from problem
        if done.returncode != 0:
            errors.seek(0)
            complaint = errors.read(MAX_OUTPUT).decode("utf-8", errors="replace")
            raise report.refusal("", f"xacro cannot expand it: {_said(complaint, done.returncode)}")
        output.seek(0)
        text = output.read(MAX_OUTPUT + 1).decode("utf-8", errors="replace")
    if len(text) > MAX_OUTPUT:
        raise report.refusal("", f"expands to more than {MAX_OUTPUT // 1_000_000} MB")
    return text


def _is_installed() -> bool:
    package = importlib.util.find_spec("xacro")
    return package is not None and package.origin is not None  # a robot's folder of that name has no origin


def _arguments(options: ImportOptions, report: ImportReport) -> dict[str, str]:
    """Return the values of a xacro's arguments by their names."""
    values = {}
    for text in options.xacro_arg:
        name, means, value = text.partition(":=")
        if not (name.strip() and means):
            raise report.refusal("", f"--xacro-arg '{shortened(text)}' is not of the form NAME:=VALUE")
        values[name.strip()] = value.strip()
    return values


def _said(complaint: str, code: int) -> str:
    """Return what xacro says last, after its warnings."""
    lines = complaint.strip().splitlines()
    said = shortened(lines[-1], 400) if lines else f"its process ended with code {code}"
    missing = said.startswith("Undefined substitution argument")
    return f"{said}; give it with --xacro-arg NAME:=VALUE" if missing else said
