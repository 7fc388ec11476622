"""A net of small blocks, computed as one: whatever is drawn between what is measured and what is commanded."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from graphlib import TopologicalSorter
from itertools import accumulate, pairwise
from typing import Protocol

import numpy as np
from pydrake.systems.framework import BasicVector, Context, ContinuousState, DiscreteValues

from simrob_drake.blocks.block import Block

Values = Sequence[float]


class NetBlock(Protocol):
    """What a block of a net does; see :mod:`simrob_drake.parts.controllers.flow_block`."""

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

    def output(self, t: float, x: Values, u: Values) -> Values:
        """Return its output by the time [s], its states and its inputs."""

    def following(self, x: Values, u: Values) -> Values:
        """Return the derivatives of its states, or their next values."""


Terms = Sequence[tuple[int, float]]
"""A sum: places among the values, with factors."""


@dataclass(frozen=True)
class Wired:
    """A block with its inputs, sums of values: first 1, the time [s], what is measured, then the outputs of blocks."""

    block: NetBlock
    inputs: Sequence[Terms]


class SignalNet(Block):
    """Compute a net of blocks in the order in which they depend on each other.

    Continuous blocks share the station's integration. Sampled ones, whose periods are multiples of the shortest, take
    their samples together, each with what the blocks before it give at that very time, and hold their outputs between.

    Ports:
        in  ``measured`` (m).
        out ``values``: the outputs of all blocks, one after the other.
    """

    def __init__(self, blocks: Mapping[str, Wired], measured: int) -> None:
        """Make the block, of blocks by name and the size of what is measured.

        Raises:
            graphlib.CycleError: an algebraic loop.
            ValueError: a period that is no multiple of the shortest.
        """
        super().__init__()
        self._input = self.DeclareVectorInputPort("measured", measured)
        wired = list(blocks.values())
        ends = list(accumulate((one.block.size for one in wired), initial=2 + measured))
        self._places = [slice(*pair) for pair in pairwise(ends)]
        self._blocks, self._first = wired, 2 + measured
        self._names = list(blocks)
        self._order = self._sorted(self._names, ends)
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
        shortest = min(periods.values(), default=0.0)
        self._every = {number: round(period / shortest) for number, period in periods.items()}
        if periods:
            if any(abs(self._every[number] * shortest - period) > 1e-9 * period for number, period in periods.items()):
                raise ValueError(f"periods of {', '.join(f'{p:g}' for p in sorted(set(periods.values())))} s")
            self.DeclareDiscreteState(np.array([0.0, *starts[1]]))  # the number of the sample stands first
            self.DeclarePeriodicDiscreteUpdateEvent(shortest, 0.0, self._sample)
        self._output = self.DeclareVectorOutputPort("values", ends[-1] - self._first, self._give)

    def _sorted(self, names: Sequence[str], ends: Sequence[int]) -> list[int]:
        """Return the places of the blocks in the order of computation."""
        owner = {place: number for number, found in enumerate(self._places) for place in range(found.start, found.stop)}
        graph: dict[str, list[str]] = {}
        for number, one in enumerate(self._blocks):
            terms = [place for given in one.inputs for place, _ in given] if one.block.fed_through else []
            graph[names[number]] = [names[owner[place]] for place in terms if place in owner]
        return [names.index(name) for name in TopologicalSorter(graph).static_order()]

    def _inputs(self, number: int, values: Values) -> Values:
        return [sum(factor * values[place] for place, factor in given) for given in self._blocks[number].inputs]

    def _known(self, context: Context) -> list[float]:
        """Return the values before those of blocks."""
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
                told = f"the block {self._names[number]} cannot be computed of {u}: {problem}"
                raise RuntimeError(told) from problem
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
