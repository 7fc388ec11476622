"""What the modules of a program declare: types, data and routines, by scope."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Any

from simrob_drake.rapid.syntax import Module, Node, Remark, nodes, predefined
from simrob_drake.rapid.values import Types, Value, WrongType

_ROUTINES = ("routine", "function")


@dataclass
class Datum:
    """Data with its type; what it holds at first is worked out when somebody asks."""

    kind: str
    dimensions: int = 0
    first: Callable[[], Value] | None = None
    held: Value | None = None
    constant: bool = False

    @property
    def value(self) -> Any:
        """What it holds.

        Raises:
            WrongType: its first value depends on itself.
        """
        if self.held is None:
            if self.first is None:
                raise WrongType("data whose value depends on itself")
            first, self.first = self.first, None
            self.held = first()
        return self.held


@dataclass(frozen=True)
class RoutineParameter:
    """A parameter of a routine."""

    name: str
    kind: str
    dimensions: int
    optional: bool
    shared: bool  # what is assigned to it, its caller sees


@dataclass(frozen=True)
class Routine:
    """A procedure, or a function if it gives something."""

    name: str
    scope: Scope
    parameters: tuple[RoutineParameter, ...]
    body: Node
    gives: str = ""


@dataclass
class Scope:
    """The names that are known in a module: its own, and those of all modules; in lower case."""

    file: str
    shared: dict[str, Any]
    own: dict[str, Any] = field(default_factory=dict)

    def find(self, name: str) -> Any:
        """Return what a name stands for: a Datum or a Routine; None if nothing."""
        key = name.lower()
        return self.own.get(key, self.shared.get(key))


@dataclass
class Declarations:
    """All that a program declares, with what of it is not understood."""

    types: Types
    scopes: list[Scope]
    shared: dict[str, Any]
    faults: list[Remark]


def declared(modules: Iterable[Module], make: Callable[[Scope, Node], tuple[str, Datum]]) -> Declarations:
    """Return what modules declare, data as ``make`` gives them with their names."""
    shared: dict[str, Any] = {}
    found = Declarations(Types(), [], shared, [])
    whole = [predefined(), *modules]
    for module in whole:
        _declare_types(found.types, module)
    for module in whole:
        scope = Scope(module.file, shared)
        found.scopes.append(scope)
        found.faults += module.faults
        for node in module.declarations:
            names = scope.own if str(node.children[0] or "").lower() == "local" else shared
            if node.data in _ROUTINES:
                routine = _routine(scope, node)
                names[routine.name.lower()] = routine
            elif node.data == "data":
                _declare_data(found, names, scope, node, make)
    return found


def _declare_types(types: Types, module: Module) -> None:
    for node in module.declarations:
        if node.data == "alias":
            types.aliases[node.children[2].lower()] = node.children[1].lower()
        elif node.data == "record":
            parts = [part.children for part in node.children[2:]]
            types.records[node.children[1].lower()] = [(str(kind).lower(), str(name).lower()) for kind, name in parts]


def _declare_data(
    found: Declarations, names: dict[str, Any], scope: Scope, node: Node, make: Callable[..., tuple[str, Datum]]
) -> None:
    kind = node.children[2]
    if not found.types.known(kind):
        found.faults.append(Remark(scope.file, kind.line, f"the type {kind} is not known"))
        return
    for item in node.children[3:]:
        name, datum = make(scope, (node, item))
        names[name.lower()] = datum


def _routine(scope: Scope, node: Node) -> Routine:
    gives = str(node.children[1]).lower() if node.data == "function" else ""
    name = node.children[2 if gives else 1]
    parameters = tuple(one for part in nodes(node, "parameter") for one in _parameters(part))
    return Routine(str(name), scope, parameters, node.children[-1], gives)


def _parameters(node: Node) -> Iterable[RoutineParameter]:
    """Yield the parameters of a node, several where only one of them is given."""
    optional, mode, *rest = node.children
    words = [str(token) for token in rest if token is not None and token.type == "NAME"]
    stars = sum(token is not None and token.type == "STAR" for token in rest)
    for kind, name in zip(words[::2], words[1::2], strict=True):
        yield RoutineParameter(name.lower(), kind.lower(), stars, optional is not None, mode is not None)
