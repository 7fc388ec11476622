"""Where variables are found: masks from the inside out, what the user gives, the model's workspace, its callbacks."""

from __future__ import annotations

import re
import shutil
import subprocess
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from simrob_drake.base.errors import InvalidParameter, Unsuitable
from simrob_drake.base.files import content_of
from simrob_drake.base.messages import message
from simrob_drake.extensions.simulink.values.code import CodeRun, undefined
from simrob_drake.extensions.simulink.values.evaluate import UndefinedVariable
from simrob_drake.extensions.simulink.values.mat import Files, variables_of_mat
from simrob_drake.extensions.simulink.values.syntax import NotUnderstood

_PATIENCE = 60.0  # s
_NAME = re.compile(r"(?<!\.)\b[A-Za-z]\w*")
_IDLE = (
    "set_param",
    "get_param",
    "gcb",
    "gcbh",
    "gcs",
    "bdroot",
    "add_block",
    "add_line",
    "delete_line",
    "disp",
)
"""Functions of Simulink, which do nothing where Octave runs code."""
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


def find_octave(folders: Iterable[Path] = ()) -> Octave:
    """Return what runs code, with functions and scripts of these folders.

    Raises InvalidParameter: GNU Octave is not installed.
    """
    program = shutil.which("octave-cli") or shutil.which("octave")
    if program is None:
        raise Unsuitable(
            "--octave",
            message("simulink.no_octave", "no program octave-cli is found"),
            message("simulink.install_octave", "install GNU Octave, or leave it out"),
        )

    paths = "".join(
        f"addpath('{str(folder.resolve()).replace(chr(39), 2 * chr(39))}');\n" for folder in folders
    )

    def run(code: str, lookup: Callable[[str], Any]) -> dict[str, Any]:
        from scipy.io import savemat

        known = {"none_": 0.0}
        for name in dict.fromkeys(_NAME.findall(code)):
            with suppress(UndefinedVariable):  # a function, or a variable that the code sets
                known[name] = lookup(name)
        texts = {
            "code": _SCRIPT.format(code=paths + code),
            **{name: _NOTHING.format(name=name) for name in _IDLE},
        }
        command, quiet = (
            [program, "--no-gui", "--no-init-file", "--quiet", "code.m"],
            subprocess.DEVNULL,
        )
        with TemporaryDirectory() as folder:
            savemat(Path(folder, "given.mat"), known)
            for name, text in texts.items():
                Path(folder, f"{name}.m").write_text(text, encoding="utf-8")
            try:
                subprocess.run(
                    command,
                    cwd=folder,
                    stdin=quiet,
                    capture_output=True,
                    timeout=_PATIENCE,
                    check=False,
                )
            except subprocess.TimeoutExpired as problem:
                expected = message(
                    "simulink.quicker_mask_code",
                    "quicker: code of a mask has not ended after {seconds:g} s",
                    seconds=_PATIENCE,
                )
                raise InvalidParameter("--octave", code[:60], expected) from problem
            found = Path(folder, "found.mat")
            return variables_of_mat(found, "--octave") if found.is_file() else {}

    return run


