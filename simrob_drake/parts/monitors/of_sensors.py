"""What the sections of monitors that watch a sensor share."""

from __future__ import annotations

from simrob_drake.errors import InvalidParameter, UnknownName
from simrob_drake.parts.monitors.monitor import MonitorSection
from simrob_drake.parts.site import Surroundings


class SensorMonitorSection(MonitorSection):
    """A section of ``monitors`` that watches a sensor."""

    sensor: str | None = None
    """The sensor, by its name; the only one of its kind unless given."""

    def watched_sensor(self, name: str, station: Surroundings, kind: str) -> str:
        """Return the name of the sensor of a kind that the monitor watches.

        Raises:
            UnknownName: no such sensor of the right kind.
            InvalidParameter: several, and the monitor names none.
        """
        known = [sensor for sensor, section in station.sensors.items() if section.kind == kind]
        if self.sensor is not None and self.sensor not in known:
            raise UnknownName(f"{kind} sensor for monitors.{name}.sensor", self.sensor, known)
        if self.sensor is None and len(known) != 1:
            none = f"a {kind} sensor, and the station has none under sensors:"
            raise InvalidParameter(f"monitors.{name}.sensor", None, f"one of {', '.join(known)}" if known else none)
        return self.sensor or known[0]
