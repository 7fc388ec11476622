"""What the sections of monitors share: of all, of those that watch a pose or a sensor; how conditions are made."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping

import numpy as np
from pydrake.math import RigidTransform
from pydrake.systems.framework import DiagramBuilder

from simrob_drake.base.errors import InvalidParameter, one_of
from simrob_drake.base.frames import XYZ_QUATERNION_NAMES, Vector
from simrob_drake.base.messages import compound, message
from simrob_drake.base.sections import NotNegative, Strict
from simrob_drake.blocks.monitor import Condition, Monitor, Trigger
from simrob_drake.parts.resolved import ResolvedRobot, Surroundings, named
from simrob_drake.parts.site import Site


class MonitorSection(Strict, ABC):
    """A section of ``monitors``."""

    kind: str
    robot: str | None = None
    """Whom it watches; the only robot unless given."""
    after: NotNegative = 0.0
    """When watching begins [s]."""
    hold: NotNegative = 0.0
    """How long the condition must last [s]."""

    @property
    def lasting(self) -> str:
        """The end of a reason: how long the condition lasted; empty where it need not."""
        return message("parts.for_seconds", " for {hold:g} s", hold=self.hold) if self.hold > 0 else ""

    @abstractmethod
    def condition(self, name: str, station: Surroundings) -> Condition:
        """Return what ends a run: functions of outputs, by the section's name; raises SimrobError: a wrong section."""

    def check(self, name: str, station: Surroundings) -> None:
        """Check that the robot exists."""
        if self.robot is not None:
            station.robot(self.robot, f"monitors.{name}")


def of_axes(robot: ResolvedRobot, *outputs: str) -> dict[str, int]:
    """Return outputs of a robot that hold a value an axis, with their sizes."""
    return {f"{robot.prefix}{output}": len(robot.axes) for output in outputs}


def worst(watched: Mapping[str, int], excesses: Callable[..., Vector], why: Callable[[int, float], str]) -> Condition:
    """Return a condition that holds where any of several does.

    ``excesses`` tells by how much each is exceeded, shape (k,), by the values of the watched signals; nan counts as
    infinite. ``why`` gives the reason by the place of the largest of them and its size.
    """

    def largest(*values: Vector) -> tuple[int, float]:
        found = excesses(*values)
        found = np.where(np.isnan(found), np.inf, found)
        index = int(np.argmax(found))
        return index, float(found[index])

    return Condition(watched, lambda *values: largest(*values)[1], lambda *values: why(*largest(*values)))


def add_monitor(
    builder: DiagramBuilder | None, site: Site, name: str, trigger: Trigger, robot: str | None = None
) -> None:
    """Add a monitor, of a robot perhaps; without a builder only the site knows it, for who records the run."""
    site.outputs.monitors[name] = trigger
    if builder is not None:
        monitor = Monitor(trigger.condition, hold=trigger.hold, after=trigger.after)
        builder.AddNamedSystem(f"monitor.{name}", monitor)
        site.picture.draw(
            f"monitor.{name}",
            "sensor",
            message("parts.block_monitor", "Monitor\n{name}", name=name),
            None if robot is None else site.robot(robot),
        )
        for output in trigger.condition.watched:
            builder.Connect(site.port(builder, output), monitor.GetInputPort(output))


class PoseMonitorSection(MonitorSection):
    """A section of ``monitors`` that watches a pose."""

    piece: str | None = None
    """A free piece to watch, in place of a robot."""

    def watched_pose(self, name: str, station: Surroundings, port: str) -> tuple[str, dict[str, int], RigidTransform]:
        """Return who is watched, the output that is its pose with its size, and where it is at the start.

        That is a free piece, the only one of a station without robots unless named, or the ``port`` of the robot:
        ``base_pose``, ``tcp_pose`` or ``tcp_pose.<tool>``. Raises SimrobError: no such free piece, no such robot, or a
        robot without such a tool.
        """
        size, free = len(XYZ_QUATERNION_NAMES), station.free_pieces
        if self.piece is not None:
            one_of(
                message("parts.free_piece_for_monitor", "free piece for monitors.{name}.piece", name=name),
                self.piece,
                free,
            )
        if self.piece is not None or (not station.robots and len(free) == 1):
            piece = self.piece or free[0]
            return piece, {f"piece_pose.{piece}": size}, station.pieces[piece].pose
        robot = station.robot(self.robot, f"monitors.{name}")
        output = f"{robot.prefix}{port}"
        if port == "base_pose":
            return robot.name, {output: size}, robot.base
        tool = port.partition(".")[2]
        if not (tool in robot.tool_names if tool else robot.tcp):
            raise InvalidParameter(
                f"monitors.{name}",
                message("parts.at_output", "at {output}", output=output),
                message("parts.tool_of_robot", "a tool that the robot has"),
            )
        return _name_of_tool(robot, tool), {output: size}, robot.base


class SensorMonitorSection(MonitorSection):
    """A section of ``monitors`` that watches a sensor."""

    sensor: str | None = None
    """The sensor, by its name; the only one of its kind unless given."""

    def watched_sensor(self, name: str, station: Surroundings, kind: str) -> str:
        """Return the watched sensor's name; raises UnknownName: none; InvalidParameter: several, none named."""
        key, known = f"monitors.{name}.sensor", [own for own, one in station.sensors.items() if one.kind == kind]
        return named(
            self.sensor, known, kind=message("parts.sensor_for", "{kind} sensor for {key}", kind=kind, key=key), key=key
        )


def _name_of_tool(robot: ResolvedRobot, tool: str | None) -> str:
    """Name of a tool for messages: with the robot's name in front if a station has several robots."""
    return compound("{prefix}{tool}", prefix=robot.prefix, tool=tool or message("parts.the_tool", "the tool"))
