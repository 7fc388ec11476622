"""The axes of a robot: their order, names and units, and how values are laid out over them."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np
import numpy.typing as npt
from pydantic import AfterValidator
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Joint, ModelInstanceIndex
from pydrake.systems.framework import Context

from simrob_drake.base.errors import InvalidParameter
from simrob_drake.base.frames import Flags, Vector
from simrob_drake.base.messages import compound, join_texts, message
from simrob_drake.base.sections import Number


def in_a_row(places: npt.NDArray[np.intp]) -> npt.NDArray[np.intp] | slice:
    """Return places, as a slice where they follow each other, which takes a third of the time to read or write."""
    follow = len(places) > 0 and bool((np.diff(places) == 1).all())
    return slice(int(places[0]), int(places[-1]) + 1) if follow else places


@dataclass(frozen=True, eq=False)
class AxisMap:
    """Where the n axes of a robot stand among the nq positions and nv velocities of a plant, and their senses.

    It holds numbers alone, so it keeps no plant alive. All methods take leading dimensions, as of samples in time: they
    act on the last one.

    Attributes:
        position_places: of the axes among the plant's positions, shape (n,).
        velocity_places: of the axes among the plant's velocities and generalized forces, shape (n,).
        signs: 1.0 or -1.0, shape (n,): the sense of each axis against that of its joint.
        num_positions, num_velocities: nq and nv of the plant.
    """

    position_places: np.ndarray[tuple[int], np.dtype[np.intp]]
    velocity_places: np.ndarray[tuple[int], np.dtype[np.intp]]
    signs: Vector
    num_positions: int
    num_velocities: int

    @classmethod
    def of_joints(cls, plant: MultibodyPlant, joints: Sequence[Joint], signs: npt.ArrayLike | None = None) -> "AxisMap":
        """Return the map of one-axis joints, one an axis, of a finalized plant; signs (n,) are all 1 unless given.

        Raises:
            InvalidParameter: signs that are not one a joint, 1 or -1.
        """
        senses = np.ones(len(joints)) if signs is None else np.asarray(signs, dtype=float)
        if senses.shape != (len(joints),) or not (np.abs(senses) == 1.0).all():
            raise InvalidParameter(
                "signs",
                signs,
                message("robots.numbers_1_or_minus_1", "{joints} numbers 1 or -1, one a joint", joints=len(joints)),
            )
        return cls(
            position_places=np.array([joint.position_start() for joint in joints], dtype=np.intp),
            velocity_places=np.array([joint.velocity_start() for joint in joints], dtype=np.intp),
            signs=senses,
            num_positions=plant.num_positions(),
            num_velocities=plant.num_velocities(),
        )

    def positions(self, plant_positions: Vector) -> Vector:
        """Return the axes' entries (..., n) of the plant's positions (..., nq)."""
        return np.asarray(self.signs * plant_positions[..., self.position_places])

    def velocities(self, plant_velocities: Vector) -> Vector:
        """Return the axes' entries (..., n) of the plant's velocities or accelerations (..., nv).

        So it does for the columns of a Jacobian (m, nv).
        """
        return np.asarray(self.signs * plant_velocities[..., self.velocity_places])

    def efforts(self, plant_efforts: Vector) -> Vector:
        """Return the axes' entries (..., n) of the plant's generalized forces or momenta (..., nv)."""
        return self.velocities(plant_efforts)

    def spread_positions(self, axes: Vector | float, onto: Vector) -> Vector:
        """Return the plant's positions ``onto`` (..., nq) with those of the axes (..., n) put in."""
        spread = np.array(onto)
        spread[..., self.position_places] = self.signs * axes
        return spread

    def spread_velocities(self, axes: Vector | float, onto: Vector | None = None) -> Vector:
        """Return velocities ``onto`` (..., nv) of the plant, zero unless given, with the axes' (..., n) put in.

        So it does for generalized forces.
        """
        leading = np.shape(axes)[:-1]
        spread = np.zeros((*leading, self.num_velocities)) if onto is None else np.array(onto)
        spread[..., self.velocity_places] = self.signs * axes
        return spread

    def set_positions(self, plant: MultibodyPlant, context: Context, axes: Vector) -> None:
        """Put the axes to positions (n,) [rad or m] in a context of the plant; the other joints stay."""
        plant.SetPositions(context, self.spread_positions(axes, plant.GetPositions(context)))

    @property
    def position_matrix(self) -> Vector:
        """The matrix (n, nq) that :meth:`positions` multiplies with."""
        return self._matrix(self.position_places, self.num_positions)

    @property
    def velocity_matrix(self) -> Vector:
        """The matrix (n, nv) that :meth:`velocities` and :meth:`efforts` multiply with."""
        return self._matrix(self.velocity_places, self.num_velocities)

    @property
    def state_matrix(self) -> Vector:
        """The matrix (2n, nq + nv) from the plant's state to positions and velocities of the axes."""
        count = len(self.signs)
        matrix = np.zeros((2 * count, self.num_positions + self.num_velocities))
        matrix[:count, : self.num_positions] = self.position_matrix
        matrix[count:, self.num_positions :] = self.velocity_matrix
        return matrix

    def actuation_matrix(
        self, plant: MultibodyPlant, instance: ModelInstanceIndex, passive: Flags | None = None
    ) -> Vector:
        """Compute the matrix (nu, n) from efforts of the axes to the actuators of a model instance of the plant.

        A joint's first actuator is its motor; others, such as its friction, take nothing.

        Args:
            plant: the finalized plant.
            instance: model instance of the robot.
            passive: whether each axis is without a motor, shape (n,); None if all axes have one. The only actuator that
                the joint of such an axis can have is its friction.
        """
        actuators = [plant.get_joint_actuator(index) for index in plant.GetJointActuatorIndices(instance)]
        matrix = (self.velocity_matrix @ plant.MakeActuationMatrix()[:, [a.input_start() for a in actuators]]).T
        joints = [actuator.joint().index() for actuator in actuators]
        matrix[[row for row, joint in enumerate(joints) if joint in joints[:row]]] = 0.0
        if passive is not None:
            matrix[:, passive] = 0.0
        return np.asarray(matrix)

    def _matrix(self, places: np.ndarray[tuple[int], np.dtype[np.intp]], columns: int) -> Vector:
        matrix = np.zeros((len(places), columns))
        matrix[np.arange(len(places)), places] = self.signs
        return matrix


