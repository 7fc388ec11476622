"""What the sections of monitors that watch a pose share: of a free piece, a tool or a base."""

from __future__ import annotations

from pydrake.math import RigidTransform

from simrob_drake.errors import InvalidParameter, UnknownName
from simrob_drake.frames import XYZ_QUATERNION_NAMES
from simrob_drake.parts.monitors.monitor import MonitorSection
from simrob_drake.parts.site import Surroundings


class PoseMonitorSection(MonitorSection):
    """A section of ``monitors`` that watches a pose."""

    piece: str | None = None
    """A free piece to watch, in place of a robot."""

    def watched_pose(self, name: str, station: Surroundings, port: str) -> tuple[str, dict[str, int], RigidTransform]:
        """Return who is watched, the output that is its pose with its size, and where it is at the start.

        The only free piece of a station without robots need not be named.

        Args:
            name: of the monitor.
            station: around it.
            port: of the robot that is watched unless a piece is: ``base_pose``, ``tcp_pose`` or ``tcp_pose.<tool>``.

        Raises:
            SimrobError: no such free piece, no such robot, or a robot without such a tool.
        """
        size, free = len(XYZ_QUATERNION_NAMES), station.free_pieces
        if self.piece is not None and self.piece not in free:
            raise UnknownName(f"free piece for monitors.{name}.piece", self.piece, free)
        if self.piece is not None or (not station.robots and len(free) == 1):
            piece = self.piece or free[0]
            return piece, {f"piece_pose.{piece}": size}, station.pieces[piece].pose
        robot = station.robot(self.robot, f"monitors.{name}")
        output = f"{robot.prefix}{port}"
        if port == "base_pose":
            return robot.name, {output: size}, robot.base
        tool = port.partition(".")[2]
        if not (tool in robot.tool_names if tool else robot.tcp):
            raise InvalidParameter(f"monitors.{name}", f"at {output}", "a tool that the robot has")
        return f"{robot.prefix}{tool or 'the tool'}", {output: size}, robot.base
