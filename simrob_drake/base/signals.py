"""Declarations of the recorded signals of a station: columns with units and roles, and the plots that show them.

A *signal* is one or more columns of a result, such as the three components of a force. The part of a station that makes
an output declares its signal once. Tables, plots, block pictures and summaries read the declarations.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal, Protocol, TypeAlias

from simrob_drake.base.frames import VELOCITY_NAMES, XYZ_QUATERNION_NAMES, Vector
from simrob_drake.base.messages import message

Role = Literal[
    "reference",
    "motion",
    "effort",
    "pose",
    "force",
    "moment",
    "applied",
    "estimate",
    "distance",
    "inertial",
    "own",
]
"""Role of a signal: a desired or an actual motion, the effort of a motor, a pose, a measured force or moment, a force
that is applied from outside, an estimate, a distance, a value of an inertial sensor, or a signal of a user's block."""

QUANTITY_WORDS: dict[str, str] = {
    "position": message("base.position", "position"),
    "velocity": message("base.velocity", "velocity"),
    "pose": message("base.pose", "pose"),
    "orientation": message("base.orientation", "orientation"),
    "angular_velocity": message("base.angular_velocity", "angular velocity"),
    "specific_force": message("base.specific_force", "specific force"),
    "base_pose": message("base.base_pose", "base pose"),
    "base_velocity": message("base.base_velocity", "base velocity"),
    "force": message("base.force", "force"),
    "torque": message("base.torque", "torque"),
    "distance": message("base.distance", "distance"),
}
"""Words for quantities in plots, by the name of the quantity in ports and columns."""

# Names of the components, their units, and the quantity of the first three components, which is what a plot shows.
POSE = (XYZ_QUATERNION_NAMES, ("m",) * 3 + ("1",) * 4, QUANTITY_WORDS["position"])
"""Names, units and quantity of a pose."""

VELOCITY = (VELOCITY_NAMES, ("m/s",) * 3 + ("rad/s",) * 3, QUANTITY_WORDS["velocity"])


@dataclass(frozen=True)
class Panel:
    """One plot in a figure of Matplotlib, with one or more curves.

    Attributes:
        figure: name of the file of the figure, without suffix, such as ``sensors`` or ``piece_ball``.
        heading: heading of the figure.
        title: title of the panel.
        label: quantity of the vertical axis: a message, to which the unit is added, or a plain text with a unit, such
            as "force [N]".
        columns: columns of the result, one for each curve.
        components: names of the curves. If it is empty, they are the ends of the columns' names.
    """

    figure: str
    heading: str
    title: str
    label: str
    columns: tuple[str, ...]
    components: tuple[str, ...] = ()


class Recorded(Protocol):
    """A run that is over, for parts of its station that compute signals from it: ports at any time of the run."""

    @property
    def step_times(self) -> Vector:
        """Ends of the accepted steps, shape (m,) [s]."""

    @property
    def memo(self) -> dict[Any, Any]:
        """Results that parts have computed from this run and keep for other parts, by any keys."""

    def sample(self, ports: Sequence[Any], times: Vector) -> list[Any]:
        """Evaluate ports at times (k,) [s] of the run.

        Returns:
            for each port an array (k, size), or a list of k abstract values.
        """


Compute: TypeAlias = Callable[[Recorded, Vector], Vector]
"""Function that computes columns (m, k) of a run at times (m,) [s]."""

Adjust: TypeAlias = Callable[[Recorded, Vector, Vector], Vector]
"""Function that changes columns (m, k) of a run, which a port has given, at times (m,) [s]. Arguments: the run, the
times, and the columns."""


@dataclass(frozen=True)
class Signal:
    """Declaration of k columns of a result.

    Attributes:
        names: names of the columns.
        units: units of the columns, such as ``rad``, ``N·m`` or ``1``.
        role: role of the signal.
        output: name of the station's output port whose values the columns are; empty if they are computed.
        entries: indices of the port's values that are the columns. If it is None, they are all values.
        compute: computes the columns. It is None if they are values of a port.
        adjust: changes the values of the port. If it is None, they stay as they are.
        part: name of the sensor, piece or block that declares the signal; empty for the signals of robots.
        panel: panel that shows the columns. If it is None, the plots of robots show them.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    role: Role
    output: str = ""
    entries: tuple[int, ...] | None = None
    compute: Compute | None = None
    adjust: Adjust | None = None
    part: str = ""
    panel: Panel | None = None

    def __getstate__(self) -> dict[str, Any]:
        """Content of a pickled declaration. The functions that compute columns need a plant, and are left out."""
        return {**self.__dict__, "compute": None, "adjust": None}


def sensor_panel(
    title: str, quantity: str, names: Sequence[str], units: Sequence[str] = ()
) -> Panel:
    """Make the panel of a sensor's columns. The panels of all sensors are in the file ``sensors``.

    Args:
        title: title of the panel.
        quantity: what the sensor measures: a key of `QUANTITY_WORDS`, or any other word.
        names: names of the columns.
        units: not used, since the signal has the units of its columns. Callers of before give them.
    """
    # A sensor of an extension may measure a quantity that has no word here.
    label = QUANTITY_WORDS.get(quantity, quantity)
    return Panel("sensors", message("base.sensors", "sensors"), title, label, tuple(names))


def applied_signal(output: str, unit: str, title: str, *, part: str = "") -> Signal:
    """Declare the columns of a force or a torque that is applied from outside, with a panel.

    Args:
        output: name of the output port, with three values in the world's axes.
        unit: ``N`` for a force, ``N·m`` for a torque.
        title: title of the panel.
        part: name of the part that applies it.
    """
    # The port has three values without names of their own.
    names = tuple(f"{output}.{axis}" for axis in "xyz")
    label = QUANTITY_WORDS["force" if unit == "N" else "torque"]
    panel = Panel("sensors", message("base.applied_forces", "applied forces"), title, label, names)
    return Signal(names, (unit,) * 3, "applied", output, part=part, panel=panel)
