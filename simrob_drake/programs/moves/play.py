"""All robots follow the references of the station's file for a time."""

from collections.abc import Mapping
from typing import Any, ClassVar

from simrob_drake.programs.geometry import LeggedGeometry
from simrob_drake.programs.moves.move import ArmStation, Move, Outlook, Run, Stage
from simrob_drake.sections import Duration


class PlayMove(Move):
    """All robots follow the references of the station's file, from where they are."""

    key: ClassVar[str] = "play"
    title: ClassVar[str] = "Play"
    brief: ClassVar[bool] = True
    form: ClassVar[Mapping[str, str | float | None]] = {"duration": 5.0}

    duration: Duration
    """How long [s]."""

    def perform(self, cell: ArmStation, robot: str | None, run: Run) -> Any:
        """Let them."""
        return cell.play(self.duration)

    def stage(self, robot: LeggedGeometry, outlook: Outlook, name: str) -> Stage:
        """Return the stage in which they do; where that leads is not known before."""
        outlook.changed = True
        return lambda robot: robot.cell.play(self.duration)
