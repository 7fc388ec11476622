"""MATLAB code as masks, callbacks and scripts have it: assignments, ``if``, ``switch``, ``for``, functions of files.

What is outside the subset is passed over, and the names that it would have set are remembered as unknown.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from contextlib import suppress
from functools import partial
from typing import Any, Protocol, Self

import numpy as np

from simrob_drake.simulink.values.evaluate import NUMBERS, Algebra, UndefinedVariable, evaluate, matrix
from simrob_drake.simulink.values.script import (
    KEYWORD,
    OPENS,
    ScriptFunction,
    branches,
    closing,
    functions_of,
    names_in,
    split,
    statements,
)
from simrob_drake.simulink.values.syntax import NotUnderstood, parse

MOST_STEPS = 20_000  # statements of one piece of code

_STEP = r"\.([A-Za-z]\w*)|\(((?:[^()=]|\([^()=]*\))*)\)"
_ASSIGNMENT = re.compile(rf"([A-Za-z]\w*)((?:{_STEP})*)\s*=(?!=)\s*(.+)", re.DOTALL)
_TARGETS = re.compile(r"(\[[^\]]*\]|[A-Za-z]\w*)(?:((?:\.[A-Za-z]\w*)+)\s*|[^=]*)=(?!=)")
_NAME = re.compile(r"(?<!\.)\b[A-Za-z]\w*")
_SEVERAL = re.compile(r"\[([^\]=]+)\]\s*=(?!=)\s*(.+)", re.DOTALL)
_CALL = re.compile(r"(\w+)\s*\((.*)\)\s*", re.DOTALL)
_FILE = re.compile(r"""(?:(run|load)\b\s*\(?\s*["']?(?:[^"'()=]*[/\\])?)?([A-Za-z]\w*)(\.m(?:at)?)?["']?\s*\)?""")
_MOST_CALLS = 50
_HERE = "(this block)"


class Files(Protocol):
    """The `.m` and `.mat` files that code may name."""

    def script(self, name: str) -> str:
        """Return the text of ``name.m``; empty where there is none."""

    def variables(self, name: str) -> dict[str, Any] | None:
        """Return what is in ``name.mat``; None where there is none."""


def undefined(name: str) -> Any:
    """Look a variable up where there is none."""
    raise UndefinedVariable(name)


class CodeRun:
    """One run of a piece of code.

    Attributes:
        variables: what it sets, on top of those it began with.
        unknown: names that a passed-over statement would have set.
        incomplete: structures of which it would have set a field.
        absent: files that it takes variables from, and that are not there.
        settings: parameters of blocks within that of the code, by their path there and their names.
    """

    def __init__(
        self,
        variables: dict[str, Any],
        lookup: Callable[[str], Any] = undefined,
        files: Files | None = None,
        functions: dict[str, ScriptFunction] | None = None,
        texts: Mapping[str, str] | None = None,
    ) -> None:
        """Take what it begins with.

        Args:
            variables: by name.
            lookup: looks others up.
            files: where functions and scripts are found.
            functions: that are known already.
            texts: of the parameters of the block whose mask this is, as they are written.
        """
        self.variables = variables
        self.unknown: set[str] = set()
        self.incomplete: set[str] = set()
        self.absent: set[str] = set()
        self.settings: dict[str, dict[str, str]] = {}
        self._outside, self._files, self._texts = lookup, files, texts or {}
        self.functions = {} if functions is None else functions
        self._steps = self.depth = 0
        known = {name: partial(self._first_of, name) for name in self.functions}
        base = self._base()
        own: dict[str, Callable[..., Any]] = {"exist": self._exists, "gcb": lambda: _HERE, "get_param": self._parameter}
        self._algebra = Algebra(base.operators, {**base.functions, **own, **known})

    def _base(self) -> Algebra:
        """Return what expressions are computed with, before functions of files."""
        return NUMBERS

    def run(self, code: str) -> None:
        """Run code."""
        self._block(statements(code))

    def _lookup(self, name: str) -> Any:
        if name in self.unknown:
            raise UndefinedVariable(name, "it is set by mask code outside the subset")
        return self.variables[name] if name in self.variables else self._outside(name)

    def value(self, text: str) -> Any:
        """Return the value of an expression (raises as `evaluate`)."""
        while True:
            try:
                return evaluate(parse(text), self._lookup, self._algebra)
            except UndefinedVariable as problem:
                if problem.name in self.unknown or not self.find(problem.name):
                    raise

    def find(self, name: str) -> bool:
        """Take in the functions of a file of this name, unless they are there."""
        if self._files is None or name in self.functions or len(self.functions) > _MOST_CALLS:
            return False
        for own, function in functions_of(self._files.script(name)).items():
            self.functions.setdefault(own, function)
            self._algebra.functions.setdefault(own, partial(self._first_of, own))
        return name in self.functions

    def _exists(self, name: Any, *_: Any) -> float:
        if name in self.unknown:
            raise UndefinedVariable(name)
        try:
            return float(self._lookup(name) is not None)
        except UndefinedVariable:
            return 0.0

    def _parameter(self, block: Any, name: Any) -> Any:
        """Return a parameter of the block whose mask this is: its text, or its value as ``value@name``."""
        if block != _HERE or not isinstance(name, str):
            raise NotUnderstood("get_param")
        if name.startswith("value@"):
            return self._lookup(name.removeprefix("value@"))
        if name not in self._texts:
            raise NotUnderstood(f"get_param of {name[:40]}")
        return self._texts[name]

    def _first_of(self, name: str, *arguments: Any) -> Any:
        (first, *_) = self.called(name, list(arguments)) or [None]
        if first is None:
            raise UndefinedVariable(name, f"what {name}.m gives is not known")
        return first

    def _inner(self, variables: dict[str, Any]) -> Self:
        """Return a run of a function's statements."""
        inner = type(self)(variables, undefined, self._files, self.functions)
        inner.depth, inner.settings = self.depth + 1, self.settings
        return inner

    def called(self, name: str, arguments: list[Any]) -> list[Any]:
        """Return the outputs of a function; None in place of those that are not known.

        Raises:
            NotUnderstood: it calls itself.
        """
        function = self.functions[name]
        if self.depth > _MOST_CALLS:
            raise NotUnderstood(f"{function.name} calls itself")
        arguments_in = {"nargin": matrix(len(arguments)), **dict(zip(function.inputs, arguments, strict=False))}
        if function.inputs[-1:] == ["varargin"]:
            arguments_in["varargin"] = arguments[len(function.inputs) - 1 :]
        inner = self._inner(arguments_in)
        inner._block(function.body)
        self.absent |= inner.absent
        return [inner.variables.get(name) for name in function.outputs]

    def _block(self, lines: list[str]) -> None:
        place = 0
        while place < len(lines):
            place = self._next(lines, place)

    def _next(self, lines: list[str], place: int) -> int:
        self._count()
        keyword = KEYWORD.match(lines[place])
        stop = closing(lines, place) if keyword and keyword[1] in OPENS else place + 1
        part = lines[place:stop]
        try:
            self._statement(keyword[1] if keyword else "", part)
        except (NotUnderstood, UndefinedVariable, KeyError, IndexError, TypeError, ValueError) as problem:
            self._pass_over(part, problem)
        return stop

    def _count(self) -> None:
        self._steps += 1
        if self._steps > MOST_STEPS:
            raise NotUnderstood(f"runs for more than {MOST_STEPS} statements")

    def _statement(self, keyword: str, part: list[str]) -> None:
        if keyword == "if":
            self._choose(branches(part[:-1], ("if", "elseif", "else")))
        elif keyword == "switch":
            self._switch(part)
        elif keyword in ("for", "while"):
            self._loop(keyword, part)
        elif keyword in ("return", "end") or not part[0]:
            return
        elif keyword:
            raise NotUnderstood(keyword)
        elif not (self._took_file(part[0]) or self._set(part[0])):
            self.assign(part[0])

    def _loop(self, keyword: str, part: list[str]) -> None:
        head, body = part[0].removeprefix(keyword).strip(), part[1:-1]
        if keyword == "for":
            name, _, values = head.partition("=")
            for column in matrix(self.value(values.strip().removesuffix(","))).T:
                self.variables[name.strip(" (")] = matrix(column).T
                self._block(body)
            return
        while met := self._condition(head):
            if not isinstance(met, bool | float):
                raise NotUnderstood(part[0])
            self._block(body)
            self._count()

    def _took_file(self, text: str) -> bool:
        """Run a script of a file, or load its variables, where a statement is that."""
        match = _FILE.fullmatch(text) if self._files is not None else None
        if match is None or self._files is None:
            return False
        command, name, suffix = match.groups()
        if command == "load":
            found = self._files.variables(name)
            self.variables |= found or {}
            self.unknown -= (found or {}).keys()
            self.absent |= set() if found is not None else {f"{name}.mat"}
        elif script := self._files.script(name):
            self._block([] if functions_of(script) else statements(script))
        elif command or suffix:
            self.absent.add(f"{name}.m")
        return True

    def _set(self, text: str) -> bool:
        """Note parameters that a statement sets of blocks within that of the code, or do the code that it makes."""
        call = _CALL.fullmatch(text)
        if call is None or call[1] not in ("set_param", "eval"):
            return False
        if call[1] == "eval":
            if self.depth > _MOST_CALLS:
                raise NotUnderstood("makes code that makes code without end")
            self.depth += 1
            try:
                self._block(statements(str(self.value(call[2]))))
            finally:
                self.depth -= 1
            return True
        block, *pairs = (self.value(argument) for argument in split(call[2]))
        if isinstance(block, str) and block.startswith(f"{_HERE}/"):
            texts = {name: value for name, value in zip(pairs[::2], pairs[1::2], strict=True) if isinstance(value, str)}
            self.settings.setdefault(block.removeprefix(f"{_HERE}/"), {}).update(texts)
        return True

    def assign(self, text: str) -> None:
        """Do an assignment, of a field or element or of several outputs of a function, too."""
        if several := _SEVERAL.fullmatch(text):
            call = _CALL.fullmatch(several[2])
            if call is None or not (call[1] in self.functions or self.find(call[1])):
                raise NotUnderstood(text[:60])
            arguments = [self.value(argument) for argument in split(call[2])]
            for name, value in zip(names_in(several[1]), self.called(call[1], arguments), strict=False):
                if value is None:
                    self._pass_over([f"{name} ="], NotUnderstood(f"{call[1]} gives no {name}"))
                elif name != "~":
                    self.variables[name] = value
                    self.unknown.discard(name)
            return
        match = _ASSIGNMENT.fullmatch(text)
        if match is None:
            raise NotUnderstood(text)
        name, steps = match[1], re.findall(_STEP, match[2])
        known = self.variables.get(name)
        if steps and steps[0][0] and known is None:
            with suppress(UndefinedVariable):
                known = self._lookup(name)
        self.variables[name] = self._put(known, steps, self.value(match[5]))
        self.unknown.discard(name)

    def _put(self, known: Any, steps: list[tuple[str, str]], value: Any) -> Any:
        """Return a value with the part replaced that fields and indices lead to."""
        if not steps:
            return value
        (field, index), *rest = steps
        if field:
            structure = dict(known) if isinstance(known, dict) else {}
            return structure | {field: self._put(structure.get(field), rest, value)}
        if not rest and not isinstance(value, dict):
            return self._changed(known, index, value)
        several = list(known) if isinstance(known, list) else [known] if isinstance(known, dict) else []
        (place,) = self._places(index, len(several))
        several += [{} for _ in range(place + 1 - len(several))]
        several[place] = self._put(several[place], rest, value)
        return several if len(several) > 1 else several[0]

    def _changed(self, known: Any, index: str, value: Any) -> Any:
        array = np.zeros((0, 0)) if known is None else matrix(known).copy()
        words = index.split(",")
        places = [
            np.arange(size) if word.strip() == ":" else self._places(word, size) for word, size in _paired(words, array)
        ]
        if len(places) == 1:
            flat = array.reshape(-1, order="F")
            grown = np.zeros(max(flat.size, int(places[0].max()) + 1), dtype=_both(array, value))
            grown[: flat.size] = flat
            grown[places[0]] = matrix(value).reshape(-1, order="F")
            if grown.size == array.size:
                return grown.reshape(array.shape, order="F")
            return grown.reshape(-1, 1) if array.shape[1:] == (1,) and array.shape[0] > 1 else grown.reshape(1, -1)
        rows, columns = (max(size, int(place.max()) + 1) for size, place in zip(array.shape, places, strict=True))
        grown = np.zeros((rows, columns), dtype=_both(array, value))
        grown[: array.shape[0], : array.shape[1]] = array
        grown[np.ix_(places[0], places[1])] = matrix(value)
        return grown

    def _places(self, word: str, size: int) -> Any:
        places = matrix(self.value(re.sub(r"\bend\b", str(size), word))).reshape(-1).astype(int) - 1
        if places.size == 0 or places.min() < 0 or places.max() > 100_000:
            raise NotUnderstood(word)
        return places

    def _switch(self, part: list[str]) -> None:
        head, *ways = branches(part[:-1], ("switch", "case", "otherwise"))
        subject = head[0].removeprefix("switch").strip()
        tests: list[tuple[str, list[str]]] = []
        for words, body in ways:
            if words.startswith("otherwise"):
                tests.append(("else", body))
                continue
            choices = words.removeprefix("case").strip().removeprefix("{").removesuffix("}").split(",")
            tests.append(("if " + " || ".join(f"(({subject}) == ({choice}))" for choice in choices), body))
        self._choose(tests)

    def _choose(self, ways: list[tuple[str, list[str]]]) -> None:
        if not ways:
            return
        (words, body), *rest = ways
        if words.startswith("else") and not words.startswith("elseif"):
            self._block(body)
            return
        condition = self._condition(words.removeprefix("elseif").removeprefix("if").strip())
        self._split_by(condition, partial(self._block, body), partial(self._choose, rest))

    def _condition(self, text: str) -> Any:
        return bool(np.all(self.value(text)))

    def _split_by(self, condition: Any, yes: Callable[[], None], no: Callable[[], None]) -> None:
        (yes if condition else no)()

    def _pass_over(self, part: list[str], _: Exception) -> None:
        for match in filter(None, map(_TARGETS.match, part)):
            if match[2]:  # a field: others stay as they are
                self.incomplete.add(match[1])
                self._drop(self.variables.get(match[1]), match[2].split(".")[1:])
                continue
            names = {name for name in _NAME.findall(match[1]) if not KEYWORD.fullmatch(name)}
            self.unknown |= names
            for name in names if match[0][len(match[1])] != "." else ():
                self.variables.pop(name, None)

    def _drop(self, known: Any, fields: list[str]) -> None:
        if isinstance(known, dict) and len(fields) > 1:
            self._drop(known.get(fields[0]), fields[1:])
        elif isinstance(known, dict):
            known.pop(fields[0], None)


def _both(array: Any, value: Any) -> Any:
    return np.result_type(array, matrix(value))


def _paired(words: list[str], array: Any) -> list[tuple[str, int]]:
    sizes = [array.size] if len(words) == 1 else list(array.shape)
    if len(words) != len(sizes):
        raise NotUnderstood("an index of this many dimensions")
    return list(zip(words, sizes, strict=True))
