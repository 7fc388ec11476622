"""A net of small blocks, computed as one: whatever is drawn between what is measured and what is commanded."""

from collections.abc import Mapping, Sequence
from fractions import Fraction
from functools import reduce
from graphlib import TopologicalSorter
from math import gcd, lcm
from traceback import walk_tb
from typing import Any

import numpy as np
from pydrake.symbolic import Expression, Variable
from pydrake.systems.framework import BasicVector, Context, ContinuousState, DiscreteValues, LeafSystem
from pydrake.systems.primitives import SymbolicVectorSystem

from simrob_drake.base.messages import compound, message
from simrob_drake.blocks.block import Block
from simrob_drake.blocks.written_net import SOURCE, WiredBlock, WrittenNet, output_places

_MOST_TERMS = 4000
"""Of a net as one expression: what several blocks read is written out, and computed, for each of them."""
_FINEST = 1e-5  # s, of a step that several periods share


def signal_net(blocks: Mapping[str, WiredBlock], measured: int, *, integrated: bool = True) -> LeafSystem:
    """Return a net of blocks as one system: in C++ unless blocks are sampled, or read each other too often.

    Drake asks expressions for their rates wherever anything is ``integrated``; elsewhere they need no state for that.

    Ports:
        in  the ``measured`` values, if there are any.
        out the outputs of all blocks, one after the other.

    Raises:
        graphlib.CycleError: an algebraic loop.
        ValueError: periods without a common step.
    """
    order = _sorted(blocks, measured)
    if any(one.block.period for one in blocks.values()) or _terms(blocks, measured, order) > _MOST_TERMS:
        return SignalNet(blocks, measured)
    return _symbolic(list(blocks.values()), measured, order, integrated=integrated)


def _sorted(blocks: Mapping[str, WiredBlock], measured: int) -> list[int]:
    names, places = list(blocks), output_places(list(blocks.values()), measured)
    owner = {place: name for name, found in zip(names, places, strict=True) for place in range(found.start, found.stop)}
    graph = {
        name: [owner[place] for terms in one.inputs for place, _ in terms if place in owner and one.block.fed_through]
        for name, one in blocks.items()
    }
    number = {name: place for place, name in enumerate(names)}
    return [number[name] for name in TopologicalSorter(graph).static_order()]


def _terms(blocks: Mapping[str, WiredBlock], measured: int, order: Sequence[int]) -> int:
    """Return how many terms a net has as expressions of what is measured."""
    wired, places = list(blocks.values()), output_places(list(blocks.values()), measured)
    counts = [1] * (places[-1].stop if places else 2)

    def taken(one: WiredBlock) -> int:
        return sum(counts[place] for terms in one.inputs for place, _ in terms)

    for number in order:
        block = wired[number].block
        if block.fed_through:
            each = 1 + taken(wired[number]) * block.repeats
            counts[places[number]] = [min(each, _MOST_TERMS)] * block.size
    return sum(counts) + sum(taken(one) * one.block.repeats for one in wired if one.block.start)


def _symbolic(wired: Sequence[WiredBlock], measured: int, order: Sequence[int], *, integrated: bool) -> LeafSystem:
    """Return a net of continuous blocks as Drake's own system of expressions, whose states are 0 at the start."""
    time, zero = Variable("t"), Expression(0.0)
    inputs = [Variable(f"u{number}") for number in range(measured)]
    values: list[Any] = [1.0, Expression(time), *map(Expression, inputs)]
    values += [zero] * sum(one.block.size for one in wired)
    places = output_places(wired, measured)
    states = [[Variable(f"x{number}_{k}") for k in range(len(one.block.start))] for number, one in enumerate(wired)]
    current = [[start + x for start, x in zip(one.block.start, own, strict=True)]
               for one, own in zip(wired, states, strict=True)]  # fmt: skip

    def taken(number: int) -> list[Any]:
        return [sum((k * values[place] for place, k in terms), start=zero) for terms in wired[number].inputs]

    for number in order:
        block = wired[number].block
        u = taken(number) if block.fed_through else []
        values[places[number]] = [zero + value for value in block.output(values[1], current[number], u)]
    rates = [
        zero + rate
        for number, one in enumerate(wired)
        if one.block.start
        for rate in one.block.following(current[number], taken(number))
    ]
    every = [x for own in states for x in own]
    if integrated and not every:
        every, rates = [Variable("none")], [zero]
    return SymbolicVectorSystem(
        time=time, state=every, input=inputs, dynamics=rates, output=values[2 + measured :], time_period=0.0
    )


