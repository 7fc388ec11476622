"""Blocks that compute and remember nothing: gains, sums, products, functions, limits, tables, comparisons, switches."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from simrob_drake.base.messages import message
from simrob_drake.extensions.simulink.model.nodes import Node
from simrob_drake.extensions.simulink.signals.forms import (
    ONE,
    PARTS,
    Form,
    Primitive,
    Rule,
    Signal,
    Term,
    Tracer,
    Value,
    computed,
    evaluated,
    fitted,
    flat,
    mapped,
    signal,
    widened,
)
from simrob_drake.extensions.simulink.values.elementary import INTEGERS
from simrob_drake.parts.controllers.flow_blocks import FUNCTIONS

MOST_INPUTS = 1000
OPERATORS = {"<": "<", "<=": "<=", ">": ">", ">=": ">=", "==": "==", "~=": "!="}
_COMPARED = {
    "<": np.less, "<=": np.less_equal, ">": np.greater, ">=": np.greater_equal, "==": np.equal, "!=": np.not_equal,
}  # fmt: skip


def applied(name: str, *values: Value) -> Value:
    """Return a function of values: a number of numbers, else a block."""
    if any(isinstance(value, Form) for value in values):
        return computed("function", *values, function=name)
    try:
        return float(FUNCTIONS[name](*values))
    except (ArithmeticError, ValueError):
        return math.nan


def compared(operator: str, left: Value, right: Value) -> Value:
    """Return 1 where a comparison holds, else 0."""
    if not (isinstance(left, Form) or isinstance(right, Form)):
        return float(_COMPARED[operator](left, right))
    if isinstance(right, Form):
        return computed("compare", left - right, operator=operator)
    return computed(
        "compare", left, operator=operator, **({"threshold": float(right)} if right else {})
    )


def chosen(condition: Value, yes: Value, no: Value) -> Value:
    """Return one of two values, by whether a condition is not 0."""
    if not isinstance(condition, Form):
        return yes if condition else no
    return yes if yes is no else computed("switch", yes, condition, no, operator="!=")


def joined(operator: str, *values: Value) -> Value:
    """Return a logical operator's value of its inputs."""
    return computed("logic", *values, operator=operator)


def switched(
    node: Node, yes: Signal, by: Signal, no: Signal, operator: str, threshold: float = 0.0
) -> Signal:
    """Return the first signal where the second meets a threshold, else the third."""

    def pick(first: Value, test: Value, other: Value) -> Value:
        if not isinstance(test, Form):
            return first if _COMPARED[operator](test, threshold) else other
        limit = {"threshold": threshold} if threshold else {}
        return computed("switch", first, test, other, operator=operator, **limit)

    return mapped(pick, *fitted(node, yes, by, no))


def limited(value: Value, lower: float, upper: float, kind: str = "saturation") -> Value:
    """Return a value within limits, or with ``dead_zone`` what it is beyond them; infinite ones are none."""
    bounds = {"lower": lower, "upper": upper}
    return computed(
        kind, value, **{name: float(bound) for name, bound in bounds.items() if np.isfinite(bound)}
    )


def inputs_of(reader: Tracer, node: Node, default: str = "2") -> list[Signal]:
    """Return all inputs of a block whose parameter ``Inputs`` is their number, their widths or names."""
    text = node.text("Inputs", node.text("NumInputs", default)).replace("|", "").replace(" ", "")
    if text and set(text) <= set("+-*/"):
        number = len(text)
    elif "," in text and "[" not in text:  # names of signals
        number = text.count(",") + 1
    else:
        sizes = node.numbers(node.named("Inputs", "NumInputs"), default)
        number = int(sizes[0]) if sizes.size == 1 else sizes.size
    return [reader.input(node, place + 1) for place in range(min(number, MOST_INPUTS))]


def _signed(reader: Tracer, node: Node, default: str, letters: str) -> list[tuple[str, Signal]]:
    """Return the inputs of a block with their signs, which ``Inputs`` has, or else their number."""
    text = node.text("Inputs", default).replace("|", "").replace(" ", "")
    signs = letters[0] * min(int(text), MOST_INPUTS) if text.isdecimal() else text
    if not signs or any(sign not in letters for sign in signs):
        raise node.refusal(
            message(
                "simulink.odd_inputs",
                "Inputs is '{text}'; it must be a number or signs such as {letters}",
                text=text,
                letters=letters,
            )
        )
    return [(sign, reader.input(node, place)) for place, sign in enumerate(signs, start=1)]


def _gain(reader: Tracer, node: Node, _: int) -> Signal:
    gain, values = node.matrix(node.named("Gain", "gain"), "1"), reader.input(node)
    if gain.size == 1:
        return np.asarray(float(gain[0, 0]) * values)
    mode = node.text("Multiplication", "Element-wise(K.*u)")
    if mode.startswith("Element-wise"):
        if values.size not in (1, gain.size):
            raise node.refusal(
                message(
                    "simulink.gain_size",
                    "Gain has {count} numbers for a signal of {size}",
                    count=gain.size,
                    size=values.size,
                )
            )
        factors = gain.reshape(-1, order="F") if 1 in gain.shape and values.ndim == 1 else gain
        return np.asarray(np.multiply(*fitted(node, factors.astype(object), values)))
    if mode.startswith("Matrix(u*K)"):
        return _times(
            node, values.reshape(1, -1) if values.ndim == 1 else values, gain.astype(object)
        ).reshape(-1)
    return _times(node, gain.astype(object), values)


