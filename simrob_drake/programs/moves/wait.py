"""All robots hold their places for a time, or follow the references of the station's file."""

from typing import Any, ClassVar

from simrob_drake.base.sections import Duration
from simrob_drake.programs.geometry import LeggedGeometry
from simrob_drake.programs.moves.move import Move, Outlook, Run, Stage
from simrob_drake.programs.stateful_station import StatefulStation


class WaitMove(Move):
    """All robots hold their places; on a dynamic station they settle."""

    key: ClassVar[str] = "wait"
    brief: ClassVar[bool] = True

    duration: Duration
    """How long [s]."""

    def perform(self, cell: StatefulStation, robot: str | None, run: Run) -> Any:
        """Let the time pass."""
        return run([], self.duration)

    def stage(self, robot: LeggedGeometry, outlook: Outlook, name: str) -> Stage:
        """Return the stage in which the time passes."""
        return lambda robot: robot.cell.wait(self.duration)


class PlayMove(Move):
    """All robots follow the references of the station's file, from where they are."""

    key: ClassVar[str] = "play"
    brief: ClassVar[bool] = True

    duration: Duration
    """How long [s]."""

    def perform(self, cell: StatefulStation, robot: str | None, run: Run) -> Any:
        """Let them."""
        return cell.play(self.duration)

    def stage(self, robot: LeggedGeometry, outlook: Outlook, name: str) -> Stage:
        """Return the stage in which they do; where that leads is not known before."""
        outlook.changed = True
        return lambda robot: robot.cell.play(self.duration)
