"""How a run gets on: whether its solver creeps, and whether it hardly gets on at all, with what holds it up."""

import warnings
from collections import deque
from collections.abc import Callable, Sequence
from time import monotonic, process_time

from pydrake.systems.framework import Context

from simrob_drake.progress import Advance
from simrob_drake.simulation.slow import Slow
from simrob_drake.stations.closed import ClosedStation
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.steps import DISCRETE, controlled_by

_OVER = 100  # steps
_CREEPING = 1e-5
"""A mean step as small creeps: a hundred thousand steps a simulated second [s]."""
_PATIENCE = 5.0  # s of a clock
_SLOWEST = 0.02
"""Part of real time that a run should make at least."""
_BUSY = 0.5
"""Part of a processor: a process that gets less has to wait for others."""
_OFTEN = 0.02  # s of a clock; a look at the processor's takes long on some machines
_PAUSE, _IDLE = 0.5, 0.01
"""Where a step takes so long [s], and a processor works so small a part of that, somebody has paused the run."""


class SlowRunWarning(RuntimeWarning):
    """A run hardly gets on; the message says what holds it up."""


def creeping(config: StationConfig, times: Sequence[float]) -> str:
    """Tell in words that a run crept in its last steps, whose ends are given [s]; empty if it did not."""
    if controlled_by(config) is None or len(times) <= _OVER:
        return ""
    step = (times[-1] - times[-1 - _OVER]) / _OVER
    left = config.duration - times[-1]
    return f"it creeps in steps of {step:.2g} s with {left:.3g} s left; {DISCRETE}" if step < _CREEPING else ""


class PaceWatch:
    """Looks after each step how fast a run gets on, shows that, and warns once if it hardly does.

    Attributes:
        config: the station.
    """

    def __init__(
        self, config: StationConfig, built: Callable[[], ClosedStation], *, own_blocks: bool, show: Advance | None
    ) -> None:
        """Watch a run.

        Args:
            config: the station.
            built: gives what is stepped now.
            own_blocks: whether there are blocks of the user's own in it.
            show: shows how far it is.
        """
        self.config, self._built, self._own_blocks, self._show = config, built, own_blocks, show
        self._ends: deque[float] = deque(maxlen=_OVER + 1)
        self._clocks, self._warned = (monotonic(), process_time()), False
        self._begin(0.0)

    def _begin(self, time: float) -> None:
        self._since, self._waited, self._worked, self._steps = time, 0.0, 0.0, 0

    def __call__(self, context: Context) -> None:
        """Look at the step that has just ended; at the very first, what went before was no step."""
        time = context.get_time()
        if not self._ends:
            self._clocks = monotonic(), process_time()
            self._begin(time)
        self._ends.append(time)
        if self._show is not None:
            self._show(time, creeping(self.config, self._ends))
        self._count()
        if self._waited < _PATIENCE or self._warned or time == self._since:
            return
        if time - self._since < _SLOWEST * self._waited:
            self._warned = True
            self._warn(context)
        self._begin(time)

    def _count(self) -> None:
        """Count the step, and now and then the time of clock and processor, but for that of a pause before it."""
        self._steps += 1
        now = monotonic()
        if now - self._clocks[0] < _OFTEN:
            return
        clocks = now, process_time()
        waited, worked = (now - before for now, before in zip(clocks, self._clocks, strict=True))
        self._clocks = clocks
        if waited < _PAUSE or worked > _IDLE * waited + _OFTEN:
            self._waited, self._worked = self._waited + waited, self._worked + worked

    def _warn(self, context: Context) -> None:
        made, share = context.get_time() - self._since, self._worked / self._waited
        if share < _BUSY:
            cause = f"the machine is busy with other work, this gets {100 * share:.0f} % of a processor"
        else:
            means = made / self._steps, self._waited / self._steps
            cause = Slow(self.config, self._built(), context, *means, self._own_blocks).cause()
        left = self.config.duration - context.get_time()
        message = f"{self.config.name} makes {made / self._waited:.2g} × real time with {left:.3g} s left: {cause}"
        warnings.warn(message, SlowRunWarning, stacklevel=2)
