"""What all monitors are: blocks that watch a robot and may end the simulation with a reason."""

from __future__ import annotations

from abc import abstractmethod

import numpy as np
from pydrake.systems.framework import (
    BasicVector,
    Context,
    DiscreteValues,
    EventStatus,
)

from simrob_drake.blocks.block import Block
from simrob_drake.errors import InvalidParameter
from simrob_drake.frames import Vector
from simrob_drake.lifetime import weakly

NOT_YET = np.inf
"""The onset of a condition that does not hold [s]."""


class Monitor(Block):
    """End a run once a condition has lasted for a given time.

    A subclass declares the signals it watches and says of their values by how much its condition is exceeded. The run
    ends at the first accepted step at which the condition holds and has held for ``hold`` seconds; between the steps
    nothing is forced, so a monitor does not change the motion. The time of the condition's onset is kept in discrete
    state. Whoever records a run need not have the block in the diagram: :meth:`holds` and :meth:`why` tell all.

    Ports:
        in  what the subclass watches, named as the station's output ports.
        out ``excess`` (1): by how much the condition is exceeded; it holds where this is not negative.

    Attributes:
        hold, after: as given [s].
        watched: the names of the signals that it watches, in the order of the arguments below.
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
        self.watched: list[str] = []
        self._onset = self.DeclareDiscreteState(np.array([NOT_YET]))
        self.DeclareVectorOutputPort("excess", 1, weakly(self._calc_excess))
        self.DeclarePerStepPublishEvent(self._watch)
        if hold > 0:
            self.DeclarePerStepDiscreteUpdateEvent(self._remember)

    def watch(self, **sizes: int) -> None:
        """Declare the signals that the monitor watches, each of so many values."""
        self.watched += [self.DeclareVectorInputPort(name, size).get_name() for name, size in sizes.items()]

    @abstractmethod
    def excess(self, *values: Vector) -> float:
        """Return by how much the condition is exceeded; it holds where this is not negative."""

    @abstractmethod
    def why(self, *values: Vector) -> str:
        """Return the reason, in words and figures, at a time when the condition holds."""

    def holds(self, time: float, values: list[Vector]) -> bool:
        """Tell whether the condition holds at a time [s] at which the watched signals have these values."""
        return time >= self.after and self.excess(*values) >= 0

    def next_onset(self, onset: float, time: float, values: list[Vector]) -> float:
        """Return since when the condition holds [s], after a step's end; it held since ``onset`` before."""
        if not self.holds(time, values):
            return NOT_YET
        return time if onset == NOT_YET else onset

    def ends(self, onset: float, time: float, values: list[Vector]) -> bool:
        """Tell whether the run ends at a step's end, before which the condition held since ``onset``."""
        return self.holds(time, values) and not (self.hold > 0 and time - onset < self.hold)

    def _values(self, context: Context) -> list[Vector]:
        return [self.get_input_port(index).Eval(context) for index in range(len(self.watched))]

    def _calc_excess(self, context: Context, output: BasicVector) -> None:
        output.SetAtIndex(0, self.excess(*self._values(context)))

    def _watch(self, context: Context) -> EventStatus:
        values = self._values(context)
        if self.ends(self._known_onset(context), context.get_time(), values):
            return EventStatus.ReachedTermination(self, self.why(*values))
        return EventStatus.DidNothing()

    def _remember(self, context: Context, state: DiscreteValues) -> None:
        onset = self.next_onset(self._known_onset(context), context.get_time(), self._values(context))
        state.set_value(self._onset, np.array([onset]))

    def _known_onset(self, context: Context) -> float:
        return float(context.get_discrete_state(self._onset).value()[0])


def largest(values: Vector) -> tuple[int, float]:
    """Return place and value of the largest entry; one that is not a number counts as infinite."""
    index = int(np.argmax(np.where(np.isnan(values), np.inf, values)))
    return index, float(values[index]) if np.isfinite(values[index]) else np.inf
