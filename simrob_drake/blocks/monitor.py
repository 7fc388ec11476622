"""What all monitors are: blocks that watch a robot and may end the simulation with a reason."""

from __future__ import annotations

from abc import abstractmethod

import numpy as np
from pydrake.systems.framework import (
    BasicVector,
    Context,
    DiscreteValues,
    EventStatus,
    InputPort,
    OutputPort,
)

from simrob_drake.blocks.block import Block
from simrob_drake.errors import InvalidParameter
from simrob_drake.frames import Vector
from simrob_drake.lifetime import weakly

_NOT_YET = np.inf


class Monitor(Block):
    """End a run once a condition has lasted for a given time.

    A subclass declares the ports it watches and says by how much its condition is exceeded. The run ends at the first
    accepted step at which the condition holds and has held for ``hold`` seconds; between the steps nothing is forced,
    so a monitor does not change the motion. The time of the condition's onset is kept in discrete state.

    Ports:
        in  what the subclass watches, named as the station's output ports.
        out ``excess`` (1): by how much the condition is exceeded; it holds where this is not negative.
    """

    def __init__(self, *, hold: float = 0.0, after: float = 0.0) -> None:
        """Make the block.

        Args:
            hold: how long the condition must last [s].
            after: when watching begins [s].

        Raises:
            InvalidParameter: a time that is negative or not finite.
        """
        super().__init__()
        for name, value in (("hold", hold), ("after", after)):
            if not (np.isfinite(value) and value >= 0):
                raise InvalidParameter(name, value, "a finite time, not negative [s]")
        self.hold, self.after = hold, after
        self._onset = self.DeclareDiscreteState(np.array([_NOT_YET]))
        self.DeclareVectorOutputPort("excess", 1, weakly(self._calc_excess))
        self.DeclarePerStepPublishEvent(self._watch)
        if hold > 0:
            self.DeclarePerStepDiscreteUpdateEvent(self._remember)

    def watch(self, name: str, size: int) -> InputPort:
        """Declare that the monitor watches the signal ``name`` of ``size`` values."""
        return self.DeclareVectorInputPort(name, size)

    @property
    def excess_port(self) -> OutputPort:
        """The output that tells by how much the condition is exceeded."""
        return self.GetOutputPort("excess")

    @abstractmethod
    def excess(self, context: Context) -> float:
        """Return by how much the condition is exceeded; it holds where this is not negative."""

    @abstractmethod
    def why(self, context: Context) -> str:
        """Return the reason, in words and figures, at a time when the condition holds."""

    def onset(self, context: Context) -> float:
        """Return the end of the first step since which the condition has held [s]; inf while it does not."""
        return float(context.get_discrete_state(self._onset).value()[0])

    def holds(self, context: Context) -> bool:
        """Tell whether the condition holds now."""
        return context.get_time() >= self.after and self.excess(context) >= 0

    def _calc_excess(self, context: Context, output: BasicVector) -> None:
        output.SetAtIndex(0, self.excess(context))

    def _watch(self, context: Context) -> EventStatus:
        if not self.holds(context):
            return EventStatus.DidNothing()
        if self.hold > 0 and context.get_time() - self.onset(context) < self.hold:
            return EventStatus.DidNothing()
        return EventStatus.ReachedTermination(self, self.why(context))

    def _remember(self, context: Context, state: DiscreteValues) -> None:
        onset = self.onset(context)
        if not self.holds(context):
            onset = _NOT_YET
        elif onset == _NOT_YET:
            onset = context.get_time()
        state.set_value(self._onset, np.array([onset]))


def largest(values: Vector) -> tuple[int, float]:
    """Return place and value of the largest entry; one that is not a number counts as infinite."""
    index = int(np.argmax(np.where(np.isnan(values), np.inf, values)))
    return index, float(values[index]) if np.isfinite(values[index]) else np.inf
