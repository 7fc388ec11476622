"""Monitors, which end a run when a condition has lasted for a given time; blocks that set where steps end.

A solver chooses its own steps. A monitor only looks at the start of a run and at the ends of these steps, so it does
not change the motion. The start counts as the end of a step.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from pydrake.systems.framework import BasicVector, Context, DiscreteValues, EventStatus

from simrob_drake.base.errors import InvalidParameter
from simrob_drake.base.frames import Vector
from simrob_drake.base.lifetime import weakly
from simrob_drake.base.messages import message
from simrob_drake.base.renaming import keep_former_attributes
from simrob_drake.blocks.block import Block

NOT_YET = np.inf
"""Onset of a condition that does not hold [s]. The onset is the time since which the condition holds."""


@dataclass(frozen=True)
class Condition:
    """A condition on signals.

    Attributes:
        watched: size of each signal, by its name; signals of a station have the names of its output ports.
        excess: function of the signals' values (one vector each, in the order of `watched`) that returns by how much
            the condition is exceeded. The condition holds if the result is not negative.
        why: function of the same values that returns the reason as text, if the condition holds.
    """

    watched: Mapping[str, int]
    excess: Callable[..., float]
    why: Callable[..., str]


@dataclass(frozen=True)
class Trigger:
    """A condition that ends a run: at the end of the first step at which it holds and has lasted long enough.

    Attributes:
        condition: the condition.
        hold: how long the condition must last [s].
        after: time from which the condition is evaluated [s].
    """

    condition: Condition
    hold: float = 0.0
    after: float = 0.0

    def __post_init__(self) -> None:
        """Check the times.

        Raises:
            InvalidParameter: a time is negative or not finite.
        """
        for name, value in (("hold", self.hold), ("after", self.after)):
            if not (np.isfinite(value) and value >= 0):
                raise InvalidParameter(
                    name,
                    value,
                    message("blocks.finite_time", "a finite time that is not negative [s]"),
                )

    def holds(self, time: float, values: Sequence[Vector]) -> bool:
        """Whether the condition holds at a time [s] with these values of the watched signals."""
        return time >= self.after and self.condition.excess(*values) >= 0

    def next_onset(self, onset: float, time: float, values: Sequence[Vector]) -> float:
        """Onset of the condition at the end of a step [s], or NOT_YET if it does not hold.

        Args:
            onset: onset at the end of the step before [s], or NOT_YET.
            time: time at the end of the step [s].
            values: values of the watched signals at that time.
        """
        if not self.holds(time, values):
            return NOT_YET
        # A condition that held before keeps its onset. With a new onset at each step, it would never last for `hold`.
        return time if onset == NOT_YET else onset

    def ends_run(self, onset: float, time: float) -> bool:
        """Whether a condition that holds since its onset [s] has lasted long enough at a time [s] to end the run."""
        return time - onset >= self.hold


keep_former_attributes(Trigger, since="next_onset", ends="ends_run")


class Monitor(Block):
    """End a run once a condition has lasted for a given time.

    The condition is evaluated at the ends of the steps only, so a monitor does not change the motion. The onset of the
    condition is a discrete state.

    Ports:
        in  the signals that the condition watches, each by its name.
        out ``excess`` (1): by how much the condition is exceeded. The condition holds if it is not negative.
    """

    def __init__(
        self,
        condition: Condition,
        *,
        hold: float = 0.0,
        after: float = 0.0,
    ) -> None:
        """Create the block.

        Args:
            condition: the condition.
            hold: how long the condition must last [s].
            after: time from which the condition is evaluated [s].

        Raises:
            InvalidParameter: a time is negative or not finite.
        """
        super().__init__()
        self._trigger = Trigger(condition, hold, after)
        self._watched = [
            self.DeclareVectorInputPort(name, size) for name, size in condition.watched.items()
        ]
        # A discrete state, and no attribute of Python: a copied or restored context contains it.
        self._onset = self.DeclareDiscreteState(np.array([NOT_YET]))
        # Drake keeps the callback of a port, which holds the block weakly, as it would otherwise never be freed.
        self.DeclareVectorOutputPort("excess", 1, weakly(self._calc_excess))
        # Drake publishes at the end of a step, but updates discrete states at the start of the next one. So `_watch`
        # computes the onset of its moment, which is not in the state yet.
        self.DeclarePerStepPublishEvent(self._watch)
        if hold > 0:  # else the first step at which the condition holds ends the run
            self.DeclarePerStepDiscreteUpdateEvent(self._update_onset)

    def _values(self, context: Context) -> list[Vector]:
        return [port.Eval(context) for port in self._watched]

    def _calc_excess(self, context: Context, output: BasicVector) -> None:
        output.SetAtIndex(0, self._trigger.condition.excess(*self._values(context)))

    def _watch(self, context: Context) -> EventStatus:
        """End the run if the condition has lasted long enough.

        Drake calls this when the simulator is initialized, and at the end of each step.
        """
        if self._trigger.ends_run(self._present_onset(context), context.get_time()):
            return EventStatus.ReachedTermination(self, str(self.reason(context)))
        return EventStatus.DidNothing()

    def reason(self, context: Context) -> str:
        """Reason why the block ends the run, for a context in which its condition holds."""
        return self._trigger.condition.why(*self._values(context))

    def _update_onset(self, context: Context, state: DiscreteValues) -> None:
        state.set_value(self._onset, np.array([self._present_onset(context)]))

    def _present_onset(self, context: Context) -> float:
        """Onset of the condition at the time of a context [s], or NOT_YET."""
        last_onset = float(context.get_discrete_state(self._onset).value()[0])
        return self._trigger.next_onset(last_onset, context.get_time(), self._values(context))


# Period of an event that happens once: longer than any run [s].
_NEVER_AGAIN = 1e9


class EventTimes(Block):
    """Make the steps of a simulation end at given times. The block has no ports.

    Error control assumes that a signal is smooth over a step, so a corner within a step is blurred. A scheme that holds
    its inputs constant over a step misses part of a push. Steps end at events, so each time is an event.
    """

    def __init__(self, times: Iterable[float]) -> None:
        """Create the block for ``times`` [s].

        Raises:
            InvalidParameter: a time is negative or not finite.
        """
        super().__init__()
        for time in times:
            if not (np.isfinite(time) and time >= 0):
                raise InvalidParameter(
                    "times",
                    time,
                    message("blocks.finite_not_negative", "finite and not negative [s]"),
                )
            self.DeclarePeriodicPublishEvent(
                period_sec=_NEVER_AGAIN, offset_sec=float(time), publish=self._do_nothing
            )

    def _do_nothing(self, context: Context) -> None:
        """Do nothing: that the event happens ends the step."""


class SteadySteps(Block):
    """Limit the length of a simulation's steps, if nothing else in the diagram does. The block has no ports."""

    def __init__(self, period: float) -> None:
        """Create the block for steps of at most ``period`` [s].

        Raises:
            InvalidParameter: the period is not positive.
        """
        super().__init__()
        if not (np.isfinite(period) and period > 0):
            raise InvalidParameter(
                "period", period, message("blocks.positive_time", "a positive time [s]")
            )
        # No step crosses an event, so no step is longer than the period.
        self.DeclarePeriodicPublishEvent(
            period_sec=period, offset_sec=0.0, publish=lambda context: None
        )
