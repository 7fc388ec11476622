"""Drivers of scenarios and servos of stations."""

from collections.abc import Mapping
from typing import Any

from simrob_drake.base.messages import message
from simrob_drake.extensions.drake_scenes.tagged import Tagged
from simrob_drake.parts.resolved import ResolvedRobot
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
                "drake_scenes.no_cascade", "{robot}: no driver is a cascade; its gains are of one loop", robot=name
            )
            remarks.append(text)
        if (robot.gains.ki > 0).any() and servo.law != "computed_torque":
            remarks.append(
                message("drake_scenes.no_integral", "{robot}: JointStiffnessDriver has no integral part", robot=name)
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
