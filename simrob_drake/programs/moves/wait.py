"""All robots hold their places for a time."""

from collections.abc import Mapping
from typing import Any, ClassVar

from simrob_drake.programs.geometry import LeggedGeometry
from simrob_drake.programs.moves.move import ArmStation, Move, Outlook, Run, Stage
from simrob_drake.sections import Duration


class WaitMove(Move):
    """All robots hold their places; on a dynamic station they settle."""

    key: ClassVar[str] = "wait"
    title: ClassVar[str] = "Wait"
    brief: ClassVar[bool] = True
    form: ClassVar[Mapping[str, str | float | None]] = {"duration": 1.0}

    duration: Duration
    """How long [s]."""

    def perform(self, cell: ArmStation, robot: str | None, run: Run) -> Any:
        """Let the time pass."""
        return run([], self.duration)

    def stage(self, robot: LeggedGeometry, outlook: Outlook, name: str) -> Stage:
        """Return the stage in which the time passes."""
        return lambda robot: robot.cell.wait(self.duration)
