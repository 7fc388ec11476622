"""Program an arm in the words of RAPID: SimRob's class Kin, later Cin."""

from __future__ import annotations

from pathlib import Path
from typing import Unpack

import numpy.typing as npt

from simrob_drake.frames import PoseLike
from simrob_drake.programs.arm_geometry import ArmGeometry
from simrob_drake.programs.plan import How
from simrob_drake.programs.planner import Planner
from simrob_drake.programs.solvers import SolverLike
from simrob_drake.programs.targets import PoseTargets, WorkObject
from simrob_drake.programs.workcell import Workcell
from simrob_drake.results.result import SimulationResult
from simrob_drake.stations.config import StationConfig


class Arm(ArmGeometry):
    """A robot of a station, to be moved: each move runs the station and returns its result.

    Every move begins where the reference of the last one ended, and rests at its end. On a kinematic station the arm is
    then exactly there; on a dynamic one it is where its motors brought it, and goes on from that state. A move that
    cannot be done raises an error before anything moves.

    Poses, work objects and attributes are those of :class:`ArmGeometry`; ``points``, ``duration``, ``times``, ``speed``
    and ``check`` of moves those of :class:`~simrob_drake.programs.plan.How`.
    """

    @property
    def plan(self) -> Planner:
        """Plan moves without running them: the methods of the same names; :meth:`Workcell.run` runs several at once."""
        return Planner(
            robot=self.name,
            chain=self.chain,
            start=self.reference,
            solver=self.solver,
            speed_limits=self.cell.model.speed_limits(self.name),
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

    def release(self, piece: str, parent: str = "world", *, frame: str | None = None) -> None:
        """Let go of a piece: it stays where it is, in the world or on another piece; see :meth:`Workcell.attach`."""
        self.cell.attach(piece, parent, frame=frame)

    def record(self) -> None:
        """Forget what was recorded, and record everything from now on (SimRob's ``Rec()``)."""
        self.cell.tape.record()

    def pause(self) -> None:
        """Stop recording (``Rec(0)``)."""
        self.cell.tape.running = False

    def resume(self) -> None:
        """Go on recording (``Rec(1)``)."""
        self.cell.tape.running = True

    def replay(self) -> list[SimulationResult]:
        """Run the recorded moves again, each from the state that it began in (``Rep()``); the arm stays where it is."""
        return self.cell.tape.replay()

    def simulate(
        self, station: str | Path | StationConfig | None = None, *, duration: float | None = None
    ) -> SimulationResult:
        """Run all recorded moves as one, on this station or another; see :meth:`Tape.simulate`."""
        config = None if station is None else Workcell(station).config
        return self.cell.tape.simulate(config, duration=duration)

    def show(self, q: npt.ArrayLike | None = None) -> str:
        """Open a browser window that shows all moves from now on, and return its address on this computer.

        Args:
            q: a posture (n,) to show, without moving there.
        """
        if q is not None:
            self.cell.draw({self.name: self.chain.postures(q, "q")[0]})
        return self.cell.show()
