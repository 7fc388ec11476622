"""What the outputs of a station are: columns with units and roles, and the plots that show them.

Whoever makes an output declares it once; tables, plots, block pictures and summaries only read the declarations.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal, Protocol, TypeAlias

from simrob_drake.base.frames import VELOCITY_NAMES, XYZ_QUATERNION_NAMES, Vector
from simrob_drake.base.messages import message

Role = Literal[
    "reference", "motion", "effort", "pose", "force", "moment", "applied", "estimate", "distance", "inertial", "own"
]
"""What a signal is: what a robot is asked, how it moves, what drives it, where it is, what is felt or applied."""

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

POSE = XYZ_QUATERNION_NAMES, ("m",) * 3 + ("1",) * 4, QUANTITY_WORDS["position"]
VELOCITY = VELOCITY_NAMES, ("m/s",) * 3 + ("rad/s",) * 3, QUANTITY_WORDS["velocity"]
"""Names of the columns of poses and velocities, their units, and the quantity of the first three in a plot."""


@dataclass(frozen=True)
class Panel:
    """What one plot panel of declared signals shows."""

    figure: str  # the file it belongs to, without suffix: ``sensors``, ``piece_ball``
    heading: str  # of the figure
    title: str  # of the panel
    # quantity on its upright axis: a message without the unit, which is added; or a plain text such as "force [N]"
    label: str
    columns: tuple[str, ...]  # of the result
    components: tuple[str, ...] = ()  # what the curves are called; as the columns end unless given


class Recorded(Protocol):
    """A run that is over, as parts look at it: its recorded states, and any port evaluated at them."""

    @property
    def step_times(self) -> Vector:
        """Ends of the accepted steps, shape (m,) [s]."""

    @property
    def memo(self) -> dict[Any, Any]:
        """What parts worked out of this run, for each other."""

    def sample(self, ports: Sequence[Any], times: Vector) -> list[Any]:
        """Return the values of ports at times (k,) [s]: arrays (k, size), or lists of abstract values."""


Compute: TypeAlias = Callable[[Recorded, Vector], Vector]
"""Gives columns of a run that is over at times (m,) [s], shape (m, k)."""


@dataclass(frozen=True)
class Signal:
    """Columns of a result."""

    names: tuple[str, ...]  # of the k columns
    units: tuple[str, ...]  # of each of them, shape (k,): ``rad``, ``N·m``, ``1``
    role: Role  # what they are
    output: str = ""  # the station's output port that gives them; empty where they are computed
    entries: tuple[int, ...] | None = None  # which of the output's values they are; all of them unless given
    compute: Compute | None = None  # gives them of a run at times (m,), shape (m, k), where no port does
    # changes what the port gave, of a run at times (m,), shape (m, k) to (m, k)
    adjust: Callable[[Recorded, Vector, Vector], Vector] | None = None
    part: str = ""  # the sensor, piece or block that declares them; empty for the robots' own
    # title and label of their own plot panel, with figure and heading; None where plots of robots show them
    panel: Panel | None = None

    def __getstate__(self) -> dict[str, Any]:
        """Content of a pickled declaration. The functions that compute columns need a plant, and are left out."""
        return {**self.__dict__, "compute": None, "adjust": None}


def sensor_panel(title: str, quantity: str, names: Sequence[str], units: Sequence[str] = ()) -> Panel:
    """Make the panel of a sensor's columns in the figure ``sensors``.

    Args:
        title: title of the panel.
        quantity: what the sensor measures: a key of `QUANTITY_WORDS`, or any other word.
        names: names of the columns.
        units: not used, since the signal has the units of its columns. Callers of before give them.
    """
    label = QUANTITY_WORDS.get(quantity, quantity)
    return Panel("sensors", message("base.sensors", "sensors"), title, label, tuple(names))


def applied_signal(output: str, unit: str, title: str, *, part: str = "") -> Signal:
    """Return what an output (3) is that gives a force [N] or a torque [N·m] from outside, with its panel."""
    names = tuple(f"{output}.{axis}" for axis in "xyz")
    label = QUANTITY_WORDS["force" if unit == "N" else "torque"]
    panel = Panel("sensors", message("base.applied_forces", "applied forces"), title, label, names)
    return Signal(names, (unit,) * 3, "applied", output, part=part, panel=panel)
