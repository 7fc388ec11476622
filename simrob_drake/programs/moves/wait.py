"""Moves in which all robots hold their positions, or follow the references of the station's file.

Arms *perform* a move at once. For a robot with legs the whole program is checked first: the *outlook* is the station as
it will be before a move, and the *stage* of a move is the function that performs it later.
"""

from typing import Any, ClassVar

from simrob_drake.base.sections import Duration
from simrob_drake.programs.geometry import LeggedGeometry
from simrob_drake.programs.moves.move import Move, Outlook, Run, Stage
from simrob_drake.programs.stateful_station import StatefulStation


class WaitMove(Move):
    """Wait, while all robots hold their positions. On a dynamic station they come to rest."""

    key: ClassVar[str] = "wait"
    brief: ClassVar[bool] = True

    duration: Duration
    """Duration [s]."""

    def perform(self, cell: StatefulStation, robot: str | None, run: Run) -> Any:
        """Run the station without any plan."""
        return run([], self.duration)

    def stage(self, robot: LeggedGeometry, outlook: Outlook, name: str) -> Stage:
        """Return the stage in which the robots wait."""
        return lambda robot: robot.cell.wait(self.duration)


class PlayMove(Move):
    """Follow the references of the station's file with all robots, from their present positions."""

    key: ClassVar[str] = "play"
    brief: ClassVar[bool] = True

    duration: Duration
    """Duration [s]."""

    def perform(self, cell: StatefulStation, robot: str | None, run: Run) -> Any:
        """Run the station by the references of its file."""
        return cell.play(self.duration)

    def stage(self, robot: LeggedGeometry, outlook: Outlook, name: str) -> Stage:
        """Return the stage in which the robots follow the references.

        The outlook is marked as changed, because where the robots end is not known before.
        """
        outlook.changed = True
        return lambda robot: robot.cell.play(self.duration)
