"""Where variables are found: masks from the inside out, the model's workspace, what the user gives, `.mat` files.

A `.mat` file of version 5 is a list of elements: matrices, of which cells and structures hold others, compressed or not
("MAT-File Format", The MathWorks). In a few bytes it can ask for more memory, or for a deeper nesting, than there is:
that is bounded before a library reads it.
"""

from __future__ import annotations

import io
import math
import re
import shutil
import struct
import subprocess
import zlib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from simrob_drake.errors import InvalidParameter
from simrob_drake.files import content_of
from simrob_drake.simulink.values.code import CodeRun
from simrob_drake.simulink.values.evaluate import UndefinedVariable, evaluate, matrix
from simrob_drake.simulink.values.syntax import NotUnderstood, parse

LARGEST = 200_000_000  # of a file, and of all that is packed in it [bytes]
_DEEPEST = 50  # matrices in cells and structures
_MOST_ELEMENTS = 500_000
_HEADER, _VERSION_5 = 128, (b"IM", b"MI")  # the mark of little-endian files, and of big-endian ones
_INT32, _MATRIX, _COMPRESSED = 5, 14, 15  # types of elements
_SPARSE = 5  # the class of a matrix that does not hold all its entries


class UnboundedMat(Exception):
    """A file that asks for far more than it holds; the text says what."""


def check_bounds(content: bytes) -> None:
    """Check that a file asks for nothing beyond what it holds.

    Raises:
        UnboundedMat: it does.
    """
    mark = content[_HEADER - 2 : _HEADER]
    if mark in _VERSION_5:
        _Scan("<" if mark == _VERSION_5[0] else ">").check(memoryview(content)[_HEADER:])


class _Scan:
    """One look through one file, whose numbers are in an order of bytes."""

    def __init__(self, order: str) -> None:
        self._order, self._room, self._elements = order, LARGEST, _MOST_ELEMENTS

    def check(self, data: memoryview) -> None:
        for kind, content in self._elements_of(data):
            packed = self._elements_of(memoryview(self._inflated(content))) if kind == _COMPRESSED else ()
            for inner, variable in packed or ((kind, content),):
                if inner == _MATRIX:
                    self._check_matrix(variable, 1)

    def _check_matrix(self, data: memoryview, depth: int) -> None:
        if depth > _DEEPEST:
            raise UnboundedMat(f"it nests cells or structures more than {_DEEPEST} deep")
        sparse = False
        for place, (kind, content) in enumerate(self._elements_of(data)):
            if kind == _MATRIX:
                self._check_matrix(content, depth + 1)
            elif place == 0:
                sparse = bool(len(content)) and self._numbers(content[:4])[0] & 0xFF == _SPARSE
            elif place == 1 and kind == _INT32 and not sparse:
                sizes = self._numbers(content)
                if min(sizes, default=0) < 0 or math.prod(sizes) > len(data):
                    raise UnboundedMat(f"it counts {' x '.join(map(str, sizes))} entries, and has no bytes for them")

    def _elements_of(self, data: memoryview) -> Iterator[tuple[int, memoryview]]:
        """Yield type and content of each element; one that is cut off is for the library to tell."""
        start = 0
        while start + 8 <= len(data):
            self._elements -= 1
            if self._elements < 0:
                raise UnboundedMat(f"it holds more than {_MOST_ELEMENTS} elements")
            kind, size = struct.unpack(f"{self._order}II", data[start : start + 8])
            if kind >> 16:  # a small one: its content stands in the second half of its own tag
                yield kind & 0xFFFF, data[start + 4 : start + 4 + (kind >> 16)]
                start += 8
                continue
            yield kind, data[start + 8 : start + 8 + size]
            start += 8 + (size if kind == _COMPRESSED else math.ceil(size / 8) * 8)

    def _numbers(self, content: memoryview) -> tuple[int, ...]:
        return struct.unpack(f"{self._order}{len(content) // 4}i", content[: len(content) // 4 * 4])

    def _inflated(self, content: memoryview) -> bytes:
        inflater = zlib.decompressobj()
        try:
            found = inflater.decompress(content, self._room)
        except zlib.error:  # for the library to tell
            return b""
        self._room -= len(found)
        if self._room <= 0:
            raise UnboundedMat(f"it unpacks to more than {LARGEST // 1_000_000} MB")
        return found


def contents_of_mat(file: Path, option: str) -> dict[str, Any]:
    """Return what a file holds by name, as SciPy has it: matrices, records, and objects that it cannot read.

    Raises:
        InvalidParameter: it cannot be read; the message names the option that asked for it.
    """
    from scipy.io import loadmat

    try:
        data = content_of(file, LARGEST)
        check_bounds(data)
        source: Any = io.BytesIO(data)  # which older stubs of scipy do not know of
        content = loadmat(source, squeeze_me=False, struct_as_record=True)
    except Exception as problem:  # readers of damaged files raise whatever they like
        reason = (
            "saved with -v7: version 7.3 is not read"
            if isinstance(problem, NotImplementedError)
            else f"readable: {problem}"
        )
        raise InvalidParameter(option, str(file), reason) from problem
    return {name: value for name, value in content.items() if not name.startswith("__")}


def variables_of_mat(file: Path, option: str = "--variables") -> dict[str, Any]:
    """Return the variables of a file, by name; errors as of :func:`contents_of_mat`."""
    content = contents_of_mat(file, option)
    return {name: value for name, raw in content.items() if (value := _plain(raw)) is not None}


def _plain(raw: Any) -> Any:
    """Return a variable of a .mat file as a matrix, a text, or one or more structures; None for objects."""
    if isinstance(raw, np.ndarray) and raw.dtype.names:
        several = [{name: _plain(one[name]) for name in raw.dtype.names} for one in raw.reshape(-1, order="F")]
        return several if len(several) > 1 else several[0] if several else {}
    if isinstance(raw, np.ndarray) and raw.dtype.kind in "US":
        return "".join(str(part) for part in raw.reshape(-1))
    try:
        return matrix(raw)
    except (NotUnderstood, TypeError, ValueError):
        return None


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
    """Variables of one level."""

    name: str = ""  # of the mask or model, for messages
    variables: dict[str, Any] = field(default_factory=dict)  # those that are known
    outer: Variables | None = None  # where others are looked up
    pending: dict[str, Callable[[], Any]] = field(default_factory=dict)
    """Those that are computed when they are first asked for."""
    unknown: set[str] = field(default_factory=set)  # names that code outside the subset sets
    code: str = ""  # what sets further variables, once one is asked for that is not known
    octave: Octave | None = None  # what runs code outside the subset; that of the outer levels unless given

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
            run.assign(f"{name}={text}")
        except (NotUnderstood, UndefinedVariable) as problem:
            raise InvalidParameter(
                f"--set {name}", text, f"an expression such as [0 0 1] or 30*pi/180: it {problem}"
            ) from problem
    return run.variables


def _undefined(name: str) -> Any:
    raise UndefinedVariable(name)
