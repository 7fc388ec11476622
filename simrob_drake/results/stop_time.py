"""When a monitor's condition came true, between the steps at which the monitor looked."""

from __future__ import annotations

import numpy as np
from pydrake.systems.framework import Context

from simrob_drake.blocks.monitor import Monitor
from simrob_drake.results.signals import Sampler

TOLERANCE = 1e-5
"""How narrowly the moment is found [s]."""


def refined_stop_time(sampler: Sampler, monitor: Monitor) -> float:
    """Return when a monitor that ended a run would have ended it, had it looked at every moment [s]."""
    history = sampler.history
    end = history.end
    seen = end
    if monitor.hold > 0:
        seen = min(monitor.onset(_own(sampler, monitor, end)), end)
    earlier = history.times[history.times < seen]
    if not len(earlier):
        return end
    onset = _onset(sampler, monitor, float(earlier[-1]), seen)
    return min(onset + monitor.hold, end)


def _onset(sampler: Sampler, monitor: Monitor, low: float, high: float) -> float:
    """Find by bisection when the condition begins to hold; it does at ``high``."""
    if monitor.holds(_own(sampler, monitor, low)):
        return low
    while high - low > TOLERANCE:
        middle = float(np.mean([low, high]))
        if monitor.holds(_own(sampler, monitor, middle)):
            high = middle
        else:
            low = middle
    return high


def _own(sampler: Sampler, monitor: Monitor, time: float) -> Context:
    return monitor.GetMyContextFromRoot(sampler.context_at(time))
