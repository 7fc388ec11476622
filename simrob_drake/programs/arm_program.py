"""A program of arms, move by move: looked at before anything moves, and run.

What a dynamic station does is known only once it is done. So the look at a program stands its robots where each move
leads them, without a simulation; it ends before a move that depends on a piece that was let fall, and before the
station's own references.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Protocol

import numpy as np

from simrob_drake.frames import Vector
from simrob_drake.programs.moves.move import ArmStation, move_name, naming
from simrob_drake.programs.moves.play import PlayMove
from simrob_drake.programs.plan import Plan
from simrob_drake.programs.program import Program
from simrob_drake.programs.stages import check_takes_time
from simrob_drake.results.record.state import State
from simrob_drake.results.result import SimulationResult


class Arms(ArmStation, Protocol):
    """A station whose arms do a program."""

    state: State | None

    def run(self, *plans: Plan, duration: float | None = None) -> SimulationResult:
        """Run planned moves at the same time."""

    def check_together(self, *plans: Plan) -> None:
        """Check that planned moves can be run at the same time."""

    def reference(self, robot: str) -> Vector:
        """Return where a robot's axes should be, shape (n,) [rad or m]."""


def perform(cell: Arms, program: Program, file: str = "") -> list[SimulationResult]:
    """Do a program of arms from where a station is; a run that does not go to its end is the last.

    Args:
        cell: the station.
        program: what is done.
        file: that it stands in, for messages.

    Returns:
        the runs, one for each move that takes time.

    Raises:
        SimrobError: what cannot be done, before anything moves where that can be known; names the move.
    """
    runs: list[SimulationResult] = []
    for number, move in enumerate(program.moves):
        with naming(move_name(number, len(program.moves), file)):
            run = move.perform(cell, program.robot, lambda plans, duration: cell.run(*plans, duration=duration))
        if run is not None:
            runs.append(run)
            if run.ending != "completed":
                break
    return runs


def rehearse(cell: Arms, program: Program, file: str = "") -> tuple[int, float]:
    """Look whether arms can do a program, as far as that can be known without running it.

    Args:
        cell: a station of its own, which stands where the program leads it afterwards.
        program: what is to be done.
        file: that it stands in, for messages.

    Returns:
        how many of the moves were looked at, and how long they take [s].

    Raises:
        InvalidParameter: a program without a move that takes time.
        SimrobError: what cannot be done; names the move.
    """
    check_takes_time(program.moves, file or "the program", "one with moves, such as move_abs_j")
    fallen, whole = set[str](), 0.0
    for number, move in enumerate(program.moves):
        if isinstance(move, PlayMove) or not fallen.isdisjoint(move.pieces()):
            return number, whole
        with naming(move_name(number, len(program.moves), file)):
            whole += move.perform(cell, program.robot, lambda plans, duration: _stand(cell, plans, duration)) or 0.0
        fallen |= {name for name in cell.config.free_pieces if name in move.pieces()}
    return len(program.moves), whole


def _stand(cell: Arms, plans: list[Plan], duration: float | None) -> float:
    """Put robots where their moves lead them, and return how long the moves take [s]."""
    cell.check_together(*plans)
    time = max(plan.duration for plan in plans) if duration is None else duration
    at = {robot: cell.reference(robot) for robot in cell.config.robots}
    at |= {plan.robot: plan.postures(np.array([min(time, plan.duration)]))[0] for plan in plans}
    still = {robot: np.zeros_like(posture) for robot, posture in at.items()}
    before = cell.state or State(at, still, at)
    cell.state = replace(before, positions=at, velocities=still, references=at)
    return time
