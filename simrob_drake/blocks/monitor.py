"""Blocks that may end a simulation once a condition has lasted, or that make its steps end at given times."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from pydrake.systems.framework import BasicVector, Context, DiscreteValues, EventStatus

from simrob_drake.base.errors import InvalidParameter
from simrob_drake.base.frames import Vector
from simrob_drake.base.lifetime import weakly
from simrob_drake.base.messages import message
from simrob_drake.blocks.block import Block

NOT_YET = np.inf
"""The onset of a condition that does not hold [s]."""


@dataclass(frozen=True)
class Condition:
    """What signals may come to, told by functions of their values, one vector a signal.

    Attributes:
        watched: the sizes of the signals by their names; a station's are named as its output ports.
        excess: by how much the condition is exceeded; it holds where this is not negative.
        why: the reason, in words and figures, where it holds.
    """

    watched: Mapping[str, int]
    excess: Callable[..., float]
    why: Callable[..., str]


@dataclass(frozen=True)
class Trigger:
    """When a condition ends a run: at the first step's end at which it holds, and has lasted.

    Attributes:
        condition: to be looked at.
        hold: how long it must last [s].
        after: when watching begins [s].
    """

    condition: Condition
    hold: float = 0.0
    after: float = 0.0

    def __post_init__(self) -> None:
        for name, value in (("hold", self.hold), ("after", self.after)):
            if not (np.isfinite(value) and value >= 0):
                raise InvalidParameter(name, value, message("blocks.finite_time", "a finite time, not negative [s]"))

    def holds(self, time: float, values: Sequence[Vector]) -> bool:
        """Tell whether the condition holds at a time [s] at which the watched signals have these values."""
        return time >= self.after and self.condition.excess(*values) >= 0

    def since(self, onset: float, time: float, values: Sequence[Vector]) -> float:
        """Return since when the condition holds [s], or NOT_YET, at a step's end; it held since ``onset`` before."""
        if not self.holds(time, values):
            return NOT_YET
        return time if onset == NOT_YET else onset

    def ends(self, onset: float, time: float) -> bool:
        """Tell whether the run ends at a step's end, at which the condition holds since ``onset``."""
        return time - onset >= self.hold


class Monitor(Block):
    """End a run once a condition has lasted for a given time.

    Between the steps nothing is forced, so a monitor does not change the motion. The time of the condition's onset is
    kept in discrete state.

    Ports:
        in  what the condition watches.
        out ``excess`` (1): by how much the condition is exceeded; it holds where this is not negative.
    """

    def __init__(self, condition: Condition, *, hold: float = 0.0, after: float = 0.0) -> None:
        """Make the block; times are those of a :class:`Trigger`.

        Raises:
            InvalidParameter: a time that is negative or not finite.
        """
        super().__init__()
        self._trigger = Trigger(condition, hold, after)
        self._watched = [self.DeclareVectorInputPort(name, size) for name, size in condition.watched.items()]
        self._onset = self.DeclareDiscreteState(np.array([NOT_YET]))
        self.DeclareVectorOutputPort("excess", 1, weakly(self._calc_excess))
        self.DeclarePerStepPublishEvent(self._watch)
        if hold > 0:
            self.DeclarePerStepDiscreteUpdateEvent(self._remember)

    def _values(self, context: Context) -> list[Vector]:
        return [port.Eval(context) for port in self._watched]

    def _calc_excess(self, context: Context, output: BasicVector) -> None:
        output.SetAtIndex(0, self._trigger.condition.excess(*self._values(context)))

    def _watch(self, context: Context) -> EventStatus:
        if self._trigger.ends(self._since(context), context.get_time()):
            return EventStatus.ReachedTermination(self, str(self.reason(context)))
        return EventStatus.DidNothing()

    def reason(self, context: Context) -> str:
        """Reason why the block ends the run, for a context in which its condition holds."""
        return self._trigger.condition.why(*self._values(context))

    def _remember(self, context: Context, state: DiscreteValues) -> None:
        state.set_value(self._onset, np.array([self._since(context)]))

    def _since(self, context: Context) -> float:
        onset = float(context.get_discrete_state(self._onset).value()[0])
        return self._trigger.since(onset, context.get_time(), self._values(context))


_NEVER_AGAIN = 1e9  # period [s] of an event that is meant to happen once


class EventTimes(Block):
    """Make a simulation's steps end at given times; the block does nothing else.

    Error control measures steps that are smooth: a corner inside of one is smeared over it, and a scheme that
    freezes its inputs at the start of a step misses part of a push. Steps end at events, so each time is one.
    The block has no ports.
    """

    def __init__(self, times: Iterable[float]) -> None:
        """Make the block for ``times`` [s].

        Raises:
            InvalidParameter: a time that is negative or not finite.
        """
        super().__init__()
        for time in times:
            if not (np.isfinite(time) and time >= 0):
                raise InvalidParameter(
                    "times", time, message("blocks.finite_not_negative", "finite and not negative [s]")
                )
            self.DeclarePeriodicPublishEvent(period_sec=_NEVER_AGAIN, offset_sec=float(time), publish=self._pass)

    def _pass(self, context: Context) -> None:
        """Let the simulation go on."""


class SteadySteps(Block):
    """Make a simulation take steps of at most a given length, where nothing else would; the block has no ports."""

    def __init__(self, period: float) -> None:
        """Make the block for steps of ``period`` [s].

        Raises:
            InvalidParameter: a period that is not positive.
        """
        super().__init__()
        if not (np.isfinite(period) and period > 0):
            raise InvalidParameter("period", period, message("blocks.positive_time", "a positive time [s]"))
        self.DeclarePeriodicPublishEvent(period_sec=period, offset_sec=0.0, publish=lambda context: None)
