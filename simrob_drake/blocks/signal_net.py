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
from pydrake.systems.framework import (
    BasicVector,
    Context,
    ContinuousState,
    DiagramBuilder,
    DiscreteValues,
    InputPort,
    LeafSystem,
    OutputPort,
    System,
)
from pydrake.systems.primitives import PassThrough, Selector, SelectorParams, SymbolicVectorSystem

from simrob_drake.blocks.block import Block, fed
from simrob_drake.lifetime import built

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
_MOST_INLINE = 20  # terms of a block of a larger net; what it reads is computed before it otherwise
_FINEST = 1e-5  # s, of a step that several periods share


def signal_net(blocks: Mapping[str, WiredBlock], measured: int, *, integrated: bool = True) -> System:
    """Return a net of blocks as one system: in C++ unless blocks are sampled.

    Drake asks expressions for their rates wherever anything is ``integrated``; elsewhere they need no state for that.

    Ports:
        in  the ``measured`` values, if there are any.
        out the outputs of all blocks, one after the other.

    Raises:
        graphlib.CycleError: an algebraic loop.
        ValueError: periods without a common step.
    """
    order = _sorted(blocks, measured)
    if any(one.block.period for one in blocks.values()):
        return SignalNet(blocks, measured)
    if _terms(blocks, measured, order) > _MOST_TERMS:
        return StagedNet(list(blocks.values()), measured, order).diagram(integrated=integrated)
    return _symbolic(list(blocks.values()), measured, order, integrated=integrated)


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


def _symbolic(wired: Sequence[WiredBlock], measured: int, order: Sequence[int], *, integrated: bool) -> LeafSystem:
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
    every = [x for own in states for x in own]
    if integrated and not every:
        every, rates = [Variable("none")], [zero]
    return SymbolicVectorSystem(
        time=time, state=every, input=inputs, dynamics=rates, output=values[2 + measured :], time_period=0.0
    )


class StagedNet:
    """A large net of continuous blocks: systems of short expressions, each of what those before it give."""

    def __init__(self, wired: Sequence[WiredBlock], measured: int, order: Sequence[int]) -> None:
        """Sort the blocks into stages; a block is written out for those of its own stage that read it."""
        self._wired, self._first = wired, 2 + measured
        self._places = _places({str(number): one for number, one in enumerate(wired)}, measured)
        self._known = [Variable(f"v{place}") for place in range(self._places[-1].stop)]
        self._states = [[Variable(f"x{number}") for _ in one.block.start] for number, one in enumerate(wired)]
        self._time, self._stages = Variable("t"), list[dict[int, Any]]()  # of each stage: expressions by place
        self._stage, self._terms = [-1] * len(self._known), [1] * len(self._known)
        self._builder, self._sources = DiagramBuilder(), dict[int, tuple[OutputPort, int]]()
        self._waiting: list[tuple[InputPort, list[Variable]]] = []
        for number in order:
            self._sort(number)

    def _sort(self, number: int) -> None:
        block, own = self._wired[number].block, self._places[number]
        read = [place for terms in self._wired[number].inputs for place, _ in terms] if block.fed_through else []
        stage = max([0, *(self._stage[place] for place in read)])
        near = [place for place in read if self._stage[place] == stage]
        terms = 1 + block.repeats * (len(read) + sum(self._terms[place] - 1 for place in near))
        if near and terms > _MOST_INLINE:
            stage, terms = stage + 1, 1 + block.repeats * len(read)
        if stage == len(self._stages):
            self._stages.append({})
        inputs = self._taken(number, self._stages[stage]) if block.fed_through else []
        output = block.output(Expression(self._time), self._current(number), inputs)
        self._stages[stage] |= {own.start + index: Expression(0.0) + value for index, value in enumerate(output)}
        self._stage[own], self._terms[own] = [stage] * block.size, [terms] * block.size

    def _current(self, number: int) -> list[Any]:
        return [start + x for start, x in zip(self._wired[number].block.start, self._states[number], strict=True)]

    def _taken(self, number: int, near: Mapping[int, Any]) -> list[Any]:
        """Return the inputs of a block: what is near as it is computed, the rest as it is given."""
        fixed = {0: 1.0, 1: Expression(self._time), **near}
        return [
            sum((k * fixed.get(place, self._known[place]) for place, k in terms), start=Expression(0.0))
            for terms in self._wired[number].inputs
        ]

    def diagram(self, *, integrated: bool = True) -> System:
        """Return the systems as one; see :func:`signal_net`."""
        if self._first > 2:
            measured = self._builder.AddSystem(PassThrough(self._first - 2))
            self._builder.ExportInput(measured.get_input_port(), "measured")
            self._give(measured, self._known[2 : self._first])
        held = [x for own in self._states for x in own]
        rates = [Expression(0.0) + rate for number, one in enumerate(self._wired) if one.block.start
                 for rate in one.block.following(self._current(number), self._taken(number, {}))]  # fmt: skip
        if held:
            self._give(self._system(list(map(Expression, held)), held, rates), held)
        for stage in self._stages:
            none = [Variable("none")] if integrated else []
            system = self._system(list(stage.values()), none, [Expression(0.0) for _ in none])
            self._give(system, [self._known[place] for place in stage])
        for port, variables in self._waiting:
            self._builder.Connect(self._selected(variables), port)
        self._builder.ExportOutput(self._selected(self._known[self._first :]), "values")
        return built(self._builder)

    def _system(self, output: list[Any], state: Sequence[Variable], dynamics: Sequence[Any]) -> System:
        """Add a system of expressions, which is to be connected to what they read."""
        read = {one.get_id(): one for part in (*dynamics, *output) for one in part.GetVariables()}
        for own in (self._time, *state):
            read.pop(own.get_id(), None)
        parameters = {"input": list(read.values()), "dynamics": dynamics, "output": output, "time_period": 0.0}
        system = self._builder.AddSystem(SymbolicVectorSystem(time=self._time, state=state, **parameters))
        if read:
            self._waiting.append((system.get_input_port(), list(read.values())))
        return system

    def _give(self, system: System, variables: Sequence[Variable]) -> None:
        port = system.get_output_port()
        self._sources |= {one.get_id(): (port, index) for index, one in enumerate(variables)}

    def _selected(self, variables: Sequence[Variable]) -> OutputPort:
        """Return what variables are given as, as one vector."""
        sources = [self._sources[one.get_id()] for one in variables]
        ports = list({id(port): port for port, _ in sources}.values())
        number = {id(port): place for place, port in enumerate(ports)}
        chosen = [
            SelectorParams.OutputSelection(input_port_index=number[id(port)], input_offset=index)
            for port, index in sources
        ]
        inputs = [
            SelectorParams.InputPortParams(name=f"u{place}", size=port.size()) for place, port in enumerate(ports)
        ]
        outputs = [SelectorParams.OutputPortParams(name="y", selections=chosen)]
        selector = Selector(SelectorParams(inputs=inputs, outputs=outputs))
        return fed(self._builder, f"selected_{len(self._builder.GetSystems())}", selector, *ports)


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
