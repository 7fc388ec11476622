"""The axes of a robot in a plant, the units of their positions, and values that users give for each axis.

The order of the axes is that of the robot's description, while Drake orders the joints in its own way. An axis may also
count its positions against the sense of its joint. :class:`AxisMap` converts between the two.
"""

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
from simrob_drake.base.renaming import keep_former_attributes
from simrob_drake.base.sections import Number


def in_a_row(places: npt.NDArray[np.intp]) -> npt.NDArray[np.intp] | slice:
    """Convert indices of an array to a slice, if each is one more than the index before.

    Reading or writing entries by a slice takes a third of the time. Other indices are returned unchanged.
    """
    # An empty array has no first index for a slice.
    are_consecutive = len(places) > 0 and bool((np.diff(places) == 1).all())
    if not are_consecutive:
        return places
    return slice(int(places[0]), int(places[-1]) + 1)


@dataclass(frozen=True, eq=False)
class AxisMap:
    """Places of a robot's n axes among the nq positions and nv velocities of a plant, and their senses.

    The map contains numbers only, so it keeps no plant alive. All methods work on the last dimension of their
    arguments; dimensions before it, such as samples in time, are kept.

    Attributes:
        position_places: index of each axis among the plant's positions, shape (n,).
        velocity_places: index of each axis among the plant's velocities and generalized forces, shape (n,).
        signs: 1.0 for an axis in the sense of its joint, -1.0 against it, shape (n,).
        num_positions: nq of the plant.
        num_velocities: nv of the plant.
    """

    position_places: np.ndarray[tuple[int], np.dtype[np.intp]]
    velocity_places: np.ndarray[tuple[int], np.dtype[np.intp]]
    signs: Vector
    num_positions: int
    num_velocities: int

    @classmethod
    def of_joints(
        cls, plant: MultibodyPlant, joints: Sequence[Joint], signs: npt.ArrayLike | None = None
    ) -> "AxisMap":
        """Make the map of axes from their joints.

        Args:
            plant: the plant, finalized.
            joints: the joint of each axis; each has one position and one velocity.
            signs: 1 or -1 for each axis, shape (n,); all 1 unless given.

        Raises:
            InvalidParameter: there is not one sign for each joint, or a sign is neither 1 nor -1.
        """
        senses = np.ones(len(joints)) if signs is None else np.asarray(signs, dtype=float)
        if senses.shape != (len(joints),) or not (np.abs(senses) == 1.0).all():
            raise InvalidParameter(
                "signs",
                signs,
                message(
                    "robots.numbers_1_or_minus_1",
                    "{joints} numbers 1 or -1, one for each joint",
                    joints=len(joints),
                ),
            )
        return cls(
            position_places=np.array([joint.position_start() for joint in joints], dtype=np.intp),
            velocity_places=np.array([joint.velocity_start() for joint in joints], dtype=np.intp),
            signs=senses,
            num_positions=plant.num_positions(),
            num_velocities=plant.num_velocities(),
        )

    def positions(self, plant_positions: Vector) -> Vector:
        """Extract the positions of the axes, shape (..., n), from positions of the plant, shape (..., nq)."""
        return np.asarray(self.signs * plant_positions[..., self.position_places])

    def velocities(self, plant_velocities: Vector) -> Vector:
        """Extract the velocities of the axes, shape (..., n), from velocities of the plant, shape (..., nv).

        The same holds for accelerations, and for the columns of a Jacobian (m, nv).
        """
        return np.asarray(self.signs * plant_velocities[..., self.velocity_places])

    def efforts(self, plant_efforts: Vector) -> Vector:
        """Extract the efforts of the axes, shape (..., n), from generalized forces of the plant, shape (..., nv).

        The same holds for momenta. The sign of an effort changes with the sense of the axis as that of a velocity does,
        so that their product, the power, stays the same.
        """
        return self.velocities(plant_efforts)

    def spread_positions(self, axes: Vector | float, onto: Vector) -> Vector:
        """Write positions of the axes into a copy of the plant's positions.

        Args:
            axes: positions of the axes, shape (..., n), or one number for all [rad or m].
            onto: positions of the plant, shape (..., nq). Those of other joints are kept.

        Returns:
            positions of the plant, shape (..., nq).
        """
        # A sign is its own inverse: the same product converts in both directions.
        spread = np.array(onto)
        spread[..., self.position_places] = self.signs * axes
        return spread

    def spread_velocities(self, axes: Vector | float, onto: Vector | None = None) -> Vector:
        """Write velocities of the axes into a copy of the plant's velocities. The same holds for generalized forces.

        Args:
            axes: velocities of the axes, shape (..., n), or one number for all [rad/s or m/s].
            onto: velocities of the plant, shape (..., nv), of which those of other joints are kept; zero unless given.

        Returns:
            velocities of the plant, shape (..., nv).
        """
        leading = np.shape(axes)[:-1]
        spread = np.zeros((*leading, self.num_velocities)) if onto is None else np.array(onto)
        spread[..., self.velocity_places] = self.signs * axes
        return spread

    def set_positions(self, plant: MultibodyPlant, context: Context, axes: Vector) -> None:
        """Set positions (n,) [rad or m] of the axes in a context of the plant. Other joints keep theirs."""
        plant.SetPositions(context, self.spread_positions(axes, plant.GetPositions(context)))

    @property
    def position_matrix(self) -> Vector:
        """Matrix, shape (n, nq), whose product with positions of the plant is the result of :meth:`positions`."""
        return self._matrix(self.position_places, self.num_positions)

    @property
    def velocity_matrix(self) -> Vector:
        """Matrix, shape (n, nv), whose product with velocities of the plant is the result of :meth:`velocities`."""
        return self._matrix(self.velocity_places, self.num_velocities)

    @property
    def state_matrix(self) -> Vector:
        """Matrix, shape (2n, nq + nv), from the state of the plant to positions and velocities of the axes."""
        count = len(self.signs)
        matrix = np.zeros((2 * count, self.num_positions + self.num_velocities))
        matrix[:count, : self.num_positions] = self.position_matrix
        matrix[count:, self.num_positions :] = self.velocity_matrix
        return matrix

    def actuation_matrix(
        self, plant: MultibodyPlant, instance: ModelInstanceIndex, passive: Flags | None = None
    ) -> Vector:
        """Compute the matrix from efforts of the axes to the inputs of a robot's nu actuators, shape (nu, n).

        The first actuator of a joint is its motor. Further ones, such as that of its friction, get no effort.

        Args:
            plant: the finalized plant.
            instance: model instance of the robot.
            passive: whether each axis is without a motor, shape (n,); None if all axes have one. The only actuator that
                the joint of such an axis can have is its friction.
        """
        actuators = [
            plant.get_joint_actuator(index) for index in plant.GetJointActuatorIndices(instance)
        ]
        # Drake's actuation matrix B gives generalized forces B u. Its columns have a single 1, so its transpose takes
        # generalized forces to the inputs u again.
        columns = [actuator.input_start() for actuator in actuators]
        actuation = plant.MakeActuationMatrix()[:, columns]
        matrix = (self.velocity_matrix @ actuation).T

        # An actuator is a further one if an actuator before it has the same joint.
        joints = [actuator.joint().index() for actuator in actuators]
        is_further = [joint in joints[:row] for row, joint in enumerate(joints)]
        matrix[is_further] = 0.0
        # A controller may compute efforts for passive axes as well. Their only actuators are those of friction, which
        # must not get them.
        if passive is not None:
            matrix[:, passive] = 0.0
        return np.asarray(matrix)

    def _matrix(self, places: np.ndarray[tuple[int], np.dtype[np.intp]], columns: int) -> Vector:
        """Make a matrix that selects entries of a vector, with the signs of the axes.

        Args:
            places: index of the entry for each of the n axes, shape (n,).
            columns: count of the entries of the vector.

        Returns:
            the matrix, shape (n, columns), with one entry of 1 or -1 in each row.
        """
        matrix = np.zeros((len(places), columns))
        matrix[np.arange(len(places)), places] = self.signs
        return matrix


