"""A loop around the servos: a block that looks at its station once a sample, and holds what it asks in between."""

from abc import abstractmethod
from collections.abc import Collection, Mapping

import numpy as np
from pydrake.common.value import AbstractValue, Value
from pydrake.systems.framework import Context, DiscreteValues, EventStatus, InputPortIndex

from simrob_drake.blocks.block import Block
from simrob_drake.frames import Vector
from simrob_drake.lifetime import weakly

Named = Mapping[str, Vector]
"""Vectors by name: what a loop remembers, reads or gives."""
Changes = Mapping[str, Vector | float]
"""What changes in a loop's memory, by name; a number is a vector of one."""


class LoopEnds(Exception):
    """What a loop raises to end the run, with the reason."""


class Loop(Block):
    """What loops share: all that one remembers is discrete state, by name, and its outputs are part of that.

    Nothing of it is asked between the samples: Drake hands the outputs on by itself.

    Ports:
        in  as the loop says; each has the name of what it reads.
        out the parts of its memory that the loop names; with ``active`` (1) among its memory also ``layer``, an index
        for Drake's PortSwitch: that of its second input while ``active`` is not zero (its first port is the selector).
    """

    units: Mapping[str, str]
    """The unit of each output; ``1`` unless named."""

    def __init__(self, *, period: float, reads: Mapping[str, int], memory: Named, gives: Collection[str]) -> None:
        """Make the block.

        Args:
            period: between samples [s].
            reads: the sizes of its inputs, by name.
            memory: what it remembers at the start, by name.
            gives: the parts of its memory that are outputs.
        """
        super().__init__()
        self.period = period
        self._reads = {name: self.DeclareVectorInputPort(name, size).get_index() for name, size in reads.items()}
        self._memory = {name: self.DeclareDiscreteState(np.atleast_1d(value)) for name, value in memory.items()}
        for name in gives:
            self.DeclareStateOutputPort(name, self._memory[name])
        if "active" in self._memory:
            index = AbstractValue.Make(InputPortIndex(1))
            self.DeclareAbstractOutputPort("layer", index.Clone, weakly(self._calc_layer), {self.xd_ticket()})
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._update)

    @abstractmethod
    def sample(self, memory: Named, read: Named) -> Changes:
        """Return what changes in the memory at a sample, by what is read; the equation of the loop.

        Raises:
            LoopEnds: the run is to end.
        """

    def _update(self, context: Context, discrete: DiscreteValues) -> EventStatus:
        memory = {name: context.get_discrete_state(group).value() for name, group in self._memory.items()}
        read = {name: self.get_input_port(index).Eval(context) for name, index in self._reads.items()}
        try:
            changed = self.sample(memory, read)
        except LoopEnds as reason:
            return EventStatus.ReachedTermination(self, str(reason))
        for name, value in changed.items():
            discrete.set_value(self._memory[name], np.atleast_1d(value))
        return EventStatus.Succeeded()

    def _calc_layer(self, context: Context, output: Value[InputPortIndex]) -> None:
        active = context.get_discrete_state(self._memory["active"]).value()[0] != 0
        output.set_value(InputPortIndex(2 if active else 1))
