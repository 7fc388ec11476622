"""What the sections of all monitors share, and how their conditions are made."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from pydrake.systems.framework import DiagramBuilder

from simrob_drake.blocks.monitor import Condition, Monitor, Trigger
from simrob_drake.frames import Vector
from simrob_drake.parts.site import ResolvedRobot, Site, Surroundings
from simrob_drake.quantities import NotNegative
from simrob_drake.yaml_files import Strict


class MonitorSection(Strict):
    """A section of ``monitors``.

    A kind has its key ``kind``, and the method ``condition(name, station)``, which gives what ends a run, as functions
    of the station's outputs, and raises what is wrong with the section.
    """

    robot: str | None = None
    """Whom it watches; the only robot unless given."""
    after: NotNegative = 0.0
    """When watching begins [s]."""
    hold: NotNegative = 0.0
    """How long the condition must last [s]."""

    @property
    def lasting(self) -> str:
        """The end of a reason: how long the condition lasted; empty where it need not."""
        return f" for {self.hold:g} s" if self.hold > 0 else ""

    def check(self, name: str, station: Surroundings) -> None:
        """Check that the robot exists."""
        if self.robot is not None:
            station.robot(self.robot, f"monitors.{name}")


def of_axes(robot: ResolvedRobot, *outputs: str) -> dict[str, int]:
    """Return outputs of a robot that hold a value an axis, with their sizes."""
    return {f"{robot.prefix}{output}": len(robot.axes) for output in outputs}


def worst(watched: Mapping[str, int], excesses: Callable[..., Vector], why: Callable[[int, float], str]) -> Condition:
    """Return a condition that holds where any of several does.

    Args:
        watched: the signals.
        excesses: by how much each is exceeded, shape (k,), by the values of the signals; nan counts as infinite.
        why: the reason, by the place of the largest of them and its size.
    """

    def largest(*values: Vector) -> tuple[int, float]:
        found = excesses(*values)
        found = np.where(np.isnan(found), np.inf, found)
        index = int(np.argmax(found))
        return index, float(found[index])

    return Condition(watched, lambda *values: largest(*values)[1], lambda *values: why(*largest(*values)))


def add_monitor(
    builder: DiagramBuilder | None, site: Site, name: str, section: MonitorSection, condition: Condition
) -> None:
    """Add a monitor; without a builder it is known to the site alone, for whoever records the run to ask.

    Args:
        builder: the diagram under construction.
        site: the station.
        name: of the monitor.
        section: that configures it.
        condition: that it gave.
    """
    site.monitors[name] = Trigger(condition, section.hold, section.after)
    if builder is not None:
        monitor = Monitor(condition, hold=section.hold, after=section.after)
        builder.AddNamedSystem(f"monitor.{name}", monitor)
        robot = None if section.robot is None else site.robot(section.robot)
        site.draw(f"monitor.{name}", "sensor", f"Monitor\n{name}", robot)
        for output in condition.watched:
            builder.Connect(site.outputs[output], monitor.GetInputPort(output))
