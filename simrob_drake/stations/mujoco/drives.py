"""Servos, forces, dry friction and joint stops of a station, as MJCF has them."""

from __future__ import annotations

import mujoco
import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Frame, JointActuatorIndex

from simrob_drake.frames import Vector
from simrob_drake.parts.site import StationRobot
from simrob_drake.stations.mujoco.names import Names

_POSITION = mujoco.mjtCtrlInput.mjINPUT_POS


def add_servos(spec: mujoco.MjSpec, robot: StationRobot, names: Names) -> None:
    """Add a robot's servos, one actuator an axis in its sense: the control is its reference [rad or m].

    With an integral part it is a PID whose integral is clamped.
    """
    gains = robot.gains
    for axis, joint, sign, kp, ki, kd, limit, most in zip(
        robot.axes,
        robot.joints,
        robot.axis_map.signs,
        gains.kp,
        gains.ki,
        gains.kd,
        gains.torque_limit,
        gains.integral_limit,
        strict=True,
    ):
        servo = spec.add_actuator(
            name=f"{robot.prefix}{axis}",
            trntype=mujoco.mjtTrn.mjTRN_JOINT,
            target=names.joint(joint),
            gear=[float(sign), 0, 0, 0, 0, 0],
        )
        if np.isfinite(limit):
            servo.forcelimited, servo.forcerange = mujoco.mjtLimited.mjLIMITED_TRUE, [-limit, limit]
        if ki > 0:
            servo.set_to_pid(kp=float(kp), kv=float(kd), ki=float(ki), imax=float(most / ki), ctrlspec=_POSITION)
        else:
            servo.set_to_position(kp=float(kp), kv=float(kd))


def add_motors(spec: mujoco.MjSpec, plant: MultibodyPlant, names: Names) -> None:
    """Add a servo for each motor of a plant that has gains, under the motor's number, and without a limit."""
    for number in range(plant.num_actuators()):
        motor = plant.get_joint_actuator(JointActuatorIndex(number))
        if motor.has_controller():
            gains, joint = motor.get_controller_gains(), names.joint(motor.joint())
            servo = spec.add_actuator(name=str(number), trntype=mujoco.mjtTrn.mjTRN_JOINT, target=joint)
            servo.set_to_position(kp=gains.p, kv=gains.d)


def add_force(spec: mujoco.MjSpec, frame: Frame, point: Vector, *, name: str, names: Names) -> None:
    """Add a force in a frame's axes, at a point (3,) [m] in it: three actuators, whose controls are its parts [N]."""
    add_site(spec, frame, name=name, names=names, point=point)
    for axis, along in zip("xyz", np.eye(3).tolist(), strict=True):
        spec.add_actuator(name=f"{name}.{axis}", trntype=mujoco.mjtTrn.mjTRN_SITE, target=name, gear=[*along, 0, 0, 0])


def add_site(
    spec: mujoco.MjSpec, frame: Frame, *, name: str, names: Names, point: Vector | None = None
) -> mujoco.MjsSite:
    """Add a frame of the plant, moved to a point (3,) [m] in it."""
    body, pose = frame.body(), frame.GetFixedPoseInBodyFrame()
    onto = spec.worldbody if body.index() == 0 else spec.body(names.body(body))
    at = pose.translation() if point is None else pose @ point
    return onto.add_site(name=name, pos=at, quat=pose.rotation().ToQuaternion().wxyz(), group=4)
