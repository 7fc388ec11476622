"""Whether a run creeps: its solver takes steps so small that it will hardly ever get to the end."""

from collections import deque
from collections.abc import Callable, Sequence

from pydrake.systems.framework import Context

from simrob_drake.progress import Move
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.solver_config import ContinuousSolver
from simrob_drake.stations.steps import DISCRETE

_OVER = 100  # steps
_CREEPING = 1e-5
"""A mean step as small creeps: a hundred thousand steps a simulated second [s]."""


def creeping(config: StationConfig, times: Sequence[float]) -> str:
    """Tell in words that a run crept in its last steps, whose ends are given [s]; empty if it did not."""
    solver = config.solver
    if config.mode == "kinematic" or not isinstance(solver, ContinuousSolver) or solver.fixed_steps:
        return ""
    if len(times) <= _OVER:
        return ""
    step = (times[-1] - times[-1 - _OVER]) / _OVER
    left = config.duration - times[-1]
    return f"it creeps in steps of {step:.2g} s with {left:.3g} s left; {DISCRETE}" if step < _CREEPING else ""


def pace_watcher(config: StationConfig, show: Move) -> Callable[[Context], None]:
    """Return what shows after each step how far a run is, and whether it creeps."""
    ends: deque[float] = deque(maxlen=_OVER + 1)

    def watch(context: Context) -> None:
        ends.append(context.get_time())
        show(ends[-1], creeping(config, ends))

    return watch
