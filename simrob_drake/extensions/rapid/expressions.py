"""The data and the expressions of RAPID: what they are at any time, and where data are kept."""

import operator
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from simrob_drake.base.errors import SimrobError, nearest
from simrob_drake.base.messages import message
from simrob_drake.extensions.rapid.syntax import (
    Datum,
    LineRemark,
    Module,
    Node,
    RapidError,
    Routine,
    Scope,
    declared,
    expression,
)
from simrob_drake.extensions.rapid.values import (
    LeftOut,
    NoData,
    RecordValue,
    SignalName,
    Value,
    WrongType,
    orient_faults,
    shape,
)

_LONGEST = 1000  # letters of a string
_OPERATORS: Mapping[str, Callable[[float, float], float]] = {
    "<": operator.lt,
    ">": operator.gt,
    "<=": operator.le,
    ">=": operator.ge,
    "-": operator.sub,
    "*": operator.mul,
    "/": operator.truediv,
    "div": lambda one, other: float(int(one / other)),
    "mod": lambda one, other: one - other * float(int(one / other)),
}
_LOGIC: Mapping[str, Callable[[Any, Any], bool]] = {
    "and": operator.and_,
    "or": operator.or_,
    "xor": operator.xor,
}


@dataclass(frozen=True)
class Location:
    """Where a value is kept that can be assigned to: data, a component or an element."""

    kind: str
    dimensions: int
    get: Callable[[], Value]
    set: Callable[[Value], None]


@dataclass(frozen=True)
class Call:
    """A call with its arguments, those in order and the optional ones by name in lower case, switches as None."""

    task: "Expressions"
    name: str
    node: Node
    arguments: tuple[Node, ...]
    options: dict[str, Node | None]

    @property
    def count(self) -> int:
        """How many arguments are given in order."""
        return len(self.arguments)

    def argument(self, index: int) -> Node:
        """Return an argument as it is written; raises WrongType: so many are not given."""
        if index >= len(self.arguments):
            raise WrongType(
                message(
                    "rapid.count_of_arguments",
                    "{name} with {count} arguments, of which {needed} or more are needed,",
                    name=self.name,
                    count=self.count,
                    needed=index + 1,
                )
            )
        return self.arguments[index]

    def value(self, index: int, kind: str = "") -> Any:
        """Evaluate an argument. If a type is named, report the quaternions in the value whose norm is not 1.

        Args:
            index: index of the argument.
            kind: name of the type that the value must have. If it is empty, a value of any type is returned, without a
                report.

        Raises:
            WrongType: the argument is missing, or has another type.
        """
        node = self.argument(index)
        return self._typed_value(node, kind) if kind else self.task.value(node)

    def _typed_value(self, node: Node, kind: str) -> Any:
        """Evaluate an expression as a value of a type, and report the quaternions in it whose norm is not 1."""
        value = self.task.typed(node, kind)
        name = str(node.children[0]) if node.data == "name" else ""
        for fault in orient_faults(value, name):
            self.remark(fault.text, lost=fault.is_wrong)
        return value

    def has(self, *names: str) -> bool:
        """Tell whether an option is given."""
        return any(name in self.options for name in names)

    def option(self, name: str, kind: str, otherwise: Any = None) -> Any:
        """Evaluate an option as a value of a type, and report the quaternions in it whose norm is not 1.

        Args:
            name: name of the option.
            kind: name of the type that the value must have.
            otherwise: value to return if the option is not given.
        """
        node = self.options.get(name)
        return otherwise if node is None else self._typed_value(node, kind)

    def known(self, value: Callable[[], Any], otherwise: str) -> Any:
        """Return a value, or predefined data, which is told, where no module declares what it names."""
        try:
            return value()
        except LeftOut as problem:
            self.remark(
                message(
                    "rapid.otherwise",
                    "{problem}; {otherwise} in its place",
                    problem=problem,
                    otherwise=otherwise,
                )
            )
            return self.task.value(_named(otherwise))

    def place(self, index: int) -> Location:
        """Return the place that an argument names."""
        return self.task.place(self.argument(index))

    def signal(self, index: int = 0) -> str:
        """Return the name of the signal that an argument is."""
        return self.task.signal(self.argument(index)).name

    def has_parameter(self, index: int) -> bool:
        """Tell whether an argument names an optional parameter that was given."""
        try:
            self.place(index)
        except WrongType:
            return False
        return True

    def remark(self, text: str, *, lost: bool = True) -> None:
        """Tell something about its line."""
        self.task.remark(self.node, text, lost=lost)


