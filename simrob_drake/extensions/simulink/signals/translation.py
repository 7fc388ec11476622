"""MATLAB code over signals: what it computes becomes blocks of a signal flow, where it is plain arithmetic."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial, reduce
from typing import Any, Self

import numpy as np

from simrob_drake.base.messages import compound, message
from simrob_drake.extensions.simulink.signals.arithmetic import (
    MATH,
    OPERATORS,
    applied,
    chosen,
    compared,
    inverse,
    joined,
    looked_up,
    whole,
)
from simrob_drake.extensions.simulink.signals.forms import (
    Form,
    Primitive,
    Signal,
    Value,
    computed,
    flat,
    mapped,
    signal,
)
from simrob_drake.extensions.simulink.values.code import CodeRun
from simrob_drake.extensions.simulink.values.elementary import INTEGERS
from simrob_drake.extensions.simulink.values.evaluate import NUMBERS, Algebra, count, matrix
from simrob_drake.extensions.simulink.values.syntax import (
    Expression,
    NotUnderstood,
    Statement,
    lines_of,
)
from simrob_drake.parts.controllers.flow_blocks import FUNCTIONS

_ENDED = "return"  # where it is kept whether a function has returned
_MOST_ROUNDS = 20  # of a loop that signals decide
_PARTIAL = ("sqrt", "log", "asin", "acos", "pow")  # functions that are not there for every number


class Complex(Form):
    """A complex number of signals; what is computed with it must become real again."""

    def __init__(self, real: Value, imag: Value = 0.0) -> None:
        super().__init__({})
        self.real, self.imag = real, imag

    def __add__(self, other: Value) -> Value:
        other = other if isinstance(other, Complex) else Complex(other)
        return Complex(self.real + other.real, self.imag + other.imag)

    def __neg__(self) -> Value:
        return Complex(-self.real, -self.imag)

    def __mul__(self, other: Value) -> Value:
        other = other if isinstance(other, Complex) else Complex(other)
        real, imag = (
            self.real * other.real - self.imag * other.imag,
            self.real * other.imag + self.imag * other.real,
        )
        return Complex(real, imag)

    def __truediv__(self, other: Value) -> Value:
        return (
            other.__rtruediv__(self)
            if isinstance(other, Complex)
            else Complex(self.real / other, self.imag / other)
        )

    def __rtruediv__(self, other: Value) -> Value:
        return (
            other * Complex(self.real, -self.imag) / (self.real * self.real + self.imag * self.imag)
        )

    __radd__, __rmul__ = __add__, __mul__


class Translation(CodeRun):
    """One run of a function over values that only a run of the model has: what it does is what blocks compute.

    Where a condition is such a value both branches are translated, and a switch takes what each leaves. What could fail
    in the branch that is not taken gets 1 there. Persistent variables are delays by a period.
    """

    def __init__(
        self,
        *arguments: Any,
        period: float | None = None,
        own: Mapping[str, Callable[..., Value]] | None = None,
        note: Callable[[str], None] = lambda _: None,
    ) -> None:
        """Take what :class:`CodeRun` takes, the time between samples [s] if there is one, and functions of values.

        Last comes what takes a note of all that is approximated.
        """
        self._note = note
        self._guards: list[Value] = []
        self._period, self._within, self._own = period, False, own or {}
        self._kept: dict[
            str, Any
        ] = {}  # persistent variables as they are at a sample; None before they have begun
        self._last: Translation | None = None  # the run of the function that was called last
        super().__init__(*arguments)
        self._workspace = self._outside

    def algebra(self) -> Algebra:
        """Return what expressions are computed with, numbers or signals, before functions of files."""
        each: dict[str, Callable[..., Value]] = {
            "./": lambda a, b: a / self._guarded(b),
            **dict.fromkeys((".^", "power"), lambda a, b: _power(a, b, self._guarded)),
            **dict.fromkeys(("&", "&&"), partial(_both, "and")),
            **dict.fromkeys(("|", "||"), partial(_both, "or")),
            **{sign: partial(compared, flow) for sign, flow in OPERATORS.items()},
            **{
                name: partial(self._applied, name)
                for name in FUNCTIONS
                if name not in ("min", "max", "pow")
            },
            **MATH,
            **{
                f"{name}d": (lambda u, name=name: applied(name, u * (np.pi / 180)))
                for name in ("sin", "cos", "tan")
            },
            "not": lambda u: joined("not", u),
            "isnan": lambda u: 0.0,
            "real": lambda u: u.real if isinstance(u, Complex) else u,
            "imag": lambda u: u.imag if isinstance(u, Complex) else 0.0,
            "abs": lambda u: (
                MATH["hypot"](u.real, u.imag) if isinstance(u, Complex) else applied("abs", u)
            ),
            **dict.fromkeys(("double", "single", "logical", "boolean"), lambda u: u),
            **{name: partial(whole, name) for name in INTEGERS},
            **self._own,
        }
        return {
            **NUMBERS,
            **{name: _on_symbols(NUMBERS.get(name), one) for name, one in each.items()},
            **{name: partial(_extreme, name) for name in ("min", "max")},
            "norm": _norm, "inv": _inverse, "interp1": _table, "1i": lambda: signal([Complex(0.0, 1.0)]),
        }  # fmt: skip

    def _guarded(self, value: Value) -> Value:
        if not isinstance(value, Form):
            return value or (1.0 if self._guards else value)
        for guard in self._guards:
            value = chosen(guard, value, 1.0)
        return value

    def _applied(self, name: str, *values: Value) -> Value:
        return applied(name, *(map(self._guarded, values) if name in _PARTIAL else values))

    def _pass_over(self, line: Statement, problem: Exception) -> None:
        first = next(lines_of(line))[:60]
        raise (
            problem
            if isinstance(problem, NotUnderstood)
            else NotUnderstood(compound("{first}: {problem}", first=first, problem=problem))
        )

    def _at_end(self, name: str, place: tuple[int, ...]) -> list[Value]:
        return [matrix(self.variables[name])[place]]

    def _block(self, lines: list[Statement]) -> None:
        for place, line in enumerate(lines, start=1):
            self._next(line)
            ended = self.variables.get(_ENDED, 0.0)
            if ended:
                if isinstance(ended, Form):  # what follows is for those who did not return
                    self._split_by(ended, lambda: None, partial(self._go_on, lines[place:]))
                return

    def _go_on(self, lines: list[Statement]) -> None:
        self.variables[_ENDED] = 0.0
        self._block(lines)

    def _do(self, line: Statement) -> None:
        words = next(lines_of(line)).split()
        if words[0] == "return":
            self.variables[_ENDED] = 1.0
        if words[0] == "persistent":
            self._keep(words[1:])
            return
        waiting = (
            [] if self._within else [name for name, state in self._kept.items() if state is None]
        )
        before, self._within = dict(self.variables), self._within or bool(waiting)
        super()._do(line)
        if not waiting:
            return
        self._within = False
        if begun := {
            name: self.variables[name] for name in waiting if matrix(self.variables[name]).size
        }:
            self.variables.clear()
            self._kept |= {name: self._state(name, start) for name, start in begun.items()}
            self.variables.update({**before, **{name: self._kept[name] for name in begun}})
            super()._do(line)  # which began them: now as it goes on

    def _keep(self, names: list[str]) -> None:
        """Take persistent variables, which are empty until the first statement that gives them a value."""
        if self._period is None or self.depth > 1:
            why = (
                message("simulink.function_others_call", "in a function that others call")
                if self.depth > 1
                else message(
                    "simulink.though_no_sample_time", "though nothing says its sample time"
                )
            )
            raise NotUnderstood(
                message(
                    "simulink.persistent_names",
                    "persistent {names}, {why}",
                    names=" ".join(names),
                    why=why,
                )
            )
        self._kept |= dict.fromkeys(names)
        self.variables |= {name: np.zeros((0, 0)) for name in names}

    def _share(self, names: list[str]) -> None:
        """Take global variables from the workspace: none that the code changes itself."""
        for name in names:
            if name not in self.shared:
                self.shared[name] = self._workspace(name)
        super()._share(names)

    def _store(self, target: Expression, value: Any) -> None:
        if self._declared.intersection(target.parts[:1]):
            raise NotUnderstood(
                message(
                    "simulink.changes_global", "changes the global {name}", name=target.parts[0]
                )
            )
        super()._store(target, value)

    def _state(self, name: str, start: Any) -> Any:
        """Return a persistent variable as delays of what it is at the end of the function."""
        array = matrix(start)
        if any(isinstance(value, Form) for value in array.flat):
            raise NotUnderstood(
                message(
                    "simulink.persistent_first_value",
                    "persistent {name}, whose first value depends on signals",
                    name=name,
                )
            )
        made = np.empty(array.shape, dtype=object)
        for place, value in np.ndenumerate(array):
            parameters = {"period": self._period, "initial": float(value)}
            made[place] = Primitive(
                "delay", parameters, partial(self._at_end, name, place)
            ).outputs[0]
        return made

    def _took_file(self, text: str) -> bool:
        return False

    def _inner(self, variables: dict[str, Any]) -> Self:
        inner = super()._inner(variables)
        inner._guards, inner._period, self._last = self._guards, self._period, inner
        inner._workspace, inner._note = self._workspace, self._note
        return inner

    def called(self, name: str, arguments: list[Any]) -> list[Any]:
        """Return the outputs of a function; errors as of expressions, where one is not known, too."""
        found = super().called(name, arguments)
        for output, value in zip(self.functions[name].outputs, found, strict=True):
            if value is None:
                raise NotUnderstood(
                    message(
                        "simulink.gives_no_output",
                        "{name} gives no {output}",
                        name=name,
                        output=output,
                    )
                )
        if (inner := self._last) is None or not inner._kept:
            return found
        for kept, state in inner._kept.items():
            if state is not None and matrix(inner.variables[kept]).shape != state.shape:
                raise NotUnderstood(
                    message(
                        "simulink.persistent_size",
                        "persistent {kept}, whose size changes",
                        kept=kept,
                    )
                )
        return [self._held(value) for value in found]

    def _held(self, value: Any) -> Any:
        """Return an output of what is sampled."""
        hold = partial(computed, "hold", period=self._period)
        return mapped(
            lambda one: hold(one) if isinstance(one, Form) else one, matrix(value).astype(object)
        )

    def _condition(self, text: str) -> Value:
        condition: Value = 1.0
        for one in flat(np.asarray(matrix(self.value(text)), dtype=object)):
            condition = _both("and", condition, one)
        return condition

    def _loop(
        self, keyword: str, line: str, body: list[Statement], left: int = _MOST_ROUNDS
    ) -> None:
        """Run a loop; of one whose end signals decide all rounds are translated, one in the other."""
        if keyword == "for":
            super()._loop(keyword, line, body)
            return
        while (condition := self._condition(line.removeprefix("while"))) and not isinstance(
            condition, Form
        ):
            self._block(body)
            self._count()
        if isinstance(condition, Form) and not left:
            self._note(
                message(
                    "simulink.loops_end",
                    "its loops by signals end after {rounds} rounds at the latest",
                    rounds=_MOST_ROUNDS,
                )
            )
        elif isinstance(condition, Form):

            def further() -> None:
                self._block(body)
                self._loop(keyword, line, body, left - 1)

            self._split_by(condition, further, lambda: None)

    def _split_by(self, condition: Value, yes: Callable[[], None], no: Callable[[], None]) -> None:
        """Run one of two ways, or by a condition of the model both, and leave what a switch takes of them."""
        if not isinstance(condition, Form):
            super()._split_by(condition, yes, no)
            return
        before, left = dict(self.variables), []
        for way, guard in ((yes, condition), (no, joined("not", condition))):
            self.variables.clear()
            self.variables.update(before)
            self._guards.append(guard)
            way()
            self._guards.pop()
            left.append(dict(self.variables))
        first, second = left
        ended = chosen(condition, *(one.get(_ENDED, 0.0) for one in left))
        for name in (first.keys() & second.keys()) - {_ENDED}:
            if first[name] is not second[name]:
                self.variables[name] = _merged(condition, first[name], second[name])
        self.variables.update({name: value for name, value in (*first.items(), *second.items())
                               if name not in first or name not in second})  # fmt: skip
        self.variables[_ENDED] = ended


def as_signal(value: Any) -> Signal:
    """Return a matrix as a signal: a column is a vector."""
    array = matrix(value).astype(object)
    if any(isinstance(one, Complex) for one in array.flat):
        raise NotUnderstood(message("simulink.complex_number", "a complex number"))
    return array.reshape(-1, order="F") if array.shape[1] == 1 else array


def _both(operator: str, first: Value, second: Value) -> Value:
    for one, other in ((first, second), (second, first)):
        if not isinstance(one, Form):
            if bool(one) == (operator == "and"):
                return other if isinstance(other, Form) else float(bool(other))
            return float(operator == "or")
    return joined(operator, first, second)


def _power(base: Value, exponent: Value, guarded: Callable[[Value], Value]) -> Value:
    if isinstance(exponent, Form) or not isinstance(base, Form) or exponent not in (1, 2, 3, 4):
        return applied("pow", guarded(base), exponent)
    result: Value = base
    for _ in range(int(exponent) - 1):
        result = result * base
    return result


def _on_symbols(
    numeric: Callable[..., Any] | None, symbolic: Callable[..., Value]
) -> Callable[..., Any]:
    """Return a function of matrices: numeric where all are of numbers, if there is one, else element by element."""

    def function(*arrays: Any) -> Any:
        values = [matrix(array) for array in arrays]
        if numeric is not None and not any(
            isinstance(one, Form) for array in values for one in array.flat
        ):
            return numeric(*(array.astype(float) for array in values))
        return mapped(symbolic, *(array.astype(object) for array in values))

    return function


def _norm(array: Any, kind: Any = 2) -> Any:
    values = matrix(array)
    if values.dtype != object:
        return NUMBERS["norm"](array, kind)
    if count(kind) != 2:
        raise NotUnderstood(message("simulink.other_norm", "a norm that is not the second"))
    return matrix(
        signal(
            [applied("sqrt", sum((one * one for one in flat(values.astype(object))), start=0.0))]
        )
    )


def _inverse(array: Any) -> Any:
    values = matrix(array)
    if values.dtype != object:
        return NUMBERS["inv"](values)
    if (found := inverse(values.astype(object))) is None:
        raise NotUnderstood(
            message(
                "simulink.inverse_of_signals",
                "the inverse of {size} signals",
                size=" x ".join(map(str, values.shape)),
            )
        )
    return found


def _extreme(name: str, first: Any, second: Any = None, axis: Any = None) -> Any:
    if second is not None and matrix(second).size:
        return mapped(
            partial(applied, name), matrix(first).astype(object), matrix(second).astype(object)
        )
    values = matrix(first).astype(object)
    if axis is not None or 1 not in values.shape:
        raise NotUnderstood(message("simulink.of_a_matrix", "{name} of a matrix", name=name))
    return matrix(signal([reduce(partial(applied, name), flat(values))]))


def _table(points: Any, values: Any, at: Any, method: Any = "linear", *_: Any) -> Any:
    if matrix(points).dtype == object or matrix(values).dtype == object or method != "linear":
        raise NotUnderstood(
            message(
                "simulink.interp1_by",
                "interp1 by {method}, or of a table that changes",
                method=method,
            )
        )
    return mapped(
        lambda u: looked_up(u, matrix(points), matrix(values), clip=False),
        matrix(at).astype(object),
    )


def _merged(condition: Value, yes: Any, no: Any) -> Any:
    if isinstance(yes, str | dict) or isinstance(no, str | dict):
        raise NotUnderstood(
            message("simulink.conditional_text", "a text or structure that depends on a condition")
        )
    first, second = matrix(yes), matrix(no)
    if first.shape != second.shape:
        raise NotUnderstood(
            message("simulink.conditional_size", "a matrix whose size depends on a condition")
        )
    return mapped(partial(chosen, condition), first.astype(object), second.astype(object))
