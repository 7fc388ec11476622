"""Make and wire the monitors that a station's configuration names."""

from __future__ import annotations

from typing import Any

import numpy as np
from pydrake.systems.framework import DiagramBuilder

from simrob_drake.blocks.contact_monitors import ContactMonitor, ForceLimitMonitor
from simrob_drake.blocks.monitor import Monitor
from simrob_drake.blocks.monitors import DivergenceMonitor, JointLimitMonitor, SettledMonitor, TorqueLimitMonitor
from simrob_drake.blocks.pose_monitors import FallMonitor, WorkspaceMonitor
from simrob_drake.errors import InvalidParameter
from simrob_drake.frames import transform_from_pose
from simrob_drake.stations.force_limits import force_limit
from simrob_drake.stations.monitor_config import (
    Contact,
    Divergence,
    Fall,
    ForceLimit,
    JointLimit,
    MonitorConfig,
    Settled,
    TorqueLimit,
    Workspace,
)
from simrob_drake.stations.names import named
from simrob_drake.stations.ports import StationPorts
from simrob_drake.stations.robots import StationRobot
from simrob_drake.stations.sensor_checks import watched_sensor
from simrob_drake.stations.sensor_config import Distance, Force


def add_monitors(builder: DiagramBuilder, ports: StationPorts) -> None:
    """Add every monitor and connect it to the outputs that it watches."""
    for name, config in ports.config.monitors.items():
        monitor, sources = _made(name, config, ports)
        builder.AddNamedSystem(f"monitor.{name}", monitor)
        for index in range(monitor.num_input_ports()):
            port = monitor.get_input_port(index)
            builder.Connect(ports.outputs[sources[port.get_name()]], port)
        ports.monitors[name] = monitor


def _made(name: str, config: MonitorConfig, ports: StationPorts) -> tuple[Monitor, dict[str, str]]:
    """Return the block for a monitor's configuration and the outputs that its inputs watch; kinds are a closed set."""
    match config:
        case Contact() | ForceLimit():
            return _sensor_monitor(name, config, ports)
        case Workspace() | Fall():
            return _pose_monitor(name, config, ports)
        case _:
            robot = _watched_robot(name, config, ports)
            monitor = _joint_monitor(config, robot)
            names = [monitor.get_input_port(index).get_name() for index in range(monitor.num_input_ports())]
            return monitor, {port: f"{robot.prefix}{port}" for port in names}


def _watched_robot(name: str, config: MonitorConfig, ports: StationPorts) -> StationRobot:
    robots = ports.plant.robots
    return robots[named(config.robot, list(robots), key=f"monitors.{name}.robot")]


def _joint_monitor(config: JointLimit | TorqueLimit | Settled | Divergence, robot: StationRobot) -> Monitor:
    model, axes = robot.model, robot.axes
    shared: dict[str, Any] = {"units": model.units, "hold": config.hold, "after": config.after}
    if isinstance(config, JointLimit):
        lower, upper = model.axis_limits
        margin = model.bounds(config.margin_deg, config.margin_m)
        return JointLimitMonitor(axes=axes, lower=lower, upper=upper, margin=margin, **shared)
    if isinstance(config, TorqueLimit):
        return TorqueLimitMonitor(axes=axes, limit=robot.gains.torque_limit, **shared)
    if isinstance(config, Divergence):
        return DivergenceMonitor(axes=axes, speed_limit=config.speed_limit, **shared)
    errors = config.error_deg, config.error_m
    error = None if errors == (None, None) else model.bounds(*(np.inf if bound is None else bound for bound in errors))
    speed = model.bounds(config.speed_deg, config.speed_m)
    return SettledMonitor(size=len(axes), speed=speed, error=error, **shared)


def _sensor_monitor(name: str, config: Contact | ForceLimit, ports: StationPorts) -> tuple[Monitor, dict[str, str]]:
    """Return a monitor that watches a sensor."""
    sensor_name = watched_sensor(ports.config, name, config)
    sensor = ports.config.sensors[sensor_name]
    times = {"hold": config.hold, "after": config.after}
    if isinstance(config, Contact):
        assert isinstance(sensor, Distance)
        names = f"{sensor.body} and {sensor.other}"
        return ContactMonitor(names=names, threshold=config.distance, **times), {"distance": f"distance.{sensor_name}"}
    assert isinstance(sensor, Force)
    region = config.limit if isinstance(config.limit, str) else ""
    limit = force_limit(config.limit)
    return ForceLimitMonitor(names=sensor.body, limit=limit, region=region, **times), {"force": f"force.{sensor_name}"}


def _pose_monitor(name: str, config: Workspace | Fall, ports: StationPorts) -> tuple[Monitor, dict[str, str]]:
    """Return a monitor that watches a pose: of a free piece, a tool or a base."""
    times = {"hold": config.hold, "after": config.after}
    free = ports.config.free_pieces
    piece = config.piece or (free[0] if not ports.config.robots and len(free) == 1 else None)
    if piece is not None:
        who, source, start = piece, f"piece_pose.{piece}", ports.config.pieces[piece].pose
    else:
        robot = _watched_robot(name, config, ports)
        tool = f".{config.tool}" if isinstance(config, Workspace) and config.tool else ""
        pose = f"tcp_pose{tool}" if isinstance(config, Workspace) else "base_pose"
        who = f"{robot.prefix}{tool.removeprefix('.') or 'the tool'}" if pose != "base_pose" else f"{robot.name}"
        source, start = f"{robot.prefix}{pose}", ports.config.robots[robot.name].base
    if source not in ports.outputs:
        raise InvalidParameter(f"monitors.{name}", f"at {source}", "a tool that the robot has")
    if isinstance(config, Workspace):
        return WorkspaceMonitor(name=who, lower=config.lower, upper=config.upper, **times), {"pose": source}
    tilt = None if config.tilt_deg is None else float(np.deg2rad(config.tilt_deg))
    upright = transform_from_pose(start).rotation()
    return FallMonitor(name=who, upright=upright, height=config.height, tilt=tilt, **times), {"pose": source}
