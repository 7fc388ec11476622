"""Where each system of a station's Diagram stands in its picture, and what its block says.

Systems are told apart by their types and by the names that the wiring functions give them; what none of the rules
knows is a user's own.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
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
    ZeroOrderHold,
)
from pydrake.systems.rendering import MultibodyPositionToGeometryPose

from simrob_drake.blocks.contacts import ContactReader
from simrob_drake.blocks.distance_sensor import DistanceSensor
from simrob_drake.blocks.events import EventTimes, SteadySteps
from simrob_drake.blocks.force_sensor import ForceSensor
from simrob_drake.blocks.frame_poses import FramePoses
from simrob_drake.blocks.joint_torque_sensor import JointTorqueSensor
from simrob_drake.blocks.momentum_observer import MomentumObserver
from simrob_drake.blocks.monitor import Monitor
from simrob_drake.results.block_diagram import captions
from simrob_drake.stations.ports import StationPorts
from simrob_drake.stations.robots import StationRobot

Role = Literal["reference", "servo", "robot", "scene", "sensor", "own"]
ROLES: tuple[Role, ...] = ("reference", "servo", "robot", "scene", "sensor", "own")
"""In the order of the signal flow."""

Shape = Literal["block", "mux", "bus", "port", "sum"]
"""Of them two are thin bars: a mux brings signals together, a bus hands them out."""

BARS: tuple[Shape, ...] = ("mux", "bus")

_SOURCE, _PUSHES, _STOPS, _ALL_JOINTS = "reference_source", "pushes", "stops", "servo"
_YIELDING, _MODEL_TORQUE = "yielding", "model_torque"
_SENSORS = {
    ForceSensor: "Force sensor",
    DistanceSensor: "Distance sensor",
    JointTorqueSensor: "Joint torques",
    MomentumObserver: "Momentum observer",
    ZeroOrderHold: "sampled",
}
_SILENT = (
    PassThrough,
    Demultiplexer,
    EventTimes,
    SteadySteps,
    ExternallyAppliedSpatialForceMultiplexer,
    ContactReader,
)


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
    robots = list(ports.plant.robots.values())
    robot = next((r for r in robots if name.startswith(r.prefix)), None)  # a station's only robot has no prefix
    owner = robot.name if robot is not None and robot.prefix else ""
    local = name.removeprefix(robot.prefix) if robot is not None else name
    rows = [*robot.axes, _ALL_JOINTS] if robot is not None else []
    if _is_wire(local, system, rows):
        return None
    place = _robot_place(name, local, system, robot, ports) if robot is not None else None
    place = place or _shared_place(name, system, ports) or _bar_place(name, system)
    if place is None:
        return Place(name, "own", captions.plain_text(name, system))
    return replace(place, robot=place.robot or owner) if place.role in ("reference", "servo", "sensor") else place


def _is_wire(local: str, system: System, rows: Sequence[str]) -> bool:
    """Tell whether a system only hands signals on; in a joint's row that includes what joins them."""
    head, _, part = local.partition(".")
    if isinstance(system, Multiplexer):
        return bool(part) and head in (*rows, _YIELDING, "felt_torque")
    if isinstance(system, MatrixGain):
        return part != "pd" and head != _STOPS and captions.is_mapping(system)
    return isinstance(system, _SILENT)


def _robot_place(name: str, local: str, system: System, robot: StationRobot, ports: StationPorts) -> Place | None:
    """Return the place of a system that belongs to one robot: its reference, servos and poses."""
    head, _, part = local.partition(".")
    if head == _SOURCE:
        label = "" if part else captions.reference_text(ports.config.reference_of(robot.name), robot.model)
        return Place(f"{robot.prefix}{_SOURCE}", "reference", label)
    if head == _PUSHES:
        pushes = ports.config.robots[robot.name].pushes
        text = "".join(f"\n{math.hypot(*push.force):.3g} N at {push.start:g} s" for push in pushes)
        return Place(f"{robot.prefix}{_PUSHES}", "robot", "" if part else f"Pushes on the base{text}")
    if part and (head in robot.axes or head == _ALL_JOINTS):
        return _servo_place(name, head, system, robot)
    if isinstance(system, Propeller):
        return Place(name, "robot", f"External force\nat {robot.prefix}{robot.tcp}")
    if isinstance(system, FramePoses) and local == "poses":
        return Place(name, "sensor", "Poses\n" + ", ".join(["base", *robot.tools]))
    return _force_place(name, local, robot, ports)


