"""A first station for a robot with closed loops: a posture that closes them, and which axes have motors."""

from typing import Any

import numpy as np
from pydrake.math import RigidTransform
from pydrake.multibody.tree import Frame

from simrob_drake.errors import InvalidParameter
from simrob_drake.frames import Vector, transform_from_pose
from simrob_drake.robots.catalog import RobotModel
from simrob_drake.robots.parse import lone_robot

_CLOSED = 1e-6  # m or rad: distance of the ends of a loop that counts as closed
_STARTS, _SPREAD = 20, 1.0  # postures about home from which a closed one is searched, and how far off [rad or m]
_STEP = 1e-6  # rad or m of the derivatives
_RANK = 1e-4  # part of the largest column below which a column of the derivatives adds nothing


class LoopsOfRobot:
    """The loops of a robot alone: how far their ends are apart over the positions of the axes."""

    def __init__(self, robot: RobotModel) -> None:
        """Build the robot alone.

        Raises:
            UnknownName: a loop between links that the robot does not have.
        """
        self._robot = robot
        self._lone = lone_robot(robot, collision=False)
        self._context = self._lone.plant.CreateDefaultContext()

    def misses(self, posture: Vector) -> Vector:
        """Deviations (k,) [m and rad] of all loops from closed, in a posture (n,) [rad or m]."""
        self._lone.axes.set_positions(self._lone.plant, self._context, posture)
        return np.concatenate([self._misses_of(entry) for entry in self._robot.loops.values()])

    def closed_posture(self) -> Vector:
        """The posture (n,) [rad or m] nearest to home that closes all loops.

        Raises:
            InvalidParameter: no posture within the limits closes them.
        """
        from scipy.optimize import least_squares  # loaded where it is needed: other commands start without SciPy

        lower, upper = self._robot.axis_limits
        home = np.clip(self._robot.home, lower, upper)
        # Stretched out, as many robots are at home, a loop is singular, and no search from there moves; hence others.
        random = np.random.default_rng(0)
        spread = random.uniform(-_SPREAD, _SPREAD, (_STARTS, len(home)))
        starts = np.clip(home + np.vstack([np.zeros(len(home)), spread]), lower, upper)
        bounds = lower - _STEP, upper + _STEP
        found = [least_squares(self.misses, start, bounds=bounds, xtol=1e-15, ftol=1e-15) for start in starts]
        gaps = np.array([float(np.abs(one.fun).max()) for one in found])
        if gaps.min() > _CLOSED:
            expected = "closed in some posture within the limits"
            raise InvalidParameter("each loop", f"open by {gaps.min():.3g} m or rad at best", expected)
        closed = np.array([one.x for one, gap in zip(found, gaps, strict=True) if gap <= _CLOSED])
        nearest = closed[np.square(closed - home).sum(axis=1).argmin()]
        return np.asarray(np.clip(nearest, lower, upper))

    def passive_axes(self, posture: Vector) -> list[int]:
        """Axes that the loops move once the others stand, by index; those nearest to the base are left to motors."""
        derivatives = self._derivatives(posture)
        least = _RANK * np.linalg.norm(derivatives, axis=0).max()
        passive = list[int]()
        for axis in reversed(range(derivatives.shape[1])):
            values = np.linalg.svd(derivatives[:, [*passive, axis]], compute_uv=False)
            if values[-1] > least and len(values) == len(passive) + 1:
                passive.append(axis)
        return sorted(passive)

    def _derivatives(self, posture: Vector) -> Vector:
        """Derivatives (k, n) of the deviations by the positions, by central differences."""
        columns = []
        for axis in range(len(posture)):
            step = np.zeros(len(posture))
            step[axis] = _STEP
            columns.append((self.misses(posture + step) - self.misses(posture - step)) / (2 * _STEP))
        return np.column_stack(columns)

    def _misses_of(self, entry: dict[str, Any]) -> Vector:
        """Deviations of one loop: the way between its ends, and for hinges and welds what they are turned."""
        poses = [self._pose(entry[end], entry[key]) for end, key in self._places(entry)]
        apart = poses[0].inverse() @ poses[1]
        way = apart.translation()
        turn = apart.rotation().matrix()
        if entry["kind"] == "ball":
            return np.asarray(way)
        # A hinge's z axes are parallel if the one has no x and y in the other.
        tilt = turn[:2, 2] if entry["kind"] == "hinge" else turn[[0, 1, 0], [2, 2, 1]]
        return np.concatenate([way, tilt])

    @staticmethod
    def _places(entry: dict[str, Any]) -> list[tuple[str, str]]:
        """Keys of the two bodies of a loop, and of the places on them."""
        key = "point" if entry["kind"] == "ball" else "pose"
        return [("body", key), ("other", f"other_{key}")]

    def _pose(self, link: str, place: list[float]) -> RigidTransform:
        """Pose in the world of a place on a link."""
        own = RigidTransform(np.array(place)) if len(place) == 3 else transform_from_pose(place)
        frame: Frame = self._lone.plant.GetFrameByName(link, self._lone.instance)
        return frame.CalcPoseInWorld(self._context) @ own
