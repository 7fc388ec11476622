"""MATLAB code as masks, callbacks and scripts have it: assignments, ``if``, ``switch``, ``for``, functions of files.

What is outside the subset is passed over, and the names that it would have set are remembered as unknown.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from contextlib import suppress
from functools import partial
from typing import Any, Self

import numpy as np

from simrob_drake.base.messages import message
from simrob_drake.extensions.simulink.values.evaluate import (
    NUMBERS,
    SEVERAL,
    Algebra,
    Evaluator,
    UndefinedVariable,
    matrix,
)
from simrob_drake.extensions.simulink.values.mat import Files
from simrob_drake.extensions.simulink.values.syntax import (
    KEYWORD,
    Expression,
    NotUnderstood,
    ScriptFunction,
    Section,
    Statement,
    functions_of,
    lines_of,
    names_in,
    parse,
    sides,
    statements,
)

MOST_STEPS = 20_000  # statements of one piece of code

_TARGETS = re.compile(r"(\[[^\]]*\]|[A-Za-z]\w*)(?:((?:\.[A-Za-z]\w*)+)\s*|[^=]*)=(?!=)")
_NAME = re.compile(r"(?<!\.)\b[A-Za-z]\w*")
_FILE = re.compile(
    r"""(?:(run|load)\b\s*\(?\s*["']?(?:[^"'()=]*[/\\])?)?([A-Za-z]\w*)(\.m(?:at)?)?["']?\s*\)?"""
)
_FARTHEST = 100_000  # place to which an assignment makes a matrix grow
_MOST_CALLS = 50
_HERE = "(this block)"


def undefined(name: str) -> Any:
    """Look a variable up where there is none."""
    raise UndefinedVariable(name)


class CodeRun(Evaluator):
    """One run of a piece of code.

    Attributes:
        variables: what it sets, on top of those it began with.
        unknown: names that a passed-over statement would have set.
        incomplete: structures of which it would have set a field.
        absent: files that it takes variables from, and that are not there.
        settings: parameters of blocks within that of the code, by their path there and their names.
        unset: whether a passed-over statement would have set such.
    """

    def __init__(
        self,
        variables: dict[str, Any],
        lookup: Callable[[str], Any] = undefined,
        files: Files | None = None,
        functions: dict[str, ScriptFunction] | None = None,
        texts: Mapping[str, str] | None = None,
    ) -> None:
        """Take variables and functions that are known already, and what looks others up; files hold further ones.

        The texts are those of the parameters of the block whose mask this is, as they are written.
        """
        self.variables = variables
        self.unknown, self.incomplete, self.absent = set[str](), set[str](), set[str]()
        self.settings: dict[str, dict[str, str]] = {}
        self.unset = False
        self._files, self._texts = files, texts or {}
        self.functions = {} if functions is None else functions
        self.shared: dict[str, Any] = {}  # by ``global``, over all functions
        self._declared: set[str] = set()  # names of those here
        self._steps = self.depth = 0
        text = self._parameter
        own: dict[str, Callable[..., Any]] = {
            **{"exist": self._exists, "gcb": lambda: _HERE, "get_param": self._parameter},
            "Simulink": lambda: {
                "Mask": {"get": lambda of: {"getParameter": lambda name: {"Value": text(of, name)}}}
            },
            **{name: partial(self._first_of, name) for name in self.functions},
        }
        super().__init__(lookup, {**self.algebra(), **own})

    def algebra(self) -> Algebra:
        """Return what expressions are computed with, before functions of files."""
        return NUMBERS

    def run(self, code: str) -> None:
        """Run code, which may call the functions that are in it."""
        self._learn(code)
        self._block(statements(code))

    def _lookup(self, name: str) -> Any:
        if name in self.unknown:
            raise UndefinedVariable(
                name,
                message("simulink.set_by_mask_code", "it is set by mask code outside the subset"),
            )
        return self.variables[name] if name in self.variables else super()._lookup(name)

    def value(self, text: str) -> Any:
        """Return the value of an expression (raises as `evaluated`)."""
        return self.evaluated(parse(text))

    def find(self, name: str) -> bool:
        """Take in a function of this name that is known, or that a file has, unless it is in use."""
        if name in self._algebra or name in self.unknown:
            return False
        if (
            name not in self.functions
            and self._files is not None
            and len(self.functions) <= _MOST_CALLS
        ):
            self._learn(self._files.script(name))
        if name in self.functions:
            self._algebra = {**self._algebra, name: partial(self._first_of, name)}
        return name in self.functions

    def _learn(self, code: str) -> None:
        for name, function in functions_of(code).items():
            self.functions.setdefault(name, function)
            self._algebra = {name: partial(self._first_of, name), **self._algebra}

    def _exists(self, name: Any, *_: Any) -> float:
        try:
            return float(self._lookup(name) is not None)
        except UndefinedVariable:
            if name in self.unknown:
                raise
            return 0.0

    def _parameter(self, block: Any, name: Any) -> Any:
        """Return a parameter of the block whose mask this is: its text, or its value as ``value@name``."""
        if block != _HERE or not isinstance(name, str):
            raise NotUnderstood("get_param")
        if name.startswith("value@"):
            return self._lookup(name.removeprefix("value@"))
        if name not in self._texts:
            raise NotUnderstood(
                message("simulink.get_param_of", "get_param of {name}", name=name[:40])
            )
        return self._texts[name]

    def _first_of(self, name: str, *arguments: Any) -> Any:
        (first, *_) = self.called(name, list(arguments)) or [None]
        if first is None:
            raise UndefinedVariable(
                name,
                message("simulink.unknown_script", "what {name}.m gives is not known", name=name),
            )
        return first

    def _inner(self, variables: dict[str, Any]) -> Self:
        """Return a run of a function's statements."""
        inner = type(self)(variables, undefined, self._files, self.functions)
        inner.depth, inner.settings, inner.shared = self.depth + 1, self.settings, self.shared
        return inner

    def called(self, name: str, arguments: list[Any]) -> list[Any]:
        """Return the outputs of a function; None in place of those that are not known.

        Raises NotUnderstood: it calls itself.
        """
        function = self.functions[name]
        if self.depth > _MOST_CALLS:
            raise NotUnderstood(
                message("simulink.calls_itself", "{function} calls itself", function=function.name)
            )
        arguments_in = {
            "nargin": matrix(len(arguments)),
            **dict(zip(function.inputs, arguments, strict=False)),
        }
        if function.inputs[-1:] == ["varargin"]:
            arguments_in["varargin"] = arguments[len(function.inputs) - 1 :]
        inner = self._inner(arguments_in)
        inner._block(function.body)
        self.absent |= inner.absent
        self.variables |= {name: self.shared[name] for name in self._declared & self.shared.keys()}
        return [inner.variables.get(name) for name in function.outputs]

    def _block(self, lines: list[Statement]) -> None:
        for line in lines:
            self._next(line)

    def _next(self, line: Statement) -> None:
        self._count()
        try:
            self._do(line)
        except (LookupError, TypeError, ValueError) as problem:
            self._pass_over(line, problem)

    def _count(self) -> None:
        self._steps += 1
        if self._steps > MOST_STEPS:
            raise NotUnderstood(
                message(
                    "simulink.too_many_statements",
                    "runs for more than {most} statements",
                    most=MOST_STEPS,
                )
            )

    def _do(self, line: Statement) -> None:
        if isinstance(line, str):
            self._do_line(line)
        elif line.keyword == "if":
            self._choose(line.parts)
        elif line.keyword == "switch":
            self._switch(line.parts)
        elif line.keyword in ("for", "while"):
            self._loop(line.keyword, *line.parts[0])
        elif line.keyword != "function":
            raise NotUnderstood(line.keyword)

    def _do_line(self, text: str) -> None:
        if (keyword := KEYWORD.match(text)) or self._took_file(text):
            if keyword and keyword[1] not in ("return", "end"):
                raise NotUnderstood(keyword[1])
            return
        if sides(text)[0]:
            self.assign(text)
            return
        if text.startswith("global "):
            self._share(text.removeprefix("global").split())
            return
        match parse(text):
            case ("call", (("name", ("eval",)), (code,))):
                if self.depth > _MOST_CALLS:
                    raise NotUnderstood(
                        message(
                            "simulink.code_without_end", "makes code that makes code without end"
                        )
                    )
                self.depth += 1
                self._block(statements(str(self.evaluated(code))))
                self.depth -= 1
            case ("call", (("name", ("set_param",)), arguments)):
                self._set(*map(self.evaluated, arguments))

    def _share(self, names: list[str]) -> None:
        self._declared.update(names)
        self.variables |= {name: self.shared[name] for name in self._declared & self.shared.keys()}
        self.shared |= {name: self.variables[name] for name in names if name in self.variables}

    def _set(self, block: Any, *pairs: Any) -> None:
        """Note parameters that a statement sets of blocks within that of the code."""
        if isinstance(block, str) and block.startswith(f"{_HERE}/"):
            texts = {
                name: value
                for name, value in zip(pairs[::2], pairs[1::2], strict=True)
                if isinstance(value, str)
            }
            self.settings.setdefault(block.removeprefix(f"{_HERE}/"), {}).update(texts)

    def _loop(self, keyword: str, line: str, body: list[Statement]) -> None:
        head = line.removeprefix(keyword).strip()
        if keyword == "for":
            name, _, values = head.partition("=")
            for column in matrix(self.value(values.strip().removesuffix(","))).T:
                self.variables[name.strip(" (")] = matrix(column).T
                self._block(body)
            return
        while self._condition(head):
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
            lines = statements(script)
            if not (lines and isinstance(lines[0], Section) and lines[0].keyword == "function"):
                self.run(script)
        elif command or suffix:
            self.absent.add(f"{name}.m")
        return True

    def assign(self, text: str) -> None:
        """Do an assignment, of a field or element or of several outputs of a function, too."""
        left, right = sides(text)
        if not left.startswith("["):
            self._store(parse(left), self.value(right))
            return
        names = names_in(left.strip("[]"))
        for name, value in zip(names, self._outputs(parse(right)), strict=False):
            if value is None:
                self._pass_over(
                    f"{name} =",
                    NotUnderstood(
                        message(
                            "simulink.gives_no_name",
                            "{text} gives no {name}",
                            text=right[:40],
                            name=name,
                        )
                    ),
                )
            elif name != "~":
                self._store(parse(name), value)

    def _outputs(self, call: Expression) -> list[Any]:
        """Return all outputs of a function that is called; None in place of those that are not known."""
        target, arguments = call.parts if call.kind == "call" else (call, ())
        name, values = target.parts[0], [self.evaluated(argument) for argument in arguments]
        if name in self.functions or self.find(name):
            return self.called(name, values)
        if name not in SEVERAL:
            raise NotUnderstood(
                message("simulink.several_outputs", "several outputs of {name}", name=name)
            )
        return SEVERAL[name](*values)

    def _store(self, target: Expression, value: Any) -> None:
        """Let a name be a value, or what a name, field or index leads to."""
        match target:
            case ("name", (name,)):
                self.variables[name] = value
                self.unknown.discard(name)
                self.shared |= {name: value} if name in self._declared else {}
            case ("field", (owner, field)):
                known = self._known(owner, outside=True)
                self._store(owner, {**(known if isinstance(known, dict) else {}), field: value})
            case ("call", (owner, index)):
                self._store(owner, self._changed(self._known(owner), index, value))
            case _:
                raise NotUnderstood(
                    message(
                        "simulink.assigns_to_nothing",
                        "assigns to what is no name, field or element",
                    )
                )

    def _known(self, target: Expression, *, outside: bool = False) -> Any:
        """Return what is there already, of the variables outside only structures; None of nothing."""
        name = target.parts[0] if target.kind == "name" else None
        if name is not None and (name in self.variables or not outside):
            return self.variables.get(name)
        with suppress(NotUnderstood, UndefinedVariable):
            return self.evaluated(target) if name is None else self._lookup(name)
        return None

    def _changed(self, known: Any, index: tuple[Expression, ...], value: Any) -> Any:
        """Return a matrix, cells or structures with what is at an index replaced; they grow to it."""
        if isinstance(known, dict | list) or isinstance(value, str | dict | list):
            several = (
                list(known)
                if isinstance(known, list)
                else [known]
                if isinstance(known, dict)
                else []
            )
            place = int(self._places(index[-1], len(several))[0])
            several += [{} for _ in range(place + 1 - len(several))]
            several[place] = value
            return several[0] if len(several) == 1 and isinstance(value, dict) else several
        array = np.zeros((0, 0)) if known is None else matrix(known)
        sizes = [array.size] if len(index) == 1 else list(array.shape)
        ways = zip(zip(index, sizes, strict=True), matrix(value).shape, strict=False)
        # as it gets
        places = [
            self._places(node, size or (node.kind == "colon") * own) for (node, size), own in ways
        ]
        both = np.result_type(array, matrix(value))
        if len(places) == 1:
            flat = array.reshape(-1, order="F")
            grown = np.zeros(max(flat.size, int(places[0].max()) + 1), dtype=both)
            grown[: flat.size] = flat
            grown[places[0]] = matrix(value).reshape(-1, order="F")
            if grown.size == array.size:
                return grown.reshape(array.shape, order="F")
            return (
                grown.reshape(-1, 1)
                if array.shape[1:] == (1,) and array.shape[0] > 1
                else grown.reshape(1, -1)
            )
        grown = np.zeros(
            [max(size, int(one.max()) + 1) for size, one in zip(sizes, places, strict=True)],
            dtype=both,
        )
        grown[: array.shape[0], : array.shape[1]] = array
        grown[np.ix_(*places)] = matrix(value)
        return grown

    def _places(self, node: Expression, size: int) -> Any:
        if node.kind == "colon":
            return np.arange(size)
        places = self._at(node, size).reshape(-1).astype(int) - 1
        if places.size == 0 or places.min() < 0 or places.max() > _FARTHEST:
            raise NotUnderstood(
                message("simulink.impossible_index", "has an index that no matrix has")
            )
        return places

    def _switch(self, parts: list[tuple[str, list[Statement]]]) -> None:
        (head, _), *ways = parts
        subject, tests = head.removeprefix("switch").strip(), []
        for words, body in ways:
            choices = (
                words.removeprefix("case").strip().removeprefix("{").removesuffix("}").split(",")
            )
            test = "if " + " || ".join(f"(({subject}) == ({choice}))" for choice in choices)
            tests.append(("else" if words.startswith("otherwise") else test, body))
        self._choose(tests)

    def _choose(self, ways: list[tuple[str, list[Statement]]]) -> None:
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

    def _pass_over(self, line: Statement, _: Exception) -> None:
        self.unset |= any("set_param" in text for text in lines_of(line))
        for match in filter(None, map(_TARGETS.match, lines_of(line))):
            if match[2]:  # a field: others stay as they are
                self.incomplete.add(match[1])
                self._drop(self.variables.get(match[1]), match[2].split(".")[1:])
                continue
            names = {name for name in _NAME.findall(match[1]) if not KEYWORD.fullmatch(name)}
            self.unknown |= names
            for name in names if match[0][len(match[1])] != "." else ():
                self.variables.pop(name, None)

    def _drop(self, known: Any, fields: list[str]) -> None:
        for field in fields[:-1]:
            known = known.get(field) if isinstance(known, dict) else None
        if isinstance(known, dict):
            known.pop(fields[-1], None)
