"""A call of an instruction or a function: its arguments, worked out as types that are asked for."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

from simrob_drake.rapid.syntax import Node
from simrob_drake.rapid.values import SignalName, Value, WrongType


@dataclass(frozen=True)
class Location:
    """Where a value is kept that can be assigned to: data, a component or an element."""

    kind: str
    dimensions: int
    get: Callable[[], Value]
    set: Callable[[Value], None]


class Evaluator(Protocol):
    """What works out the arguments of a call."""

    def value(self, node: Node) -> Value:
        """Return what an expression is."""

    def typed(self, node: Node, kind: str) -> Any:
        """Return what an expression is, as a value of a type."""

    def place(self, node: Node) -> Location:
        """Return the place that an expression names."""

    def signal(self, node: Node) -> SignalName:
        """Return the signal that an expression names."""

    def remark(self, node: Node, text: str, *, lost: bool = True) -> None:
        """Tell something about a line."""

    def where(self, node: Node) -> str:
        """Return the file and the line of something."""


@dataclass(frozen=True)
class Call:
    """A call with its arguments, those in order and the optional ones by name in lower case, switches as None."""

    task: Evaluator
    name: str
    node: Node
    arguments: tuple[Node, ...]
    options: dict[str, Node | None]

    @property
    def count(self) -> int:
        """How many arguments are given in order."""
        return len(self.arguments)

    def argument(self, index: int) -> Node:
        """Return an argument as it is written.

        Raises:
            WrongType: so many are not given.
        """
        if index >= len(self.arguments):
            raise WrongType(f"{self.name} with {self.count} arguments, of which {index + 1} or more are needed,")
        return self.arguments[index]

    def value(self, index: int, kind: str = "") -> Any:
        """Return an argument, as a value of a type if one is named."""
        node = self.argument(index)
        return self.task.typed(node, kind) if kind else self.task.value(node)

    def has(self, *names: str) -> bool:
        """Tell whether an option is given."""
        return any(name in self.options for name in names)

    def option(self, name: str, kind: str, otherwise: Any = None) -> Any:
        """Return the value of an option, if it is given."""
        node = self.options.get(name)
        return otherwise if node is None else self.task.typed(node, kind)

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
