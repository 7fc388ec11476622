"""Moves of different arms at the same time, and the list of the motions that arms plan.

A *planning* is the start of a move of one arm: its posture, its limits and its surroundings.
"""

from collections.abc import Iterable
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

from pydantic import Field

from simrob_drake.base.sections import Duration
from simrob_drake.programs.moves.motion import ArmMotion
from simrob_drake.programs.moves.move import Move, Run, field_of
from simrob_drake.programs.moves.move_free import MoveFree, plan_together
from simrob_drake.programs.moves.move_j import MoveAbsJ, MoveJ
from simrob_drake.programs.moves.move_l import MoveC, MoveL
from simrob_drake.programs.stateful_station import StatefulStation

MOTIONS: tuple[type[ArmMotion], ...] = (MoveAbsJ, MoveJ, MoveL, MoveC, MoveFree)
"""Kinds of moves that an arm plans and runs. A new one has to be listed here."""

if TYPE_CHECKING:
    AnyMotion = ArmMotion
else:
    AnyMotion = field_of(*MOTIONS)


class TogetherMove(Move):
    """Moves of different robots at the same time."""

    key: ClassVar[str] = "together"
    of_legs: ClassVar[bool] = False

    together: "Annotated[tuple[AnyMotion, ...], Field(min_length=1)]"
    """The moves, one for each robot."""
    duration: Duration | None = None
    """Duration of all moves [s]. If it is not set, until the last one ends."""

    def caption(self, *, robots: bool = False) -> str:
        """Captions of all moves."""
        return ", ".join(move.caption(robots=robots) for move in self.together)

    def pieces(self) -> Iterable[str]:
        """Names of the pieces that the moves depend on."""
        return [piece for move in self.together for piece in move.pieces()]

    def perform(self, cell: StatefulStation, robot: str | None, run: Run) -> Any:
        """Plan all moves from where the arms are, and run them at the same time; see :meth:`Move.perform`.

        If all of several moves are moves around obstacles, they are planned as one, around each other. Otherwise each
        move is planned by itself, with the other arms where they are at the start. Before it runs the plans, `run`
        checks that they do not collide with each other.

        Args:
            cell: the station.
            robot: name of the robot of a move that names none. If it is None, the only robot.
            run: function that runs several plans at the same time.

        Returns:
            The value that `run` returns.

        Raises:
            SimrobError: a move cannot be done, or the moves cannot be done at the same time.
        """
        plannings = [cell.planning(move.robot or robot) for move in self.together]
        free_moves = [move for move in self.together if isinstance(move, MoveFree)]
        # One search over the axes of all robots is the only way to avoid collisions between robots that all move.
        if len(free_moves) == len(plannings) > 1:
            return run(plan_together(free_moves, plannings), self.duration)
        plans = [
            move.plan(planning) for move, planning in zip(self.together, plannings, strict=True)
        ]
        return run(plans, self.duration)
