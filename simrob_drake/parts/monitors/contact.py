"""Two things that touch."""

from __future__ import annotations

from typing import Literal

import numpy as np

from simrob_drake.blocks.monitor import Monitor
from simrob_drake.errors import InvalidParameter
from simrob_drake.frames import Vector
from simrob_drake.parts.monitors.monitor import Made
from simrob_drake.parts.monitors.of_sensors import SensorMonitorSection
from simrob_drake.parts.site import Site, Surroundings
from simrob_drake.quantities import NotNegative


class Contact(SensorMonitorSection):
    """End the run when two things touch: a distance sensor reads 0."""

    kind: Literal["contact"]
    distance: NotNegative = 0.0
    """Distance that counts as contact [m]."""

    def check(self, name: str, station: Surroundings) -> None:
        """Check that there is a distance sensor."""
        super().check(name, station)
        self.watched_sensor(name, station, "distance")

    def made(self, name: str, site: Site) -> Made:
        """Return the block."""
        sensor = self.watched_sensor(name, site.station, "distance")
        section = site.station.sensors[sensor]
        names = f"{section.body} and {section.other}"
        monitor = ContactMonitor(names=names, threshold=self.distance, **self.times)
        return monitor, {"distance": f"distance.{sensor}"}


class ContactMonitor(Monitor):
    """End the run when two things touch, as the proximity switch of the Simulink library does.

    Ports:
        in  ``distance`` (1): signed distance [m].
        out ``excess`` (1): how far the distance is below the threshold [m].
    """

    def __init__(self, *, names: str, threshold: float = 0.0, hold: float = 0.0, after: float = 0.0) -> None:
        """Watch the distance between two things, called ``names`` together, down to ``threshold`` [m]."""
        super().__init__(hold=hold, after=after)
        if not (np.isfinite(threshold) and threshold >= 0):
            raise InvalidParameter("threshold", threshold, "a distance, not negative [m]")
        self._names, self._threshold = names, threshold
        self.watch(distance=1)

    def excess(self, *values: Vector) -> float:
        """Return how far the distance is below the threshold [m]; one that is not a number counts as contact."""
        (distance,) = values
        excess = self._threshold - float(distance[0])
        return np.inf if np.isnan(excess) else excess

    def why(self, *values: Vector) -> str:
        """Say what touches what."""
        if self._threshold == 0:
            return f"{self._names} touch"
        return f"{self._names} are nearer than {1e3 * self._threshold:g} mm"
