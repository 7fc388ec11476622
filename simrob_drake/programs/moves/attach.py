"""A piece that is taken, or hung on something else (SimRob's PegarEn), and one that is let go."""

from typing import Annotated, ClassVar

from simrob_drake.base.sections import Boolean, Pose
from simrob_drake.parts.resolved import WORLD
from simrob_drake.programs.geometry import LeggedGeometry
from simrob_drake.programs.grasps import let_go
from simrob_drake.programs.model import StationModel, reparented
from simrob_drake.programs.moves.move import Move, NameOf, Outlook, Run, Stage, naming
from simrob_drake.programs.stateful_station import StatefulStation
from simrob_drake.stations.config import StationConfig


class AttachMove(Move):
    """A piece that is taken; it takes no time."""

    key: ClassVar[str] = "attach"
    says: ClassVar[str] = "attach {it.piece}"
    brief: ClassVar[bool] = True
    takes_time: ClassVar[bool] = False

    piece: Annotated[str, NameOf("pieces")]
    """Which."""
    tool: Annotated[str | None, NameOf("tools")] = None
    """With what: a tool or link of the robot, or a piece that it carries; the first tool unless given."""
    pose: Pose | None = None
    """Its pose in the hand, to put it there; it keeps its place in the world unless given."""
    parent: str | None = None
    """Instead of a tool of the robot anything else that it is to hang on: `world`, a robot, another piece."""
    frame: str | None = None
    """A frame of that piece, instead of its tool centre point; or a tool or link of that robot."""
    robot: str | None = None
    """Which robot of the station takes it; that of the program unless given."""

    def perform(self, cell: StatefulStation, robot: str | None, run: Run) -> None:
        """Take it: an arm with the tool that it has now, unless another parent or tool is named."""
        who = self.robot or robot
        if self.parent is None and self.tool is None:
            cell.take(self.piece, who, frame=self.frame, pose=self.pose)
            return
        parent, frame = self.mount(cell.config, who or "" if self.parent else cell.robot_name(who))
        cell.attach(self.piece, parent, frame=frame, pose=self.pose)

    def stage(self, robot: LeggedGeometry, outlook: Outlook, name: str) -> Stage:
        """Return the stage in which a robot with legs takes it, however far away it is now."""
        parent, frame = self.mount(outlook.station, self.robot or robot.name)
        model = StationModel(outlook.station)
        outlook.station = reparented(model, self.piece, parent, frame=frame, pose=self.pose)
        outlook.changed = True

        def take(robot: LeggedGeometry) -> None:
            with naming(name):
                parent, frame = self.mount(robot.cell.config, self.robot or robot.name)
                robot.cell.attach(self.piece, parent, frame=frame, pose=self.pose)

        return take

    def mount(self, station: StationConfig, robot: str) -> tuple[str, str | None]:
        """Return what it is hung on, and with which frame: a piece that a robot carries, or itself with a tool."""
        if self.parent is not None:
            return self.parent, self.frame
        if self.tool is not None and self.tool in station.pieces:
            return self.tool, self.frame
        return robot, self.tool or self.frame


class ReleaseMove(Move):
    """A piece that is let go; it takes no time."""

    key: ClassVar[str] = "release"
    says: ClassVar[str] = "release {it.piece}"
    brief: ClassVar[bool] = True
    takes_time: ClassVar[bool] = False

    piece: Annotated[str, NameOf("pieces")]
    """Which."""
    parent: str = WORLD
    """Where it is then: the world, or another piece that it hangs on."""
    fixed: Boolean = False
    """Hang it in the world, too, instead of letting it fall."""
    frame: str | None = None
    """A frame of the piece that it hangs on, instead of its tool centre point."""

    def perform(self, cell: StatefulStation, robot: str | None, run: Run) -> None:
        """Let it go."""
        cell.release(self.piece, self.parent, frame=self.frame, fixed=self.fixed)

    def stage(self, robot: LeggedGeometry, outlook: Outlook, name: str) -> Stage:
        """Return the stage in which a robot with legs lets it go."""
        model = StationModel(outlook.station)
        outlook.station = let_go(model, self.piece, self.parent, frame=self.frame, fixed=self.fixed)
        outlook.changed = True

        def release(robot: LeggedGeometry) -> None:
            with naming(name):
                robot.cell.release(self.piece, self.parent, frame=self.frame, fixed=self.fixed)

        return release
