"""Let a run end when a monitor's condition came true, between the steps at which the monitor looked."""

from __future__ import annotations

import numpy as np
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context

from simrob_drake.blocks.monitor import Monitor
from simrob_drake.results.record.history import History, Recorder
from simrob_drake.results.record.signals import Sampler
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.solve import apply_solver
from simrob_drake.stations.solver_config import DiscreteSolver

TOLERANCE = 1e-4
"""How narrowly the moment is found [s]."""


def cut_at_stop(sampler: Sampler, monitor: Monitor, config: StationConfig) -> None:
    """Let a recorded run end at the moment at which its monitor would have ended it, had it looked all the time.

    The moment is guessed between two recorded states and the motion stepped again up to there, until the two states
    around it are near enough: a state in the middle of a step is not to be trusted where that step holds an impact.

    Where the motion cannot be stepped again, as after a divergence, the run stays as it was recorded.

    Args:
        sampler: of the run; its history is changed.
        monitor: which ended it.
        config: the station.
    """
    recorded = sampler.history
    try:
        _cut(sampler, monitor, config)
    except (RuntimeError, SystemExit):  # Drake's failed assertions come as SystemExit
        sampler.history = recorded


def _cut(sampler: Sampler, monitor: Monitor, config: StationConfig) -> None:
    discrete = isinstance(config.solver, DiscreteSolver) and config.mode == "dynamic"
    if discrete or len(sampler.history.times) < 2:  # a discrete state is that of a step's end; or it held at the start
        return
    if monitor.hold > 0:
        onset = min(monitor.onset(_own(sampler, monitor, sampler.history.end)), sampler.history.end)
        stop = _crossing(sampler, monitor, onset) + monitor.hold
        if stop < sampler.history.end:
            sampler.history = sampler.history.joined(_stepped_to(sampler, config, stop))
        return
    while sampler.history.end - sampler.history.times[-2] > TOLERANCE:
        end = sampler.history.last()
        between = _stepped_to(sampler, config, _crossing(sampler, monitor, end.end))
        shorter = sampler.history.joined(between)
        sampler.history = shorter
        if not monitor.holds(_own(sampler, monitor, between.end)):
            sampler.history = shorter.joined(end)


def _crossing(sampler: Sampler, monitor: Monitor, seen: float) -> float:
    """Return a time inside of the step that ends at ``seen``, where the condition begins to hold on its way."""
    times = sampler.history.times
    low = float(times[np.searchsorted(times, seen) - 1])
    width = seen - low
    inside = low + TOLERANCE / 2, seen - TOLERANCE / 2
    high = seen
    while high - low > TOLERANCE / 4:
        middle = (low + high) / 2
        if monitor.holds(_own(sampler, monitor, middle)):
            high = middle
        else:
            low = middle
    return float(np.clip(high, *inside)) if width > TOLERANCE else seen


def _stepped_to(sampler: Sampler, config: StationConfig, time: float) -> History:
    """Return the state at ``time``, stepped from the last recorded one before it."""
    simulator = Simulator(sampler.diagram)
    apply_solver(simulator, config)
    before = int(np.searchsorted(sampler.history.times, time)) - 1
    sampler.history.put(before, simulator.get_mutable_context())
    recorder = Recorder(simulator)
    simulator.AdvanceTo(time)
    if not recorder.is_sane():
        raise RuntimeError("a state ran away between two recorded ones")
    return recorder.history().last()


def _own(sampler: Sampler, monitor: Monitor, time: float) -> Context:
    return monitor.GetMyContextFromRoot(sampler.context_at(time))
