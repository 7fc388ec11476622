"""A net of small blocks, computed as one: whatever is drawn between what is measured and what is commanded."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import reduce
from graphlib import TopologicalSorter
from itertools import accumulate, pairwise
from math import gcd, lcm
from typing import Any, Protocol

import numpy as np
from pydrake.symbolic import Expression, Variable
from pydrake.systems.framework import BasicVector, Context, ContinuousState, DiscreteValues, LeafSystem
from pydrake.systems.primitives import SymbolicVectorSystem

from simrob_drake.blocks.block import Block

Values = Sequence[float]


class NetBlock(Protocol):
    """What a block of a net does; see :mod:`simrob_drake.parts.controllers.flow_blocks`."""

    @property
    def period(self) -> float:
        """Between samples [s]; 0 of a continuous block."""

    @property
    def size(self) -> int:
        """How many elements its output has."""

    @property
    def start(self) -> Values:
        """Its states at the start."""

    @property
    def fed_through(self) -> bool:
        """Whether its output depends on its inputs at the same time."""

    @property
    def repeats(self) -> int:
        """How often an input stands in its equation."""

    def output(self, t: float, x: Values, u: Values) -> Values:
        """Return its output by the time [s], its states and its inputs."""

    def following(self, x: Values, u: Values) -> Values:
        """Return the derivatives of its states, or their next values."""


Terms = Sequence[tuple[int, float]]
"""A sum: places among the values, with factors."""


@dataclass(frozen=True)
class WiredBlock:
    """A block with its inputs, sums of values: first 1, the time [s], what is measured, then the outputs of blocks."""

    block: NetBlock
    inputs: Sequence[Terms]


_MOST_TERMS = 4000
"""Of a net as one expression: what several blocks read is written out, and computed, for each of them."""
_FINEST = 1e-5  # s, of a step that several periods share


def signal_net(blocks: Mapping[str, WiredBlock], measured: int) -> LeafSystem:
    """Return a net of blocks as one system: in C++ unless blocks are sampled, or read each other too often.

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
    return _symbolic(list(blocks.values()), measured, order)


def _places(blocks: Mapping[str, WiredBlock], measured: int) -> list[slice]:
    ends = accumulate((one.block.size for one in blocks.values()), initial=2 + measured)
    return [slice(*pair) for pair in pairwise(ends)]


def _sorted(blocks: Mapping[str, WiredBlock], measured: int) -> list[int]:
    names, places = list(blocks), _places(blocks, measured)
    owner = {place: name for name, found in zip(names, places, strict=True) for place in range(found.start, found.stop)}
    graph = {
        name: [owner[place] for terms in one.inputs for place, _ in terms if place in owner and one.block.fed_through]
        for name, one in blocks.items()
    }
    number = {name: place for place, name in enumerate(names)}
    return [number[name] for name in TopologicalSorter(graph).static_order()]


def _terms(blocks: Mapping[str, WiredBlock], measured: int, order: Sequence[int]) -> int:
    """Return how many terms a net has as expressions of what is measured."""
    wired, places = list(blocks.values()), _places(blocks, measured)
    counts = [1] * (places[-1].stop if places else 2)

    def taken(one: WiredBlock) -> int:
        return sum(counts[place] for terms in one.inputs for place, _ in terms)

    for number in order:
        block = wired[number].block
        if block.fed_through:
            each = 1 + taken(wired[number]) * block.repeats
            counts[places[number]] = [min(each, _MOST_TERMS)] * block.size
    return sum(counts) + sum(taken(one) * one.block.repeats for one in wired if one.block.start)


