"""Kinematics and statics of the robots of a station: of arms, and of robots with legs. Nothing moves.

Forward kinematics (`pose`) computes where a tool is, inverse kinematics (`joint`) the postures that bring a tool to a
pose. A *place* is a position without an orientation. A robot's *reference* is where its axes should be. A *chain* is
the axes between a base and a tool, for their kinematics. A *work object* (`wobj`) is the frame of poses and places:
None is the world.
"""

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
    """A robot of a station: the common part of arms and of robots with legs.

    Attributes:
        cell: the station and its state. Several robots may share it.
        name: name of the robot in the station.
    """

    def __setattr__(self, name: str, value: Any) -> None:
        """Set an attribute, but refuse to replace a method: users of SimRob write `robot.tool = ...` by mistake.

        Raises:
            AttributeError: the class has a method of this name.
        """
        # The assignment would hide the method without any message, and no tool would change.
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
            robot: name of the robot. It may be None if the station has a single robot.

        Raises:
            UnknownName: there is no such robot.
            InvalidParameter: the station has no robot, or it has several and none is named.
        """
        self.cell = cell
        self.name = cell.robot_name(robot)

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {self.name}: {', '.join(self._description())}>"

    def _description(self) -> list[str]:
        """Parts of the text that `repr` returns."""
        return [
            f"{self.cell.robot(self.name).model.name} in {self.cell.config.name}",
            f"{len(self.axes)} axes",
        ]

    @property
    def axes(self) -> list[str]:
        """Names of the axes, in their order."""
        return self.cell.robot(self.name).axes

    @property
    def tools(self) -> list[str]:
        """Names of the robot's tools, and of the pieces that it carries; also ``tcp`` if its tool has an offset."""
        return list(self.cell.robot(self.name).tools)

    @property
    def position(self) -> Vector:
        """Positions of the axes, shape (n,) [rad or m]."""
        return self.cell.position(self.name)

    @property
    def velocity(self) -> Vector:
        """Velocities of the axes, shape (n,) [rad/s or m/s]."""
        return self.cell.velocity(self.name)

    def _poses(self, chain: Chain, base: RigidTransform, q: npt.ArrayLike | None) -> Vector:
        """Compute poses of the tool of a chain.

        Args:
            chain: the chain.
            base: pose of the chain's base in the frame in which the poses are returned.
            q: postures (n,) or (k, n) [rad or m]. If it is None, where the robot is.

        Returns:
            [x y z Rz Ry Rx] [m, rad], shape (6,), or (k, 6) for several postures.
        """
        # A single posture gives a single pose, not an array of one.
        postures = self.position if q is None else q
        poses = poses_from_matrices(base.GetAsMatrix4() @ chain.forward(postures))
        return poses if np.ndim(postures) > 1 else np.asarray(poses[0])

    @property
    def reference(self) -> Vector:
        """References of the axes, from which the next move begins, shape (n,) [rad or m]."""
        return self.cell.reference(self.name)


