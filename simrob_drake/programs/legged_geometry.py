"""Where a legged robot and its hands, feet and head are, and what posture brings them elsewhere."""

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt
from pydrake.math import RigidTransform, RotationMatrix

from simrob_drake.errors import InvalidParameter, UnknownName
from simrob_drake.frames import PoseLike, Vector, as_transform
from simrob_drake.kinematics import Chain, NumericSolver, require
from simrob_drake.kinematics.analytic import SolverLike, solver_for
from simrob_drake.programs.cell_robot import CellRobot
from simrob_drake.programs.stateful_station import one_posture
from simrob_drake.programs.targets import PoseTargets, is_place, is_single, world_poses
from simrob_drake.robots.catalog import RobotModel

_STAYS = (1e-4, 1e-3)
"""What counts as a foot that stays [m, rad]: soles that sink in stand a little crooked."""
_WHOLE_POSE = (1.0, 1.0, 1.0, 1.0, 1.0, 1.0)
_PLACE_ONLY = (1.0, 1.0, 1.0, 0.0, 0.0, 0.0)


class LeggedGeometry(CellRobot):
    """A robot whose root moves: its axes, and kinematics from the trunk to hands, feet and head. Nothing moves.

    Attributes: those of :class:`CellRobot`.
    """

    @property
    def model(self) -> RobotModel:
        """The robot as its ``robot.yaml`` describes it."""
        return self.cell.robot(self.name).model

    @property
    def worn_feet(self) -> str | None:
        """The kind of feet that it stands on: the station's ``robot.feet``, else its default one; None without feet."""
        return self.cell.config.robots[self.name].feet or (self.model.feet.default if self.model.feet else None)

    @property
    def base_pose(self) -> RigidTransform:
        """Pose of the root link in the world."""
        return self.cell.model.pose(self.cell.robot(self.name).root)

    def chain(self, tool: str, base: str = "trunk") -> Chain:
        """Return the axes from the trunk, or from another tool, to a tool, with their limits.

        Raises:
            UnknownName: no such tool.
        """
        model = self.cell.model
        robot = model.robots[self.name]
        start = robot.root if base == "trunk" else robot.tools[self._tool(base)]
        return model.chain(self.name, robot.tools[self._tool(tool)], start)

    def pose(self, tool: str, q: npt.ArrayLike | None = None, frame: str = "world") -> Vector:
        """Return where a tool is (forward kinematics).

        Args:
            tool: one of :attr:`tools`.
            q: postures (n,) or (k, n) [rad]; where the robot is unless given.
            frame: ``world`` (with the trunk where it is now), ``trunk``, or another tool.

        Returns:
            [x y z Rz Ry Rx], shape (6,), or (k, 6) for rows.

        Raises:
            UnknownName: no such tool or frame.
        """
        return self._poses(self.chain(tool, "trunk" if frame == "world" else frame), self._place_of(frame), q)

    def joint(
        self,
        tool: str,
        pose: PoseTargets,
        frame: str = "trunk",
        solver: SolverLike = "numeric",
        *,
        start: npt.ArrayLike | None = None,
    ) -> Vector:
        """Return postures that bring a tool to poses (inverse kinematics); axes that do not move it stay.

        Args:
            tool: one of :attr:`tools`.
            pose: one or many, or places [x y z], which leave the orientation free: limbs of less than six axes reach
                few whole poses.
            frame: ``trunk``, ``world`` (with the trunk where it is now), or another tool, such as a foot that stands:
                then all axes from there to the tool help.
            solver: for whole poses.
            start: near which posture (n,) the first is wanted; where its reference is unless given.

        Returns:
            shape (n,), or (k, n) for rows [rad].

        Raises:
            Unreachable: names the pose, why, and how near the best posture comes.
            UnknownName: no such tool, frame or solver.
        """
        chain = self.chain(tool, "trunk" if frame == "world" else frame)
        begin = self.reference if start is None else one_posture(start, len(self.axes), "start")
        targets = world_poses(pose, self._place_of(frame).inverse(), RotationMatrix().matrix(), "pose")
        chosen = NumericSolver(chain, weights=_PLACE_ONLY) if is_place(pose) else solver_for(chain, solver)
        found = require(chosen.solve(targets, begin), "pose").copy()
        others = [axis for axis in range(len(chain.names)) if axis not in chain.order]
        found[:, others] = begin[others]  # searches that begin anew change all axes
        return np.asarray(found[0]) if is_single(pose) else found

    def posture(
        self, trunk: PoseLike, reach: Mapping[str, PoseTargets] | None = None, *, start: npt.ArrayLike | None = None
    ) -> Vector:
        """Return the posture (n,) [rad] in which the trunk is somewhere else while the feet stay where they are.

        Args:
            trunk: pose of the root link in the world.
            reach: what other tools do then: poses, or places [x y z], in the world.
            start: near which posture (n,) it is wanted; where the robot's reference is unless given.

        Raises:
            InvalidParameter: a robot without feet, or one that is held.
            Unreachable: names the tool; legs without roll or yaw let the trunk go up, down, ahead and back only.
            UnknownName: no such tool.
        """
        feet = self.feet
        if not feet or not self.cell.model.floats(self.name):
            raise InvalidParameter("robot", self.model.name, "one on its own feet, to move its trunk over them")
        there = as_transform(trunk).inverse()
        q = self.reference if start is None else one_posture(start, len(self.axes), "start")
        for foot in feet:
            stays = there @ self.base_pose @ as_transform(self.pose(foot, frame="trunk"))
            chain = self.chain(foot)
            weights = _PLACE_ONLY if len(chain.order) <= 3 else _WHOLE_POSE  # a ball at the end of a leg may turn
            position, rotation = _STAYS
            solver = NumericSolver(chain, weights=weights, position_tolerance=position, rotation_tolerance=rotation)
            q = self.joint(foot, stays, solver=solver, start=q)
        for tool, target in (reach or {}).items():
            seen = there @ np.asarray(target, dtype=float) if is_place(target) else there @ as_transform(target)
            q = self.joint(tool, seen, start=q)
        return q

    @property
    def feet(self) -> list[str]:
        """The tools that lie on the robot's feet."""
        robot = self.cell.robot(self.name)
        links = [] if robot.feet is None else robot.feet.links
        plant = self.cell.model.plant
        bodies = [plant.GetFrameByName(link, robot.instance).body().index() for link in links]
        return [name for name, frame in robot.tools.items() if frame.body().index() in bodies]

    @property
    def soles(self) -> Vector:
        """The points of its feet that may touch the ground, in the world, shape (m, 3) [m]; none without feet."""
        robot, model = self.cell.robot(self.name), self.cell.model
        if robot.feet is None:
            return np.zeros((0, 3))
        poses = {link: model.pose(model.plant.GetFrameByName(link, robot.instance)) for link in robot.feet.links}
        return np.vstack(
            [robot.feet.lowest_points(link, pose.GetAsMatrix4()[np.newaxis])[0] for link, pose in poses.items()]
        )

    def targets_deg(self, q: npt.ArrayLike) -> dict[str, float]:
        """Return a posture (n,) [rad] as targets of a move [deg]: the axes that differ from where the reference is."""
        target = one_posture(q, len(self.axes), "q")
        moved = np.abs(target - self.reference) > 0
        values = target / self.model.user_units
        return {axis: float(value) for axis, value, new in zip(self.axes, values, moved, strict=True) if new}

    def _place_of(self, frame: str) -> RigidTransform:
        return self.base_pose if frame == "world" else RigidTransform()

    def _tool(self, tool: str) -> str:
        known = self.cell.robot(self.name).tools
        if not isinstance(tool, str) or tool not in known:
            raise UnknownName(f"tool of {self.model.name}", tool, [*known, "trunk", "world"])
        return tool
