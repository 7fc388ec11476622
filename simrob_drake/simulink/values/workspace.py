"""Where variables are found: masks from the inside out, the model's workspace, what the user gives."""

from __future__ import annotations

import re
import shutil
import subprocess
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from simrob_drake.errors import InvalidParameter
from simrob_drake.files import content_of
from simrob_drake.simulink.values.code import CodeRun
from simrob_drake.simulink.values.evaluate import UndefinedVariable, evaluate
from simrob_drake.simulink.values.mat_files import variables_of_mat
from simrob_drake.simulink.values.syntax import NotUnderstood, parse

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


@dataclass
class Variables:
    """Variables of one level.

    Attributes:
        name: of the mask or model, for messages.
        variables: those that are known.
        outer: where others are looked up.
        pending: those that are computed when they are first asked for.
        unknown: names that code outside the subset sets.
        code: what sets further variables, once one is asked for that is not known.
        octave: what runs code outside the subset; that of the outer levels unless given.
    """

    name: str = ""
    variables: dict[str, Any] = field(default_factory=dict)
    outer: Variables | None = None
    pending: dict[str, Callable[[], Any]] = field(default_factory=dict)
    unknown: set[str] = field(default_factory=set)
    code: str = ""
    octave: Octave | None = None

    def lookup(self, name: str) -> Any:
        """Return a variable's value.

        Raises:
            UndefinedVariable: no workspace has it.
        """
        if name in self.pending:
            self.variables[name] = self.pending[name]()  # stays pending where it cannot be told
            del self.pending[name]
        if self.code:
            self._run()
        if name in self.variables:
            return self.variables[name]
        if name in self.unknown:
            raise UndefinedVariable(name, f"it is set by code of '{self.name}' that only MATLAB runs")
        if self.outer is None:
            raise UndefinedVariable(name)
        return self.outer.lookup(name)

    def value(self, text: str) -> Any:
        """Return the value of an expression here.

        Raises:
            UndefinedVariable: it uses a variable that no workspace has.
            NotUnderstood: it is outside the subset.
        """
        return evaluate(parse(text), self.lookup)

    def _run(self) -> None:
        code, self.code = self.code, ""
        run = CodeRun(self.variables, self.lookup)
        run.run(code)
        self.unknown |= run.unknown
        octave = self._octave() if self.unknown else None
        if octave is not None:
            found = octave(code, self._lookup_before)
            self.variables |= {name: value for name, value in found.items() if name in self.unknown}
            self.unknown -= found.keys()

    def _octave(self) -> Octave | None:
        return self.octave or (self.outer._octave() if self.outer is not None else None)

    def _lookup_before(self, name: str) -> Any:
        """Look a variable up that its own code does not set."""
        if name in self.unknown:
            raise UndefinedVariable(name)
        return self.lookup(name)


def variables_of(settings: Mapping[str, str], files: list[Path]) -> dict[str, Any]:
    """Return the variables that a user gives.

    Args:
        settings: expressions by name; ``tool.mass`` is a field of a structure.
        files: `.mat` files, or `.m` scripts of assignments.

    Raises:
        InvalidParameter: a file or an expression that cannot be read.
    """
    run = CodeRun({}, _undefined)
    for file in files:
        if file.suffix == ".mat":
            run.variables.update(variables_of_mat(file))
        else:
            try:
                run.run(content_of(file).decode("utf-8", errors="replace"))
            except (OSError, NotUnderstood) as problem:
                raise InvalidParameter(
                    "--variables", str(file), f"a .mat file or a script of assignments: {problem}"
                ) from problem
    for name, text in settings.items():
        try:
            value = evaluate(parse(text), lambda other: _known(run.variables, other))
        except (NotUnderstood, UndefinedVariable) as problem:
            raise InvalidParameter(
                f"--set {name}", text, f"an expression such as [0 0 1] or 30*pi/180: it {problem}"
            ) from problem
        target, *fields = name.split(".")
        here = run.variables
        for part in [target, *fields][:-1]:
            here[part] = dict(here[part]) if isinstance(here.get(part), dict) else {}
            here = here[part]
        here[name.split(".")[-1]] = value
    return run.variables


def _undefined(name: str) -> Any:
    raise UndefinedVariable(name)


def _known(variables: dict[str, Any], name: str) -> Any:
    return variables[name] if name in variables else _undefined(name)
