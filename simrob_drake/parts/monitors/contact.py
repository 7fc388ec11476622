"""Two things that touch."""

from typing import Literal

from simrob_drake.blocks.monitor import Condition
from simrob_drake.frames import Vector
from simrob_drake.parts.monitors.monitor import SensorMonitorSection, worst
from simrob_drake.parts.site import Surroundings
from simrob_drake.sections import NotNegative


class Contact(SensorMonitorSection):
    """End the run when two things touch: a distance sensor reads 0."""

    kind: Literal["contact"]
    distance: NotNegative = 0.0
    """Distance that counts as contact [m]."""

    def condition(self, name: str, station: Surroundings) -> Condition:
        """Return what ends a run, as the proximity switch of the Simulink library does; its excess is in metres."""
        sensor = self.watched_sensor(name, station, "distance")
        names = f"{station.sensors[sensor].body} and {station.sensors[sensor].other}"

        def nearness(distance: Vector) -> Vector:
            return self.distance - distance

        def why(*_: float) -> str:
            return f"{names} are nearer than {1e3 * self.distance:g} mm" if self.distance else f"{names} touch"

        return worst({f"distance.{sensor}": 1}, nearness, why)