class Expressions:
    """Works out the expressions of a program.

    Attributes:
        remarks: what its user should know, so far.
        types: of the program.
    """

    def __init__(
        self,
        modules: Iterable[Module],
        functions: Mapping[str, Callable[[Call], Value]],
        signal: Callable[[str], float | None],
    ) -> None:
        """Read what modules declare; functions are by name in lower case, ``signal`` gives a signal's value."""
        self._functions, self._signal = functions, signal
        self.remarks: list[LineRemark] = []
        self._locals: dict[str, Datum] = {}
        self.types, self._scope, self._faults = declared(modules, self._datum)

    def remark(self, node: Node, text: str, *, lost: bool = True) -> None:
        """Tell something about a line, once."""
        remark = LineRemark(self._scope.file, _line(node), text, lost)
        if remark not in self.remarks:
            self.remarks.append(remark)

    def read(self, text: str) -> Value:
        """Return the value that a text writes; raises WrongType: it is none."""
        try:
            return self.value(expression(text))
        except RapidError as problem:
            raise WrongType(str(problem)) from problem

    def where(self, node: Node) -> str:
        """Return the file and the line of something."""
        return message(
            "rapid.at_line", "{file}: line {line}", file=self._scope.file, line=_line(node)
        )

    def place(self, node: Node) -> Location:
        """Return the place that an expression names.

        What is assigned to a value that is kept nowhere is lost. Raises WrongType: there is no such data, component or
        element.
        """
        if node.data == "name":
            found = self._find(node.children[0])
            if not isinstance(found, Datum):
                raise NoData(
                    message(
                        "rapid.no_data",
                        "there is no data '{name}'{hint}",
                        name=node.children[0],
                        hint=self._hint(node.children[0]),
                    )
                )
            return Location(
                found.kind,
                found.dimensions,
                lambda: found.value,
                lambda value: setattr(found, "held", value),
            )
        if node.data == "component_of":
            return self._component(self.place(node.children[0]), str(node.children[1]).lower())
        if node.data == "element":
            place = self.place(node.children[0])
            for index in node.children[1:]:
                place = self._element(place, self.typed(index, "num"))
            return place
        value = self.value(node)
        return Location(
            value.kind if isinstance(value, RecordValue) else "", 0, lambda: value, lambda _: None
        )

    def _component(self, base: Location, name: str) -> Location:
        kinds = {
            part: kind for kind, part in self.types.records.get(self.types.plain(base.kind), ())
        }
        record = base.get()
        if not isinstance(record, RecordValue) or name not in kinds:
            raise WrongType(
                message(
                    "rapid.no_component",
                    "a {kind} has no component '{name}'{suggestion}",
                    kind=base.kind,
                    name=name,
                    suggestion=nearest(name, kinds),
                )
            )
        parts = record.parts
        return Location(
            kinds[name], 0, lambda: parts[name], lambda value: parts.__setitem__(name, value)
        )

    @staticmethod
    def _element(base: Location, number: float) -> Location:
        rows, row = base.get(), int(number) - 1
        if not isinstance(rows, list):
            raise WrongType(
                message("rapid.no_elements", "{shape} has no elements", shape=shape(rows))
            )
        if not 0 <= row < len(rows):
            raise WrongType(
                message(
                    "rapid.no_element",
                    "there is no element {number} of {count}",
                    number=int(number),
                    count=len(rows),
                )
            )
        return Location(
            base.kind,
            base.dimensions - 1,
            lambda: rows[row],
            lambda value: rows.__setitem__(row, value),
        )

    def _datum(self, scope: Scope, declaration: tuple[Node, Node]) -> tuple[str, Datum]:
        parts, (name, sizes, first) = declaration[0], declaration[1].children
        kind, constant = str(parts[2]).lower(), parts[1].lower() == "const"

        def value() -> Value:
            with (
                self._in(scope, self._locals if scope is self._scope else {}),
                self._naming_line(parts[2]),
            ):
                counts = [int(self.typed(size, "num")) for size in sizes.children] if sizes else []
                if first is None:
                    return self.types.default(kind, counts)
                return self.types.fitted(kind, self.value(first), len(counts))

        dimensions = len(sizes.children) if sizes else 0
        return str(name), Datum(kind, dimensions, value, constant=constant)

    def _find(self, name: str) -> Any:
        return self._locals.get(name.lower()) or self._scope.find(name)

    def _hint(self, name: str, more: Iterable[str] | None = None) -> str:
        """Return the name that was perhaps meant: of data, or of a routine or ``more``."""
        own = {**self._scope.shared, **self._scope.own, **self._locals}.items()
        kind = Datum if more is None else Routine
        text = nearest(
            str(name).lower(),
            [*(key for key, held in own if isinstance(held, kind)), *(more or ())],
        )
        return text if "did you mean" in text else ""

    def value(self, node: Node) -> Value:
        """Evaluate an expression of any kind: by its function in _VALUES, or by a method ``_value_<kind>``."""
        if node.data in ("component_of", "element"):
            return self.place(node).get()
        if node.data in _VALUES:
            return _VALUES[node.data](self, *node.children)
        result: Value = getattr(self, f"_value_{node.data}")(*node.children)
        return result

    def typed(self, node: Node, kind: str) -> Any:
        """Return what an expression is, as a value of a type."""
        return self.types.fitted(kind, self.value(node))

    def signal(self, node: Node) -> SignalName:
        """Find the signal that an expression names.

        The expression is the name of data of a signal's type, which stands for a signal. A name that no module declares
        is that of a signal of the robot's controller.

        Raises:
            WrongType: the expression names something else.
        """
        declared_name = self._find(node.children[0]) if node.data == "name" else None
        if node.data == "name" and declared_name is None:
            return SignalName(str(node.children[0]))
        value = declared_name.value if isinstance(declared_name, Datum) else self.value(node)
        if not isinstance(value, SignalName):
            raise WrongType(
                message(
                    "rapid.signal_asked_for",
                    "{shape} where a signal is asked for",
                    shape=shape(value),
                )
            )
        return value

    def _value_name(self, name: str) -> Value:
        """Evaluate a name: TRUE or FALSE, data that a module declares, or a signal of the robot's controller.

        The value of a signal is its level.

        Raises:
            NoData: the name is that of something else, such as a routine, or of nothing known.
        """
        if name.lower() in ("true", "false"):
            return name.lower() == "true"
        signal = name
        declared_name = self._find(name)
        if isinstance(declared_name, Datum):
            value: Value = declared_name.value
            if not isinstance(value, SignalName):
                return value
            signal = value.name
        level = self._signal(signal)
        is_no_data = declared_name is not None and not isinstance(declared_name, Datum)
        if is_no_data or level is None:
            raise NoData(
                message(
                    "rapid.no_data",
                    "there is no data '{name}'{hint}",
                    name=name,
                    hint=self._hint(name),
                )
            )
        return level

    def _value_binary(self, one: Node, sign: str, other: Node) -> Value:
        key = sign.lower()
        if key in _LOGIC:
            return _LOGIC[key](self.typed(one, "bool"), self.typed(other, "bool"))
        return self._applied(key, self.value(one), self.value(other))

    def _applied(self, key: str, one: Value, other: Value) -> Value:
        """Return what an operator gives of two values; an aggregate beside a record is one of its type."""
        if isinstance(one, RecordValue) and isinstance(other, list):
            other = self.types.fitted(one.kind, other)
        elif isinstance(other, RecordValue) and isinstance(one, list):
            one = self.types.fitted(other.kind, one)
        if key in ("=", "<>"):
            if shape(one) != shape(other):
                raise WrongType(
                    message(
                        "rapid.compared_with",
                        "{shape} compared with {other}",
                        shape=shape(one),
                        other=shape(other),
                    )
                )
            return (one == other) == (key == "=")
        if key == "+" and isinstance(one, str) and isinstance(other, str):
            if len(one + other) > _LONGEST:
                raise WrongType(
                    message(
                        "rapid.string_too_long",
                        "a string of more than {longest} letters",
                        longest=_LONGEST,
                    )
                )
            return one + other
        if isinstance(one, float) and isinstance(other, float):
            return one + other if key == "+" else _OPERATORS[key](one, other)
        return self._of_positions(key, one, other)

    def _of_positions(self, key: str, one: Value, other: Value) -> Value:
        first, second = _three(one), _three(other)
        if first and second and key in ("+", "-"):
            sign = 1 if key == "+" else -1
            return self._pos(a + sign * b for a, b in zip(first, second, strict=True))
        if first and second and key == "*":
            (a, b, c), (x, y, z) = first, second
            return self._pos((b * z - c * y, c * x - a * z, a * y - b * x))
        if first and isinstance(other, float) and key in ("*", "/"):
            return self._pos(_OPERATORS[key](value, other) for value in first)
        if second and isinstance(one, float) and key == "*":
            return self._pos(one * value for value in second)
        raise WrongType(
            message(
                "rapid.operands",
                "{shape} {operator} {other}",
                shape=shape(one),
                operator=key,
                other=shape(other),
            )
        )

    @staticmethod
    def _pos(values: Iterable[float]) -> RecordValue:
        return RecordValue("pos", dict(zip("xyz", values, strict=True)))

    def _value_function_call(self, name: str, arguments: Node | None) -> Value:
        found, call = self._find(name), self._call_of(name, name, arguments)
        if isinstance(found, Routine) and found.gives:
            result: Value = self._called(found, call)
            return result
        if name.lower() not in self._functions:
            raise LeftOut(
                message(
                    "rapid.no_function",
                    "there is no function '{name}'{hint}",
                    name=name,
                    hint=self._hint(name, self._functions),
                )
            )
        return self._functions[name.lower()](call)

    def _call_of(self, name: str, node: Node, arguments: Node | None) -> Call:
        parts = [part for part in (arguments.children if arguments else ()) if part is not None]
        options: dict[str, Node | None] = {}
        for part in (part for part in parts if part.data == "option"):
            _, key, value = part.children
            if value is None or hasattr(value, "data"):
                options[key.lower()] = value
            elif (
                str(value).lower() in self._locals
            ):  # \Key?parameter, which is given on if it was given
                options[key.lower()] = _named(value)
        return Call(
            self, str(name), node, tuple(part for part in parts if part.data != "option"), options
        )

    def _called(self, routine: Routine, call: Call) -> Any:
        raise NotImplementedError

    @contextmanager
    def _in(self, scope: Scope, names: dict[str, Datum]) -> Iterator[None]:
        before = self._scope, self._locals
        self._scope, self._locals = scope, names
        try:
            yield
        finally:
            self._scope, self._locals = before

    @contextmanager
    def _naming_line(self, node: Node) -> Iterator[None]:
        try:
            yield
        except (RapidError, LeftOut):
            raise
        except (WrongType, SimrobError) as problem:
            raise RapidError(self.where(node), str(problem)) from problem
        except RecursionError as problem:
            raise RapidError(
                self.where(node), message("rapid.nested_too_deeply", "is nested too deeply")
            ) from problem
        except ZeroDivisionError as problem:
            raise RapidError(
                self.where(node), message("rapid.division_by_zero", "division by zero")
            ) from problem
        except (ArithmeticError, ValueError, TypeError, LookupError) as problem:
            raise RapidError(
                self.where(node),
                message(
                    "rapid.cannot_be_worked_out", "cannot be worked out: {problem}", problem=problem
                ),
            ) from problem


_VALUES: Mapping[str, Callable[..., Value]] = {
    "number": lambda task, text: (
        float(int(text, 0)) if text[:2].lower() in ("0x", "0b") else float(text)
    ),
    "string": lambda task, text: text[1:-1].replace('""', '"'),
    "aggregate": lambda task, *parts: [task.value(part) for part in parts if part is not None],
    "signed": lambda task, sign, node: (
        task.value(node) if sign == "+" else task._applied("*", -1.0, task.value(node))
    ),
    "negation": lambda task, node: not task.typed(node, "bool"),
    "and_not": lambda task, one, _, other: bool(
        task.typed(one, "bool") and not task.typed(other, "bool")
    ),
}
"""What simple expressions are, by their names in the grammar."""


def _three(value: Value) -> list[Any]:
    """Return the numbers of a ``pos``, or of an aggregate of three; nothing of anything else."""
    row = value.flat() if isinstance(value, RecordValue) else value
    return row if isinstance(row, list) and [*map(type, row)] == [float] * 3 else []


def _named(token: str) -> Node:
    from lark import Tree

    return Tree("name", [token])


def _line(node: Node) -> int:
    return int(node.line if hasattr(node, "line") else getattr(node.meta, "line", 1))
