"""A net of small blocks as one system: all blocks between measured and commanded signals, as in a block diagram.

The values of a net are those of :mod:`simrob_drake.blocks.written_net`: the constant 1, the time, the measured values,
then the outputs of the blocks. An input of a block is a sum of such values with factors.

A continuous block has states that are integrated, or none. A sampled block has a period: it computes at multiples of
the period, and holds its output in between. A block has feedthrough if its output depends on its inputs at the same
time; blocks that feed each other so are an algebraic loop, which cannot be computed.
"""

from collections.abc import Mapping, Sequence
from fractions import Fraction
from functools import reduce
from graphlib import TopologicalSorter
from math import gcd, lcm
from traceback import walk_tb
from typing import Any, NamedTuple

import numpy as np
from pydrake.symbolic import Expression, Variable
from pydrake.systems.framework import (
    BasicVector,
    Context,
    ContinuousState,
    DiscreteValues,
    LeafSystem,
)
from pydrake.systems.primitives import SymbolicVectorSystem

from simrob_drake.base.messages import compound, message
from simrob_drake.blocks.block import Block
from simrob_drake.blocks.written_net import (
    FIRST_MEASURED,
    OUTPUTS,
    RATES,
    SAMPLE,
    SOURCE,
    WiredBlock,
    WrittenNet,
    output_slices,
)

# Largest count of terms of a net as expressions. An expression that several blocks read is repeated in each of them,
# and so computed several times.
_MOST_TERMS = 4000
# Shortest common step of several periods [s].
_SHORTEST_STEP = 1e-5
# Largest denominator of a period as a fraction of seconds: the resolution is 1 µs.
_LARGEST_DENOMINATOR = 1_000_000
# Largest difference of a period from such a fraction, as part of the period [1].
_PERIOD_ROUNDING = 1e-9


def signal_net(
    blocks: Mapping[str, WiredBlock],
    measured: int,
    *,
    integrated: bool = True,
) -> LeafSystem:
    """Create the system that computes a net of blocks.

    It is a system of symbolic expressions, which Drake computes in C++. If blocks are sampled, or the expressions would
    become too long, it is a `SignalNet`.

    Args:
        blocks: the blocks, by name.
        measured: count of measured values.
        integrated: whether the diagram has continuous states. Drake then asks a system of expressions for its time
            derivatives, for which it needs a state.

    Returns:
        The system. Its input is the vector of the measured values, if there are any, and its output the vector of all
        outputs of blocks, block after block.

    Raises:
        graphlib.CycleError: the net has an algebraic loop.
        ValueError: the periods of the blocks have no common step.
    """
    order = _computing_order(blocks, measured)
    wired = list(blocks.values())
    is_sampled = any(wired_block.block.period for wired_block in wired)
    if is_sampled or _count_terms(wired, measured, order) > _MOST_TERMS:
        return SignalNet(blocks, measured)
    return _symbolic_net(wired, measured, order, integrated=integrated)


def _computing_order(blocks: Mapping[str, WiredBlock], measured: int) -> list[int]:
    """Sort blocks so that each comes after the blocks whose outputs it needs at the same time.

    Args:
        blocks: the blocks, by name.
        measured: count of measured values.

    Returns:
        The indices of the blocks.

    Raises:
        graphlib.CycleError: the net has an algebraic loop. It contains the names of its blocks.
    """
    slices = output_slices(list(blocks.values()), measured)
    # Name of the block that gives a value, by the value's index.
    owner = dict[int, str]()
    for name, own in zip(blocks, slices, strict=True):
        owner.update(dict.fromkeys(range(own.start, own.stop), name))

    needed = dict[str, list[str]]()
    for name, wired_block in blocks.items():
        needed[name] = []
        if not wired_block.block.has_feedthrough:
            continue
        for terms in wired_block.inputs:
            # Only outputs of blocks have an owner: constant, time and measured values are known from the start.
            needed[name] += [owner[index] for index, _ in terms if index in owner]

    number_of = {name: number for number, name in enumerate(blocks)}
    return [number_of[name] for name in TopologicalSorter(needed).static_order()]


