"""Monitors of a run, asked about the recorded states: so none of them stands in the diagram that is stepped.

A monitor changes nothing, so it may look a few steps late: the run is then cut where it would have ended.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from pydrake.systems.framework import OutputPort

from simrob_drake.blocks.monitor import NOT_YET
from simrob_drake.parts.site import Site
from simrob_drake.results.record.history import History
from simrob_drake.results.record.signals import Sampler


@dataclass(frozen=True)
class Stop:
    """Why a run ends.

    Attributes:
        name: of the monitor.
        count: how many steps were recorded until it ended the run.
        onset: since when the condition held [s].
        why: in words.
    """

    name: str
    count: int
    onset: float
    why: str


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

    def look(self, steps: History) -> bool:
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
