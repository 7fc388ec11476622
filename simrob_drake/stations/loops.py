"""Closed kinematic loops of a robot: a posture that closes them, and the axes that need no motor.

A robot's model is a tree of links. A *loop* is closed by a coupling between two links, which holds an *end* on one link
to an end on the other. A coupling is one of three kinds: a ball joint holds two points together, a hinge two frames
whose z axes stay parallel, and a weld two frames. The *deviations* of a loop say how far its ends are from that.
The first station that is drafted for a robot begins in a posture in which all deviations are zero.

An axis is *passive* if the loops determine its position from the positions of the other axes. It needs no motor. Axes
that have no motor in the robot's file are chosen first.
"""

from typing import Any, NamedTuple

import numpy as np
from pydrake.math import RigidTransform
from pydrake.multibody.tree import Frame

from simrob_drake.base.errors import InvalidParameter
from simrob_drake.base.frames import Vector, transform_from_pose
from simrob_drake.base.messages import message
from simrob_drake.robots.catalog import RobotModel
from simrob_drake.robots.parse import lone_robot

_CLOSED = 1e-6  # a loop is closed if no deviation is larger than this [m or rad]
# Count of random postures from which a search starts, in addition to the home posture.
_RANDOM_STARTS = 20
# Largest distance of these postures from the home posture, for each axis [rad or m].
_SPREAD = 1.0
_STEP = 1e-6  # step of an axis for the central difference [rad or m]
_MARGIN = 1e-6  # distance of a search's bounds from the limits of the axes [rad or m]
# Columns of a matrix are dependent below this singular value, as a share of the longest column.
_INDEPENDENT = 1e-4


class _EndPoses(NamedTuple):
    """Poses of the two ends of a loop in the world. Ends that are points have the axes of their links."""

    first: RigidTransform
    second: RigidTransform


