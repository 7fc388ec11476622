"""Let a run end when a monitor's condition came true, between the steps at which the monitor looked."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from simrob_drake.results.record.history import History
from simrob_drake.results.record.signals import Sampler

TOLERANCE = 1e-4
"""How narrowly the moment is found [s]."""

Holds = Callable[[Sampler, float], bool]
"""Whether the condition holds at a time [s] of a sampler's run."""
Step = Callable[[History, float], History]
"""Steps from the last state of a history before a time to that time [s], and returns the state there."""


def cut_at_stop(sampler: Sampler, holds: Holds, step: Step, *, onset: float, hold: float) -> None:
    """Let a recorded run end at the moment at which its monitor would have ended it, had it looked all the time.

    The moment is guessed between two recorded states and the motion stepped again up to there, until the two states
    around it are near enough: a state in the middle of a step is not to be trusted where that step holds an impact.

    Where the motion cannot be stepped again, as after a divergence, the run stays as it was recorded.

    Args:
        sampler: of the run; its history is changed.
        holds: tells of the monitor's condition.
        step: steps the motion again.
        onset: since when the condition has held [s].
        hold: how long it must last [s].
    """
    recorded = sampler.history
    try:
        if len(recorded.times) < 2:  # it held at the start
            return
        if hold > 0:
            _cut_lasting(sampler, holds, step, onset, hold)
        else:
            _cut(sampler, holds, step)
    except (RuntimeError, SystemExit):  # Drake's failed assertions come as SystemExit
        sampler.history = recorded


def _cut_lasting(sampler: Sampler, holds: Holds, step: Step, onset: float, hold: float) -> None:
    stop = _crossing(sampler, holds, min(onset, sampler.history.end)) + hold
    if stop < sampler.history.end:
        sampler.history = sampler.history.joined(step(sampler.history, stop))


def _cut(sampler: Sampler, holds: Holds, step: Step) -> None:
    while sampler.history.end - sampler.history.times[-2] > TOLERANCE:
        end = sampler.history.last()
        between = step(sampler.history, _crossing(sampler, holds, end.end))
        shorter = sampler.history.joined(between)
        sampler.history = shorter
        if not holds(sampler, between.end):
            sampler.history = shorter.joined(end)


def _crossing(sampler: Sampler, holds: Holds, seen: float) -> float:
    """Return a time inside of the step that ends at ``seen``, where the condition begins to hold on its way."""
    times = sampler.history.times
    low = float(times[np.searchsorted(times, seen) - 1])
    width = seen - low
    inside = low + TOLERANCE / 2, seen - TOLERANCE / 2
    high = seen
    while high - low > TOLERANCE / 4:
        middle = (low + high) / 2
        if holds(sampler, middle):
            high = middle
        else:
            low = middle
    return float(np.clip(high, *inside)) if width > TOLERANCE else seen
