"""Where each system of a station's Diagram stands in its picture, and what its block says.

Systems are told apart by their types and by the names that the wiring functions give them; what none of the rules
knows is a user's own.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from pydrake.geometry import SceneGraph
from pydrake.multibody.plant import ExternallyAppliedSpatialForceMultiplexer, MultibodyPlant, Propeller
from pydrake.systems.controllers import InverseDynamics
from pydrake.systems.framework import System
from pydrake.systems.primitives import (
    Adder,
    ConstantVectorSource,
    Demultiplexer,
    LinearSystem,
    MatrixGain,
    Multiplexer,
    PassThrough,
    Saturation,
    Selector,
)
from pydrake.systems.rendering import MultibodyPositionToGeometryPose

from simrob_drake.blocks.events import EventTimes, SteadySteps
from simrob_drake.blocks.frame_pose import FramePose
from simrob_drake.blocks.monitor import Monitor
from simrob_drake.results import block_captions as captions
from simrob_drake.stations.plant import StationRobot
from simrob_drake.stations.ports import StationPorts

Role = Literal["reference", "servo", "robot", "scene", "sensor", "own"]
ROLES: tuple[Role, ...] = ("reference", "servo", "robot", "scene", "sensor", "own")
"""In the order of the signal flow."""

Shape = Literal["block", "mux", "bus", "port", "sum"]
"""Of them two are thin bars: a mux brings signals together, a bus hands them out."""

BARS: tuple[Shape, ...] = ("mux", "bus")

_SOURCE, _STOPS, _ALL_JOINTS = "reference_source", "stops", "servo"
_SILENT = (PassThrough, Demultiplexer, EventTimes, SteadySteps, ExternallyAppliedSpatialForceMultiplexer)


@dataclass(frozen=True)
class Place:
    """Where a system is drawn: systems of one key share a block, whose lines are their labels."""

    key: str
    role: Role
    label: str = ""
    robot: str = ""  # empty for what the robots share
    shape: Shape = "block"


def place_of(name: str, system: System, ports: StationPorts) -> Place | None:
    """Return where a system is drawn, or None for wiring that is part of the arrows."""
    robot = next((r for r in ports.plant.robots.values() if r.prefix and name.startswith(r.prefix)), None)
    owner = robot.name if robot else ""
    robot = robot or (ports.plant.robots[ports.config.only_robot] if ports.config.only_robot else None)
    if robot is not None:
        place = _robot_place(name, system, robot, owner, ports)
        if place is not None:
            return place if place.key else None
    return _shared_place(name, system, ports) or _wiring_place(name, system, owner)


_WIRE = Place("", "own")
"""Wiring of a robot."""


def _robot_place(name: str, system: System, robot: StationRobot, owner: str, ports: StationPorts) -> Place | None:
    """Return the place of a system that belongs to one robot: its reference, servos and poses."""
    local = name.removeprefix(robot.prefix)
    head, _, part = local.partition(".")
    if head == _SOURCE:
        label = "" if part else captions.reference_text(ports.config.reference_of(robot.name))
        return Place(f"{robot.prefix}{_SOURCE}", "reference", label, owner)
    if part and (head in robot.axes or head == _ALL_JOINTS):
        return _servo_place(name, head, system, robot, owner)
    if isinstance(system, FramePose):
        of_base = head == "base_pose"
        return Place(name, "sensor", "Base pose" if of_base else f"TCP pose\n{part}", owner)
    if local == "base_pose":
        return Place(name, "sensor", "Base pose\nfixed", owner)
    if isinstance(system, Propeller):
        return Place(name, "robot", f"External force\nat {robot.prefix}{robot.tcp}")
    return None


def _servo_place(name: str, head: str, system: System, robot: StationRobot, owner: str) -> Place | None:
    """Return the place of a servo's part; of many joints the ones between the first and the last share a block."""
    if isinstance(system, Multiplexer):
        return _WIRE
    between = robot.axes[1:-1]
    if head in between and len(robot.axes) > captions.MANY:
        return Place(f"{robot.prefix}more", "servo", f"⋮\n{len(between)} joints,\n{between[0]} to {between[-1]}", owner)
    count = len(robot.axes) if head == _ALL_JOINTS else 1
    who = f"{count} joints" if head == _ALL_JOINTS else head
    if isinstance(system, LinearSystem) and name.endswith(".integrator"):
        label = f"{who}: I\n{captions.integral_text(system, count)}"
        return Place(f"{robot.prefix}{head}.integral", "servo", label, owner)
    if isinstance(system, Saturation) and name.endswith(".integral_clip"):
        return Place(f"{robot.prefix}{head}.integral", "servo", captions.range_text(system, "N·m"), owner)
    if isinstance(system, MatrixGain) and name.endswith(".pd"):
        return Place(name, "servo", f"{who}: PD\n{captions.pd_text(system, count)}", owner)
    if isinstance(system, Saturation):
        return Place(name, "servo", f"Saturation\n{captions.range_text(system, 'N·m')}", owner)
    return None


def _shared_place(name: str, system: System, ports: StationPorts) -> Place | None:
    """Return the place of a system that all robots share, or that watches one."""
    config, robots = ports.config, list(ports.plant.robots.values())
    if name.startswith(f"{_STOPS}."):
        stops = config.joint_stops
        return Place(_STOPS, "robot", f"Joint stops\n{stops.stiffness:g} N·m/rad\n{stops.damping:g} N·m·s/rad")
    match system:
        case MultibodyPlant():
            return Place(name, "robot", captions.plant_text(system, config, robots))
        case SceneGraph():
            return Place(name, "scene", "Scene graph\nall geometry")
        case InverseDynamics():
            return Place(name, "robot", "\n".join(["Inverse dynamics", *map(captions.robot_text, robots)]))
        case MultibodyPositionToGeometryPose():
            return Place(name, "robot", "Geometry poses")
        case Monitor():
            label = name.removeprefix("monitor.")
            watched = getattr(config.monitors.get(label), "robot", None)
            return Place(name, "sensor", f"Monitor\n{label}", watched if watched and not config.only_robot else "")
    return None


def _wiring_place(name: str, system: System, owner: str) -> Place | None:
    """Return the place of a bus bar, of a sum or constant, or of a block that is the user's own."""
    if isinstance(system, _SILENT) or (isinstance(system, MatrixGain) and captions.is_mapping(system)):
        return None
    if isinstance(system, Multiplexer):
        return Place(name, "servo", "", owner, "mux")
    if isinstance(system, Selector):
        return Place(name, "servo", "", owner, "bus")
    if isinstance(system, Adder):
        return Place(name, "servo", "+", owner, "sum")
    if isinstance(system, ConstantVectorSource) and name.endswith(".zero"):
        return Place(name, "reference", "0", owner)
    return Place(name, "own", captions.plain_text(name, system))