class ArmGeometry(CellRobot):
    """A robot on a fixed base: kinematics and torques of its tool. Nothing moves.

    Attributes: those of :class:`CellRobot`, and:
        solver: solver of the inverse kinematics for calls that name none.
    """

    solver: SolverLike

    @property
    def chain(self) -> Chain:
        """Chain of the axes from the world to the tool centre point, with their limits."""
        model = self.cell.model
        robot = model.robots[self.name]
        return model.chain(self.name, robot.tools[robot.tcp])

    def tool_pose(self) -> RigidTransform:
        """Pose of the tool centre point in the world, now. The method :meth:`pose` returns it as numbers."""
        return as_transform(self.chain.forward(self.position)[0])

    def frame(self, wobj: WorkObject = None) -> RigidTransform:
        """Pose of a work object in the world.

        Args:
            wobj: None or ``"world"`` for the world; the name of a piece, one of its frames as ``piece.frame``, the name
                of a robot or an arm (its tool centre point now); or a pose in any form. This arm, or its own name,
                means its tool at its reference.

        Raises:
            UnknownName: there is no such piece, frame or robot.
            InvalidParameter: the value is no pose, or it is in other units than m and rad.
        """
        # A move begins at the reference: targets in the tool's own frame are measured from there, not from where
        # servos sag.
        if wobj is self or (isinstance(wobj, str) and wobj == self.name):
            return as_transform(self.chain.forward(self.reference)[0])
        return self.cell.frame(wobj)

    def pose(self, q: npt.ArrayLike | None = None, wobj: WorkObject = None) -> Vector:
        """Compute the pose of the tool (forward kinematics; SimRob's Pose).

        Args:
            q: postures (n,) or (k, n) [rad or m]. If it is None, where the arm is.
            wobj: the work object in whose frame the pose is returned, see :meth:`frame`. If it is None or ``"world"``,
                the world.

        Returns:
            [x y z Rz Ry Rx] [m, rad], shape (6,), or (k, 6) for several postures.

        Raises:
            UnknownName: there is no such work object.
            InvalidParameter: the postures have a wrong shape or are not finite, or the work object is no pose.
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
        """Find postures that bring the tool to poses (inverse kinematics; SimRob's Joint).

        Args:
            pose: one or several poses, or places, which keep the orientation that the tool has.
            wobj: the work object in whose frame they are. If it is None, the world.
            solver: the solver. If it is None, that of the arm.
            start: posture (n,) near which the first solution is searched; each next one near the one before. If it is
                None, where the arm is.

        Returns:
            Postures, shape (n,), or (k, n) for several poses [rad or m].

        Raises:
            Unreachable: no posture reaches a pose. The message names it, why, and how near the best posture comes.
            UnknownName: there is no such work object or solver.
            InvalidParameter: a value is no pose, or it is in other units than m and rad; or the start is no posture.
        """
        chain = self.chain
        begin = self.position if start is None else start
        # A place keeps the orientation of the tool as it is now: a rotation matrix (3, 3).
        orientation = chain.forward(self.position)[0, :3, :3]
        targets = world_poses(pose, self.frame(wobj), orientation, "pose")
        chosen = solver_for(chain, self.solver if solver is None else solver)
        postures = require(chosen.solve(targets, begin), "pose")
        return np.asarray(postures[0]) if is_single(pose) else postures

    def branches(
        self,
        pose: PoseTargets,
        wobj: WorkObject = None,
        *,
        held: Mapping[str, npt.ArrayLike] | None = None,
        start: npt.ArrayLike | None = None,
    ) -> Branches:
        """Find every posture that brings the tool to a pose, also beyond limits, with its torque, distances, overlap.

        Args:
            pose: a pose, or a place, which keeps the orientation that the tool has.
            wobj: the work object in whose frame it is. If it is None, the world.
            held: for an arm with more than six axes, the axes that do not move, by name, at one position [rad or m] or
                at each of several; see :func:`~simrob_drake.kinematics.branches`.
            start: posture (n,) near which whole turns are chosen. If it is None, where the arm is.

        Returns:
            The postures; as text they are a table. It is empty if no posture reaches the pose.

        Raises:
            InvalidParameter: several poses are given, or a value is no pose, no posture or no position.
            UnknownName: there is no such work object, or `held` names an unknown axis.
        """
        chain = self.chain
        begin = self.position if start is None else start
        target = world_poses(
            pose, self.frame(wobj), chain.forward(self.position)[0, :3, :3], "pose"
        )
        if len(target) != 1:
            raise InvalidParameter(
                "pose",
                message("programs.count_of_poses", "{count} poses", count=len(target)),
                message("base.one_pose", "one pose"),
            )
        gains = self.cell.robot(self.name).gains
        # A passive axis has no motor to overload: an infinite limit makes its load 0.
        limit = np.where(gains.passive, np.inf, gains.limit_at_rest)
        model = self.cell.collision_model
        # Function that gives the smallest distance of the arm to its surroundings in a posture. Making it takes several
        # postures, so it is made once.
        gap = gaps(model, self.name, chain)

        def branch_at(q: Vector) -> Branch:
            """Describe a posture (n,) [rad or m] that reaches the pose."""
            overlap = collision(model, self.name, self.reference, q)
            return Branch.of(chain, q, self.inverse_dynamics(q), limit, overlap, gap(q))

        return Branches.of(chain, target, begin, {} if held is None else held, branch_at)

    def jacobian(self, q: npt.ArrayLike | None = None) -> Vector:
        """Compute the Jacobian J of the tool: its velocity is J times the velocities of the axes.

        The rows are the velocity of the tool centre point along x, y, z of the world [m/s], then the angular velocity
        about them [rad/s].

        Args:
            q: postures (n,) or (k, n) [rad or m]. If it is None, where the arm is.

        Returns:
            The Jacobian, shape (6, n), or (k, 6, n) for several postures.
        """
        postures = self.position if q is None else q
        jacobians = self.chain.jacobian(postures)
        return jacobians if np.ndim(postures) > 1 else np.asarray(jacobians[0])

    @property
    def dynamics(self) -> Dynamics:
        """Equation of motion of the arm with what it carries, while other robots are at rest."""
        return self.cell.model.dynamics(self.name)

    def inverse_dynamics(
        self, q: npt.ArrayLike | None = None, v: npt.ArrayLike = 0.0, a: npt.ArrayLike = 0.0
    ) -> Vector:
        """Compute the torques of a motion, with what the arm carries and other robots at rest (SimRob's IDin).

        By default the arm is held still: the torques balance gravity.

        Args:
            q: postures (n,) or (k, n) [rad or m]. If it is None, where the arm is.
            v: velocities, of the same shape, or one number [rad/s or m/s].
            a: accelerations, of the same shape, or one number [rad/s² or m/s²].

        Returns:
            Torques or forces, shape (n,), or (k, n) for several postures [N·m or N].
        """
        return self.dynamics.inverse_dynamics(self.position if q is None else q, v, a)


# Largest motion of a foot that stays where it is. Soles that sink into the ground are a little tilted.
_FOOT_MOVES = 1e-4  # [m]
_FOOT_TURNS = 1e-3  # [rad]
# A leg with at most so many axes cannot keep the orientation of its foot: it ends in a ball, which may turn on the
# ground.
_AXES_OF_BALL_LEG = 3

# Weights of x, y, z and of the rotations about them in the inverse kinematics.
_WHOLE_POSE = (1.0, 1.0, 1.0, 1.0, 1.0, 1.0)
_PLACE_ONLY = (1.0, 1.0, 1.0, 0.0, 0.0, 0.0)


class LeggedGeometry(CellRobot):
    """A robot with legs: kinematics from its trunk to hands, feet and head. Nothing moves.

    Attributes: those of :class:`CellRobot`.
    """

    @property
    def model(self) -> RobotModel:
        """Model of the robot, from its ``robot.yaml``."""
        return self.cell.robot(self.name).model

    @property
    def worn_feet(self) -> str | None:
        """Kind of feet of the robot in its station. It is None if the robot has no feet."""
        chosen = self.cell.config.robots[self.name].feet
        default = self.model.feet.default if self.model.feet else None
        return chosen or default

    @property
    def base_pose(self) -> RigidTransform:
        """Pose of the root link in the world."""
        return self.cell.model.pose(self.cell.robot(self.name).root)

    def chain(self, tool: str, base: str = "trunk") -> Chain:
        """Chain of the axes from a base to a tool, with their limits.

        Args:
            tool: name of the tool.
            base: ``trunk``, or the name of another tool.

        Raises:
            UnknownName: the robot has no such tool.
        """
        model = self.cell.model
        robot = model.robots[self.name]
        # The trunk is no tool, but the frame from which the limbs begin.
        start = robot.root if base == "trunk" else robot.tools[self._tool(base)]
        return model.chain(self.name, robot.tools[self._tool(tool)], start)

    def trunk_chain(self) -> Chain:
        """Chain of the axes, with their limits, for checks that need no tool."""
        model = self.cell.model
        # The chain ends at the root, and so has no path of its own. Its limits are those of all axes.
        return model.chain(self.name, model.robots[self.name].root)

    def pose(self, tool: str, q: npt.ArrayLike | None = None, frame: str = "world") -> Vector:
        """Compute the pose of a tool (forward kinematics).

        Args:
            tool: one of :attr:`tools`.
            q: postures (n,) or (k, n) [rad]. If it is None, where the robot is.
            frame: ``world`` (with the trunk where it is now), ``trunk``, or another tool.

        Returns:
            [x y z Rz Ry Rx] [m, rad], shape (6,), or (k, 6) for several postures.

        Raises:
            UnknownName: there is no such tool or frame.
        """
        chain = self.chain(tool, _base_of(frame))
        return self._poses(chain, self._base_pose_in(frame), q)

    def joint(
        self,
        tool: str,
        pose: PoseTargets,
        frame: str = "trunk",
        solver: SolverLike = "numeric",
        *,
        start: npt.ArrayLike | None = None,
    ) -> Vector:
        """Find postures that bring a tool to poses (inverse kinematics). Axes that do not move the tool stay.

        Args:
            tool: one of :attr:`tools`.
            pose: one or several poses, or places [x y z], which leave the orientation free: limbs with less than six
                axes reach few whole poses.
            frame: ``trunk``, ``world`` (with the trunk where it is now), or another tool, such as a foot that stands:
                then all axes from there to the tool may move.
            solver: the solver for whole poses. Places have a solver of their own.
            start: posture (n,) near which the first solution is searched; the other axes stay there. If it is None, the
                robot's reference.

        Returns:
            Postures, shape (n,), or (k, n) for several poses [rad].

        Raises:
            Unreachable: no posture reaches a pose. The message names it, why, and how near the best posture comes.
            UnknownName: there is no such tool, frame or solver.
            InvalidParameter: a value is no pose, or it is in other units than m and rad; or the start is no posture.
        """
        chain = self.chain(tool, _base_of(frame))
        begin = self.reference if start is None else one_posture(start, len(self.axes), "start")
        # Any orientation will do for places: their solver ignores it.
        no_rotation = RotationMatrix().matrix()
        targets = world_poses(pose, self._base_pose_in(frame).inverse(), no_rotation, "pose")
        chosen = (
            NumericSolver(chain, weights=_PLACE_ONLY)
            if is_place(pose)
            else solver_for(chain, solver)
        )
        postures = require(chosen.solve(targets, begin), "pose").copy()
        # A search that begins again from a random posture changes all axes.
        others = [axis for axis in range(len(chain.names)) if axis not in chain.order]
        postures[:, others] = begin[others]
        return np.asarray(postures[0]) if is_single(pose) else postures

    def posture(
        self,
        trunk: PoseLike,
        reach: Mapping[str, PoseTargets] | None = None,
        *,
        start: npt.ArrayLike | None = None,
    ) -> Vector:
        """Find the posture (n,) [rad] in which the trunk has another pose while the feet stay where they are.

        Nothing moves. The legs are solved first, then the other tools one after the other.

        Args:
            trunk: pose of the root link in the world.
            reach: poses, or places [x y z], in the world of other tools, by their names. If it is None, there are none.
            start: posture (n,) near which the solution is searched. If it is None, the robot's reference.

        Raises:
            InvalidParameter: the robot has no feet, or is held.
            Unreachable: a tool cannot reach its target. The message names the tool. Legs without roll or yaw let the
                trunk go up, down, ahead and back only.
            UnknownName: there is no such tool.
        """
        feet = self.feet
        if not feet or not self.cell.model.floats(self.name):
            raise InvalidParameter(
                "robot",
                self.model.name,
                message("programs.robot_on_own_feet", "a robot that stands on its own feet"),
            )
        # From the world to the frame of the trunk at its new pose.
        to_trunk = as_transform(trunk).inverse()
        posture = self.reference if start is None else one_posture(start, len(self.axes), "start")
        for foot in feet:
            # The present pose of the foot, from the present trunk to the world, and from there to the new trunk.
            foot_in_trunk = as_transform(self.pose(foot, frame="trunk"))
            target = to_trunk @ self.base_pose @ foot_in_trunk
            chain = self.chain(foot)
            is_ball = len(chain.order) <= _AXES_OF_BALL_LEG
            solver = NumericSolver(
                chain,
                weights=_PLACE_ONLY if is_ball else _WHOLE_POSE,
                position_tolerance=_FOOT_MOVES,
                rotation_tolerance=_FOOT_TURNS,
            )
            posture = self.joint(foot, target, solver=solver, start=posture)
        for tool, wish in (reach or {}).items():
            in_world = np.asarray(wish, dtype=float) if is_place(wish) else as_transform(wish)
            posture = self.joint(tool, to_trunk @ in_world, start=posture)
        return posture

    @property
    def feet(self) -> list[str]:
        """Names of the tools that are on the robot's feet."""
        robot = self.cell.robot(self.name)
        links = [] if robot.feet is None else robot.feet.links
        plant = self.cell.model.plant
        # A tool may be another frame of the foot's body than the link itself: bodies are compared, not names.
        bodies = [plant.GetFrameByName(link, robot.instance).body().index() for link in links]
        return [name for name, frame in robot.tools.items() if frame.body().index() in bodies]

    @property
    def soles(self) -> Vector:
        """Points of the feet that may touch the ground: where they are in the world now, shape (m, 3) [m].

        Without feet, m is 0.
        """
        robot = self.cell.robot(self.name)
        model = self.cell.model
        if robot.feet is None:
            return np.zeros((0, 3))
        points = []
        for link in robot.feet.links:
            pose = model.pose(model.plant.GetFrameByName(link, robot.instance))
            points.append(robot.feet.lowest_points(link, pose.GetAsMatrix4()[np.newaxis])[0])
        return np.vstack(points)

    def targets_deg(self, q: npt.ArrayLike) -> dict[str, float]:
        """Convert a posture to targets of a move: those of the axes that differ from their references.

        Args:
            q: the posture, shape (n,) [rad].

        Returns:
            Target of each such axis by name [deg].
        """
        target = one_posture(q, len(self.axes), "q")
        degrees = target / self.model.user_units
        reference = self.reference
        targets = {}
        for index, axis in enumerate(self.axes):
            # An axis that the inverse kinematics left alone has exactly its reference. It needs no target.
            if target[index] != reference[index]:
                targets[axis] = float(degrees[index])
        return targets

    def _base_pose_in(self, frame: str) -> RigidTransform:
        """Pose of the chain's base in the frame of the poses: of the trunk in ``world``, else the identity.

        Other frames are themselves the base, see :func:`_base_of`.
        """
        return self.base_pose if frame == "world" else RigidTransform()

    def _tool(self, tool: str) -> str:
        """Check the name of a tool, and return it.

        Raises:
            UnknownName: the robot has no such tool.
        """
        known = self.cell.robot(self.name).tools
        # A value of another type cannot be looked up, and gets the same message.
        if not isinstance(tool, str) or tool not in known:
            raise UnknownName(
                message("base.tool_of", "tool of {model}", model=self.model.name),
                tool,
                [*known, "trunk", "world"],
            )
        return tool


def _base_of(frame: str) -> str:
    """Name of the base of the chain for poses in a frame. In ``world`` it is the trunk, in other frames the frame."""
    return "trunk" if frame == "world" else frame