def _force_place(name: str, local: str, robot: StationRobot, ports: StationPorts) -> Place | None:
    """Return the place of an external force, and of what lets servos give in to it."""
    head, _, part = local.partition(".")
    if head == "external_force" and part:
        label = "" if "." in part else captions.force_text(ports.config.external_force)
        return Place(f"{robot.prefix}{head}.source", "reference", label)
    if head == _YIELDING:
        gain = ports.config.servo_of(robot.name).yield_gain
        return Place(name, "servo", f"Yielding\nintegrator, {gain:g} 1/s")
    if head == _MODEL_TORQUE:
        label = "" if part else "Torque of the model\nat this speed"
        return Place(f"{robot.prefix}{head}", "servo", label)
    return None


def _servo_place(name: str, head: str, system: System, robot: StationRobot) -> Place | None:
    """Return the place of a servo's part; of many joints the ones between the first and the last share a block."""
    between = robot.axes[1:-1]
    if head in between and len(robot.axes) > captions.MANY:
        return Place(f"{robot.prefix}more", "servo", f"⋮\n{len(between)} joints,\n{between[0]} to {between[-1]}")
    count = len(robot.axes) if head == _ALL_JOINTS else 1
    who, key = f"{count} joints" if head == _ALL_JOINTS else head, name
    efforts = robot.model.effort_units
    units = efforts if head == _ALL_JOINTS else [efforts[robot.axes.index(head)]]
    match system, name.rsplit(".", 1)[-1]:
        case MatrixGain(), "pd":
            label = f"{who}: PD\n{captions.pd_text(system, count)}"
        case LinearSystem(), "integrator":
            key, label = f"{robot.prefix}{head}.integral", f"{who}: I\n{captions.integral_text(system, count)}"
        case Saturation(), "integral_clip":
            key, label = f"{robot.prefix}{head}.integral", captions.range_text(system, units)
        case Saturation(), _:
            label = f"Saturation\n{captions.range_text(system, units)}"
        case _:
            return None
    return Place(key, "servo", label)


def _shared_place(name: str, system: System, ports: StationPorts) -> Place | None:
    """Return the place of a system that all robots share, or that watches one."""
    config, robots = ports.config, list(ports.plant.robots.values())
    stops = config.joint_stops
    match system:
        case _ if name.startswith(f"{_STOPS}."):
            label = captions.stops_text(stops, robots)
            place = Place(_STOPS, "robot", label)
        case MultibodyPlant():
            place = Place(name, "robot", captions.plant_text(system, config, robots))
        case InverseDynamics():
            place = Place(name, "robot", "\n".join(["Inverse dynamics", *map(captions.robot_text, robots)]))
        case MultibodyPositionToGeometryPose():
            place = Place(name, "robot", "Geometry poses")
        case SceneGraph():
            place = Place(name, "scene", "Scene graph\nall geometry")
        case FramePoses():
            place = Place(name, "sensor", captions.wrapped(f"Poses of {', '.join(ports.plant.free_pieces)}"))
        case _ if name.startswith("sensor.") and type(system) in _SENSORS:
            sensor = name.split(".")[1]
            kind = _SENSORS[type(system)]
            label = kind if isinstance(system, ZeroOrderHold) else f"{kind}\n{sensor}"
            place = Place(f"sensor.{sensor}", "sensor", label)
        case Monitor() if name.removeprefix("monitor.") in config.monitors:
            monitor = name.removeprefix("monitor.")
            watched = config.monitors[monitor].robot if not config.only_robot else None
            place = Place(name, "sensor", f"Monitor\n{monitor}", watched or "")
        case _:
            return None
    return place


def _bar_place(name: str, system: System) -> Place | None:
    """Return the place of a thin bar, a sum or a constant; a bar takes the role of its many ends later."""
    if isinstance(system, Multiplexer):
        return Place(name, "servo", shape="mux")
    if isinstance(system, Selector):
        return Place(name, "servo", shape="bus")
    if isinstance(system, Adder):
        return Place(name, "servo", "+", shape="sum")
    if isinstance(system, ConstantVectorSource) and name.endswith(".zero"):
        return Place(name, "reference", "0")
    return None