def _times(node: Node, left: Signal, right: Signal) -> Signal:
    """Return a product of matrices, of which a vector is a column."""
    rows = left.reshape(-1, 1) if left.ndim == 1 else left
    if rows.shape[1] != 1:
        right = widened(right, rows.shape[1])
    if 1 in (left.size, right.size):
        return np.asarray(left * right)
    if len(right) != rows.shape[1] == right.size:
        right = right.reshape(-1, 1)
    if len(right) != rows.shape[1]:
        raise node.refusal(
            message(
                "simulink.gain_shape",
                "Gain is {shape} for a signal of {size}",
                shape=" × ".join(map(str, rows.shape)),
                size=right.size,
            )
        )
    return np.asarray(rows.dot(right), dtype=object)


def _sum(reader: Tracer, node: Node, _: int) -> Signal:
    total = [
        (1.0 if sign == "+" else -1.0) * one for sign, one in _signed(reader, node, "++", "+-")
    ]
    if len(total) == 1:
        return signal([sum(flat(total[0]), start=0.0)])
    return mapped(lambda *values: sum(values[1:], start=values[0]), *fitted(node, *total))


def _product(reader: Tracer, node: Node, _: int) -> Signal | None:
    signs, signals = zip(*_signed(reader, node, "2", "*/"), strict=True)
    if node.text("Multiplication", "Element-wise(.*)").startswith("Matrix"):
        product, *factors = [
            one if sign == "*" else inverse(one) for sign, one in zip(signs, signals, strict=True)
        ]
        for other in factors:
            if product is None or other is None:
                return None
            product = _times(node, product, other)
        return product
    if len(signals) == 1:
        signals, signs = (
            tuple(signal([value]) for value in flat(signals[0])),
            signs * signals[0].size,
        )

    def product_of(*values: Value) -> Value:
        constant, rest = 1.0, []
        for sign, value in zip(signs, values, strict=True):
            if isinstance(value, Form) or (sign == "/" and not value):
                rest.append((sign, value))
            else:
                constant = constant * value if sign == "*" else constant / value
        if [sign for sign, _ in rest] in ([], ["*"]):
            return constant * rest[0][1] if rest else constant
        divides = [place for place, (sign, _) in enumerate(rest) if sign == "/"]
        made = computed(
            "product", *(value for _, value in rest), **({"divides": divides} if divides else {})
        )
        return constant * made

    return mapped(product_of, *fitted(node, *signals))


def inverse(values: Signal) -> Signal | None:
    """Return the inverse of a matrix of at most 3 × 3, of a rotation its transpose; None of others."""
    if values.size == 1:
        return None if values.ravel()[0] == 0 else mapped(lambda one: 1.0 / one, values)
    size = values.shape[0]
    if values.shape != (size, size) or size > 3:
        return None
    if _turns(values):
        return values.T

    def cofactor(row: int, column: int) -> Value:
        rest = np.delete(np.delete(values, row, 0), column, 1)
        minor: Value = (
            rest[0, 0] if size == 2 else rest[0, 0] * rest[1, 1] - rest[0, 1] * rest[1, 0]
        )
        return minor if (row + column) % 2 == 0 else -minor

    cofactors = np.array([[cofactor(i, j) for j in range(size)] for i in range(size)], dtype=object)
    determinant = sum(values[0, j] * cofactors[0, j] for j in range(size))
    return None if determinant == 0 else mapped(lambda one: one / determinant, cofactors.T)


def _turns(values: Signal) -> bool:
    """Tell whether a matrix is a rotation whatever its signals are, by trying it with random ones."""
    rng = np.random.default_rng(0)
    for _ in range(2):
        known: dict[Term, float] = {}

        def leaf(term: Term, known: dict[Term, float] = known) -> float | None:
            if isinstance(term.of, Primitive):  # blocks that remember, or choose, may give anything
                return None if term.of.kind in ("product", "function") else float(rng.normal())
            attitude = [
                Term("sensed", term.of, PARTS.index(part)) for part in ("qw", "qx", "qy", "qz")
            ]
            turn = rng.normal(size=4)
            known.update(zip(attitude, turn / np.linalg.norm(turn), strict=True))
            return known.get(term, 1.0 if term == ONE else float(rng.normal()))

        try:
            tried = np.array([[evaluated(one, leaf, known) for one in row] for row in values])
        except (ArithmeticError, ValueError):  # such as the root of what is negative
            return False
        if not np.allclose(tried @ tried.T, np.eye(len(tried)), atol=1e-9):  # nor does nan
            return False
    return True


def _truncated(value: Value) -> Value:
    return applied("sign", value) * applied("floor", applied("abs", value))


