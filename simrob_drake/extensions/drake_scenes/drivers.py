"""Drivers of scenarios and servos of stations."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from pydrake.manipulation import IiwaDriver, SchunkWsgDriver

from simrob_drake.base.messages import message
from simrob_drake.extensions.drake_scenes.plant_parts import Connection, PlantGroup
from simrob_drake.extensions.drake_scenes.scenario import (
    InverseDynamicsDriver,
    JointPidControllerGains,
    JointStiffnessDriver,
)
from simrob_drake.extensions.drake_scenes.tagged import Tagged
from simrob_drake.parts.resolved import ResolvedRobot
from simrob_drake.robots.imports import ImportReport
from simrob_drake.stations.config import StationConfig


def driver_entries(
    config: StationConfig, robots: Mapping[str, ResolvedRobot]
) -> tuple[dict[str, Tagged], list[str]]:
    """Make the section ``model_drivers`` of a scenario from the servos of a station.

    Args:
        config: the station.
        robots: its robots, resolved.

    Returns:
        the driver of each robot by its name, and remarks about what no driver expresses.
    """
    entries = dict[str, Tagged]()
    remarks = list[str]()
    for name, robot in robots.items():
        servo = config.servo_of(name)
        if robot.gains.passive.all():
            entries[name] = Tagged("ZeroForceDriver", {})
            continue
        entries[name] = _driver(robot, servo.law)
        if servo.law == "pid" and servo.feedforward == "none":
            text = message(
                "drake_scenes.driver_compensates",
                "{robot}: JointStiffnessDriver adds the torque against gravity, which the station's servos do not",
                robot=name,
            )
            remarks.append(text)
        if servo.law == "cascade":
            text = message(
                "drake_scenes.no_cascade",
                "{robot}: no driver is a cascade; its gains are of one loop",
                robot=name,
            )
            remarks.append(text)
        if (robot.gains.ki > 0).any() and servo.law != "computed_torque":
            remarks.append(
                message(
                    "drake_scenes.no_integral",
                    "{robot}: JointStiffnessDriver has no integral part",
                    robot=name,
                )
            )
    return entries, remarks


def _driver(robot: ResolvedRobot, law: str) -> Tagged:
    """Make the driver of a robot whose servos have a control law."""
    gains = robot.gains
    own = dict[str, dict[str, float]]()
    for index, axis in enumerate(robot.model.axes.values()):
        if gains.passive[index]:
            continue
        values = {"kp": float(gains.kp[index]), "kd": float(gains.kd[index])}
        if law == "computed_torque":
            values = {"kp": values["kp"], "ki": float(gains.ki[index]), "kd": values["kd"]}
        own[_actuator(robot, axis.joint)] = values
    kind = "InverseDynamicsDriver" if law == "computed_torque" else "JointStiffnessDriver"
    return Tagged(kind, {"gains": own})


def _actuator(robot: ResolvedRobot, joint: str) -> str:
    """Find the name of the actuator of a joint in the URDF of a robot."""
    for transmission in robot.model.element.iterfind("transmission"):
        driven = transmission.find("joint")
        actuator = transmission.find("actuator")
        if driven is not None and actuator is not None and driven.get("name") == joint:
            return actuator.get("name", joint)
    return joint


@dataclass
class DrivenRobot:
    """A robot of a scene, with what drives it.

    Attributes:
        group: the robot.
        drivers: driver of the model that each axis belongs to, by the name of the axis. None without a driver.
        first_kp: proportional gains for axes whose driver has none, by axis [N·m/rad or N/m].
        first_kd: derivative gains for these axes [N·m·s/rad or N·s/m].
        is_discrete: whether the scene has a time step.
    """

    group: PlantGroup
    drivers: Mapping[str, Any]
    first_kp: Mapping[str, float]
    first_kd: Mapping[str, float]
    is_discrete: bool


_IIWA_KP = 100.0
"""Proportional gain of Drake's SimIiwaDriver by default [1/s²]."""


