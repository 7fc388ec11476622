"""MATLAB code outside the subset, run by GNU Octave where the user allows it."""

import re
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from simrob_drake.errors import InvalidParameter
from simrob_drake.simulink.values.evaluate import UndefinedVariable
from simrob_drake.simulink.values.mat_files import variables_of_mat

_PATIENCE = 60.0  # s
_NAME = re.compile(r"(?<!\.)\b[A-Za-z]\w*")
_IDLE = ("set_param", "get_param", "gcb", "gcbh", "gcs", "bdroot", "add_block", "add_line", "delete_line", "disp")
"""Functions of Simulink, which do nothing here: what they do stands in the saved file."""
_NOTHING = "function varargout = {name}(varargin)\n  varargout = cell(1, nargout);\nend\n"
_SCRIPT = """load('given.mat');
try
{code}
catch problem
  fprintf(stderr, '%s', problem.message);
end
save('-v7', 'found.mat');
"""

Octave = Callable[[str, Callable[[str], Any]], dict[str, Any]]
"""Runs code, with what looks up the variables that it asks for, and returns all that are there then."""


def find_octave() -> Octave:
    """Return what runs code.

    Raises:
        InvalidParameter: GNU Octave is not installed.
    """
    program = shutil.which("octave-cli") or shutil.which("octave")
    if program is None:
        raise InvalidParameter("--octave", "given", "left out, or GNU Octave installed: no program octave-cli is found")

    def run(code: str, lookup: Callable[[str], Any]) -> dict[str, Any]:
        with TemporaryDirectory() as folder:
            return _run(program, code, _names_needed(code, lookup), Path(folder))

    return run


def _names_needed(code: str, lookup: Callable[[str], Any]) -> dict[str, Any]:
    """Return the variables that are known of those that code names."""
    known = {}
    for name in dict.fromkeys(_NAME.findall(code)):
        try:
            known[name] = lookup(name)
        except UndefinedVariable:
            continue  # a function, or a variable that the code sets
    return known


def _run(program: str, code: str, variables: dict[str, Any], folder: Path) -> dict[str, Any]:
    from scipy.io import savemat

    savemat(folder / "given.mat", {"none_": 0.0, **variables})
    (folder / "code.m").write_text(_SCRIPT.format(code=code), encoding="utf-8")
    for name in _IDLE:
        (folder / f"{name}.m").write_text(_NOTHING.format(name=name), encoding="utf-8")
    command = [program, "--no-gui", "--no-init-file", "--quiet", "code.m"]
    try:
        subprocess.run(
            command, cwd=folder, stdin=subprocess.DEVNULL, capture_output=True, timeout=_PATIENCE, check=False
        )
    except subprocess.TimeoutExpired as problem:
        expected = f"quicker: code of a mask has not ended after {_PATIENCE:g} s"
        raise InvalidParameter("--octave", code[:60], expected) from problem
    found = folder / "found.mat"
    return variables_of_mat(found, "--octave") if found.is_file() else {}