MATH: dict[str, Callable[..., Value]] = {
    "hypot": lambda u, v: applied("sqrt", u * u + v * v),
    "mod": lambda u, v: u - v * applied("floor", u / v),
    "rem": lambda u, v: u - v * _truncated(u / v),
    "round": lambda u: applied("sign", u) * applied("floor", applied("abs", u) + 0.5),
    "fix": _truncated,
}
"""Functions of MATLAB that are not those of a flow's blocks."""


def whole(name: str, value: Value, rounded: Callable[[Value], Value] = MATH["round"]) -> Value:
    """Return a value as a whole number of a type, such as ``int8``."""
    return limited(rounded(value), *INTEGERS[name])


_ROUNDED: dict[str, Callable[[Value], Value]] = {
    "Ceiling": partial(applied, "ceil"),
    "Zero": _truncated,
    **dict.fromkeys(("Nearest", "Round"), MATH["round"]),
}


def _converted(node: Node) -> Callable[[Value], Value]:
    """Return what a Data Type Conversion makes of a value: of a fraction or a truth, where its type has no others."""
    name = node.text("OutDataTypeStr", node.text("DataType"))
    if name == "boolean":
        return lambda u: compared("!=", u, 0.0)
    rounded = _ROUNDED.get(node.text("RndMeth"), partial(applied, "floor"))
    return partial(whole, name, rounded=rounded) if name in INTEGERS else lambda u: u


def _extreme(reader: Tracer, node: Node, _: int) -> Signal:
    signals = inputs_of(reader, node, "1")
    found, *others = (
        [signal([value]) for value in flat(signals[0])]
        if len(signals) == 1
        else fitted(node, *signals)
    )
    for other in others:
        found = mapped(
            partial(applied, (node.text("Operator", node.text("Function")) or "min").lower()),
            found,
            other,
        )
    return found


def looked_up(value: Value, points: Any, values: Any, *, clip: bool) -> Value:
    """Return what a table, whose points rise, holds at a value; beyond its ends what they are, or go on to be."""
    x, y = (np.asarray(column, dtype=float).reshape(-1).tolist() for column in (points, values))
    if clip and not isinstance(value, Form):
        return float(np.interp(value, x, y))
    return computed("lookup", value, points=x, values=y, **({"clip": True} if clip else {}))


def _lookup(reader: Tracer, node: Node, _: int) -> Signal | None:
    if node.text("NumberOfTableDimensions", "1") != "1":
        return None
    heights = node.numbers(node.named("Table", "OutputValues"), "tanh([-5:5])")
    clip = "Clip" in node.text("ExtrapMethod") or "Use End Values" in node.text("LookUpMeth")
    if node.text("BreakpointsSpecification", "Explicit values") == "Explicit values":
        places = node.numbers(node.named("BreakpointsForDimension1", "InputValues"), "[-5:5]")
    else:
        first, step = (
            node.number(f"BreakpointsForDimension1{what}", "1")
            for what in ("FirstPoint", "Spacing")
        )
        places = np.asarray(first + step * np.arange(heights.size))
    return mapped(lambda value: looked_up(value, places, heights, clip=clip), reader.input(node))


def _indexed(reader: Tracer, node: Node, _: int) -> Signal | None:
    """Return the element of a table whose index, from 0, is the input, without its fraction and within the table."""
    element = node.text("InputsSelectThisObjectFromTable", "Element") == "Element"
    if (
        node.text("NumberOfTableDimensions", "2") != "1"
        or not element
        or node.is_on("TableIsInput")
    ):
        return None
    heights = node.numbers("Table", "[4 5 6;16 19 20;10 18 23]")
    places = np.arange(heights.size)
    return mapped(
        lambda value: looked_up(_truncated(value), places, heights, clip=True), reader.input(node)
    )


def _logic(reader: Tracer, node: Node, _: int) -> Signal | None:
    operator = node.text("Operator", "AND").lower()
    if operator not in ("and", "or", "nand", "nor", "xor", "not"):
        return None  # such as NXOR
    if operator == "not":
        return mapped(lambda value: joined("not", value), reader.input(node))
    signals = inputs_of(reader, node)
    if len(signals) == 1:
        return signal([joined(operator, *flat(signals[0]))])
    return mapped(lambda *values: joined(operator, *values), *fitted(node, *signals))


def _switch(reader: Tracer, node: Node, _: int) -> Signal:
    criteria = node.text("Criteria", "u2 >= Threshold")
    operator = OPERATORS[next((sign for sign in (">=", ">", "~=") if sign in criteria), ">=")]
    threshold = 0.0 if operator == "!=" else node.number("Threshold", "0")
    yes, by, no = (reader.input(node, place) for place in (1, 2, 3))
    return switched(node, yes, by, no, operator, threshold)


ARITHMETIC: dict[str, Rule] = {
    **dict.fromkeys(("Gain", "Slider Gain"), _gain),
    "DataTypeConversion": lambda reader, node, _: mapped(_converted(node), reader.input(node)),
    "Sum": _sum,
    "Product": _product,
    "MinMax": _extreme,
    **dict.fromkeys(("Lookup_n-D", "Lookup"), _lookup),
    "LookupNDDirect": _indexed,
    "Logic": _logic,
    "Switch": _switch,
}
