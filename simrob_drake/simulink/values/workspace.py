"""Where variables are found: masks from the inside out, then the model's workspace, then what the user gives."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from simrob_drake.errors import InvalidParameter
from simrob_drake.files import content_of
from simrob_drake.simulink.values.code import CodeRun
from simrob_drake.simulink.values.evaluate import UndefinedVariable, evaluate
from simrob_drake.simulink.values.mat_files import variables_of_mat
from simrob_drake.simulink.values.octave import Octave
from simrob_drake.simulink.values.syntax import NotUnderstood, parse


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
