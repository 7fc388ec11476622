"""What the sections of monitors that watch a pose share: of a free piece, a tool or a base."""

from __future__ import annotations

from pydrake.math import RigidTransform

from simrob_drake.errors import InvalidParameter, UnknownName
from simrob_drake.parts.monitors.monitor import MonitorSection
from simrob_drake.parts.site import Site, Surroundings


class PoseMonitorSection(MonitorSection):
    """A section of ``monitors`` that watches a pose."""

    piece: str | None = None
    """A free piece to watch, in place of a robot."""

    def check(self, name: str, station: Surroundings) -> None:
        """Check that the robot, or the free piece, exists."""
        super().check(name, station)
        if self.piece is not None and self.piece not in station.free_pieces:
            raise UnknownName(f"free piece for monitors.{name}.piece", self.piece, station.free_pieces)

    def watched_piece(self, site: Site) -> str | None:
        """Return the free piece that is watched; the only one of a station without robots need not be named."""
        free = site.station.free_pieces
        return self.piece or (free[0] if not site.plant.robots and len(free) == 1 else None)

    def watched_pose(self, name: str, site: Site, port: str) -> tuple[str, str, RigidTransform]:
        """Return who is watched, the output that is its pose, and where it is at the start.

        Args:
            name: of the monitor.
            site: the station.
            port: of the robot that is watched unless a piece is: ``base_pose``, ``tcp_pose`` or ``tcp_pose.<tool>``.

        Raises:
            InvalidParameter: the robot has no such tool.
        """
        piece = self.watched_piece(site)
        if piece is not None:
            return piece, f"piece_pose.{piece}", site.station.pieces[piece].pose
        robot = self.watched_robot(name, site)
        output, tool = f"{robot.prefix}{port}", port.partition(".")[2] or "the tool"
        if output not in site.outputs:
            raise InvalidParameter(f"monitors.{name}", f"at {output}", "a tool that the robot has")
        return robot.name if port == "base_pose" else f"{robot.prefix}{tool}", output, robot.base
