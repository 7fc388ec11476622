"""Where the robots of a station and their tools are, and which postures bring tools elsewhere: of arms, and of legs."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt
from pydrake.math import RigidTransform, RotationMatrix

from simrob_drake.base.errors import InvalidParameter, UnknownName
from simrob_drake.base.frames import PoseLike, Vector, as_transform, poses_from_matrices
from simrob_drake.base.messages import message
from simrob_drake.dynamics import Dynamics
from simrob_drake.kinematics.chain import Chain
from simrob_drake.kinematics.numeric import NumericSolver
from simrob_drake.kinematics.registry import SolverLike, solver_for
from simrob_drake.kinematics.solver import require
from simrob_drake.programs.branches import Branch, Branches, collision, gaps
from simrob_drake.programs.model import one_posture
from simrob_drake.programs.planning import PoseTargets, WorkObject, is_place, is_single, world_poses
from simrob_drake.programs.stateful_station import StatefulStation
from simrob_drake.robots.catalog import RobotModel


class CellRobot:
    """A robot of a station, as arms and legged robots share it; its methods are called, and not assigned to.

    Attributes:
        cell: the station and its state; several robots may share it.
        name: of the robot in the station.
    """

    def __setattr__(self, name: str, value: Any) -> None:
        if callable(getattr(type(self), name, None)):
            raise AttributeError(
                message(
                    "programs.is_a_method",
                    "{name} is a method of {owner}: call {name}({value})",
                    name=name,
                    owner=type(self).__name__,
                    value=repr(value),
                )
            )
        super().__setattr__(name, value)

    def __init__(self, cell: StatefulStation, robot: str | None = None) -> None:
        """Take a robot of a station.

        Args:
            cell: the station.
            robot: its name in the station; needed where there are several.

        Raises:
            UnknownName: no such robot.
            InvalidParameter: a station without a robot, or no robot named where there are several.
        """
        self.cell = cell
        self.name = cell.robot_name(robot)

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {self.name}: {', '.join(self._described())}>"

    def _described(self) -> list[str]:
        return [f"{self.cell.robot(self.name).model.name} in {self.cell.config.name}", f"{len(self.axes)} axes"]

    @property
    def axes(self) -> list[str]:
        """The names of the axes, in order."""
        return self.cell.robot(self.name).axes

    @property
    def tools(self) -> list[str]:
        """The names of the tool frames, and of the pieces that the robot carries."""
        return list(self.cell.robot(self.name).tools)

    @property
    def position(self) -> Vector:
        """Where the axes are, shape (n,) [rad or m]."""
        return self.cell.position(self.name)

    @property
    def velocity(self) -> Vector:
        """How fast they move, shape (n,) [rad/s or m/s]."""
        return self.cell.velocity(self.name)

    def _poses(self, chain: Chain, base: RigidTransform, q: npt.ArrayLike | None) -> Vector:
        """Return where the tool of a chain is, its base being somewhere: pose (6,), or (k, 6) for rows of postures."""
        rows = self.position if q is None else q
        poses = poses_from_matrices(base.GetAsMatrix4() @ chain.forward(rows))
        return poses if np.ndim(rows) > 1 else np.asarray(poses[0])

    @property
    def reference(self) -> Vector:
        """Where they should be, and the next move begins, shape (n,) [rad or m]."""
        return self.cell.reference(self.name)


class ArmGeometry(CellRobot):
    """A robot on a fixed base: kinematics and torques of its tool. Nothing moves.

    Attributes: those of :class:`CellRobot`, and:
        solver: of the inverse kinematics, where a call names none.
    """

    solver: SolverLike

    @property
    def chain(self) -> Chain:
        """The axes from the world to the tool centre point, with their limits."""
        model = self.cell.model
        robot = model.robots[self.name]
        return model.chain(self.name, robot.tools[robot.tcp])

    def tool_pose(self) -> RigidTransform:
        """Return where the tool centre point is now, in the world; :meth:`pose` gives it as numbers."""
        return as_transform(self.chain.forward(self.position)[0])

    def frame(self, wobj: WorkObject = None) -> RigidTransform:
        """Return the pose of a work object in the world; see :class:`Arm`."""
        if wobj is self or (isinstance(wobj, str) and wobj == self.name):
            return as_transform(self.chain.forward(self.reference)[0])
        return self.cell.frame(wobj)

    def pose(self, q: npt.ArrayLike | None = None, wobj: WorkObject = None) -> Vector:
        """Return where the tool is (forward kinematics; SimRob's Pose).

        Args:
            q: postures (n,) or (k, n) [rad or m]; where the arm is unless given.
            wobj: the work object in whose frame the pose is wanted.

        Returns:
            [x y z Rz Ry Rx], shape (6,), or (k, 6) for rows.
        """
        return self._poses(self.chain, self.frame(wobj).inverse(), q)

    def joint(
        self,
        pose: PoseTargets,
        wobj: WorkObject = None,
        solver: SolverLike | None = None,
        *,
        start: npt.ArrayLike | None = None,
    ) -> Vector:
        """Return postures that bring the tool to poses (inverse kinematics; SimRob's Joint).

        Args:
            pose: one or many, or places, which keep the orientation that the tool has.
            wobj: the work object in whose frame they are.
            solver: which; that of the arm unless given.
            start: near which posture (n,) the first is wanted; the next ones near the last. Where the arm is unless
                given.

        Returns:
            shape (n,), or (k, n) for rows [rad or m].

        Raises:
            Unreachable: names the pose, why, and how near the best posture comes.
        """
        chain, begin = self.chain, self.position if start is None else start
        turn = chain.forward(self.position)[0, :3, :3]
        targets = world_poses(pose, self.frame(wobj), turn, "pose")
        found = require(solver_for(chain, self.solver if solver is None else solver).solve(targets, begin), "pose")
        return np.asarray(found[0]) if is_single(pose) else found

    def branches(
        self,
        pose: PoseTargets,
        wobj: WorkObject = None,
        *,
        held: Mapping[str, npt.ArrayLike] | None = None,
        start: npt.ArrayLike | None = None,
    ) -> Branches:
        """Return every posture that brings the tool to a pose, with torque, room to the limits and collision of each.

        Args:
            pose: one, or a place, which keeps the orientation that the tool has.
            wobj: the work object in whose frame it is.
            held: of an arm with more than six axes those that stay, by name, at one position [rad or m] or each of
                several; see :func:`~simrob_drake.kinematics.branches`.
            start: posture (n,) near to which whole turns are chosen; where the arm is unless given.

        Returns:
            as text a table; empty where nothing reaches the pose.
        """
        chain, begin = self.chain, self.position if start is None else start
        target = world_poses(pose, self.frame(wobj), chain.forward(self.position)[0, :3, :3], "pose")
        if len(target) != 1:
            raise InvalidParameter(
                "pose",
                message("programs.count_of_poses", "{count} poses", count=len(target)),
                message("base.one_pose", "one pose"),
            )
        gains = self.cell.robot(self.name).gains
        limit = np.where(gains.passive, np.inf, gains.limit_at_rest)  # a passive axis has no motor to overload
        model = self.cell.collision_model
        gap = gaps(model, self.name, chain)

        def meant(q: Vector) -> Branch:
            met = collision(model, self.name, self.reference, q)
            return Branch.of(chain, q, self.inverse_dynamics(q), limit, met, gap(q))

        return Branches.of(chain, target, begin, {} if held is None else held, meant)

    def jacobian(self, q: npt.ArrayLike | None = None) -> Vector:
        """Return what the axes' speeds give of the tool's: shape (6, n), or (k, 6, n) for rows.

        Rows: velocity of the tool centre point along x, y, z of the world, then angular velocity about them.
        """
        rows = self.position if q is None else q
        jacobians = self.chain.jacobian(rows)
        return jacobians if np.ndim(rows) > 1 else np.asarray(jacobians[0])

    @property
    def dynamics(self) -> Dynamics:
        """Inertia, gravity, payload and more of the arm as it is, with what it carries; others rest."""
        return self.cell.model.dynamics(self.name)

    def inverse_dynamics(
        self, q: npt.ArrayLike | None = None, v: npt.ArrayLike = 0.0, a: npt.ArrayLike = 0.0
    ) -> Vector:
        """Return the torques of a motion with what the arm carries, others at rest (SimRob's IDin).

        Args:
            q: postures (n,) or (k, n) [rad or m]; where the arm is unless given.
            v: velocities, of the same shape, or one number [rad/s].
            a: accelerations, likewise [rad/s²].

        Returns:
            shape (n,), or (k, n) for rows [N·m or N].
        """
        return self.dynamics.inverse_dynamics(self.position if q is None else q, v, a)


_STAYS = (1e-4, 1e-3)  # what counts as a foot that stays [m, rad]: soles that sink in stand a little crooked
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
        """Return the axes, with limits, from the trunk or another tool to a tool; raises UnknownName: no such tool."""
        model = self.cell.model
        robot = model.robots[self.name]
        start = robot.root if base == "trunk" else robot.tools[self._tool(base)]
        return model.chain(self.name, robot.tools[self._tool(tool)], start)

    def trunk_chain(self) -> Chain:
        """Return the axes, with limits, from the world to the trunk: for checks that need no tool."""
        model = self.cell.model
        return model.chain(self.name, model.robots[self.name].root)

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
            raise InvalidParameter(
                "robot",
                self.model.name,
                message("programs.robot_on_own_feet", "one on its own feet, to move its trunk over them"),
            )
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
            raise UnknownName(
                message("base.tool_of", "tool of {model}", model=self.model.name), tool, [*known, "trunk", "world"]
            )
        return tool
