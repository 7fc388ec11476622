"""A block that looks around once a sample: what it remembers, by name, is discrete state; outputs are parts of it."""

import math
from abc import abstractmethod
from collections.abc import Collection, Mapping, Sequence
from itertools import pairwise
from types import MappingProxyType
from typing import Any

import numpy as np
from pydrake.systems.framework import Context, DiscreteValues, EventStatus

from simrob_drake.blocks.block import Block
from simrob_drake.frames import Vector

Named = Mapping[str, Vector]
"""Vectors by name: what a block remembers, reads or gives."""
Changes = Mapping[str, Vector | float]
"""What changes in a block's memory, by name; a number is a vector of one."""
TIME = "time"
"""What every block reads beside its inputs: since the run began, a vector of one [s]."""

_ASLEEP, _SAMPLED, _AWAKE = 0.0, 1.0, 2.0
"""Before the first sample; after one that was taken before the run began; afterwards."""


class RunEnds(Exception):
    """What a sampled block raises to end the run, with the reason."""


class BlockFails(Exception):
    """What a sampled block raises that cannot go on: the run ends as one that failed.

    Attributes:
        block: its name.
    """

    def __init__(self, block: str, why: str) -> None:
        super().__init__(why)
        self.block = block


class _Remembered(dict[str, Vector]):
    """What a block remembers by name, looked at when it is needed: looking is most of what a sample costs.

    All are copies, which a block may keep: a view would hold on to a context that is Drake's, and is gone with the run.
    """

    def __init__(self, values: DiscreteValues, own: Mapping[str, int], group: int, kept: Mapping[str, slice]) -> None:
        self._values, self._own, self._group, self._kept = values, own, group, kept

    def __missing__(self, name: str) -> Vector:
        if name in self._own:
            known: dict[str, Vector] = {name: self._values.value(self._own[name]).copy()}
        else:
            whole = self._values.value(self._group).copy()
            known = {name: whole[part] for name, part in self._kept.items()}
        self.update(known)
        return known[name]


class _Read(dict[str, Vector]):
    """What a block reads by name, likewise."""

    def __init__(self, block: Block, context: Context, inputs: Mapping[str, int]) -> None:
        self._block, self._context, self._inputs = block, context, inputs

    def __missing__(self, name: str) -> Vector:
        if name == TIME:
            value: Vector = np.array([self._context.get_time()])
        else:
            value = self._block.EvalVectorInput(self._context, self._inputs[name]).value().copy()
        self[name] = value
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
    components: Mapping[str, Sequence[str]] = MappingProxyType({})
    """What the numbers of an output are called in pictures, where they are not one for each axis."""

    def __init__(
        self,
        *,
        period: float,
        reads: Mapping[str, int],
        memory: Mapping[str, Vector | float],
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
        self._inputs = {name: self.DeclareVectorInputPort(name, size).get_index() for name, size in reads.items()}
        values = {name: np.atleast_1d(value) for name, value in memory.items()}
        self._reported, self._late = {name: self.DeclareDiscreteState(values.pop(name)) for name in gives}, {}
        for name, group in self._reported.items():
            if delay:
                value = np.atleast_1d(memory[name])
                waiting = self.DeclareDiscreteState(np.full(delay * len(value), np.inf))
                self._late[name] = waiting, self.DeclareDiscreteState(value)
            self.DeclareStateOutputPort(name, self._late[name][1] if delay else group)
        self.outputs = {name: int(self._late[name][1] if delay else group) for name, group in self._reported.items()}
        """The discrete group of its own that each output hands on, by the output's name."""
        ends = np.cumsum([0, *map(len, values.values())]).tolist()
        self._kept = {name: slice(*part) for name, part in zip(values, pairwise(ends), strict=True)}
        self._group = self.DeclareDiscreteState(np.concatenate([[], *values.values()]))  # one, for each takes time
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._update)
        self._stage = self.DeclareDiscreteState(np.array([_ASLEEP])) if at_once else None
        if at_once:
            self.DeclareInitializationDiscreteUpdateEvent(self._begin)

    @property
    def remembered(self) -> list[str]:
        """Names of the parts of its memory, outputs first."""
        return [*self._reported, *self._kept]

    def arguments(self) -> dict[str, Any]:
        """Arguments with which a block of the same ports, memory and timing can be made."""
        memory = self.now(self.CreateDefaultContext())[0]
        return {
            "period": self.period,
            "reads": {name: self.get_input_port(index).size() for name, index in self._inputs.items()},
            "memory": {name: memory[name] for name in self.remembered},
            "gives": [*self._reported],
            "delay": self._delay,
            "at_once": self._stage is not None,
        }

    @abstractmethod
    def sample(self, memory: Named, read: Named) -> Changes:
        """Return what changes in the memory at a sample, by what is read; the equation of the block.

        Raises:
            RunEnds: the run is to end.
            BlockFails: it cannot go on.
        """

    def now(self, context: Context) -> tuple[Named, Named]:
        """Return what the block remembers in a context of its own, and what it reads there, by name."""
        memory = _Remembered(context.get_discrete_state(), self._reported, self._group, self._kept)
        return memory, _Read(self, context, self._inputs)

    def remember(self, context: Context, changes: Changes) -> None:
        """Change what the block remembers in a context of its own, between its samples."""
        self._set(changes, self.now(context)[0], context, context.get_mutable_discrete_state())

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
        memory, read = self.now(context)
        try:
            changed = self.sample(memory, read)
        except RunEnds as reason:
            return EventStatus.ReachedTermination(self, str(reason))
        if changed or self._late:
            self._set(changed, memory, context, discrete)
        return None

    def _set(self, changed: Changes, memory: Named, context: Context, discrete: DiscreteValues) -> None:
        kept = discrete.get_mutable_value(self._group)
        for name, value in changed.items():
            if name in self._kept:
                kept[self._kept[name]] = value
            else:  # Drake takes a list ten times as long as an array
                discrete.set_value(self._reported[name], value if isinstance(value, np.ndarray) else np.array([value]))
        for name, (waiting, group) in self._late.items():
            now = np.atleast_1d(changed[name] if name in changed else memory[name])
            line = context.get_discrete_state(waiting).value()
            line = np.tile(now, self._delay) if math.isinf(line[-1]) else line  # the first sample
            discrete.set_value(waiting, np.concatenate([line[len(now) :], now]))
            discrete.set_value(group, line[: len(now)])
