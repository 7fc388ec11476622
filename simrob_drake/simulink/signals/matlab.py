"""MATLAB code of blocks as blocks of a signal flow, where it is plain arithmetic: nothing is run."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from typing import Any, Self

import numpy as np

from simrob_drake.parts.controllers.flow_blocks import FUNCTIONS
from simrob_drake.simulink.model.nodes import Node
from simrob_drake.simulink.reading.model_file import SCRIPT
from simrob_drake.simulink.signals.arithmetic import (
    MATH,
    OPERATORS,
    applied,
    chosen,
    compared,
    inverse,
    joined,
    limited,
    table_of,
)
from simrob_drake.simulink.signals.forms import (
    TIME,
    Form,
    Rule,
    Signal,
    SignalReader,
    Value,
    computed,
    fitted,
    flat,
    mapped,
    signal,
)
from simrob_drake.simulink.tables import table
from simrob_drake.simulink.values.code import CodeRun, Files, undefined
from simrob_drake.simulink.values.evaluate import NUMBERS, Algebra, UndefinedVariable, matrix
from simrob_drake.simulink.values.script import functions_of
from simrob_drake.simulink.values.syntax import NotUnderstood, parse

_EQUALS = re.compile(r"(?<![=~<>!])=(?!=)")
_ENDED = "return"  # where it is kept whether a function has returned
_PARTIAL = ("sqrt", "log", "asin", "acos", "pow")  # functions that are not there for every number


class Translation(CodeRun):
    """One run of a function over values that only a run of the model has: what it does is what blocks compute.

    Where a condition is such a value both branches are translated, and a switch takes what each leaves. What could fail
    in the branch that is not taken gets 1 there.
    """

    def __init__(self, *arguments: Any) -> None:
        """Take what :class:`CodeRun` takes."""
        self._guards: list[Value] = []
        super().__init__(*arguments)

    def _base(self) -> Algebra:
        return Algebra(self._operators(), {**NUMBERS.functions, **self._own_functions()})

    def _operators(self) -> dict[str, Callable[..., Any]]:
        each: dict[str, Callable[..., Value]] = {
            "./": lambda a, b: a / self._guarded(b),
            ".^": lambda a, b: _power(self._guarded(a), b),
            "&": lambda a, b: _both("and", a, b),
            "|": lambda a, b: _both("or", a, b),
            **{sign: partial(compared, flow) for sign, flow in OPERATORS.items()},
        }
        each |= {"&&": each["&"], "||": each["|"]}
        return {**NUMBERS.operators, **{name: _on_symbols(NUMBERS.operators[name], one) for name, one in each.items()}}

    def _own_functions(self) -> dict[str, Callable[..., Any]]:
        each: dict[str, Callable[..., Value]] = {
            **{name: partial(self._applied, name) for name in FUNCTIONS if name not in ("min", "max", "pow")},
            **MATH,
            **{f"{name}d": (lambda u, name=name: applied(name, u * (np.pi / 180))) for name in ("sin", "cos", "tan")},
            "power": lambda a, b: _power(self._guarded(a), b),
            "not": lambda u: joined("not", u),
            "isnan": lambda u: 0.0,
            **dict.fromkeys(("double", "single", "logical", "boolean"), lambda u: u),
            **dict.fromkeys(("int8", "int16", "int32", "uint8", "uint16", "uint32"), MATH["round"]),
        }
        found = {name: _on_symbols(NUMBERS.functions.get(name), one) for name, one in each.items()}
        return {
            **found,
            **{name: partial(_extreme, name) for name in ("min", "max")},
            "norm": _norm, "inv": _inverse, "interp1": _table,
        }  # fmt: skip

    def _guarded(self, value: Value) -> Value:
        if not isinstance(value, Form):
            return value or (1.0 if self._guards else value)
        for guard in self._guards:
            value = chosen(guard, value, 1.0)
        return value

    def _applied(self, name: str, *values: Value) -> Value:
        return applied(name, *(map(self._guarded, values) if name in _PARTIAL else values))

    def _pass_over(self, part: list[str], problem: Exception) -> None:
        raise problem if isinstance(problem, NotUnderstood) else NotUnderstood(f"{part[0][:60]}: {problem}")

    def _block(self, lines: list[str]) -> None:
        place = 0
        while place < len(lines):
            place = self._next(lines, place)
            ended = self.variables.get(_ENDED, 0.0)
            if ended:
                if isinstance(ended, Form):  # what follows is for those who did not return
                    self._split_by(ended, lambda: None, partial(self._go_on, lines[place:]))
                return

    def _go_on(self, lines: list[str]) -> None:
        self.variables[_ENDED] = 0.0
        self._block(lines)

    def _statement(self, keyword: str, part: list[str]) -> None:
        if keyword == "break":
            raise NotUnderstood(keyword)
        if keyword == "return":
            self.variables[_ENDED] = 1.0
        super()._statement(keyword, part)

    def assign(self, text: str) -> None:
        """Do an assignment; an expression alone changes nothing."""
        if _EQUALS.search(text):
            super().assign(text)
            return
        try:
            parse(text)
        except NotUnderstood:
            raise NotUnderstood(text[:60]) from None

    def _took_file(self, text: str) -> bool:
        return False

    def _inner(self, variables: dict[str, Any]) -> Self:
        inner = super()._inner(variables)
        inner._guards = self._guards
        return inner

    def called(self, name: str, arguments: list[Any]) -> list[Any]:
        """Return the outputs of a function; errors as of expressions, where one is not known, too."""
        found = super().called(name, arguments)
        for output, value in zip(self.functions[name].outputs, found, strict=True):
            if value is None:
                raise NotUnderstood(f"{name} gives no {output}")
        return found

    def _condition(self, text: str) -> Value:
        condition: Value = 1.0
        for one in flat(np.asarray(matrix(self._value(text)), dtype=object)):
            condition = _both("and", condition, one)
        return condition

    def _split_by(self, condition: Value, yes: Callable[[], None], no: Callable[[], None]) -> None:
        """Run one of two ways, or by a condition of the model both, and leave what a switch takes of them."""
        if not isinstance(condition, Form):
            super()._split_by(condition, yes, no)
            return
        before, left = dict(self.variables), []
        for way, guard in ((yes, condition), (no, joined("not", condition))):
            self.variables.clear()
            self.variables.update(before)
            with self._guard(guard):
                way()
            left.append(dict(self.variables))
        first, second = left
        ended = chosen(condition, *(one.get(_ENDED, 0.0) for one in left))
        for name in (first.keys() & second.keys()) - {_ENDED}:
            if first[name] is not second[name]:
                self.variables[name] = _merged(condition, first[name], second[name])
        self.variables.update({name: value for name, value in (*first.items(), *second.items())
                               if name not in first or name not in second})  # fmt: skip
        self.variables[_ENDED] = ended

    @contextmanager
    def _guard(self, condition: Value) -> Iterator[None]:
        self._guards.append(condition)
        yield
        self._guards.pop()


def _both(operator: str, first: Value, second: Value) -> Value:
    for one, other in ((first, second), (second, first)):
        if not isinstance(one, Form):
            if bool(one) == (operator == "and"):
                return other if isinstance(other, Form) else float(bool(other))
            return float(operator == "or")
    return joined(operator, first, second)


def _power(base: Value, exponent: Value) -> Value:
    if isinstance(exponent, Form) or not isinstance(base, Form) or exponent not in (1, 2, 3, 4):
        return applied("pow", base, exponent)
    result: Value = base
    for _ in range(int(exponent) - 1):
        result = result * base
    return result


def _on_symbols(numeric: Callable[..., Any] | None, symbolic: Callable[..., Value]) -> Callable[..., Any]:
    """Return a function of matrices: numeric where all are of numbers, else element by element."""

    def function(*arrays: Any) -> Any:
        values = [matrix(array) for array in arrays]
        if numeric is not None and not any(isinstance(one, Form) for array in values for one in array.flat):
            return numeric(*(array.astype(float) for array in values))
        return mapped(symbolic, *(array.astype(object) for array in values))

    return function


def _norm(array: Any) -> Any:
    if matrix(array).dtype != object:
        return NUMBERS.functions["norm"](array)
    return matrix(signal([applied("sqrt", sum((one * one for one in _elements(array)), start=0.0))]))


def _inverse(array: Any) -> Any:
    values = matrix(array)
    if values.dtype != object:
        return NUMBERS.functions["inv"](values)
    if (found := inverse(values.astype(object))) is None:
        raise NotUnderstood(f"the inverse of {' x '.join(map(str, values.shape))} signals")
    return found


def _elements(array: Any) -> list[Value]:
    return flat(matrix(array).astype(object))


def _extreme(name: str, first: Any, second: Any = None, axis: Any = None) -> Any:
    if second is not None and matrix(second).size:
        return mapped(partial(applied, name), matrix(first).astype(object), matrix(second).astype(object))
    values = matrix(first)
    if axis is not None or 1 not in values.shape:
        raise NotUnderstood(f"{name} of a matrix")
    found, *rest = _elements(values)
    for one in rest:
        found = applied(name, found, one)
    return matrix(signal([found]))


def _table(points: Any, values: Any, at: Any, method: Any = "linear", *_: Any) -> Any:
    if matrix(points).dtype == object or matrix(values).dtype == object or method != "linear":
        raise NotUnderstood(f"interp1 by {method}, or of a table that changes")
    parameters = table_of(matrix(points), matrix(values), clip=False)
    return mapped(lambda u: computed("lookup", u, **parameters), matrix(at).astype(object))


def _merged(condition: Value, yes: Any, no: Any) -> Any:
    if isinstance(yes, str | dict) or isinstance(no, str | dict):
        raise NotUnderstood("a text or structure that depends on a condition")
    first, second = matrix(yes), matrix(no)
    if first.shape != second.shape:
        raise NotUnderstood("a matrix whose size depends on a condition")
    return mapped(partial(chosen, condition), first.astype(object), second.astype(object))


def _columns(values: Signal) -> Any:
    return values.reshape(-1, 1) if values.ndim == 1 else values


def _as_signal(value: Any) -> Signal:
    array = matrix(value).astype(object)
    return array.reshape(-1, order="F") if array.shape[1] == 1 else array


def _matlab_function(reader: SignalReader, node: Node, number: int) -> Signal | None:
    """Return an output of a MATLAB Function: of the S-Function in it, whose first output is for order alone."""
    block = node.parent
    code = block.text(SCRIPT) if block is not None else ""
    if block is None or not code:
        return None

    def translated() -> list[Signal]:
        functions = functions_of(code)
        (main, *_) = functions.values()
        inports = [child for child in block.children.values() if child.kind == "Inport"]
        ports = {child.block.name: int(child.text("Port", "1") or "1") for child in inports}
        arguments = [
            _columns(reader.input(node, ports[name])) if name in ports else block.workspace.lookup(name)
            for name in main.inputs
        ]
        run = Translation({}, undefined, reader.network.expanded.libraries, functions)
        return [_as_signal(value) for value in run.called(main.name, arguments)]

    outputs = _understood(block, lambda: reader.once(node, translated))
    return outputs[number - 2] if 0 <= number - 2 < len(outputs) else None


def _understood(node: Node, translate: Callable[[], list[Signal]]) -> list[Signal]:
    try:
        return translate()
    except UndefinedVariable as problem:
        raise node.refusal(f"its code uses {problem.name}, which is not known") from problem
    except (NotUnderstood, ValueError, TypeError, IndexError, KeyError) as problem:
        raise node.refusal(f"its code is not plain arithmetic: {' '.join(str(problem).split())[:120]}") from problem


def condition_on(node: Node, text: str, variables: Mapping[str, Signal]) -> Value:
    """Return whether all of a condition on signals holds, as a value that is not 0.

    Raises:
        InvalidModel: what is not understood.
    """
    run = _over(node, variables)
    return flat(_understood(node, lambda: [signal([run._condition(text)])])[0])[0]


def _over(node: Node, variables: Mapping[str, Signal], files: Files | None = None) -> Translation:
    known = {name: _columns(values) for name, values in variables.items()}
    return Translation(known, node.workspace.lookup, files)


_BARE = re.compile(r"\bu\b(?!\s*\()")  # the input of a Fcn without an index: its first element


def _expression(reader: SignalReader, node: Node, _: int) -> Signal | None:
    """Return an expression of the input ``u``, of a Fcn or Interpreted MATLAB Function."""
    text = node.text("Expr", node.text("Expression", node.text("MATLABFcn", "")))
    values = reader.input(node)
    if node.kind == "Fcn":
        text = _BARE.sub("u(1)", text.replace("[", "(").replace("]", ")"))
    run = _over(node, {"u": values}, reader.network.expanded.libraries)
    if text in FUNCTIONS or (text.isidentifier() and run.find(text)):
        text = f"{text}(u)"
    return _understood(node, lambda: [_as_signal(run._value(text))])[0] if text else None


_BLOCKS: dict[str, Callable[..., Value]] = {
    **{kind: partial(limited, kind=kind) for kind in ("saturation", "dead_zone")},
    "step": lambda time, before, after: computed("step", time=float(time), before=float(before), after=float(after)),
}
"""Functions of formulas that are blocks of a flow."""


_CHOICE = re.compile(r"\{(\w+)(?: or (\w+))?:(.+?)\}")


def _formula(reader: SignalReader, node: Node, _: int) -> Signal | None:
    """Return what a block computes by its formula; None where that has no such choice."""
    row = dict(table("formulas")[node.kind])
    text, choices = row.pop("is"), row.pop("choices", None)
    if choice := _CHOICE.search(text):
        chosen = node.text(choice[1], node.text(choice[2] or "")) or choice[3]
        if (chosen := chosen if choices is None else choices.get(chosen.lower(), "")) == "":
            return None
        text = text[: choice.start()] + chosen + text[choice.end() :]
    words = set(re.findall(r"[A-Za-z]\w*", text))
    values = {name: reader.input(node, place) for place, name in enumerate("uvw", start=1) if name in words}
    if "t" in words:
        values["t"] = reader.input(node) if node.text("TimeSource").startswith("Use external") else signal([TIME])
    values |= {name: _parameter(node, default, others or [name]) for name, (default, *others) in row.items()}
    columns = map(_columns, fitted(node, *values.values()))
    run = Translation(dict(zip(values, columns, strict=True)))
    run._algebra.functions.update({name: _on_symbols(None, function) for name, function in _BLOCKS.items()})
    return _understood(node, lambda: [_as_signal(run._value(text))])[0]


def _parameter(node: Node, default: str, names: list[str]) -> Signal:
    name = next((one for one in names if one in node.block.parameters), names[0])
    unit = node.text(f"{name}_unit", "1")
    factor = node.in_si(unit, name) * (2 * np.pi if "Hz" in unit else 1.0)  # in sines
    return (node.matrix(name, default) * factor).reshape(-1, order="F").astype(object)


FORMULAS: dict[str, Rule] = dict.fromkeys(table("formulas"), _formula)
MATLAB: dict[str, Rule] = {
    **FORMULAS,
    "S-Function": _matlab_function,
    **dict.fromkeys(("Fcn", "MATLABFcn"), _expression),
}