AxisValues = Number | list[Number] | dict[str, Number]
"""One number for all axes, a list in axis order, or a mapping by axis name or alias."""


def every_axis(accepts: Callable[[float], bool], meaning: str) -> AfterValidator:
    """Make a check of the values that a user gives for the axes, as an annotation of a pydantic field.

    Args:
        accepts: returns whether a number is allowed.
        meaning: message for a number that is not allowed. It describes the allowed numbers.
    """

    def check(values: AxisValues) -> AxisValues:
        """Check every number of the values. A wrong one raises ValueError, which pydantic reports with the key."""
        if isinstance(values, dict):
            numbers = list(values.values())
        elif isinstance(values, list):
            numbers = values
        else:
            numbers = [values]
        if not all(accepts(number) for number in numbers):
            raise ValueError(meaning)
        return values

    return AfterValidator(check)


NotNegativeAxisValues = Annotated[
    AxisValues,
    every_axis(lambda value: value >= 0, message("robots.not_negative", "it must not be negative")),
]
"""Values of axes, none of which is negative."""
PositiveAxisValues = Annotated[
    AxisValues,
    every_axis(lambda value: value > 0, message("robots.positive", "it must be positive")),
]
"""Values of axes, all of which are positive."""


@dataclass(frozen=True)
class AxisUnit:
    """Units of an axis.

    Attributes:
        size: size of the user's unit of position in SI units, such as pi/180 for degrees.
        name: name of the user's unit of position.
        si: name of the SI unit of position, which Drake uses.
        effort: unit of torque or force.
        digits: format of positions in the user's unit, such as ``.1f``.
    """

    size: float
    name: str
    si: str
    effort: str
    digits: str

    def format(self, position: float) -> str:
        """Write a position [rad or m] in the user's unit, such as "110.0 deg"."""
        return compound(
            "{position} {name}", position=f"{position / self.size:{self.digits}}", name=self.name
        )


keep_former_attributes(AxisUnit, shown="format")

REVOLUTE = AxisUnit(size=float(np.deg2rad(1.0)), name="deg", si="rad", effort="N·m", digits=".1f")
"""Units of a revolute axis. Users write degrees."""
PRISMATIC = AxisUnit(size=1.0, name="m", si="m", effort="N", digits=".4g")
"""Units of a prismatic axis."""


def with_units(values: Vector, units: Sequence[str], written: Callable[[Vector], str]) -> str:
    """Write values of axes that have different units: those with the same unit together, followed by the unit.

    Args:
        values: a value of each axis, shape (n,) or (n, k), in the axis' unit.
        units: unit of each axis.
        written: function that writes the values of the axes with the same unit, shape (i,) or (i, k).

    Returns:
        the texts of all units, in the order in which the units appear, such as ``10, 20 deg, 0.5 m``.
    """
    # A set would lose the order of the axes, in which the units appear.
    kinds = list(dict.fromkeys(units))
    texts = []
    for kind in kinds:
        has_unit = [unit == kind for unit in units]
        text = written(values[has_unit])
        texts.append(compound("{written} {kind}", written=text, kind=kind))
    return join_texts(texts, ", ")