def servo_section(robot: DrivenRobot, report: ImportReport) -> dict[str, Any]:
    """Make the section ``servo`` of a robot from the drivers of its models.

    Args:
        robot: the robot.
        report: record of what is changed.
    """
    driven = {joint.name: joint for joint in robot.group.moving_joints if joint.motor is not None}
    kinds = {type(robot.drivers[axis]).__name__ for axis in driven}
    compensates = bool(kinds & {"IiwaDriver", "InverseDynamicsDriver", "JointStiffnessDriver"})
    if kinds & {"IiwaDriver", "InverseDynamicsDriver"}:
        if len(driven) == len(robot.group.moving_joints):
            return _computed_torque(robot, driven, report)
        text = message(
            "drake_scenes.no_inverse_dynamics",
            "computed_torque needs a motor on every axis; gains times the inertia at the start, with the torque "
            "against gravity, take its place",
        )
        report.add("approximated", robot.group.name, text)
    kp, kd = dict[str, float](), dict[str, float]()
    for axis, joint in driven.items():
        kp[axis], kd[axis] = _spring_and_damper(robot, axis, joint)
    section: dict[str, Any] = {"kp": kp, "kd": kd}
    if robot.is_discrete:
        section["realization"] = (
            "implicit"  # the solver then takes the servos into account, as Drake's drivers do
        )
    if compensates and robot.group.is_free:
        text = message(
            "drake_scenes.no_gravity_torque",
            "the torque against gravity of its driver is left out: a robot that stands free has other forces, too",
        )
        report.add("approximated", robot.group.name, text)
    elif compensates:
        section["feedforward"] = "gravity"
    return section


def _spring_and_damper(robot: DrivenRobot, axis: str, joint: Connection) -> tuple[float, float]:
    """Find the gains of an axis: kp [N·m/rad or N/m] and kd [N·m·s/rad or N·s/m]."""
    driver = robot.drivers[axis]
    match driver:
        case JointStiffnessDriver():
            assert joint.motor is not None
            own = driver.gains.get(joint.motor.name)
            return (0.0, 0.0) if own is None else (float(own.kp), float(own.kd))
        case SchunkWsgDriver():
            return float(driver.pid_gains[0]), float(driver.pid_gains[2])
        case IiwaDriver() | InverseDynamicsDriver():
            stiffness, damping = _gains_per_inertia(robot, axis, joint)
            return stiffness * joint.inertia, damping * joint.inertia
        case _:
            return robot.first_kp[axis], robot.first_kd[axis]


def _gains_per_inertia(robot: DrivenRobot, axis: str, joint: Connection) -> tuple[float, float]:
    """Find the gains of an axis whose driver has inverse dynamics: kp [1/s²] and kd [1/s]."""
    driver = robot.drivers[axis]
    if isinstance(driver, IiwaDriver):
        desired = driver.desired_kp_gains
        same = [
            other.name for other in robot.group.moving_joints if robot.drivers[other.name] is driver
        ]
        kp = _IIWA_KP if desired is None else float(desired[same.index(axis)])
        return kp, 2 * math.sqrt(kp)  # critically damped
    assert joint.motor is not None
    own = driver.gains.get(joint.motor.name, JointPidControllerGains())
    return float(own.kp), float(own.kd)


def _computed_torque(
    robot: DrivenRobot, driven: Mapping[str, Connection], report: ImportReport
) -> dict[str, Any]:
    """Make the section ``servo`` of a robot of which a model has a driver with inverse dynamics.

    All axes of a robot have the same law, so gains of other drivers are divided by the inertia that the axis moves.

    Args:
        robot: the robot.
        driven: joints with a motor by the name of the axis.
        report: record of what is changed.
    """
    kp, kd = dict[str, float](), dict[str, float]()
    for axis, joint in driven.items():
        if isinstance(robot.drivers[axis], IiwaDriver | InverseDynamicsDriver):
            kp[axis], kd[axis] = _gains_per_inertia(robot, axis, joint)
            continue
        stiffness, damping = _spring_and_damper(robot, axis, joint)
        kp[axis], kd[axis] = stiffness / joint.inertia, damping / joint.inertia
        text = message(
            "drake_scenes.gains_by_inertia",
            "its gains are divided by its inertia: the servos of one robot have the same law, computed_torque",
        )
        report.add("approximated", axis, text)
    text = message(
        "drake_scenes.integral_left_out",
        "the integral gain of its driver is left out: the model of computed_torque takes its place",
    )
    report.add("approximated", robot.group.name, text)
    return {"law": "computed_torque", "kp": kp, "kd": kd}
