"""RAPID, done statement by statement: data, arithmetic, loops and routines; what moves is left to instructions."""

from __future__ import annotations

import operator
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any

from simrob_drake.errors import SimrobError, nearest
from simrob_drake.rapid.calls import Call, Place
from simrob_drake.rapid.declarations import Datum, Parameter, Routine, Scope, declared
from simrob_drake.rapid.functions import FUNCTIONS
from simrob_drake.rapid.syntax import Module, Node, RapidError, Remark
from simrob_drake.rapid.values import Record, Signal, Value, WrongType, shape

_DEEPEST = 40  # routines that wait for each other
_MOST_STATEMENTS = 1_000_000
_OPERATORS: Mapping[str, Callable[[Any, Any], Any]] = {
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
_LOGIC: Mapping[str, Callable[[Any, Any], Any]] = {"and": operator.and_, "or": operator.or_, "xor": operator.xor}


class Ended(Exception):
    """The program ends itself."""


class _Returned(Exception):
    """A routine ends, and gives a value if it is a function."""


class _Jump(Exception):
    """A statement GOTO."""


class Interpreter:
    """Does a program.

    Attributes:
        remarks: what its user should know, so far.
    """

    def __init__(
        self,
        modules: Iterable[Module],
        instructions: Mapping[str, Callable[[Call], None]],
        functions: Mapping[str, Callable[[Call], Value]],
        signal: Callable[[str], float | None],
        cycles: int,
    ) -> None:
        """Read what the modules declare.

        Args:
            modules: of the program.
            instructions: what each does, by name in lower case.
            functions: likewise, those that depend on more than their arguments.
            signal: gives the value of a signal, or None if there is no such.
            cycles: how often a loop WHILE TRUE is done.
        """
        self._instructions = {**instructions, "goto": self._goto, "exit": self._end, "exitcycle": self._end}
        self._functions, self._signal, self._cycles = {**FUNCTIONS, **functions}, signal, cycles
        found = declared(modules, self._datum)
        self.remarks: list[Remark] = []
        self.types, self._shared, self._faults = found.types, found.shared, found.faults
        self._scope, self._locals, self._depth, self._done = found.scopes[-1], dict[str, Datum](), 0, 0

    def run(self, main: str = "main") -> None:
        """Do a procedure of the program.

        Raises:
            RapidError: something that cannot be; names the file and the line.
        """
        self.remarks += self._faults
        routine = self._scope.find(main)
        if not isinstance(routine, Routine):
            raise RapidError(self._scope.file, f"there is no PROC {main}")
        try:
            self._run(routine, [])
        except Ended:
            return

    def remark(self, node: Node, text: str, *, lost: bool = True) -> None:
        """Tell something about a line, once."""
        remark = Remark(self._scope.file, _line(node), text, lost)
        if remark not in self.remarks:
            self.remarks.append(remark)

    def where(self, node: Node) -> str:
        """Return the file and the line of something."""
        return f"{self._scope.file}: line {_line(node)}"

    # ---- data

    def place(self, node: Node) -> Place:
        """Return the place that an expression names.

        Raises:
            WrongType: it names none.
        """
        if node.data == "name":
            found = self._find(node.children[0])
            if not isinstance(found, Datum):
                raise WrongType(f"there is no data '{node.children[0]}'{self._hint(node.children[0])}")
            return Place(found.kind, found.dimensions, lambda: found.value, lambda value: setattr(found, "held", value))
        if node.data == "component_of":
            return self._component(self.place(node.children[0]), str(node.children[1]).lower())
        if node.data == "element":
            place = self.place(node.children[0])
            for index in node.children[1:]:
                place = self._element(place, self.typed(index, "num"))
            return place
        raise WrongType("a value where the name of data is asked for")

    def _component(self, base: Place, name: str) -> Place:
        kinds = {part: kind for kind, part in self.types.records.get(self.types.plain(base.kind), ())}
        record = base.get()
        if not isinstance(record, Record) or name not in kinds:
            raise WrongType(f"a {base.kind} has no component '{name}'{nearest(name, kinds)}")
        parts = record.parts
        return Place(kinds[name], 0, lambda: parts[name], lambda value: parts.__setitem__(name, value))

    @staticmethod
    def _element(base: Place, number: float) -> Place:
        rows, row = base.get(), int(number) - 1
        if not isinstance(rows, list):
            raise WrongType(f"{shape(rows)} has no elements")
        if not 0 <= row < len(rows):
            raise WrongType(f"there is no element {int(number)} of {len(rows)}")
        return Place(
            base.kind, base.dimensions - 1, lambda: rows[row], lambda value: rows.__setitem__(row, value)
        )

    def _datum(self, scope: Scope, declaration: tuple[Node, Node]) -> tuple[str, Datum]:
        """Return the name and the data of an item of a declaration."""
        node, (name, sizes, first) = declaration[0], declaration[1].children
        kind, constant = str(node.children[2]).lower(), node.children[1].lower() == "const"

        def value() -> Value:
            with self._in(scope, self._locals if scope is self._scope else {}), self._telling(node):
                counts = [int(self.typed(size, "num")) for size in sizes.children] if sizes else []
                if first is None:
                    return self.types.default(kind, counts)
                return self.types.fitted(kind, self.value(first), len(counts))

        dimensions = len(sizes.children) if sizes else 0
        return str(name), Datum(kind, dimensions, value, constant=constant)

    def _find(self, name: str) -> Any:
        return self._locals.get(name.lower()) or self._scope.find(name)

    def _hint(self, name: str) -> str:
        text = nearest(str(name).lower(), [*self._locals, *self._scope.own, *self._shared])
        return text if "did you mean" in text else ""

    # ---- expressions

    def value(self, node: Node) -> Value:
        """Return what an expression is."""
        result: Value = getattr(self, f"_value_{node.data}")(*node.children)
        return result

    def typed(self, node: Node, kind: str) -> Any:
        """Return what an expression is, as a value of a type."""
        return self.types.fitted(kind, self.value(node))

    def signal(self, node: Node) -> Signal:
        """Return the signal that an expression names: data of a signal's type, or a name of the controller's."""
        if node.data == "name" and self._find(node.children[0]) is None:
            return Signal(str(node.children[0]).lower())
        value = self.value(node)
        if not isinstance(value, Signal):
            raise WrongType(f"{shape(value)} where a signal is asked for")
        return value

    def _value_name(self, name: str) -> Value:
        key = name.lower()
        if key in ("true", "false"):
            return key == "true"
        found = self._find(name)
        if isinstance(found, Datum):
            value: Value = found.value
            return value
        level = self._signal(key)
        if found is not None or level is None:
            raise WrongType(f"there is no data '{name}'{self._hint(name)}")
        return level

    def _value_component_of(self, base: Node, name: str) -> Value:
        value, key = self.value(base), name.lower()
        if not isinstance(value, Record) or key not in value.parts:
            raise WrongType(f"{shape(value)} has no component '{name}'")
        return value.parts[key]

    def _value_element(self, base: Node, *indices: Node) -> Value:
        rows = self.value(base)
        for index in indices:
            rows = self._element(Place("", 0, lambda rows=rows: rows, print), self.typed(index, "num")).get()  # type: ignore[misc]
        return rows

    def _value_number(self, text: str) -> Value:
        based = text[:2].lower() in ("0x", "0b")
        return float(int(text, 0)) if based else float(text)

    def _value_string(self, text: str) -> Value:
        return text[1:-1].replace('""', '"')

    def _value_aggregate(self, *parts: Node) -> Value:
        return [self.value(part) for part in parts if part is not None]

    def _value_signed(self, sign: str, node: Node) -> Value:
        value = self.value(node)
        return value if sign == "+" else self._applied("*", -1.0, value)

    def _value_negation(self, node: Node) -> Value:
        return not self.typed(node, "bool")

    def _value_and_not(self, one: Node, _: str, other: Node) -> Value:
        return bool(self.typed(one, "bool") and not self.typed(other, "bool"))

    def _value_binary(self, one: Node, sign: str, other: Node) -> Value:
        key = sign.lower()
        if key in _LOGIC:
            result: bool = _LOGIC[key](self.typed(one, "bool"), self.typed(other, "bool"))
            return result
        return self._applied(key, self.value(one), self.value(other))

    def _applied(self, key: str, one: Value, other: Value) -> Value:
        """Return what an operator gives of two values; an aggregate beside a record is one of its type."""
        if isinstance(one, Record) and isinstance(other, list):
            other = self.types.fitted(one.kind, other)
        elif isinstance(other, Record) and isinstance(one, list):
            one = self.types.fitted(other.kind, one)
        if key in ("=", "<>"):
            if shape(one) != shape(other):
                raise WrongType(f"{shape(one)} compared with {shape(other)}")
            return (one == other) == (key == "=")
        if key == "+" and isinstance(one, str) and isinstance(other, str):
            return one + other
        if isinstance(one, float) and isinstance(other, float):
            function = operator.add if key == "+" else _OPERATORS[key]
            result: Value = function(one, other)
            return result
        return self._of_positions(key, one, other)

    def _of_positions(self, key: str, one: Value, other: Value) -> Value:
        rows = [value.flat() if isinstance(value, Record) and value.kind == "pos" else None for value in (one, other)]
        first, second = rows
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
        raise WrongType(f"{shape(one)} {key} {shape(other)}")

    @staticmethod
    def _pos(values: Iterable[float]) -> Record:
        return Record("pos", dict(zip("xyz", values, strict=True)))

    def _value_function_call(self, name: str, arguments: Node | None) -> Value:
        found, call = self._find(name), self._call_of(name, name, arguments)
        if isinstance(found, Routine) and found.gives:
            return self._run(found, self._bound(found, call))
        if name.lower() not in self._functions:
            raise WrongType(f"there is no function '{name}'{self._hint(name)}")
        return self._functions[name.lower()](call)

    def _call_of(self, name: str, node: Node, arguments: Node | None) -> Call:
        given = [part for part in (arguments.children if arguments else ()) if part is not None]
        options: dict[str, Node | None] = {}
        for part in (part for part in given if part.data == "option"):
            _, key, value = part.children
            if value is None or hasattr(value, "data"):
                options[key.lower()] = value
            elif str(value).lower() in self._locals:  # \Key?parameter, which is given on if it was given
                options[key.lower()] = _named(value)
        return Call(self, str(name), node, tuple(part for part in given if part.data != "option"), options)

    # ---- statements

    def _block(self, lines: list[Node]) -> None:
        row = 0
        while row < len(lines):
            try:
                self._do(lines[row])
                row += 1
            except _Jump as jump:
                labels = [line.data == "label" and line.children[0].lower() == jump.args[0] for line in lines]
                if True not in labels:
                    raise
                row = labels.index(True)

    def _do(self, node: Node) -> None:
        self._done += 1
        with self._telling(node):
            if self._done > _MOST_STATEMENTS:
                raise WrongType(f"the program does not end within {_MOST_STATEMENTS} statements")
            getattr(self, f"_do_{node.data}")(*node.children)

    def _do_data(self, *parts: Node) -> None:
        for item in parts[3:]:
            name, datum = self._datum(self._scope, (_Parts(parts), item))
            if not self.types.known(datum.kind):
                raise WrongType(f"the type {parts[2]} is not known")
            _ = datum.value
            self._locals[name.lower()] = datum

    def _do_assignment(self, target: Node, expression: Node) -> None:
        place = self.place(target)
        place.set(self.types.fitted(place.kind, self.value(expression), place.dimensions))

    def _do_call(self, name: Node, arguments: Node | None) -> None:
        found, call = self._find(name), self._call_of(name, name, arguments)
        if isinstance(found, Routine):
            self._run(found, self._bound(found, call))
        elif name.lower() in self._instructions:
            self._instructions[name.lower()](call)
        else:
            self.remark(name, f"{name} is not known, and left out{self._hint(name)}")

    def _do_late_call(self, name: Node, arguments: Node | None) -> None:
        routine = self._find(self.typed(name, "string"))
        if not isinstance(routine, Routine):
            raise WrongType(f"there is no procedure '{self.typed(name, 'string')}'")
        self._run(routine, self._bound(routine, self._call_of(routine.name, name, arguments)))

    def _do_return(self, expression: Node | None) -> None:
        raise _Returned(None if expression is None else self.value(expression))

    def _do_connect(self, target: Node, trap: Node) -> None:
        self.remark(trap, f"interrupts are not done: TRAP {trap} is left out")

    def _do_label(self, name: Node) -> None:
        pass

    def _do_if(self, *parts: Node | None) -> None:
        for condition, block in zip(parts[:-1:2], parts[1:-1:2], strict=True):
            if self.typed(condition, "bool"):
                return self._block(block.children)
        return self._block(parts[-1].children) if parts[-1] is not None else None

    def _do_compact_if(self, condition: Node, statement: Node) -> None:
        if self.typed(condition, "bool"):
            self._do(statement)

    def _do_for(self, name: Node, begin: Node, end: Node, step: Node | None, block: Node) -> None:
        at, last = self.typed(begin, "num"), self.typed(end, "num")
        by = self.typed(step, "num") if step is not None else (1.0 if at <= last else -1.0)
        if by == 0:
            raise WrongType("a STEP of 0, which never ends")
        hidden = self._locals.get(name.lower())
        while (last - at) * by >= 0:
            self._locals[name.lower()] = Datum("num", held=at)
            self._block(block.children)
            at += by
        del self._locals[name.lower()]
        if hidden:
            self._locals[name.lower()] = hidden

    def _do_while(self, condition: Node, block: Node) -> None:
        endless, rounds = condition.data == "name" and condition.children[0].lower() == "true", 0
        while self.typed(condition, "bool"):
            if endless and rounds == self._cycles:
                times = "once" if rounds == 1 else f"{rounds} times"
                self.remark(condition, f"WHILE TRUE is done {times}, then the program ends: see --cycles", lost=False)
                raise Ended
            self._block(block.children)
            rounds += 1
            self._done += 1
            if self._done > _MOST_STATEMENTS:
                raise WrongType(f"a loop that does not end within {_MOST_STATEMENTS} rounds")

    def _do_test(self, expression: Node, *cases: Node | None) -> None:
        value = self.value(expression)
        for case in cases[:-1]:
            choices, block = case.children
            if any(self._applied("=", value, self.value(choice)) for choice in choices.children):
                return self._block(block.children)
        return self._block(cases[-1].children) if cases[-1] is not None else None

    def _goto(self, call: Call) -> None:
        raise _Jump(str(call.argument(0).children[0]).lower())

    def _end(self, call: Call) -> None:
        raise Ended

    # ---- routines

    def _bound(self, routine: Routine, call: Call) -> list[tuple[Parameter, Datum, Place | None]]:
        """Return the parameters of a routine with what a call gives for them, and where shared ones come from."""
        needed = [parameter for parameter in routine.parameters if not parameter.optional]
        if len(needed) != call.count:
            raise WrongType(f"{routine.name} with {call.count} arguments, of {len(needed)} that it has,")
        given = list(zip(needed, call.arguments, strict=True))
        known = {parameter.name: parameter for parameter in routine.parameters if parameter.optional}
        for name, node in call.options.items():
            if name not in known:
                raise WrongType(f"{routine.name} has no option '{name}'{nearest(name, known)}")
            given.append((known[name], node))
        return [self._argument(parameter, node) for parameter, node in given]

    def _argument(self, parameter: Parameter, node: Node | None) -> tuple[Parameter, Datum, Place | None]:
        if node is None:
            return parameter, Datum("bool", held=True), None
        if parameter.kind.startswith("signal"):
            return parameter, Datum(parameter.kind, held=self.signal(node)), None
        value = self.types.fitted(parameter.kind, self.value(node), parameter.dimensions)
        place = self.place(node) if parameter.shared else None
        return parameter, Datum(parameter.kind, parameter.dimensions, held=value), place

    def _run(self, routine: Routine, bound: list[tuple[Parameter, Datum, Place | None]]) -> Any:
        if self._depth == _DEEPEST:
            raise WrongType(f"{routine.name} is called {_DEEPEST} deep: it calls itself without an end")
        self._depth += 1
        value = None
        with self._in(routine.scope, {parameter.name: datum for parameter, datum, _ in bound}):
            try:
                self._block([line for line in routine.body.children if line.data != "handler"])
            except _Returned as returned:
                value = returned.args[0]
            except _Jump as jump:
                raise WrongType(f"there is no label '{jump.args[0]}' in {routine.name}") from None
        self._depth -= 1
        for _, datum, place in bound:
            if place is not None:
                place.set(datum.value)
        if routine.gives:
            if value is None:
                raise WrongType(f"FUNC {routine.name} ends without RETURN")
            dimensions = 1 if isinstance(value, list) and routine.gives not in self.types.records else 0
            return self.types.fitted(routine.gives, value, dimensions)
        return None

    @contextmanager
    def _in(self, scope: Scope, names: dict[str, Datum]) -> Iterator[None]:
        """Go to another scope for a while."""
        before = self._scope, self._locals
        self._scope, self._locals = scope, names
        try:
            yield
        finally:
            self._scope, self._locals = before

    @contextmanager
    def _telling(self, node: Node) -> Iterator[None]:
        """Put the file and the line before what goes wrong in a statement."""
        try:
            yield
        except RapidError:
            raise
        except (WrongType, SimrobError) as problem:
            raise RapidError(self.where(node), str(problem)) from problem
        except ZeroDivisionError as problem:
            raise RapidError(self.where(node), "division by zero") from problem
        except (ArithmeticError, ValueError, TypeError, LookupError) as problem:
            raise RapidError(self.where(node), f"cannot be worked out: {problem}") from problem


class _Parts:
    """The parts of a declaration inside a routine."""

    def __init__(self, parts: tuple[Node, ...]) -> None:
        self.children, self.line = parts, parts[2].line


def _named(token: Node) -> Node:
    from lark import Tree

    return Tree("name", [token])


def _line(node: Node) -> int:
    return int(node.line if hasattr(node, "line") else getattr(node.meta, "line", 1))
