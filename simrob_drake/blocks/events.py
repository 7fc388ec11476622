"""Times that a simulation must not step across: corners of references, edges of pushes."""

from collections.abc import Iterable

import numpy as np
from pydrake.systems.framework import Context

from simrob_drake.blocks.block import Block
from simrob_drake.errors import InvalidParameter

_NEVER_AGAIN = 1e9
"""Period [s] of an event that is meant to happen once."""


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
                raise InvalidParameter("times", time, "finite and not negative [s]")
            self.DeclarePeriodicPublishEvent(period_sec=_NEVER_AGAIN, offset_sec=float(time), publish=self._pass)

    def _pass(self, context: Context) -> None:
        """Let the simulation go on."""


class SteadySteps(Block):
    """Make a simulation take steps of at most a given length, where nothing else would.

    The block has no ports.
    """

    def __init__(self, period: float) -> None:
        """Make the block for steps of ``period`` [s].

        Raises:
            InvalidParameter: a period that is not positive.
        """
        super().__init__()
        if not (np.isfinite(period) and period > 0):
            raise InvalidParameter("period", period, "a positive time [s]")
        self.DeclarePeriodicPublishEvent(period_sec=period, offset_sec=0.0, publish=lambda context: None)
