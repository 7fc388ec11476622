"""Moves that attach a piece to a robot or to another piece (SimRob's PegarEn), and that release it.

An attached piece moves with its *parent*: a robot's tool or link, another piece, or the world.

Arms *perform* a move at once. For a robot with legs the whole program is checked first: the *outlook* is the station as
it will be before a move, and the *stage* of a move is the function that performs it later.
"""

from typing import Annotated, ClassVar, NamedTuple

from simrob_drake.base.sections import Boolean, Pose
from simrob_drake.parts.resolved import WORLD
from simrob_drake.programs.geometry import LeggedGeometry
from simrob_drake.programs.grasps import release_piece
from simrob_drake.programs.model import StationModel, reparent_piece
from simrob_drake.programs.moves.move import Move, NameOf, Outlook, Run, Stage, naming
from simrob_drake.programs.stateful_station import StatefulStation
from simrob_drake.stations.config import StationConfig


class Mount(NamedTuple):
    """The thing to which a piece is attached.

    Attributes:
        parent: name of a robot or a piece, or ``world``.
        frame: name of the parent's frame, tool or link. If it is None, the tool centre point of a piece, or the first
            tool of a robot.
    """

    parent: str
    frame: str | None


class AttachMove(Move):
    """Attach a piece. This takes no time."""

    key: ClassVar[str] = "attach"
    says: ClassVar[str] = "attach {it.piece}"
    brief: ClassVar[bool] = True
    takes_time: ClassVar[bool] = False

    piece: Annotated[str, NameOf("pieces")]
    """Name of the piece."""
    tool: Annotated[str | None, NameOf("tools")] = None
    """Tool or link of the robot, or a piece that it carries, which takes the piece. By default the first tool."""
    pose: Pose | None = None
    """Pose of the piece in the frame of the tool. If it is not set, the piece stays where it is."""
    parent: str | None = None
    """Parent instead of a tool of the robot: `world`, a robot or another piece."""
    frame: str | None = None
    """Frame of a parent piece, instead of its tool centre point; or tool or link of a parent robot."""
    robot: str | None = None
    """Robot of the station that takes the piece. If it is not set, that of the program."""

    def perform(self, cell: StatefulStation, robot: str | None, run: Run) -> None:
        """Attach the piece to the tool or the parent that the move names.

        Without both, it is attached to the tool in use if that is a piece. Otherwise it is attached to the robot: at
        `frame`, or else at the robot's first tool.

        Args:
            cell: the station.
            robot: name of the robot whose program it is. If it is None, the only robot.
            run: not used, because the move takes no time.

        Raises:
            SimrobError: there is no such robot, piece or parent, or the piece is too far away; see
                :meth:`StatefulStation.attach`.
        """
        own_robot = self.robot or robot
        # The tool that is in use may have been changed by a `tool` move, so only the station can find it.
        if self.parent is None and self.tool is None:
            cell.take(self.piece, own_robot, frame=self.frame, pose=self.pose)
            return
        # A named parent needs no robot; otherwise the station has to have a robot that is meant.
        name = (own_robot or "") if self.parent else cell.robot_name(own_robot)
        mount = self.mount(cell.config, name)
        cell.attach(self.piece, mount.parent, frame=mount.frame, pose=self.pose)

    def stage(self, robot: LeggedGeometry, outlook: Outlook, name: str) -> Stage:
        """Return the stage in which a robot with legs takes the piece.

        The outlook gets the station with the attached piece, however far away the piece is now: where the robot will be
        is not known. The stage itself refuses a piece that is too far away then.

        Args:
            robot: the robot.
            outlook: the station as it will be before the move.
            name: name of the move for messages.

        Raises:
            SimrobError: there is no such piece, parent or frame.
        """
        mount = self.mount(outlook.station, self.robot or robot.name)
        model = StationModel(outlook.station)
        outlook.station = reparent_piece(
            model, self.piece, mount.parent, frame=mount.frame, pose=self.pose
        )
        # Later gaits depend on the load, and its place is not known exactly yet: they are planned again when they run.
        outlook.changed = True

        def run_stage(robot: LeggedGeometry) -> None:
            """Attach the piece on the station of the robot that runs the program."""
            # The stage runs on the station of that time, which may differ from the outlook.
            with naming(name):
                mount = self.mount(robot.cell.config, self.robot or robot.name)
                robot.cell.attach(self.piece, mount.parent, frame=mount.frame, pose=self.pose)

        return run_stage

    def mount(self, station: StationConfig, robot: str) -> Mount:
        """Find the parent of the piece: the one that the move names, or else a piece that is the tool, or the robot.

        Args:
            station: the station.
            robot: name of the robot that takes the piece. It is not used if the move names a parent, or a piece as its
                tool.
        """
        if self.parent is not None:
            return Mount(self.parent, self.frame)
        # A tool may be a piece, such as a gripper that the robot carries. Then the new piece hangs on that piece.
        if self.tool is not None and self.tool in station.pieces:
            return Mount(self.tool, self.frame)
        return Mount(robot, self.tool or self.frame)


class ReleaseMove(Move):
    """Release a piece. This takes no time."""

    key: ClassVar[str] = "release"
    says: ClassVar[str] = "release {it.piece}"
    brief: ClassVar[bool] = True
    takes_time: ClassVar[bool] = False

    piece: Annotated[str, NameOf("pieces")]
    """Name of the piece."""
    parent: str = WORLD
    """New parent of the piece: the world, or another piece."""
    fixed: Boolean = False
    """Whether a piece whose parent is the world stays where it is instead of falling."""
    frame: str | None = None
    """Frame of a parent that is a piece, instead of its tool centre point."""

    def perform(self, cell: StatefulStation, robot: str | None, run: Run) -> None:
        """Release the piece. The move takes no time, so `run` is not used; nor is the name of the robot."""
        cell.release(self.piece, self.parent, frame=self.frame, fixed=self.fixed)

    def stage(self, robot: LeggedGeometry, outlook: Outlook, name: str) -> Stage:
        """Return the stage in which a robot with legs releases the piece.

        The outlook gets the station with the released piece.

        Args:
            robot: the robot.
            outlook: the station as it will be before the move.
            name: name of the move for messages.

        Raises:
            SimrobError: the piece is attached to nothing or cannot fall, or there is no such piece or parent.
        """
        model = StationModel(outlook.station)
        outlook.station = release_piece(
            model, self.piece, self.parent, frame=self.frame, fixed=self.fixed
        )
        # Later gaits depend on the load: they are planned again when they run.
        outlook.changed = True

        def run_stage(robot: LeggedGeometry) -> None:
            """Release the piece on the station of the robot that runs the program."""
            with naming(name):
                robot.cell.release(self.piece, self.parent, frame=self.frame, fixed=self.fixed)

        return run_stage
