"""Monitors of a run, asked about the recorded states: so none of them stands in the diagram that is stepped.

A monitor changes nothing, so it may look a few steps late: the run is then cut where it would have ended, between the
steps at which the monitor looked.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from pydrake.systems.framework import OutputPort

from simrob_drake.blocks.monitor import NOT_YET
from simrob_drake.parts.site import Site
from simrob_drake.results.record.history import StateHistory
from simrob_drake.results.record.signals import Sampler

TOLERANCE = 1e-4
"""How narrowly the moment is found [s]."""

Holds = Callable[[Sampler, float], bool]
"""Whether the condition holds at a time [s] of a sampler's run."""
Step = Callable[[StateHistory, float], StateHistory]
"""Steps from the last state of a history before a time to that time [s], and returns the state there."""


@dataclass(frozen=True)
class Stop:
    """Why a run ends."""

    name: str  # of the monitor
    count: int  # how many steps were recorded until it ended the run
    onset: float  # since when the condition held [s]
    why: str  # in words


class Watch:
    """Asks the monitors of a station about each recorded step, in their order.

    Attributes:
        stop: why the run ends; None as long as it does not.
    """

    def __init__(self, site: Site, sampler: Sampler) -> None:
        """Watch a station whose ports a sampler evaluates."""
        self._site, self._sampler = site, sampler
        self._onsets = dict.fromkeys(site.monitors, NOT_YET)
        self._count = 0
        self.stop: Stop | None = None

    def look(self, steps: StateHistory) -> bool:
        """Look at the steps that follow those of the last call; tell whether one of them ends the run."""
        ports = {name: self._ports(name) for name in self._site.monitors}
        values = self._sampler.evaluate(list(dict.fromkeys(port for own in ports.values() for port in own)), steps)
        for row, time in enumerate(steps.times.tolist()):
            for name, trigger in self._site.monitors.items():
                seen = [values[port][row] for port in ports[name]]
                onset = self._onsets[name] = trigger.since(self._onsets[name], time, seen)
                if trigger.ends(onset, time):
                    self.stop = Stop(name, self._count + row + 1, onset, trigger.condition.why(*seen))
                    return True
        self._count += len(steps.times)
        return False

    def holds(self, name: str, sampler: Sampler, time: float) -> bool:
        """Tell whether a monitor's condition holds at a time of a sampler's run [s]."""
        values = [rows[0] for rows in sampler.sample(self._ports(name), np.array([time]))]
        return self._site.monitors[name].holds(time, values)

    def _ports(self, name: str) -> list[OutputPort]:
        return [self._site.outputs[output] for output in self._site.monitors[name].condition.watched]


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
            stop = _crossing(sampler, holds, min(onset, recorded.end)) + hold
            if stop < recorded.end:
                sampler.history = recorded.joined(step(recorded, stop))
        else:
            _cut(sampler, holds, step)
    except (RuntimeError, SystemExit):  # Drake's failed assertions come as SystemExit
        sampler.history = recorded


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
    inside, high = (low + TOLERANCE / 2, seen - TOLERANCE / 2), seen
    if seen - low <= TOLERANCE:
        return seen
    while high - low > TOLERANCE / 4:
        middle = (low + high) / 2
        if holds(sampler, middle):
            high = middle
        else:
            low = middle
    return float(np.clip(high, *inside))