def _count_terms(wired: Sequence[WiredBlock], measured: int, order: Sequence[int]) -> int:
    """Estimate the sum of the counts of terms of all values and derivatives of a net, as expressions.

    These are expressions of the measured values and the states.

    Args:
        wired: the blocks.
        measured: count of measured values.
        order: indices of the blocks in the order of their computation.
    """
    slices = output_slices(wired, measured)
    # Count of terms of each value, if written as an expression: 1 for a variable, such as a measured value or a state.
    counts = [1] * (slices[-1].stop if slices else FIRST_MEASURED)

    def count_inputs(wired_block: WiredBlock) -> int:
        """Count the terms of all inputs of a block."""
        return sum(counts[index] for terms in wired_block.inputs for index, _ in terms)

    for number in order:
        block = wired[number].block
        if block.has_feedthrough:
            # The equation of a block may contain each input several times.
            count = 1 + count_inputs(wired[number]) * block.input_repetitions
            # Counts grow exponentially along a chain of blocks, so they are limited.
            counts[slices[number]] = [min(count, _MOST_TERMS)] * block.size
    # The derivatives of states contain the inputs once more. Only a block with states has their values at the start.
    rate_count = 0
    for wired_block in wired:
        if wired_block.block.start:
            rate_count += count_inputs(wired_block) * wired_block.block.input_repetitions
    return sum(counts) + rate_count


def _symbolic_net(
    wired: Sequence[WiredBlock],
    measured: int,
    order: Sequence[int],
    *,
    integrated: bool,
) -> LeafSystem:
    """Create a net of continuous blocks as Drake's system of symbolic expressions.

    Args:
        wired: the blocks.
        measured: count of measured values.
        order: indices of the blocks in the order of their computation.
        integrated: whether the diagram has continuous states, so that the system needs one, too.
    """
    time = Variable("t")
    zero = Expression(0.0)
    measured_variables = [Variable(f"u{number}") for number in range(measured)]
    # All values of the net. Those of the blocks are 0 until they are computed, in order.
    values: list[Any] = [1.0, Expression(time), *map(Expression, measured_variables)]
    values += [zero] * sum(wired_block.block.size for wired_block in wired)
    slices = output_slices(wired, measured)

    # Drake's states are 0 at the start of a run, so each is the difference of a block's state from its start.
    state_variables = list[Variable]()
    states = list[list[Any]]()  # states of each block, as expressions
    for number, wired_block in enumerate(wired):
        own_variables = [
            Variable(f"x{number}_{index}") for index in range(len(wired_block.block.start))
        ]
        state_variables += own_variables
        states.append(
            [start + x for start, x in zip(wired_block.block.start, own_variables, strict=True)]
        )

    def inputs_of(number: int) -> list[Any]:
        """Inputs of a block, by its index, as expressions, with the values so far."""
        return [
            sum((factor * values[index] for index, factor in terms), start=zero)
            for terms in wired[number].inputs
        ]

    for number in order:
        block = wired[number].block
        # Inputs of a block without feedthrough may not be computed yet, and its output does not need them.
        inputs = inputs_of(number) if block.has_feedthrough else []
        outputs = block.output(values[1], states[number], inputs)
        # `zero +` makes an expression of a plain number.
        values[slices[number]] = [zero + value for value in outputs]
    rates = list[Any]()
    for number, wired_block in enumerate(wired):
        if wired_block.block.start:
            updates = wired_block.block.state_update(states[number], inputs_of(number))
            rates += [zero + rate for rate in updates]

    # A state that stays 0, as Drake needs one to be asked for derivatives.
    if integrated and not state_variables:
        state_variables = [Variable("none")]
        rates = [zero]
    return SymbolicVectorSystem(
        time=time,
        state=state_variables,
        input=measured_variables,
        dynamics=rates,
        output=values[FIRST_MEASURED + measured :],
        time_period=0.0,
    )


def _common_step(periods: Sequence[float]) -> float:
    """Find the longest step [s] of which all periods [s] are multiples.

    Raises:
        ValueError: there is none, or it is too short.
    """
    # With a common denominator, the step is the greatest common divisor of the numerators.
    fractions = [Fraction(period).limit_denominator(_LARGEST_DENOMINATOR) for period in periods]
    denominator = reduce(lcm, (fraction.denominator for fraction in fractions), 1)
    numerators = [int(fraction * denominator) for fraction in fractions]
    step = Fraction(reduce(gcd, numerators), denominator)

    are_exact = all(
        abs(float(fraction) - period) <= _PERIOD_ROUNDING * period
        for fraction, period in zip(fractions, periods, strict=True)
    )
    if step < _SHORTEST_STEP or not are_exact:
        listed = ", ".join(f"{period:g}" for period in sorted(set(periods)))
        raise ValueError(
            message(
                "blocks.periods_of", "the periods {periods} s have no common step", periods=listed
            )
        )
    return float(step)


class _NetStates(NamedTuple):
    """States of a net, as lists of numbers.

    Attributes:
        continuous: continuous states.
        sample: number of the next sample.
        held: states and outputs that sampled blocks hold.
    """

    continuous: list[float]
    sample: float
    held: list[float]


