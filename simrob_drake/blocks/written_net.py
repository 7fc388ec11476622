"""A net of small blocks as compiled Python source, so that it costs no more than the arithmetic of its blocks.

All values of a net have an index: 0 is the constant 1, 1 is the time [s], then come the measured values (inputs of the
net), then the outputs of the blocks, block after block. The source has the variables ``v0``, ``v1`` and so on for the
values, ``x0`` … for the continuous states of all blocks, ``h0`` … for what sampled blocks hold (their states and
outputs), ``u0`` … for the inputs of the block at hand, and ``n`` for the number of the sample.

Continuous blocks have states that are integrated. Sampled blocks sample at multiples of a common step, each at every
second, third ... of these steps, and hold their outputs in between. The net's sample n is at n common steps.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import accumulate, pairwise
from typing import TYPE_CHECKING, Any, ClassVar

from pydrake.symbolic import Expression, Formula, Variable

from simrob_drake.base.renaming import former_names_of

Values = Sequence[float]
"""Numbers, or symbolic expressions of Drake."""

FIRST_MEASURED = 2
"""Index of the first measured value: the constant 1 and the time [s] come before."""


class NetBlock:
    """A block of a net. It computes with numbers and with symbolic expressions of Drake alike.

    The kinds of blocks are in :mod:`simrob_drake.parts.controllers.flow_blocks`.
    """

    delays: ClassVar[bool] = False
    """Whether the output depends on the states alone."""

    if TYPE_CHECKING:
        period: float
        """Time between samples [s]; 0 for a continuous block."""

    @property
    def size(self) -> int:
        """Count of elements of the output."""
        return 1

    @property
    def start(self) -> Values:
        """States at the start of a run."""
        return ()

    @property
    def has_feedthrough(self) -> bool:
        """Whether the output depends on the inputs at the same time."""
        return not self.delays

    @property
    def input_repetitions(self) -> int:
        """Count of occurrences of an input in the block's equation."""
        return 2

    def output(self, t: float, x: Values, u: Values) -> Values:
        """Compute the elements of the output.

        Args:
            t: time [s].
            x: states of the block.
            u: inputs of the block; empty if it has no feedthrough.
        """
        return self._output(t, x, u)

    def _output(self, t: float, x: Values, u: Values) -> Values:
        raise NotImplementedError

    def state_update(self, x: Values, u: Values) -> Values:
        """Compute the derivatives of the states; of a sampled block, their next values. A block may have no states.

        Args:
            x: states of the block.
            u: inputs of the block.
        """
        return ()


Terms = Sequence[tuple[int, float]]
"""A sum of values of a net: the index of each value, with its factor."""


@dataclass(frozen=True)
class WiredBlock:
    """A block of a net with its inputs.

    Attributes:
        block: the block.
        inputs: each input as a sum of values of the net.
    """

    block: NetBlock
    inputs: Sequence[Terms]


def output_slices(wired: Sequence[WiredBlock], measured: int) -> list[slice]:
    """Find the outputs of blocks among the values of their net.

    Args:
        wired: the blocks.
        measured: count of measured values.

    Returns:
        The slice of each block's output.
    """
    sizes = [wired_block.block.size for wired_block in wired]
    ends = accumulate(sizes, initial=FIRST_MEASURED + measured)
    return [slice(begin, end) for begin, end in pairwise(ends)]


def _power(base: float, exponent: float) -> float:
    """Compute a power as Drake does: 0 to a negative power is infinite, not an error."""
    return math.inf if base == 0 and exponent < 0 else math.pow(base, exponent)


# Python's operator for each function that Drake's `Unapply` names.
_OPERATORS = {
    "_reduce_add": "+",
    "_reduce_mul": "*",
    "truediv": "/",
    "lt": "<",
    "le": "<=",
    "gt": ">",
    "ge": ">=",
    "eq": "==",
    "ne": "!=",
    "logical_and": "and",
    "logical_or": "or",
}
# The time as an expression.
_TIME: Any = Expression(Variable("v1"))
# Functions that the source may call, by name.
_NAMES: dict[str, Any] = {**vars(math), "pow": _power, "abs": abs, "min": min, "max": max}


def _source(value: Any) -> str:
    """Write a number, a variable, an expression or a formula of Drake as Python source, part by part."""
    if isinstance(value, float):
        # `repr` writes all digits: the source has the same number, to the last bit. That of a number of NumPy has the
        # name of its type.
        return repr(float(value))
    if not isinstance(value, (Expression, Formula)):
        # A whole number, or a variable of Drake, whose text is its name in the source.
        return str(value)

    # Drake takes an expression apart into its outermost function and the arguments of this function.
    function, arguments = value.Unapply()
    name = function.__name__
    texts = [_source(argument) for argument in arguments]
    if name == "if_then_else":
        condition, yes, no = texts
        return f"({yes} if {condition} else {no})"
    if name in _OPERATORS:
        operator = f" {_OPERATORS[name]} "
        return f"({operator.join(texts)})"
    if name == "Expression":  # an expression that is only a number or a variable
        return texts[0]
    return f"{name}({', '.join(texts)})"


