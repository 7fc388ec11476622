"""What the sections of all monitors share."""

from __future__ import annotations

from typing import Any

from pydrake.systems.framework import DiagramBuilder

from simrob_drake.blocks.monitor import Monitor
from simrob_drake.errors import UnknownName
from simrob_drake.parts.site import Site, StationRobot, Surroundings, named
from simrob_drake.quantities import NotNegative
from simrob_drake.yaml_files import Strict


class MonitorSection(Strict):
    """A section of ``monitors``.

    A kind has its key ``kind``, and the methods ``check(name, station)``, which raises what is wrong with it before
    anything is built, and ``made(name, site)``, which gives its block and the outputs that its ports watch.
    """

    robot: str | None = None
    """Whom it watches; the only robot unless given."""
    after: NotNegative = 0.0
    """When watching begins [s]."""
    hold: NotNegative = 0.0
    """How long the condition must last [s]."""

    @property
    def times(self) -> dict[str, Any]:
        """What every monitor's block takes."""
        return {"hold": self.hold, "after": self.after}

    def check(self, name: str, station: Surroundings) -> None:
        """Check that the robot exists."""
        if self.robot is not None and self.robot not in station.robots:
            raise UnknownName(f"robot for monitors.{name}", self.robot, station.robots)

    def watched_robot(self, name: str, site: Site) -> StationRobot:
        """Return the robot that is watched; the only one unless named.

        Raises:
            SimrobError: no such robot, or none named and there is not just one.
        """
        return site.plant.robots[named(self.robot, list(site.plant.robots), key=f"monitors.{name}.robot")]


Made = tuple[Monitor, dict[str, str]]
"""A monitor's block, and by port the station's output that it watches."""


def of_robot(monitor: Monitor, robot: StationRobot) -> Made:
    """Return a monitor of signals of one robot, whose ports are named as its outputs."""
    return monitor, {port: f"{robot.prefix}{port}" for port in monitor.watched}


def add_monitor(builder: DiagramBuilder | None, site: Site, name: str, made: Made, robot: StationRobot | None) -> None:
    """Add a monitor; without a builder it is known to the site alone, for whoever records the run to ask.

    Args:
        builder: the diagram under construction.
        site: the station.
        name: of the monitor.
        made: its block, and what that watches.
        robot: whom its section names.
    """
    monitor, sources = made
    site.monitors[name] = monitor
    site.watched[name] = [sources[port] for port in monitor.watched]
    if builder is not None:
        builder.AddNamedSystem(f"monitor.{name}", monitor)
        site.draw(f"monitor.{name}", "sensor", f"Monitor\n{name}", robot)
        for port, source in sources.items():
            builder.Connect(site.outputs[source], monitor.GetInputPort(port))