class SignalNet(Block):
    """Compute a net of blocks by Python source that a `WrittenNet` writes and compiles for it.

    The source has three functions: ``outputs`` of the blocks, ``rates``, the derivatives of the continuous states, and
    ``sample``, what sampled blocks hold after a sample.

    Continuous blocks share the station's integration. Sampled blocks, whose periods are multiples of a common step,
    sample together, each with the outputs of the blocks before it at that very time, and hold their outputs in between.

    Ports:
        in  ``measured`` (m): the measured values.
        out ``values``: the outputs of all blocks, one after the other.
    """

    def __init__(self, blocks: Mapping[str, WiredBlock], measured: int) -> None:
        """Create the block.

        Args:
            blocks: blocks of the net, by name.
            measured: count m of measured values.

        Raises:
            graphlib.CycleError: the net has an algebraic loop.
            ValueError: the periods of the blocks have no common step.
        """
        super().__init__()
        self._input = self.DeclareVectorInputPort("measured", measured)
        self._names = list(blocks)
        wired = list(blocks.values())
        periods = dict[int, float]()
        for number, wired_block in enumerate(wired):
            if wired_block.block.period:
                periods[number] = wired_block.block.period
        step = _common_step(list(periods.values())) if periods else 0.0
        # Common steps between two samples of each sampled block, by its index.
        every = {number: round(period / step) for number, period in periods.items()}
        self._written = WrittenNet(wired, measured, _computing_order(blocks, measured), every)

        if self._written.continuous:
            self.DeclareContinuousState(BasicVector(self._written.continuous))
        if periods:
            first_sample = 0.0
            self.DeclareDiscreteState(np.array([first_sample, *self._written.sampled]))
            self.DeclarePeriodicDiscreteUpdateEvent(step, 0.0, self._sample)
        size = sum(wired_block.block.size for wired_block in wired)
        self._output = self.DeclareVectorOutputPort("values", size, self._calc_values)

    def _known_values(self, context: Context) -> list[float]:
        """Values before the outputs of the blocks: the constant 1, the time and the measured values."""
        measured = self._input.Eval(context).tolist() if self._input.size() else []
        return [1.0, context.get_time(), *measured]

    def _states(self, context: Context) -> _NetStates:
        """Read the states of the net from a context. A net without sampled blocks holds nothing."""
        continuous = context.get_continuous_state_vector().CopyToVector().tolist()
        if not context.num_discrete_state_groups():
            return _NetStates(continuous, sample=0.0, held=[])
        sample, *held = context.get_discrete_state_vector().CopyToVector().tolist()
        return _NetStates(continuous, sample=sample, held=held)

    def _compute(self, function: str, *arguments: Any) -> list[float]:
        """Call a function of the net's source.

        Args:
            function: name of the function: ``outputs``, ``rates`` or ``sample``.
            *arguments: its arguments: values of the net, states, and the number of the sample.

        Returns:
            the numbers that the function returns.

        Raises:
            RuntimeError: a block cannot be computed, such as a division by 0.
        """
        try:
            computed: list[float] = self._written.functions[function](*arguments)
        except (ArithmeticError, ValueError) as problem:
            steps = walk_tb(problem.__traceback__)
            # The traceback also contains frames of Drake and of this file; the net's own frame has the inputs.
            frame, line = next(step for step in steps if step[0].f_code.co_filename == SOURCE)
            number, input_names = self._written.find_block(line)
            text = message(
                "blocks.block_cannot_compute",
                "the block {block} cannot be computed from {values}",
                block=self._names[number],
                values=[frame.f_locals[name] for name in input_names],
            )
            raise RuntimeError(
                compound("{message}: {problem}", message=text, problem=problem)
            ) from problem
        return computed

    def _calc_values(self, context: Context, output: BasicVector) -> None:
        """Compute the outputs of all blocks. Sampled blocks give what they hold, as no sample is taken here."""
        states = self._states(context)
        known = self._known_values(context)
        no_sample = None
        output.SetFromVector(
            self._compute(OUTPUTS, known, states.continuous, states.held, no_sample)
        )

    def DoCalcTimeDerivatives(self, context: Context, derivatives: ContinuousState) -> None:  # noqa: N802 - Drake's
        """Compute the derivatives of the continuous states."""
        if derivatives.size():
            values = [*self._known_values(context), *self._output.Eval(context).tolist()]
            derivatives.SetFromVector(
                self._compute(RATES, values, self._states(context).continuous)
            )

    def _sample(self, context: Context, discrete: DiscreteValues) -> None:
        """Take a sample of all blocks whose period ends; writes the new state to `discrete`."""
        states = self._states(context)
        known = self._known_values(context)
        outputs = self._compute(OUTPUTS, known, states.continuous, states.held, states.sample)
        held = self._compute(SAMPLE, [*known, *outputs], states.held, states.sample)
        discrete.set_value([states.sample + 1, *held])
