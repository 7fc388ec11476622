"""What changes in a program between its moves, done: pieces taken and let go, tools chosen."""

from simrob_drake.programs.arm_moves import ToolMove
from simrob_drake.programs.moves import Attach, AttachMove, ReleaseMove
from simrob_drake.programs.ongoing import OngoingStation
from simrob_drake.stations.config import StationConfig


def apply(cell: OngoingStation, change: AttachMove | ReleaseMove | ToolMove, robot: str | None = None) -> None:
    """Do in a station what an entry of a program says.

    Args:
        cell: the station.
        change: what.
        robot: whose program it is; for entries that name none.

    Raises:
        SimrobError: as :meth:`OngoingStation.attach`, :meth:`~OngoingStation.release`, :meth:`~OngoingStation.tool`.
    """
    if isinstance(change, ReleaseMove):
        let = change.release
        cell.release(let.piece, let.parent, frame=let.frame, fixed=let.fixed)
    elif isinstance(change, AttachMove):
        took = change.attach
        who = took.robot or robot
        parent, frame = taker(cell.config, who or "" if took.parent else cell.robot_name(who), took)
        cell.attach(took.piece, parent, frame=frame, pose=took.pose)
    else:
        tool = change.tool
        cell.tool(cell.robot_name(tool.robot or robot), tool.name if tool.pose is None else tool.pose)


def taker(station: StationConfig, robot: str, attach: Attach) -> tuple[str, str | None]:
    """Return what a piece is hung on, and with which frame: a piece that a robot carries, or itself with a tool."""
    if attach.parent is not None:
        return attach.parent, attach.frame
    if attach.tool is not None and attach.tool in station.pieces:
        return attach.tool, attach.frame
    return robot, attach.tool or attach.frame
