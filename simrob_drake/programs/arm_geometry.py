"""Where an arm and its tool are, which postures bring the tool elsewhere, and which torques a motion takes."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt
from pydrake.math import RigidTransform

from simrob_drake.dynamics import Dynamics
from simrob_drake.errors import InvalidParameter
from simrob_drake.frames import Vector, as_transform
from simrob_drake.kinematics.analytic import SolverLike, solver_for
from simrob_drake.kinematics.chain import Chain
from simrob_drake.kinematics.solver import require
from simrob_drake.programs.branches import Branch, Branches
from simrob_drake.programs.cell_robot import CellRobot
from simrob_drake.programs.targets import PoseTargets, WorkObject, is_single, world_poses
from simrob_drake.programs.together import collision, gaps


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
            raise InvalidParameter("pose", f"{len(target)} poses", "one pose")
        limit, model = self.cell.robot(self.name).gains.torque_limit, self.cell.collision_model
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
