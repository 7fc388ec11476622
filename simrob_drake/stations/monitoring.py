"""Make and wire the monitors that a station's configuration names."""

from __future__ import annotations

import numpy as np
from pydrake.systems.framework import DiagramBuilder

from simrob_drake.blocks.monitor import Monitor
from simrob_drake.blocks.monitors import DivergenceMonitor, JointLimitMonitor, SettledMonitor, TorqueLimitMonitor
from simrob_drake.errors import InvalidParameter
from simrob_drake.stations.monitor_config import Divergence, JointLimit, MonitorConfig, TorqueLimit
from simrob_drake.stations.ports import StationPorts
from simrob_drake.stations.robots import StationRobot


def add_monitors(builder: DiagramBuilder, ports: StationPorts) -> None:
    """Add every monitor and connect it to the outputs that it watches."""
    for name, config in ports.config.monitors.items():
        robot = _watched_robot(name, config, ports)
        monitor = builder.AddNamedSystem(f"monitor.{name}", _make(config, robot))
        for index in range(monitor.num_input_ports()):
            port = monitor.get_input_port(index)
            builder.Connect(ports.outputs[f"{robot.prefix}{port.get_name()}"], port)
        ports.monitors[name] = monitor


def _watched_robot(name: str, config: MonitorConfig, ports: StationPorts) -> StationRobot:
    robot = config.robot or ports.config.only_robot
    if robot is None:
        raise InvalidParameter(f"monitors.{name}.robot", None, f"one of {', '.join(ports.config.robots)}")
    return ports.plant.robots[robot]


def _make(config: MonitorConfig, robot: StationRobot) -> Monitor:
    """Return the block for a monitor's configuration; the kinds are a closed set."""
    times = {"hold": config.hold, "after": config.after}
    if isinstance(config, JointLimit):
        lower, upper = robot.model.axis_limits
        margin = float(np.deg2rad(config.margin_deg))
        return JointLimitMonitor(axes=robot.axes, lower=lower, upper=upper, margin=margin, **times)
    if isinstance(config, TorqueLimit):
        return TorqueLimitMonitor(axes=robot.axes, limit=robot.gains.torque_limit, **times)
    if isinstance(config, Divergence):
        return DivergenceMonitor(axes=robot.axes, speed_limit=config.speed_limit, **times)
    error = None if config.error_deg is None else float(np.deg2rad(config.error_deg))
    return SettledMonitor(size=len(robot.axes), speed=float(np.deg2rad(config.speed_deg)), error=error, **times)
