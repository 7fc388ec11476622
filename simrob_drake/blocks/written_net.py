"""A net of blocks as Python source: what many blocks compute costs no more than their arithmetic."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import accumulate, pairwise
from typing import TYPE_CHECKING, Any, ClassVar

from pydrake.symbolic import Expression, Formula, Variable

Values = Sequence[float]


class NetBlock:
    """What a block of a net does; see :mod:`simrob_drake.parts.controllers.flow_blocks`."""

    delays: ClassVar[bool] = False  # whether its output depends on its states alone

    if TYPE_CHECKING:
        period: float
        """Between samples [s]; 0 of a continuous block."""

    @property
    def size(self) -> int:
        """How many elements its output has."""
        return 1

    @property
    def start(self) -> Values:
        """Its states at the start."""
        return ()

    @property
    def fed_through(self) -> bool:
        """Whether its output depends on its inputs at the same time."""
        return not self.delays

    @property
    def repeats(self) -> int:
        """How often an input stands in its equation."""
        return 2

    def output(self, t: float, x: Values, u: Values) -> Values:
        """Return its output by the time [s], its states and its inputs, by element."""
        return self._output(t, x, u)

    def _output(self, t: float, x: Values, u: Values) -> Values:
        raise NotImplementedError

    def following(self, x: Values, u: Values) -> Values:
        """Return the derivatives of its states, or their next values."""
        return ()


Terms = Sequence[tuple[int, float]]
"""A sum: places among the values, with factors."""


@dataclass(frozen=True)
class WiredBlock:
    """A block with its inputs, sums of values: first 1, the time [s], what is measured, then the outputs of blocks."""

    block: NetBlock
    inputs: Sequence[Terms]


def output_places(wired: Sequence[WiredBlock], measured: int) -> list[slice]:
    """Return where the outputs of blocks stand among the values."""
    ends = accumulate((one.block.size for one in wired), initial=2 + measured)
    return [slice(*pair) for pair in pairwise(ends)]


def _power(base: float, exponent: float) -> float:
    return math.inf if base == 0 and exponent < 0 else math.pow(base, exponent)


_SIGNS = {"_reduce_add": "+", "_reduce_mul": "*", "truediv": "/", "lt": "<", "le": "<=", "gt": ">", "ge": ">=",
          "eq": "==", "ne": "!=", "logical_and": "and", "logical_or": "or"}  # fmt: skip
_TIME: Any = Expression(Variable("v1"))
_NAMES: dict[str, Any] = {**vars(math), "pow": _power, "abs": abs, "min": min, "max": max}


def _source(value: Any) -> str:
    """Return a number, a variable, an expression or a formula as Python has it."""
    if not isinstance(value, (Expression, Formula)):
        return repr(value) if isinstance(value, float) else str(value)
    make, parts = value.Unapply()
    name, texts = make.__name__, [_source(part) for part in parts]
    if name == "if_then_else":
        condition, yes, no = texts
        return f"({yes} if {condition} else {no})"
    if name in _SIGNS:
        return f"({f' {_SIGNS[name]} '.join(texts)})"
    return texts[0] if name == "Expression" else f"{name}({', '.join(texts)})"


SOURCE = "<net>"
"""What tracebacks call the file of what was written."""


class WrittenNet:
    """The functions of a net, written out and compiled.

    Attributes:
        continuous, sampled: states at the start: of continuous blocks, and of sampled ones with what they hold.
        functions: ``outputs`` by the values that are known, continuous states, what is sampled, and the number of a
            sample or None; ``rates`` by all values and continuous states; ``following`` by all values, what is sampled
            and the number of the sample. Each gives a list.
    """

    def __init__(
        self, wired: Sequence[WiredBlock], measured: int, order: Sequence[int], every: Mapping[int, int]
    ) -> None:
        """Write it: blocks in the order in which they are computed, and those sampled each so many samples."""
        self._wired, self._every, self._places = wired, every, output_places(wired, measured)
        self.continuous, self.sampled = list[float](), list[float]()
        self._kept = list[list[str]]()  # the states of each block, and what it holds
        for number, one in enumerate(wired):
            letter, kept = ("h", self.sampled) if number in every else ("x", self.continuous)
            start = [*one.block.start, *([0.0] * one.block.size if number in every else [])]
            self._kept.append([f"{letter}{len(kept) + place}" for place in range(len(start))])
            kept.extend(start)
        known = 2 + measured
        count = self._places[-1].stop if wired else known
        self._lines, self._owners = list[str](), dict[int, int]()
        self._begin("outputs(v, x, h, n)", v=known, x=len(self.continuous), h=len(self.sampled))
        for number in order:
            self._write_output(number)
        self._end(f"v{place}" for place in range(known, count))
        self._begin("rates(v, x)", v=count, x=len(self.continuous))
        self._end([rate for number in range(len(wired)) if number not in every for rate in self._following(number)])
        self._begin("following(v, h, n)", v=count, h=len(self.sampled))
        for number, times in every.items():
            self._write(number, f"if n % {times} == 0:")
            after = [*self._following(number, "  "), *self._outputs(number)]
            self._write(number, f"  {_row(self._kept[number])} = {_row(after)}")
        self._end(f"h{place}" for place in range(len(self.sampled)))
        self.functions: dict[str, Any] = dict(_NAMES)
        exec(compile("\n".join(self._lines), SOURCE, "exec"), self.functions)

    def at(self, line: int) -> tuple[int, list[str]]:
        """Return whose line one of the source is: the number of its block, and the names of what that takes."""
        number = self._owners[line]
        return number, [f"u{place}" for place in range(len(self._wired[number].inputs))]

    def _write(self, number: int, line: str) -> None:
        self._lines.append(f"  {line}")
        self._owners[len(self._lines)] = number

    def _begin(self, head: str, **lists: int) -> None:
        self._lines.append(f"def {head}:")
        for name, size in lists.items():
            if size:
                self._lines.append(f"  {_row(f'{name}{place}' for place in range(size))} = {name}")

    def _end(self, values: Iterable[str]) -> None:
        self._lines.append(f"  return [{', '.join(values)}]")

    def _outputs(self, number: int) -> list[str]:
        return [f"v{place}" for place in range(self._places[number].start, self._places[number].stop)]

    def _states(self, number: int) -> list[Any]:
        names = self._kept[number][: len(self._wired[number].block.start)]
        return [Expression(Variable(name)) for name in names]

    def _inputs(self, number: int, indent: str) -> list[Any]:
        for place, terms in enumerate(self._wired[number].inputs):
            parts = [f"v{own}" if factor == 1.0 else f"{float(factor)!r} * v{own}" for own, factor in terms]
            self._write(number, f"{indent}u{place} = {' + '.join(parts) or '0.0'}")
        return [Expression(Variable(f"u{place}")) for place in range(len(self._wired[number].inputs))]

    def _write_output(self, number: int) -> None:
        block, names, indent = self._wired[number].block, self._outputs(number), ""
        if number in self._every:
            self._write(number, f"if n is None or n % {self._every[number]}:")
            self._write(number, f"  {_row(names)} = {_row(self._kept[number][len(block.start) :])}")
            self._write(number, "else:")
            indent = "  "
        inputs = self._inputs(number, indent) if block.fed_through else []
        for name, value in zip(names, block.output(_TIME, self._states(number), inputs), strict=True):
            self._write(number, f"{indent}{name} = {_source(value)}")

    def _following(self, number: int, indent: str = "") -> list[str]:
        """Write what becomes of a block's states; return the names of that."""
        states = self._states(number)
        values = self._wired[number].block.following(states, self._inputs(number, indent)) if states else ()
        names = [f"d{own}" for own in self._kept[number][: len(states)]]
        for name, value in zip(names, values, strict=True):
            self._write(number, f"{indent}{name} = {_source(value)}")
        return names


def _row(names: Iterable[str]) -> str:
    """Return names as a tuple has them."""
    return "".join(f"{name}, " for name in names)
