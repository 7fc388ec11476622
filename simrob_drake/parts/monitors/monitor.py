"""Base classes of monitors, and the functions that make their conditions and their blocks.

A monitor ends a run when a condition has held for some time. Its section in a station file, a class derived from
:class:`MonitorSection`, makes the :class:`~simrob_drake.blocks.monitor.Condition`: the names and sizes of the outputs
of the station that are watched, the *excess* (by how much the condition is exceeded; it holds if the excess is not
negative), and a function that gives the reason in words. Outputs of a robot have its prefix, such as ``left.``, if the
station has several robots.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from pydrake.math import RigidTransform
from pydrake.systems.framework import DiagramBuilder

from simrob_drake.base.errors import InvalidParameter, one_of
from simrob_drake.base.frames import XYZ_QUATERNION_NAMES, Vector
from simrob_drake.base.messages import compound, message
from simrob_drake.base.renaming import former_names_of, keep_former_attributes
from simrob_drake.base.sections import NotNegative, Strict
from simrob_drake.blocks.monitor import Condition, Monitor, Trigger
from simrob_drake.parts.resolved import ResolvedRobot, StationContents, name_or_only
from simrob_drake.parts.site import Site


class MonitorSection(Strict, ABC):
    """A section of ``monitors``."""

    kind: str
    robot: str | None = None
    """Robot that it watches; the only robot unless given."""
    after: NotNegative = 0.0
    """Time at which the monitor begins to watch [s]."""
    hold: NotNegative = 0.0
    """Time for which the condition must last [s]."""

    @property
    def hold_text(self) -> str:
        """Words for the end of a reason, such as " for 0.5 s". Empty if the condition need not last."""
        return (
            message("parts.for_seconds", " for {hold:g} s", hold=self.hold) if self.hold > 0 else ""
        )

    @abstractmethod
    def condition(self, name: str, station: StationContents) -> Condition:
        """Make the condition that ends a run once it has held for `hold`.

        Args:
            name: name of the section.
            station: contents of the station.

        Raises:
            SimrobError: the section does not fit the station, for example its robot does not exist.
        """

    def check(self, name: str, station: StationContents) -> None:
        """Check that the robot exists, if the section names one.

        Args:
            name: name of the section.
            station: contents of the station.

        Raises:
            SimrobError: the station has no robot of this name.
        """
        # Without a robot, the section may watch a piece or a sensor; `condition` finds out.
        if self.robot is not None:
            station.robot(self.robot, f"monitors.{name}")


keep_former_attributes(MonitorSection, lasting="hold_text")


def axis_outputs(robot: ResolvedRobot, *outputs: str) -> dict[str, int]:
    """Names and sizes of outputs of a robot that have one value for each axis.

    Args:
        robot: the robot.
        *outputs: names of the outputs without the robot's prefix, such as ``position``.
    """
    return {f"{robot.prefix}{output}": len(robot.axes) for output in outputs}


def condition_on_largest(
    watched: Mapping[str, int],
    excesses: Callable[..., Vector],
    why: Callable[[int, float], str],
) -> Condition:
    """Make a condition that holds if at least one of k excesses is not negative.

    Args:
        watched: sizes of the watched outputs, by their names.
        excesses: function of the values of these outputs that returns the excesses, shape (k,). An excess that is not
            a number counts as infinite.
        why: function of the index and the value of the largest excess that returns the reason.
    """

    def find_largest(*values: Vector) -> tuple[int, float]:
        """Find the index and the value of the largest excess."""
        # A simulation that has diverged gives values that are not numbers. It must end, and not count as within bounds.
        found = excesses(*values)
        found = np.where(np.isnan(found), np.inf, found)
        index = int(np.argmax(found))
        return index, float(found[index])

    def largest_excess(*values: Vector) -> float:
        """Compute the excess of the condition."""
        return find_largest(*values)[1]

    def reason(*values: Vector) -> str:
        """Write the reason for the largest excess."""
        return why(*find_largest(*values))

    return Condition(watched, largest_excess, reason)


def add_monitor(
    builder: DiagramBuilder | None,
    site: Site,
    name: str,
    trigger: Trigger,
    robot: str | None = None,
) -> None:
    """Register a monitor in the station's outputs, and add its block to the diagram.

    Args:
        builder: builder of the diagram. If it is None, no block is added: then the code that steps the station
            evaluates the registered trigger itself.
        site: the station under construction.
        name: name of the monitor.
        trigger: condition of the monitor, and how long it must last.
        robot: name of the robot whose part of the block picture contains the block; None if it belongs to none.
    """
    site.outputs.monitors[name] = trigger
    # The caller evaluates the registered trigger itself, so the diagram needs no block for it.
    if builder is None:
        return
    system_name = f"monitor.{name}"
    block = Monitor(trigger.condition, hold=trigger.hold, after=trigger.after)
    builder.AddNamedSystem(system_name, block)
    label = message("parts.block_monitor", "Monitor\n{name}", name=name)
    # The block is drawn in its robot's part of the picture.
    owner = None if robot is None else site.robot(robot)
    site.picture.draw(system_name, "sensor", label, owner)
    # The block's input ports have the names of the outputs that they read.
    for output in trigger.condition.watched:
        builder.Connect(site.port(builder, output), block.GetInputPort(output))


class WatchedPose(NamedTuple):
    """The pose that a monitor watches.

    Attributes:
        subject: name of the piece, the robot or the tool that has the pose, for messages.
        watched: size of the output that is the pose, by its name.
        start: pose of the piece, or of the robot's root link, in the world at the start.
    """

    subject: str
    watched: dict[str, int]
    start: RigidTransform


class PoseMonitorSection(MonitorSection):
    """A section of ``monitors`` that watches the pose of a free piece, of a robot's base or of a robot's tool."""

    piece: str | None = None
    """A free piece to watch, in place of a robot."""

    def watched_pose(self, name: str, station: StationContents, port: str) -> WatchedPose:
        """Find the pose that is watched.

        It is the pose of the free piece that the section names. If it names none, it is the pose of the only free
        piece of a station without robots, and otherwise an output of the robot.

        Args:
            name: name of the section.
            station: contents of the station.
            port: output of a robot: ``base_pose``, ``tcp_pose`` or ``tcp_pose.<tool>``.

        Raises:
            UnknownName: there is no such free piece or robot.
            InvalidParameter: no robot is named, and the station has none or several; or the robot has no such tool, or
                none in use.
        """
        free = station.free_pieces
        if self.piece is not None:
            what = message(
                "parts.free_piece_for_monitor", "free piece for monitors.{name}.piece", name=name
            )
            return _pose_of_piece(station, one_of(what, self.piece, free))
        # In a station without robots, such as a ball on a floor, a monitor need not name the only piece.
        if not station.robots and len(free) == 1:
            return _pose_of_piece(station, free[0])
        return _pose_of_robot(name, station.robot(self.robot, f"monitors.{name}"), port)


class SensorMonitorSection(MonitorSection):
    """A section of ``monitors`` that watches a sensor."""

    sensor: str | None = None
    """The sensor, by its name; the only one of its kind unless given."""

    def watched_sensor(self, name: str, station: StationContents, kind: str) -> str:
        """Find the name of the sensor that is watched.

        Args:
            name: name of the section.
            station: contents of the station.
            kind: kind that the sensor must have, such as ``force``.

        Raises:
            UnknownName: there is no sensor of this name and kind.
            InvalidParameter: no sensor is named, and the station has none or several of this kind.
        """
        key = f"monitors.{name}.sensor"
        # A sensor of another kind has other outputs, so it does not count even if it is named.
        known = [own for own, sensor in station.sensors.items() if sensor.kind == kind]
        what = message("parts.sensor_for", "{kind} sensor for {key}", kind=kind, key=key)
        return name_or_only(self.sensor, known, kind=what, key=key)


def _pose_of_piece(station: StationContents, piece: str) -> WatchedPose:
    """Describe the pose of a free piece, by its name."""
    watched = {f"piece_pose.{piece}": len(XYZ_QUATERNION_NAMES)}
    return WatchedPose(subject=piece, watched=watched, start=station.pieces[piece].pose)


def _pose_of_robot(name: str, robot: ResolvedRobot, port: str) -> WatchedPose:
    """Describe the pose of a robot's base or tool, for a monitor to watch.

    Args:
        name: name of the monitor's section.
        robot: the robot.
        port: ``base_pose``, ``tcp_pose`` or ``tcp_pose.<tool>``.

    Raises:
        InvalidParameter: the robot has no such tool, or no tool in use.
    """
    output = f"{robot.prefix}{port}"
    watched = {output: len(XYZ_QUATERNION_NAMES)}
    if port == "base_pose":
        return WatchedPose(subject=robot.name, watched=watched, start=robot.base)
    # ``tcp_pose`` alone is the pose of the tool in use; a name after the dot is another tool.
    tool = port.partition(".")[2]
    has_tool = tool in robot.tool_names if tool else robot.tcp != ""
    if not has_tool:
        raise InvalidParameter(
            f"monitors.{name}.tool",
            tool or None,
            message("parts.tool_of_robot", "a tool of {robot}", robot=robot.name),
        )
    tool_text = tool or message("parts.the_tool", "the tool")
    subject = compound("{prefix}{tool}", prefix=robot.prefix, tool=tool_text)
    # The start is that of the robot's base, also for a tool.
    return WatchedPose(subject=subject, watched=watched, start=robot.base)


if not TYPE_CHECKING:
    __getattr__ = former_names_of(
        __name__, {"of_axes": "axis_outputs", "worst": "condition_on_largest"}
    )
