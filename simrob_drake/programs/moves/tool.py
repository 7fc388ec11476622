"""Another tool centre point for an arm (SimRob's Tool)."""

from collections.abc import Mapping
from typing import ClassVar, Self

from pydantic import model_validator

from simrob_drake.programs.moves.move import Move, Run
from simrob_drake.programs.stateful_station import StatefulStation
from simrob_drake.sections import Pose


class ToolMove(Move):
    """A robot uses another tool; it takes no time."""

    key: ClassVar[str] = "tool"
    title: ClassVar[str] = "Tool"
    brief: ClassVar[bool] = True
    takes_time: ClassVar[bool] = False
    of_legs: ClassVar[bool] = False
    form: ClassVar[Mapping[str, str | float | None]] = {"name": "tools"}

    name: str | None = None
    """A tool of the robot, or a piece that it carries."""
    pose: Pose | None = None
    """Or its pose in the frame of the tool that the robot has now."""
    robot: str | None = None
    """Which robot of the station; that of the program unless given."""

    @model_validator(mode="after")
    def _one_way(self) -> Self:
        if (self.name is None) == (self.pose is None):
            raise ValueError("a tool is given by one of name and pose")
        return self

    def perform(self, cell: StatefulStation, robot: str | None, run: Run) -> None:
        """Use it."""
        tool = self.name if self.pose is None else self.pose
        assert tool is not None  # one of them is given
        cell.tool(cell.robot_name(self.robot or robot), tool)
