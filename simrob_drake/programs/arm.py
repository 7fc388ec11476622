"""Program an arm in the words of RAPID: SimRob's class Kin, later Cin."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal, Unpack

import numpy as np
import numpy.typing as npt
from pydrake.math import RigidTransform

from simrob_drake.dynamics import Dynamics
from simrob_drake.errors import InvalidParameter
from simrob_drake.frames import PoseLike, Vector, as_transform
from simrob_drake.kinematics.chain import Chain
from simrob_drake.kinematics.registry import SolverLike, solver_for
from simrob_drake.kinematics.solver import require
from simrob_drake.programs.automatic import pace_of, run_cells
from simrob_drake.programs.branches import Branch, Branches
from simrob_drake.programs.cell_robot import CellRobot
from simrob_drake.programs.moves import MOVE_TIME, JointMove, move_of
from simrob_drake.programs.planner import Planner
from simrob_drake.programs.targets import PoseTargets, WorkObject, is_single, world_poses
from simrob_drake.programs.timing import How
from simrob_drake.programs.together import collision, gaps
from simrob_drake.programs.workcell import Workcell
from simrob_drake.results.files import Saved
from simrob_drake.results.result import SimulationResult
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.station import StationLike


class Arm(CellRobot):
    """A robot of a station: kinematics and torques of its tool, and moves that run the station.

    Every move begins where the reference of the last one ended, rests at its end, and returns the run. On a kinematic
    station the arm is then exactly there; on a dynamic one it is where its motors brought it, and goes on from that
    state. A move that cannot be done raises an error before anything moves. ``points``, ``duration``, ``times``,
    ``speed``, ``acceleration``, ``profile``, ``zone`` and ``check`` of moves are those of
    :class:`~simrob_drake.programs.timing.How`.

    Poses are those of the tool centre point, in the world unless a work object is given: pose vectors
    [x y z Rz Ry Rx], matrices (4, 4), RigidTransforms, one or many; or places [x y z], which keep the orientation.
    A work object is a piece's name (its tool centre point) or one of its frames as ``piece.frame``, a robot's name or
    an arm (its tool centre point; an arm's own is where its reference is), or a pose in any form.

    Attributes:
        cell: the station and its state; several arms may share it.
        name: of the robot in the station.
        solver: of the inverse kinematics, where a call names none.
        references: the cells that :meth:`add_reference` stored; ``clear()`` forgets them.
    """

    def __init__(
        self,
        station: Workcell | StationLike,
        robot: str | None = None,
        tool: str | PoseLike | None = None,
        *,
        solver: SolverLike = "auto",
    ) -> None:
        """Take a robot of a station.

        Args:
            station: a workcell, or what makes one: a station's name, file or configuration.
            robot: its name in the station; needed where there are several.
            tool: see :meth:`tool`.
            solver: ``auto``, ``numeric``, ``analytic``, ``incremental``, ``constrained``, or one made for ``chain``.

        Raises:
            UnknownName: no such station, robot or tool.
            InvalidParameter: a robot without a tool, or on a base that moves.
        """
        self.cell: Workcell
        super().__init__(station if isinstance(station, Workcell) else Workcell(station), robot)
        self.solver = solver
        self.references: list[JointMove] = []
        model = self.cell.model.robots[self.name].model
        if model.base != "fixed":
            raise InvalidParameter("robot", model.name, "one on a fixed base; LeggedRobot programs those with legs")
        if not self.cell.model.robots[self.name].tcp:
            raise InvalidParameter("robot", model.name, "one with a tool frame, under tools: in its robot.yaml")
        if tool is not None:
            self.tool(tool)
        _ = self.chain  # of joints that can be followed

    @property
    def chain(self) -> Chain:
        """The axes from the world to the tool centre point, with their limits."""
        model = self.cell.model
        robot = model.robots[self.name]
        return model.chain(self.name, robot.tools[robot.tcp])

    def _described(self) -> list[str]:
        values = np.append(self.pose()[:3], np.rad2deg(self.pose()[3:])).round(6) + 0.0  # no -0
        place, angles = (" ".join(f"{value:.4g}" for value in part) for part in (values[:3], values[3:]))
        tool = self.cell.model.robots[self.name].tcp
        return [*super()._described(), f"tool {tool} at {place} m, Rz Ry Rx {angles} deg"]

    def tool(self, tool: str | PoseLike) -> None:
        """Change the tool centre point (SimRob's Tool).

        Args:
            tool: one of :attr:`tools`: a frame of the robot or a piece that it carries; or a pose in the frame of
                the tool that it has now.

        Raises:
            UnknownName: no such tool.
        """
        self.cell.tool(self.name, tool)

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

    @property
    def plan(self) -> Planner:
        """Plan moves without running them: the methods of the same names; :meth:`Workcell.run` runs several at once."""
        model = self.cell.robot(self.name).model
        return Planner(
            robot=self.name,
            chain=self.chain,
            start=self.reference,
            solver=self.solver,
            rate_limits=(model.speed_limits, model.accelerations),
            frame=self.frame,
            collide=self.cell.check_collisions,
        )

    def move_abs_j(self, targets: npt.ArrayLike, *, stop: bool = False, **how: Unpack[How]) -> SimulationResult:
        """Move the axes to a posture (n,), or through many (k, n) [rad or m]; see :meth:`Planner.move_abs_j`."""
        return self.cell.run(self.plan.move_abs_j(targets, stop=stop, **how))

    def move_j(
        self,
        targets: PoseTargets,
        *,
        wobj: WorkObject = None,
        solver: SolverLike | None = None,
        stop: bool = False,
        **how: Unpack[How],
    ) -> SimulationResult:
        """Move the tool to poses the easiest way, straight in the joints; see :meth:`Planner.move_j`."""
        return self.cell.run(self.plan.move_j(targets, wobj=wobj, solver=solver, stop=stop, **how))

    def move_l(
        self, targets: PoseTargets, *, wobj: WorkObject = None, solver: SolverLike | None = None, **how: Unpack[How]
    ) -> SimulationResult:
        """Move the tool along straight lines; see :meth:`Planner.move_l`."""
        return self.cell.run(self.plan.move_l(targets, wobj=wobj, solver=solver, **how))

    def move_c(
        self,
        via: PoseTargets,
        targets: PoseTargets,
        *,
        wobj: WorkObject = None,
        solver: SolverLike | None = None,
        **how: Unpack[How],
    ) -> SimulationResult:
        """Move the tool along arcs of circles; see :meth:`Planner.move_c`."""
        return self.cell.run(self.plan.move_c(via, targets, wobj=wobj, solver=solver, **how))

    def wait(self, duration: float) -> SimulationResult:
        """Hold the place for a time [s]; on a dynamic station the arm settles."""
        return self.cell.wait(duration)

    def attach(
        self, piece: str, parent: str | None = None, *, frame: str | None = None, pose: PoseLike | None = None
    ) -> None:
        """Take a piece with the tool that the arm has now, or hang it on ``parent``; see :meth:`Workcell.attach`."""
        tool = self.cell.model.tool_in_use(self.name)
        own = tool if tool in self.cell.config.pieces else self.name
        self.cell.attach(piece, own if parent is None else parent, frame=frame, pose=pose)

    def release(self, piece: str, parent: str = "world", *, frame: str | None = None, fixed: bool = False) -> None:
        """Let go of a piece, in the world or on another piece; see :meth:`Workcell.release`."""
        self.cell.release(piece, parent, frame=frame, fixed=fixed)

    def record(self) -> None:
        """Forget what was recorded, and record everything from now on (SimRob's ``Rec()``)."""
        self.cell.record()

    def pause(self) -> None:
        """Stop recording (``Rec(0)``)."""
        self.cell.pause()

    def resume(self) -> None:
        """Go on recording (``Rec(1)``)."""
        self.cell.resume()

    def replay(self) -> list[SimulationResult]:
        """Run the recorded moves again, each from the state that it began in (``Rep()``); the arm stays where it is."""
        return self.cell.replay()

    def result(self) -> SimulationResult:
        """Return all that was recorded as one result; see :meth:`Workcell.result`."""
        return self.cell.result()

    def save(self, folder: Path | str | None = None, **options: Unpack[Saved]) -> Path:
        """Write all that was recorded to a folder; see :meth:`Workcell.save`."""
        return self.cell.save(folder, **options)

    def film(self, file: Path | str, *, frames: int | Literal["events"] = 7) -> Path:
        """Write all that was recorded as a film; see :meth:`Workcell.film`."""
        return self.cell.film(file, frames=frames)

    def add_reference(self, targets: npt.ArrayLike, duration: float = MOVE_TIME) -> None:
        """Store a posture (n,), or many (k, n) [rad or m], as cells for :meth:`simulate` with ``automatic`` (AddRef).

        Nothing moves. A cell lasts until it is reached; ``duration`` [s] is that of the way there.

        Raises:
            SimrobError: as :meth:`move_abs_j`; they are looked at as moves from where the arm is.
        """
        self.plan.move_abs_j(targets)
        rows = np.atleast_2d(self.chain.postures(targets, "targets"))
        values = rows / self.cell.robot(self.name).model.user_units
        self.references += [move_of(dict(zip(self.axes, row.tolist(), strict=True)), duration) for row in values]

    def simulate(
        self,
        station: str | Path | StationConfig | None = None,
        *,
        duration: float | None = None,
        automatic: bool | Mapping[str, Any] = False,
    ) -> SimulationResult:
        """Do again all that was recorded, on this station or another; see :meth:`Workcell.simulate`. The arm stays.

        Args:
            station: another one, such as the dynamic one.
            duration: of the whole [s].
            automatic: run :attr:`references` instead, from the station's start and in the robot's own time; see
                :meth:`LeggedRobot.simulate`.
        """
        config = None if station is None else Workcell(station).config
        if automatic is False:
            return self.cell.simulate(config, duration=duration)
        if duration is not None:
            raise InvalidParameter("duration", duration, "left out: an automatic robot takes its own time")
        other = Workcell(self.cell.config if config is None else config)
        other.progress = self.cell.progress
        return run_cells(Arm(other, self.name), self.references, pace_of(automatic))

    def show(self, q: npt.ArrayLike | None = None) -> str:
        """Open a browser window that shows all moves from now on, and return its address on this computer.

        Args:
            q: a posture (n,) to show, without moving there.
        """
        if q is not None:
            self.cell.draw({self.name: self.chain.postures(q, "q")[0]})
        return self.cell.show()