AxisValues = Number | list[Number] | dict[str, Number]
"""One number for all axes, a list in axis order, or a mapping by axis name or alias."""


def every_axis(accepts: Callable[[float], bool], meaning: str) -> AfterValidator:
    """Check every number of values per axis; ``meaning`` says which are accepted."""

    def checked(values: AxisValues) -> AxisValues:
        listed = values.values() if isinstance(values, dict) else values if isinstance(values, list) else [values]
        if not all(map(accepts, listed)):
            raise ValueError(meaning)
        return values

    return AfterValidator(checked)


NotNegativeAxisValues = Annotated[
    AxisValues, every_axis(lambda value: value >= 0, message("robots.not_negative", "it must not be negative"))
]
PositiveAxisValues = Annotated[
    AxisValues, every_axis(lambda value: value > 0, message("robots.positive", "it must be positive"))
]


@dataclass(frozen=True)
class AxisUnit:
    """In what an axis is measured."""

    size: float  # of a user's unit of position in SI
    name: str  # of the user's unit, and ``si`` of the one that Drake has
    si: str
    effort: str  # unit of its torque or force
    digits: str  # how its positions are written

    def shown(self, position: float) -> str:
        """Return a position [rad or m] in the user's unit: "110.0 deg"."""
        return compound("{position} {name}", position=f"{position / self.size:{self.digits}}", name=self.name)


REVOLUTE = AxisUnit(float(np.deg2rad(1.0)), "deg", "rad", "N·m", ".1f")
PRISMATIC = AxisUnit(1.0, "m", "m", "N", ".4g")


def with_units(values: Vector, units: Sequence[str], written: Callable[[Vector], str]) -> str:
    """Return values (n,) or (n, k) as ``written`` writes them, those of each unit together with it."""
    kinds = list(dict.fromkeys(units))
    return join_texts(
        (
            compound("{written} {kind}", written=written(values[[unit == kind for unit in units]]), kind=kind)
            for kind in kinds
        ),
        ", ",
    )
