"""A station with arms: they share its state, and do programs together."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from simrob_drake.frames import PoseLike
from simrob_drake.given import instance
from simrob_drake.kinematics.registry import SolverLike
from simrob_drake.programs.arm_program import perform, rehearse
from simrob_drake.programs.program import Program
from simrob_drake.programs.recorded import STATION, RecordedStation
from simrob_drake.programs.timeline import following
from simrob_drake.results.result import SimulationResult
from simrob_drake.results.whole import joined

if TYPE_CHECKING:
    from simrob_drake.programs.arm import Arm


class Workcell(RecordedStation):
    """A station with arms, which share its state: see :class:`OngoingStation` and :class:`RecordedStation`."""

    def arm(self, name: str | None = None, tool: str | PoseLike | None = None, *, solver: SolverLike = "auto") -> Arm:
        """Return one of the station's robots, to be programmed.

        Args:
            name: of the robot; needed where there are several.
            tool: see :meth:`Arm.tool`.
            solver: of the inverse kinematics, where a move names none.
        """
        from simrob_drake.programs.arm import Arm  # which is made of a workcell

        return Arm(self, name, tool, solver=solver)

    def perform(self, program: Program | Path | str) -> SimulationResult:
        """Do a program of arms from the state that the station is in, and return all of it as one result.

        All of it is looked at before anything moves, up to a move that depends on where a piece comes to rest. A run
        that does not go to its end, as a monitor ends it, is the last. What cannot be done leaves all as it was.

        Args:
            program: one, or the YAML file of one; see :class:`Program`.

        Raises:
            InvalidParameter: a program without a move that takes time, or with moves for legs.
            InvalidConfig: a damaged file.
            SimrobError: what the arms cannot do; names the move.
        """
        instance(program, "program", (Program, Path, str), "a Program, or the YAML file of one")
        given, file = (program, "") if isinstance(program, Program) else (Program.load(program), str(program))
        trial = Workcell(self.config)
        trial.state = self.state
        rehearse(trial, given, file)
        config, state, entries = self.config, self.state, list(self.tape.entries)
        try:
            with following(self, given.grid, given.changes):
                runs = perform(self, given, file)
        except BaseException:
            self._change(config)
            self.state, self.tape.entries = state, entries
            raise
        return joined(runs, begun=(config, state), left=self.config, program=given.on(STATION).text())