@dataclass
class Variables:
    """Variables of one level."""

    name: str = ""  # of the mask or model, for messages
    variables: dict[str, Any] = field(default_factory=dict)  # those that are known
    outer: Variables | None = None  # where others are looked up
    pending: dict[str, Callable[[], Any]] = field(default_factory=dict)
    """Those that are computed when they are first asked for."""
    unknown: set[str] = field(default_factory=set)  # names that code outside the subset sets
    code: str = ""  # what sets further variables, once one is asked for that is not known
    octave: Octave | None = (
        None  # what runs code outside the subset; that of the outer levels unless given
    )
    files: Files | None = None  # what code may name; those of the outer levels unless given
    texts: dict[str, str] = field(default_factory=dict)  # parameters of a mask, as they are written
    # files that code takes variables from, and that are not there
    absent: set[str] = field(default_factory=set)
    settings: dict[str, dict[str, str]] = field(default_factory=dict)
    """Parameters that code of a mask sets of blocks in its subsystem, by their path there, once it has run."""
    unset: bool = False  # whether it would set others by what is outside the subset
    # what counts where no code tells a variable; None of nothing
    spare: Callable[[str], Any] = lambda _: None

    def __post_init__(self) -> None:
        if self.outer is not None:
            self.octave, self.files = (
                self.octave or self.outer.octave,
                self.files or self.outer.files,
            )

    def lookup(self, name: str) -> Any:
        """Return a variable's value (raises UndefinedVariable: no workspace has it)."""
        if name in self.pending:
            try:
                self.variables[name] = self.pending[name]()
            except (UndefinedVariable, NotUnderstood):
                self.run()  # which may set it anew
                if name not in self.variables:
                    raise  # it stays pending
            del self.pending[name]
        self.run()
        if name in self.variables:
            return self.variables[name]
        if (value := self.spare(name)) is not None:
            return self.variables.setdefault(name, value)
        if name in self.unknown:
            raise UndefinedVariable(
                name,
                message(
                    "simulink.set_by_code_of",
                    "it is set by code of '{name}' that only MATLAB runs",
                    name=self.name,
                ),
            )
        if self.outer is None:
            missing = ", ".join(sorted(self.absent))
            why = (
                message(
                    "simulink.variables_missing",
                    "'{name}' takes variables from {missing}, which is not there",
                    name=self.name,
                    missing=missing,
                )
                if missing
                else ""
            )
            raise UndefinedVariable(name, why)
        return self.outer.lookup(name)

    def value(self, text: str) -> Any:
        """Return the value of an expression here, which may call functions of files.

        Raises:
            UndefinedVariable: it uses a variable that no workspace has.
            NotUnderstood: it is outside the subset.
        """
        return CodeRun({}, self.lookup, self.files).value(text.rstrip("; "))

    def run(self) -> None:
        """Run the code that sets further variables, unless it has run."""
        code, self.code = self.code, ""
        if not code:
            return
        run = CodeRun(self.variables, self.lookup, self.files, texts=self.texts)
        run.run(code)
        self.unknown |= run.unknown
        self.absent |= run.absent
        self.settings, self.unset = run.settings, run.unset
        lacking = self.unknown | run.incomplete
        if lacking and self.octave is not None:
            found = self.octave(
                code, lambda name: undefined(name) if name in self.unknown else self.lookup(name)
            )
            self.variables |= {name: value for name, value in found.items() if name in lacking}
            self.unknown -= found.keys()


def variables_of(
    settings: Mapping[str, str], files: list[Path], named: Files | None = None
) -> dict[str, Any]:
    """Return the variables that a user gives, by expressions and files, which may name what others hold.

    A name ``tool.mass`` is a field of a structure; files are `.mat`, or `.m` scripts of assignments. Raises
    InvalidParameter: a file or an expression that cannot be read.
    """
    run = CodeRun({}, files=named)
    for file in files:
        if file.suffix == ".mat":
            run.variables.update(variables_of_mat(file))
        else:
            try:
                run.run(content_of(file).decode("utf-8", errors="replace"))
            except (OSError, NotUnderstood) as problem:
                expected = message(
                    "simulink.mat_or_script",
                    "a .mat file or a script of assignments: {problem}",
                    problem=problem,
                )
                raise InvalidParameter("--variables", str(file), expected) from problem
    for name, text in settings.items():
        try:
            run.assign(f"{name}={text}")
        except (NotUnderstood, UndefinedVariable) as problem:
            expected = message(
                "simulink.an_expression",
                "an expression such as [0 0 1] or 30*pi/180: it {problem}",
                problem=problem,
            )
            raise InvalidParameter(f"--set {name}", text, expected) from problem
    return run.variables