def _common_step(periods: Sequence[float]) -> float:
    """Return the longest step of which all periods are multiples; a ValueError without one long enough."""
    exact = [Fraction(period).limit_denominator(1_000_000) for period in periods]
    below = reduce(lcm, (one.denominator for one in exact), 1)
    step = Fraction(reduce(gcd, (int(one * below) for one in exact)), below)
    if step < _FINEST or any(
        abs(float(one) - period) > 1e-9 * period for one, period in zip(exact, periods, strict=True)
    ):
        listed = ", ".join(f"{period:g}" for period in sorted(set(periods)))
        raise ValueError(message("blocks.periods_of", "periods of {periods} s", periods=listed))
    return float(step)


class SignalNet(Block):
    """Compute a net of blocks in the order in which they depend on each other, by Python that is written out of them.

    Continuous blocks share the station's integration. Sampled ones, whose periods are multiples of a common step, take
    their samples together, each with what the blocks before it give at that very time, and hold their outputs between.

    Ports:
        in  ``measured`` (m).
        out ``values``: the outputs of all blocks, one after the other.
    """

    def __init__(self, blocks: Mapping[str, WiredBlock], measured: int) -> None:
        """Make the block, of blocks by name and the size of what is measured.

        Raises:
            graphlib.CycleError: an algebraic loop.
            ValueError: periods without a common step.
        """
        super().__init__()
        self._input = self.DeclareVectorInputPort("measured", measured)
        wired = list(blocks.values())
        periods = {number: one.block.period for number, one in enumerate(wired) if one.block.period}
        step = _common_step(list(periods.values())) if periods else 0.0
        every = {number: round(period / step) for number, period in periods.items()}
        self._written = WrittenNet(wired, measured, _sorted(blocks, measured), every)
        self._names = list(blocks)
        if self._written.continuous:
            self.DeclareContinuousState(BasicVector(self._written.continuous))
        if periods:
            self.DeclareDiscreteState(np.array([0.0, *self._written.sampled]))  # the number of the sample stands first
            self.DeclarePeriodicDiscreteUpdateEvent(step, 0.0, self._sample)
        size = sum(one.block.size for one in wired)
        self._output = self.DeclareVectorOutputPort("values", size, self._give)

    def _known(self, context: Context) -> list[float]:
        return [1.0, context.get_time(), *(self._input.Eval(context).tolist() if self._input.size() else [])]

    def _states(self, context: Context) -> tuple[list[float], list[float]]:
        """Return the continuous states, and the number of the sample with what is sampled."""
        discrete = context.num_discrete_state_groups()
        kept = context.get_discrete_state_vector().CopyToVector().tolist() if discrete else [0.0]
        return context.get_continuous_state_vector().CopyToVector().tolist(), kept

    def _computed(self, part: str, *known: Any) -> list[float]:
        """Return what a function of the net gives; RuntimeError: a block that cannot be computed."""
        try:
            found: list[float] = self._written.functions[part](*known)
        except (ArithmeticError, ValueError) as problem:
            steps = walk_tb(problem.__traceback__)
            frame, line = next(step for step in steps if step[0].f_code.co_filename == SOURCE)
            number, taken = self._written.at(line)
            text = message(
                "blocks.block_cannot_compute",
                "the block {block} cannot be computed of {values}",
                block=self._names[number],
                values=[frame.f_locals[name] for name in taken],
            )
            raise RuntimeError(compound("{message}: {problem}", message=text, problem=problem)) from problem
        return found

    def _give(self, context: Context, output: BasicVector) -> None:
        x, (_, *held) = self._states(context)
        output.SetFromVector(self._computed("outputs", self._known(context), x, held, None))

    def DoCalcTimeDerivatives(self, context: Context, derivatives: ContinuousState) -> None:  # noqa: N802 - Drake's
        """Work out how the continuous states change."""
        if derivatives.size():
            values = [*self._known(context), *self._output.Eval(context).tolist()]
            derivatives.SetFromVector(self._computed("rates", values, self._states(context)[0]))

    def _sample(self, context: Context, discrete: DiscreteValues) -> None:
        known, (x, (count, *held)) = self._known(context), self._states(context)
        values = self._computed("outputs", known, x, held, count)
        discrete.set_value([count + 1, *self._computed("following", [*known, *values], held, count)])
