"""A block that looks around once a sample: what it remembers, by name, is discrete state; outputs are parts of it."""

from abc import abstractmethod
from collections.abc import Callable, Collection, Mapping
from types import MappingProxyType

import numpy as np
from pydrake.systems.framework import Context, DiscreteValues, EventStatus

from simrob_drake.blocks.block import Block
from simrob_drake.frames import Vector

Named = Mapping[str, Vector]
"""Vectors by name: what a block remembers, reads or gives."""
Changes = Mapping[str, Vector | float]
"""What changes in a block's memory, by name; a number is a vector of one."""

_ASLEEP, _SAMPLED, _AWAKE = 0.0, 1.0, 2.0
"""Before the first sample; after one that was taken before the run began; afterwards."""


class RunEnds(Exception):
    """What a sampled block raises to end the run, with the reason."""


class _Looked(dict[str, Vector]):
    """Vectors by name that are looked at when they are needed: looking is most of what a sample costs."""

    def __init__(self, look: Callable[[str], Vector]) -> None:
        super().__init__()
        self._look = look

    def __missing__(self, name: str) -> Vector:
        value = self[name] = self._look(name)
        return value


class SampledBlock(Block):
    """What sensors that sample and loops share.

    Between the samples nothing is asked: Drake hands the outputs on by itself.

    Ports:
        in  as the block says; each has the name of what it reads.
        out the parts of its memory that the block names, perhaps as they were some samples ago.
    """

    units: Mapping[str, str] = MappingProxyType({})
    """The unit of each output that is a signal; ``1`` unless named."""

    def __init__(
        self,
        *,
        period: float,
        reads: Mapping[str, int],
        memory: Mapping[str, Vector],
        gives: Collection[str],
        delay: int = 0,
        at_once: bool = False,
    ) -> None:
        """Make the block.

        Args:
            period: between samples [s].
            reads: the sizes of its inputs, by name.
            memory: what it remembers at the start, by name.
            gives: the parts of its memory that are outputs.
            delay: by how many samples the outputs are late; until then they are those of the first sample.
            at_once: take the first sample before the run begins, so that others can read it in their own first one.
        """
        super().__init__()
        self.period, self._delay = period, delay
        self._inputs = {name: self.DeclareVectorInputPort(name, size) for name, size in reads.items()}
        self._memory = {name: self.DeclareDiscreteState(np.atleast_1d(value)) for name, value in memory.items()}
        self._late = {}
        for name in gives:
            told = self._memory[name]
            if delay:
                value = np.atleast_1d(memory[name])
                waiting = self.DeclareDiscreteState(np.full(delay * len(value), np.inf))
                told = self.DeclareDiscreteState(value)
                self._late[name] = waiting, told
            self.DeclareStateOutputPort(name, told)
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._update)
        self._stage = self.DeclareDiscreteState(np.array([_ASLEEP])) if at_once else None
        if at_once:
            self.DeclareInitializationDiscreteUpdateEvent(self._begin)

    @abstractmethod
    def sample(self, memory: Named, read: Named) -> Changes:
        """Return what changes in the memory at a sample, by what is read; the equation of the block.

        Raises:
            RunEnds: the run is to end.
        """

    def _begin(self, context: Context, discrete: DiscreteValues) -> EventStatus | None:
        assert self._stage is not None  # only then is this asked
        if context.get_discrete_state(self._stage).value()[0] != _ASLEEP:
            return EventStatus.DidNothing()  # it goes on from another run, or in another diagram
        status = self._update(context, discrete)
        discrete.set_value(self._stage, np.array([_SAMPLED]))
        return status

    def _update(self, context: Context, discrete: DiscreteValues) -> EventStatus | None:
        if self._stage is not None:
            stage = context.get_discrete_state(self._stage).value()[0]
            discrete.set_value(self._stage, np.array([_AWAKE]))
            if stage == _SAMPLED:  # this very moment, before the run began
                return None
        groups, inputs = self._memory, self._inputs
        memory = _Looked(lambda name: context.get_discrete_state(groups[name]).value())
        read = _Looked(lambda name: inputs[name].Eval(context))
        try:
            changed = self.sample(memory, read)
        except RunEnds as reason:
            return EventStatus.ReachedTermination(self, str(reason))
        for name, value in changed.items():
            discrete.set_value(self._memory[name], np.atleast_1d(value))
        for name, (waiting, told) in self._late.items():
            now = np.atleast_1d(changed[name] if name in changed else memory[name])
            line = context.get_discrete_state(waiting).value().reshape(self._delay, len(now))
            line = np.tile(now, (self._delay, 1)) if np.isinf(line).any() else line  # the first sample
            discrete.set_value(waiting, np.vstack([line[1:], now]).ravel())
            discrete.set_value(told, line[0])
        return None
