"""Blocks that take samples: at every period they read their inputs and change their memory.

A sampled block has named vectors in its memory. Its outputs are some of these vectors, late by some samples if the
block has a delay. A subclass states what is read and remembered, and implements `SampledBlock.sample`: the changes at a
sample.
"""

import math
from abc import abstractmethod
from collections.abc import Collection, Mapping, Sequence
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from pydrake.systems.framework import Context, DiscreteStateIndex, DiscreteValues, EventStatus

from simrob_drake.base.frames import Vector
from simrob_drake.blocks.block import Block

Named = Mapping[str, Vector]
"""Vectors by name: the memory of a block, or what it reads."""
Changes = Mapping[str, Vector | float]
"""New values of parts of a block's memory, by name; a number is a vector with one entry. Other parts do not change."""
TIME = "time"
"""Name of the time since the run began, a vector with one entry [s]. Every block reads it in addition to its inputs."""

# Stages of a block that takes its first sample before the run begins.
_NO_SAMPLE = 0.0  # no sample was taken yet
_SAMPLED_EARLY = 1.0  # the first sample was taken before the run began
_RUNNING = 2.0  # the first period has passed


class RunEnds(Exception):
    """Raised by a sampled block to end the run; the text is the reason."""


class BlockFails(Exception):
    """Raised by a sampled block that cannot go on: the run ends as one that failed.

    Attributes:
        block: name of the block.
    """

    def __init__(self, block: str, why: str) -> None:
        super().__init__(why)
        self.block = block


class _Memory(dict[str, Vector]):
    """The memory of a block by name, which is read from Drake's context when a name is first looked up.

    Reading the context is most of the time that a sample takes. The vectors are copies, which a block may keep: a view
    would refer to a context that belongs to Drake, and is gone after the run.
    """

    def __init__(
        self,
        values: DiscreteValues,
        outputs: Mapping[str, DiscreteStateIndex],
        group: DiscreteStateIndex,
        slices: Mapping[str, slice],
    ) -> None:
        """Remember where the vectors are.

        Args:
            values: the discrete state of the block, which consists of groups.
            outputs: group of each vector that is an output, by name.
            group: group with all other vectors, one after the other.
            slices: entries of each other vector in that group, by name.
        """
        self._values = values
        self._outputs = outputs
        self._group = group
        self._slices = slices

    def __missing__(self, name: str) -> Vector:
        """Read a vector that was not looked up before, and keep it. All vectors of the common group are read at once.

        Raises:
            KeyError: there is no such vector.
        """
        if name in self._outputs:
            vectors: dict[str, Vector] = {name: self._values.value(self._outputs[name]).copy()}
        else:
            group_values = self._values.value(self._group).copy()
            vectors = {other: group_values[entries] for other, entries in self._slices.items()}
        self.update(vectors)
        return vectors[name]


class _Inputs(dict[str, Vector]):
    """The vectors that a block reads, by name, which are evaluated when a name is first looked up; all are copies."""

    def __init__(self, block: Block, context: Context, ports: Mapping[str, int]) -> None:
        """Remember where the vectors are.

        Args:
            block: the block.
            context: context of the block.
            ports: index of each input port, by name.
        """
        self._block = block
        self._context = context
        self._ports = ports

    def __missing__(self, name: str) -> Vector:
        """Evaluate an input that was not looked up before, or the time, and keep it.

        Raises:
            KeyError: there is no such input.
        """
        if name == TIME:
            value: Vector = np.array([self._context.get_time()])
        else:
            value = self._block.EvalVectorInput(self._context, self._ports[name]).value().copy()
        self[name] = value
        return value


class MemoryAndInputs(NamedTuple):
    """Memory and inputs of a block at one moment.

    Attributes:
        memory: the memory, by name.
        read: the inputs and the time, by name.
    """

    memory: Named
    read: Named


class _DelayLine(NamedTuple):
    """Groups of the discrete state that delay one output.

    Attributes:
        queue: values that wait, the oldest first, one after the other.
        output: the value that the output port gives.
    """

    queue: DiscreteStateIndex
    output: DiscreteStateIndex