class LoopsOfRobot:
    """The loops of a robot without a station around it, as functions of the positions of its axes."""

    def __init__(self, robot: RobotModel) -> None:
        """Build the plant of the robot alone.

        Args:
            robot: a robot with at least one loop.
        """
        self._robot = robot
        self._lone = lone_robot(robot, collision=False)
        self._context = self._lone.plant.CreateDefaultContext()

    def deviations(self, posture: Vector) -> Vector:
        """Deviations (k,) [m and rad] of all loops in a posture (n,) [rad or m]; zero if all loops are closed."""
        self._lone.axes.set_positions(self._lone.plant, self._context, posture)
        by_loop = [self._deviations(coupling) for coupling in self._robot.loops.values()]
        return np.concatenate(by_loop)

    def closed_posture(self) -> Vector:
        """Search the posture (n,) [rad or m] that closes all loops, within the limits of the axes.

        Of several such postures that are found, the one that is nearest to the home posture is returned.

        Raises:
            InvalidParameter: no posture was found that closes all loops.
        """
        # Loaded where it is needed: other commands start without SciPy.
        from scipy.optimize import least_squares

        lower, upper = self._robot.axis_limits
        home = np.clip(self._robot.home, lower, upper)
        # Many robots are stretched out at home. The loops are singular there: all derivatives in the direction of the
        # solution are zero, so a search from home does not move. Searches from random postures do.
        random = np.random.default_rng(0)
        offsets = random.uniform(-_SPREAD, _SPREAD, (_RANDOM_STARTS, len(home)))
        all_offsets = np.vstack([np.zeros(len(home)), offsets])
        starts = np.clip(home + all_offsets, lower, upper)

        # A start may be at a limit, and SciPy accepts only starts strictly inside the bounds.
        bounds = (lower - _MARGIN, upper + _MARGIN)
        closed_postures = []
        least_deviation = np.inf
        for start in starts:
            # Tolerances at rounding: SciPy's own ones stop before the loops are closed to _CLOSED.
            solution = least_squares(self.deviations, start, bounds=bounds, xtol=1e-15, ftol=1e-15)
            deviation = float(np.abs(solution.fun).max())
            least_deviation = min(least_deviation, deviation)
            if deviation <= _CLOSED:
                closed_postures.append(solution.x)
        if not closed_postures:
            expected = message(
                "stations.closed_within_limits", "closed in some posture within the limits"
            )
            raise InvalidParameter(
                message("stations.each_loop", "each kinematic loop"),
                message(
                    "stations.open_at_best",
                    "open by {deviation:.3g} m or rad at best",
                    deviation=least_deviation,
                ),
                expected,
            )
        candidates = np.array(closed_postures)
        squared_distances = np.square(candidates - home).sum(axis=1)
        nearest = candidates[squared_distances.argmin()]
        return np.asarray(np.clip(nearest, lower, upper))

    def passive_axes(self, posture: Vector) -> list[int]:
        """Choose the passive axes: those that the loops move, as soon as the other axes have their positions.

        The derivatives of the deviations by the passive axes form a matrix with linearly independent columns. Many
        choices are possible. Axes without a motor become passive first. Of the others, axes far from the base follow
        first, so motors stay near the base.

        Args:
            posture: a posture that closes all loops, shape (n,) [rad or m].

        Returns:
            indices of the passive axes, in ascending order.
        """
        jacobian = self._jacobian(posture)  # a row for each deviation, a column for each axis
        longest_column = np.linalg.norm(jacobian, axis=0).max()
        # Relative, as the columns mix metres and radians and grow with the size of the robot.
        threshold = _INDEPENDENT * longest_column
        axis_count = jacobian.shape[1]
        passive = list[int]()
        # Usually the axes of a robot are numbered from the base outward.
        outermost_first = list(reversed(range(axis_count)))
        # Sorting keeps the order of equal keys: axes without a motor have the key False, which comes first.
        order = sorted(outermost_first, key=lambda axis: not self._robot.passive[axis])
        for axis in order:
            columns = [*passive, axis]
            singular_values = np.linalg.svd(jacobian[:, columns], compute_uv=False)
            # A matrix with more columns than rows has fewer singular values than columns, which are then dependent.
            has_enough_rows = len(singular_values) == len(columns)
            if has_enough_rows and singular_values[-1] > threshold:
                passive.append(axis)
        return sorted(passive)

    def _jacobian(self, posture: Vector) -> Vector:
        """Derivatives (k, n) of the deviations by the positions of the axes, by central differences."""
        columns = []
        for axis in range(len(posture)):
            step = np.zeros(len(posture))
            step[axis] = _STEP
            difference = self.deviations(posture + step) - self.deviations(posture - step)
            columns.append(difference / (2 * _STEP))
        return np.column_stack(columns)

    def _deviations(self, coupling: dict[str, Any]) -> Vector:
        """Deviations of one loop in the present posture.

        Args:
            coupling: the coupling that closes the loop, as a mapping with the keys that it has in a station's file.

        Returns:
            the translation from the first end to the second, in the axes of the first (3,) [m]. For a hinge two, and
            for a weld three elements of the rotation between the ends follow. They are zero if the z axes are parallel,
            or the frames aligned, and nearly angles [rad] if the loop is almost closed.
        """
        ends = self._end_poses(coupling)
        relative = ends.first.inverse() @ ends.second
        translation = relative.translation()
        rotation = relative.rotation().matrix()
        if coupling["kind"] == "ball":
            return np.asarray(translation)
        z_tilt = rotation[:2, 2]  # x and y component of the second z axis
        if coupling["kind"] == "hinge":
            return np.concatenate([translation, z_tilt])
        y_tilt = rotation[:1, 1]  # x component of the second y axis
        return np.concatenate([translation, z_tilt, y_tilt])

    def _end_poses(self, coupling: dict[str, Any]) -> _EndPoses:
        """Poses in the world of the two ends of a loop, in the present posture."""
        if coupling["kind"] == "ball":
            first = RigidTransform(np.array(coupling["point"]))
            second = RigidTransform(np.array(coupling["other_point"]))
        else:
            first = transform_from_pose(coupling["pose"])
            second = transform_from_pose(coupling["other_pose"])
        return _EndPoses(
            first=self._link_pose(coupling["body"]) @ first,
            second=self._link_pose(coupling["other"]) @ second,
        )

    def _link_pose(self, link: str) -> RigidTransform:
        """Pose of a link in the world, in the present posture."""
        frame: Frame = self._lone.plant.GetFrameByName(link, self._lone.instance)
        return frame.CalcPoseInWorld(self._context)