SOURCE = "<net>"
"""File name of the compiled source in tracebacks."""

# Names of the functions in the source.
OUTPUTS = "outputs"
RATES = "rates"
SAMPLE = "sample"


class WrittenNet:
    """The functions of a net, written as Python source and compiled.

    Attributes:
        continuous: states of the continuous blocks at the start.
        sampled: what the sampled blocks hold at the start: the states and the output of each.
        functions: the compiled functions, by name. Each returns a list of numbers:

            - ``outputs(v, x, h, n)``: the outputs of all blocks, from the constant, the time and the measured values v,
              the continuous states x, what sampled blocks hold h, and the number n of the sample. If n is None, no
              block samples, and the held outputs are returned.
            - ``rates(v, x)``: the derivatives of the continuous states, from all values v.
            - ``sample(v, h, n)``: what sampled blocks hold after sample n, from all values v.
    """

    def __init__(
        self,
        wired: Sequence[WiredBlock],
        measured: int,
        order: Sequence[int],
        every: Mapping[int, int],
    ) -> None:
        """Write and compile the source.

        Args:
            wired: the blocks.
            measured: count of measured values.
            order: indices of the blocks in the order of their computation.
            every: common steps between two samples of a block, by the index of each sampled block.
        """
        self._wired = wired
        self._every = every
        self._slices = output_slices(wired, measured)
        self.continuous = list[float]()
        self.sampled = list[float]()
        self._variables = list[list[str]]()
        """Variables of each block for its states; of a sampled block, then for the output that it holds."""
        for number, wired_block in enumerate(wired):
            self._declare_states(number, wired_block.block)

        self._lines = list[str]()
        self._owners = dict[int, int]()
        """Index of the block to which a line belongs, by the line's number, which counts from 1."""
        known_count = FIRST_MEASURED + measured
        value_count = self._slices[-1].stop if wired else known_count
        self._write_outputs_function(order, known_count, value_count)
        self._write_rates_function(value_count)
        self._write_sample_function(value_count)

        self.functions: dict[str, Any] = dict(_NAMES)
        # The source is run once to define its functions. The file name marks its lines in a traceback, by which
        # `SignalNet` finds the block of an error.
        exec(compile("\n".join(self._lines), SOURCE, "exec"), self.functions)

    def _declare_states(self, number: int, block: NetBlock) -> None:
        """Append the states of a block at the start to `continuous` or `sampled`, and name their variables.

        It must be called for the blocks in their order, since the variables are numbered through all blocks.

        Args:
            number: index of the block.
            block: the block.
        """
        is_sampled = number in self._every
        letter = "h" if is_sampled else "x"
        all_states = self.sampled if is_sampled else self.continuous
        first = len(all_states)
        all_states.extend(block.start)
        if is_sampled:
            # The held output is 0 only until the first sample, at the start of the run.
            all_states.extend([0.0] * block.size)
        self._variables.append([f"{letter}{index}" for index in range(first, len(all_states))])

    def _write_outputs_function(
        self,
        order: Sequence[int],
        known_count: int,
        value_count: int,
    ) -> None:
        """Write the function ``outputs``, which computes the outputs of all blocks, as the class describes it.

        Args:
            order: indices of the blocks in the order of their computation.
            known_count: count of the values before the outputs of blocks.
            value_count: count of all values.
        """
        self._begin(
            f"{OUTPUTS}(v, x, h, n)", v=known_count, x=len(self.continuous), h=len(self.sampled)
        )
        # A line may read the outputs of the lines before it only, hence the order of the computation.
        for number in order:
            self._write_output(number)
        self._end(f"v{index}" for index in range(known_count, value_count))

    def _write_rates_function(self, value_count: int) -> None:
        """Write the function ``rates``, which computes the derivatives of the continuous states.

        Args:
            value_count: count of all values.
        """
        self._begin(f"{RATES}(v, x)", v=value_count, x=len(self.continuous))
        # Here all outputs are known, so the blocks may be in any order: that of the states.
        rates = list[str]()
        for number in range(len(self._wired)):
            if number not in self._every:
                rates += self._write_state_update(number)
        self._end(rates)

    def _write_sample_function(self, value_count: int) -> None:
        """Write the function ``sample``, which computes what sampled blocks hold after a sample.

        Args:
            value_count: count of all values.
        """
        self._begin(f"{SAMPLE}(v, h, n)", v=value_count, h=len(self.sampled))
        for number, steps in self._every.items():
            self._write(number, f"if n % {steps} == 0:")
            # The states are assigned together after all updates, which read the states before the sample. The output of
            # this sample follows them.
            new_states = self._write_state_update(number, "  ")
            new_values = [*new_states, *self._output_variables(number)]
            self._write(number, f"  {_tuple_of(self._variables[number])} = {_tuple_of(new_values)}")
        self._end(f"h{index}" for index in range(len(self.sampled)))

    def find_block(self, line: int) -> tuple[int, list[str]]:
        """Find the block to which a line of the source belongs.

        Args:
            line: number of the line, from 1.

        Returns:
            The index of the block, and the names of the variables that hold its inputs.
        """
        number = self._owners[line]
        return number, [f"u{index}" for index in range(len(self._wired[number].inputs))]

    def _write(self, number: int, line: str) -> None:
        """Append a line that belongs to a block."""
        self._lines.append(f"  {line}")
        self._owners[len(self._lines)] = number

    def _begin(self, head: str, **lists: int) -> None:
        """Append the head of a function, which unpacks lists into variables.

        Args:
            head: name and arguments of the function.
            **lists: length of each list, by its argument. The variables are called ``<argument>0`` and so on.
        """
        self._lines.append(f"def {head}:")
        for name, size in lists.items():
            # An empty list has no names to unpack it into.
            if size:
                variables = _tuple_of(f"{name}{index}" for index in range(size))
                self._lines.append(f"  {variables} = {name}")

    def _end(self, values: Iterable[str]) -> None:
        """Append the return statement of a function."""
        self._lines.append(f"  return [{', '.join(values)}]")

    def _output_variables(self, number: int) -> list[str]:
        """Variables of a block's output."""
        own = self._slices[number]
        return [f"v{index}" for index in range(own.start, own.stop)]

    def _state_variables(self, number: int) -> list[str]:
        """Variables of a block's states."""
        count = len(self._wired[number].block.start)
        return self._variables[number][:count]

    def _states(self, number: int) -> list[Any]:
        """States of a block as expressions."""
        return [Expression(Variable(name)) for name in self._state_variables(number)]

    def _write_inputs(self, number: int, indent: str) -> list[Any]:
        """Append the lines that compute the inputs of a block, and return the inputs as expressions.

        Args:
            number: index of the block.
            indent: spaces before each line, for lines inside of a condition.
        """
        names = list[str]()
        for position, terms in enumerate(self._wired[number].inputs):
            # A factor of 1 is left out: the multiplication would take time.
            parts = [
                f"v{index}" if factor == 1.0 else f"{float(factor)!r} * v{index}"
                for index, factor in terms
            ]
            # An input without terms is 0.
            names.append(f"u{position}")
            self._write(number, f"{indent}{names[-1]} = {' + '.join(parts) or '0.0'}")
        return [Expression(Variable(name)) for name in names]

    def _write_output(self, number: int) -> None:
        """Append the lines that compute the output of a block, by its index.

        Between samples, a sampled block gives the output that it holds.
        """
        block = self._wired[number].block
        names = self._output_variables(number)
        indent = ""
        if number in self._every:
            # The block's variables are its states, then the output that it holds.
            held = self._variables[number][len(block.start) :]
            # The block takes a sample if n is a multiple of its steps: then the remainder is 0, which counts as false.
            self._write(number, f"if n is None or n % {self._every[number]}:")
            self._write(number, f"  {_tuple_of(names)} = {_tuple_of(held)}")
            self._write(number, "else:")
            indent = "  "
        inputs = self._write_inputs(number, indent) if block.has_feedthrough else []
        values = block.output(_TIME, self._states(number), inputs)
        for name, value in zip(names, values, strict=True):
            self._write(number, f"{indent}{name} = {_source(value)}")

    def _write_state_update(self, number: int, indent: str = "") -> list[str]:
        """Append the lines that compute the derivatives of a block's states, or their next values.

        Args:
            number: index of the block.
            indent: spaces before each line, for lines inside of a condition.

        Returns:
            The variables that hold them: ``dx0`` or ``dh0`` and so on. None are written for a block without states.
        """
        states = self._states(number)
        if not states:
            return []
        inputs = self._write_inputs(number, indent)
        values = self._wired[number].block.state_update(states, inputs)
        # Names of their own, since the next lines still read the states x or h.
        names = [f"d{name}" for name in self._state_variables(number)]
        for name, value in zip(names, values, strict=True):
            self._write(number, f"{indent}{name} = {_source(value)}")
        return names


def _tuple_of(names: Iterable[str]) -> str:
    """Write names as the elements of a tuple, each followed by a comma."""
    return "".join(f"{name}, " for name in names)


if not TYPE_CHECKING:
    __getattr__ = former_names_of(__name__, {"output_places": "output_slices"})