class SampledBlock(Block):
    """Base class of blocks that take samples, such as sensors with a sampling rate and controllers.

    Between the samples nothing is computed: the outputs are discrete state of Drake.

    Ports:
        in  the vectors that the block reads, each by its name.
        out the parts of its memory that the block names, late by its delay.
    """

    units: Mapping[str, str] = MappingProxyType({})
    """Unit of each output that is a signal, by name; an output without an entry has the unit ``1``."""
    components: Mapping[str, Sequence[str]] = MappingProxyType({})
    """Names of the entries of an output in pictures, by the output's name, if there is not one entry for each axis."""

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
        """Declare the ports and the state of the block.

        Args:
            period: time between two samples [s].
            reads: sizes of its inputs, by name.
            memory: initial values of its memory, by name.
            gives: names of the parts of its memory that are outputs.
            delay: delay of the outputs, in samples. Until the first sample has passed through, they give its value;
                before the first sample they give their initial values.
            at_once: take the first sample before the run begins, so that other blocks can read it in their own first
                sample.
        """
        super().__init__()
        self.period = period
        self._delay = delay
        self._ports = {
            name: self.DeclareVectorInputPort(name, size).get_index()
            for name, size in reads.items()
        }
        initial = {name: np.atleast_1d(value) for name, value in memory.items()}

        # Each output has a group of the discrete state. A delayed output has two groups more.
        self._output_memory = {name: self.DeclareDiscreteState(initial[name]) for name in gives}
        self._delay_lines = dict[str, _DelayLine]()
        self.outputs = dict[str, int]()
        """Index of the group of the discrete state that each output port gives, by the output's name."""
        for name, memory_group in self._output_memory.items():
            port_group = memory_group
            if delay:
                self._delay_lines[name] = self._declare_delay_line(initial[name])
                port_group = self._delay_lines[name].output
            self.DeclareStateOutputPort(name, port_group)
            self.outputs[name] = int(port_group)

        # The rest of the memory is in one group, since each group takes time.
        rest = {name: value for name, value in initial.items() if name not in self._output_memory}
        self._slices = dict[str, slice]()
        begin = 0
        for name, value in rest.items():
            self._slices[name] = slice(begin, begin + len(value))
            begin += len(value)
        # The empty list makes the vector empty if nothing is left: `np.concatenate` needs at least one part.
        self._rest_group = self.DeclareDiscreteState(np.concatenate([[], *rest.values()]))

        # The offset 0 puts the first sample at the very start of the run.
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._update)
        self._stage = self.DeclareDiscreteState(np.array([_NO_SAMPLE])) if at_once else None
        if at_once:
            self.DeclareInitializationDiscreteUpdateEvent(self._sample_early)

    def set_output(self, context: Context, name: str, values: Vector) -> None:
        """Set the memory of an output in a context of the block. It stays until a sample changes it.

        Without a delay, the output's port gives these values at once. With a delay, the port keeps its value: the new
        ones enter the delay at the next sample, unless that sample changes them.

        Args:
            context: context of the block.
            name: name of the output, one of ``gives``.
            values: the new values, of the output's size.
        """
        context.SetDiscreteState(self._output_memory[name], values)

    def _declare_delay_line(self, initial: Vector) -> _DelayLine:
        """Declare the groups of the discrete state that delay an output, with its initial value (n,).

        The queue holds infinite numbers until the first sample, which fills the whole queue (see `_apply`).
        """
        queue = self.DeclareDiscreteState(np.full(self._delay * len(initial), np.inf))
        return _DelayLine(queue=queue, output=self.DeclareDiscreteState(initial))

    @property
    def memory_names(self) -> list[str]:
        """Names of the parts of its memory, outputs first."""
        return [*self._output_memory, *self._slices]

    def arguments(self) -> dict[str, Any]:
        """Arguments with which a block of the same ports, memory and timing can be made, in another process, say."""
        memory = self.now(self.CreateDefaultContext()).memory
        return {
            "period": self.period,
            "reads": {
                name: self.get_input_port(index).size() for name, index in self._ports.items()
            },
            "memory": {name: memory[name] for name in self.memory_names},
            "gives": [*self._output_memory],
            "delay": self._delay,
            "at_once": self._stage is not None,
        }

    @abstractmethod
    def sample(self, memory: Named, read: Named) -> Changes:
        """Compute the changes of the memory at a sample: the equation of the block.

        Args:
            memory: the memory before the sample, by name.
            read: the inputs and the time, by name.

        Raises:
            RunEnds: the run shall end.
            BlockFails: the block cannot go on.
        """

    def now(self, context: Context) -> MemoryAndInputs:
        """Memory and inputs of the block in a context of the block. They are read when a name is looked up."""
        return MemoryAndInputs(
            memory=_Memory(
                context.get_discrete_state(), self._output_memory, self._rest_group, self._slices
            ),
            read=_Inputs(self, context, self._ports),
        )

    def remember(self, context: Context, changes: Changes) -> None:
        """Change the memory of the block in a context of the block, between its samples.

        Delayed outputs move on by one sample. Before the first sample a delayed output shows the new value at once.

        Args:
            context: context of the block, which is changed.
            changes: new values of parts of the memory, by name.
        """
        self._apply(
            changes, self.now(context).memory, context, context.get_mutable_discrete_state()
        )

    def _sample_early(
        self,
        context: Context,
        discrete: DiscreteValues,
    ) -> EventStatus | None:
        """Take the first sample before the run begins, and write the new state to `discrete`.

        Nothing happens if the context is from a run that has begun already, which this run continues.
        """
        assert self._stage is not None  # the event is declared with the stage only
        if context.get_discrete_state(self._stage).value()[0] != _NO_SAMPLE:
            # The run goes on from the state of another run.
            return EventStatus.DidNothing()
        status = self._update(context, discrete)
        # In place of _RUNNING, which `_update` has written: so its call at the first moment of the run takes no sample.
        discrete.set_value(self._stage, np.array([_SAMPLED_EARLY]))
        return status

    def _update(self, context: Context, discrete: DiscreteValues) -> EventStatus | None:
        """Take a sample, and write the new state to `discrete`. A first sample that was taken early is not repeated.

        Returns:
            the status with which Drake ends the run if the sample raises :class:`RunEnds`, otherwise None.

        Raises:
            BlockFails: the block cannot go on.
        """
        if self._stage is not None:
            stage = context.get_discrete_state(self._stage).value()[0]
            discrete.set_value(self._stage, np.array([_RUNNING]))
            # The sample of this moment was taken before the run began.
            if stage == _SAMPLED_EARLY:
                return None
        present = self.now(context)
        # Drake ends a run by the status that an event returns: an exception would count as a failure.
        try:
            changes = self.sample(present.memory, present.read)
        except RunEnds as reason:
            return EventStatus.ReachedTermination(self, str(reason))
        if changes or self._delay_lines:
            self._apply(changes, present.memory, context, discrete)
        return None

    def _apply(
        self,
        changes: Changes,
        memory: Named,
        context: Context,
        discrete: DiscreteValues,
    ) -> None:
        """Write changes of the memory to a new state, and move delayed outputs on by one sample.

        Args:
            changes: new values of parts of the memory, by name.
            memory: memory before the sample, by name.
            context: context of the block, with the state before the sample.
            discrete: the new state, which is written to.
        """
        rest = discrete.get_mutable_value(self._rest_group)
        for name, value in changes.items():
            if name in self._slices:
                rest[self._slices[name]] = value
            else:
                # Drake takes an array in a tenth of the time of a list.
                vector = value if isinstance(value, np.ndarray) else np.array([value])
                discrete.set_value(self._output_memory[name], vector)
        for name, line in self._delay_lines.items():
            newest = np.atleast_1d(changes[name] if name in changes else memory[name])
            queue = context.get_discrete_state(line.queue).value()
            # At the first sample the queue is infinite. It is filled with this sample, which the output gives until it
            # has passed through.
            if math.isinf(queue[-1]):
                queue = np.tile(newest, self._delay)
            discrete.set_value(line.queue, np.concatenate([queue[len(newest) :], newest]))
            discrete.set_value(line.output, queue[: len(newest)])