def _symbolic(wired: Sequence[WiredBlock], measured: int, order: Sequence[int]) -> LeafSystem:
    """Return a net of continuous blocks as Drake's own system of expressions, whose states are 0 at the start."""
    time, zero = Variable("t"), Expression(0.0)
    inputs = [Variable(f"u{number}") for number in range(measured)]
    values: list[Any] = [1.0, Expression(time), *map(Expression, inputs)]
    values += [zero] * sum(one.block.size for one in wired)
    places = _places({str(number): one for number, one in enumerate(wired)}, measured)
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
    every = [x for own in states for x in own] or [Variable("none")]  # Drake asks one without states for its rates, too
    return SymbolicVectorSystem(
        time=time, state=every, input=inputs, dynamics=rates or [zero], output=values[2 + measured :], time_period=0.0
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
        raise ValueError(f"periods of {listed} s")
    return float(step)


class SignalNet(Block):
    """Compute a net of blocks in the order in which they depend on each other.

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
        self._places = _places(blocks, measured)
        self._blocks, self._first = wired, 2 + measured
        self._names = list(blocks)
        self._order = _sorted(blocks, measured)
        self._states: dict[int, slice] = {}
        starts: tuple[list[float], list[float]] = [], []  # continuous, sampled: states and what is held
        for number, one in enumerate(wired):
            start = [*one.block.start, *([0.0] * one.block.size if one.block.period else [])]
            kept = starts[one.block.period > 0]
            self._states[number] = slice(len(kept), len(kept) + len(start))
            kept.extend(start)
        if starts[0]:
            self.DeclareContinuousState(BasicVector(starts[0]))
        periods = {number: one.block.period for number, one in enumerate(wired) if one.block.period}
        self._every: dict[int, int] = {}
        if periods:
            step = _common_step(list(periods.values()))
            self._every = {number: round(period / step) for number, period in periods.items()}
            self.DeclareDiscreteState(np.array([0.0, *starts[1]]))  # the number of the sample stands first
            self.DeclarePeriodicDiscreteUpdateEvent(step, 0.0, self._sample)
        self._output = self.DeclareVectorOutputPort("values", self._places[-1].stop - self._first, self._give)

    def _inputs(self, number: int, values: Values) -> Values:
        return [sum(factor * values[place] for place, factor in terms) for terms in self._blocks[number].inputs]

    def _known(self, context: Context) -> list[float]:
        return [1.0, context.get_time(), *(self._input.Eval(context).tolist() if self._input.size() else [])]

    def _computed(self, context: Context, *, sampled: bool = False) -> tuple[list[float], list[float], list[float]]:
        """Return all values at a time, the continuous states, and the sampled ones; at a sample with its outputs."""
        x = context.get_continuous_state_vector().CopyToVector().tolist()
        kept = context.get_discrete_state_vector().CopyToVector().tolist() if self._every else []
        values = [*self._known(context), *[0.0] * (self._places[-1].stop - self._first)]
        for number in self._order:
            block = self._blocks[number].block
            own = (kept[1:] if block.period else x)[self._states[number]]
            if block.period and not (sampled and kept[0] % self._every[number] == 0):
                values[self._places[number]] = own[len(block.start) :]
                continue
            u = self._inputs(number, values) if block.fed_through else ()
            try:
                values[self._places[number]] = block.output(values[1], own[: len(block.start)], u)
            except (ArithmeticError, ValueError) as problem:
                message = f"the block {self._names[number]} cannot be computed of {u}: {problem}"
                raise RuntimeError(message) from problem
        return values, x, kept

    def _give(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._computed(context)[0][self._first :])

    def DoCalcTimeDerivatives(self, context: Context, derivatives: ContinuousState) -> None:  # noqa: N802 - Drake's
        """Work out how the continuous states change."""
        if not derivatives.size():
            return
        values = [*self._known(context), *self._output.Eval(context).tolist()]
        x = context.get_continuous_state_vector().CopyToVector().tolist()
        rates = [0.0] * len(x)
        for number, one in enumerate(self._blocks):
            if not one.block.period and one.block.start:
                place = self._states[number]
                rates[place] = one.block.following(x[place], self._inputs(number, values))
        derivatives.SetFromVector(rates)

    def _sample(self, context: Context, discrete: DiscreteValues) -> None:
        values, _, kept = self._computed(context, sampled=True)
        following = list(kept)
        for number, every in self._every.items():
            if kept[0] % every == 0:
                place, block = self._states[number], self._blocks[number].block
                own = kept[1:][place][: len(block.start)]
                changed = [*block.following(own, self._inputs(number, values)), *values[self._places[number]]]
                following[place.start + 1 : place.stop + 1] = changed
        discrete.set_value([kept[0] + 1, *following[1:]])
