"""What the kinds of sensor share."""

from collections.abc import Mapping, Sequence
from typing import Any

from pydrake.systems.framework import DiagramBuilder, OutputPort
from pydrake.systems.primitives import ZeroOrderHold

from simrob_drake.blocks.wiring import fed
from simrob_drake.errors import InvalidParameter
from simrob_drake.parts.site import Surroundings
from simrob_drake.sections import Positive, Strict


class Sensor(Strict):
    """A section of ``sensors``.

    A kind has its key ``kind``, and the methods ``check(key, station)``, which raises what is wrong with it before
    anything is built, and ``wire(builder, site, name)``, which adds its systems and declares its outputs.
    """

    @property
    def stepped(self) -> bool:
        """Whether it takes samples while the station is stepped; others are wired after the run unless something reads.

        A block that nothing reads still costs a solver time at every look at the diagram.
        """
        return False

    def read(self, sensors: Mapping[str, Any]) -> dict[str, str]:
        """Return which of a station's other sensors it reads, if they are there, by what it reads them for."""
        return {}


class ShapeSensor(Sensor):
    """What sensors at the collision shapes of a body share."""

    kind: str
    body: str
    """What it is at: a robot, a link, a piece, or a shape of a piece (`<piece>.<shape>`)."""
    rate: Positive | None = None
    """Samples a second that a loop or a monitor gets [Hz]; it may always look unless given."""

    @property
    def stepped(self) -> bool:
        """Whether it takes samples."""
        return self.rate is not None


def check_contact(key: str, sensor: str, station: Surroundings) -> None:
    """Check that a station has the contact section that a sensor needs."""
    if not station.has_contact:
        raise InvalidParameter(key, sensor, "in a station with a contact: section ({} takes its defaults)")


def sampled(builder: DiagramBuilder, name: str, port: OutputPort, rate: float | None) -> OutputPort:
    """Hold a port's value between samples, ``rate`` a second [Hz]; as it is where that is None."""
    return port if rate is None else fed(builder, name, ZeroOrderHold(1 / rate, port.size()), port)


def axis_names(signal: str, sensor: str, axes: Sequence[str] = "xyz") -> tuple[str, ...]:
    """Return the columns of a sensor's signal: ``<signal>.<sensor>.<axis>``."""
    return tuple(f"{signal}.{sensor}.{axis}" for axis in axes)


def sensor_label(kind: str, name: str, rate: float | None = None) -> str:
    """Return what a sensor's block says in the picture."""
    return f"{kind}\n{name}" + (", sampled" if rate is not None else "")
