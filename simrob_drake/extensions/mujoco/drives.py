"""What moves a MuJoCo model, and what it tells: servos, forces and sensors of a station, as MJCF has them."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import mujoco
import numpy as np
from pydrake.geometry import GeometryId
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Frame, JointActuatorIndex

from simrob_drake.base.frames import Vector
from simrob_drake.extensions.mujoco.coordinates import Names
from simrob_drake.parts.resolved import StationContents
from simrob_drake.parts.sensors.shapes import Distance, Force
from simrob_drake.parts.station_plant import StationPlant, StationRobot
from simrob_drake.parts.targets import shapes_of
from simrob_drake.stations.poses import unit_poses

_POSITION = mujoco.mjtCtrlInput.mjINPUT_POS


def add_servos(spec: mujoco.MjSpec, robot: StationRobot, names: Names) -> None:
    """Add a robot's servos, one actuator an axis in its sense: the control is its reference [rad or m].

    With an integral part it is a PID whose integral is clamped. The line of a motor is the joint's damper, which the
    plant has, beside what is left of the servo. A passive axis has an actuator without any gain, whose force is always
    0: so controls and sensors stay one for each axis.
    """
    gains = robot.gains
    for axis, joint, sign, kp, ki, kd, limit, most in zip(
        robot.axes,
        robot.joints,
        robot.axis_map.signs,
        gains.kp,
        gains.ki,
        gains.kd - gains.damping,
        gains.actuator_limit,
        gains.integral_limit,
        strict=True,
    ):
        servo = spec.add_actuator(
            name=f"{robot.prefix}{axis}",
            trntype=mujoco.mjtTrn.mjTRN_JOINT,
            target=names.joint(joint),
            gear=[float(sign), 0, 0, 0, 0, 0],
        )
        if np.isfinite(limit) and limit > 0:
            servo.forcelimited, servo.forcerange = mujoco.mjtLimited.mjLIMITED_TRUE, [-limit, limit]
        if ki > 0:
            servo.set_to_pid(
                kp=float(kp), kv=float(kd), ki=float(ki), imax=float(most / ki), ctrlspec=_POSITION
            )
        else:
            servo.set_to_position(kp=float(kp), kv=float(kd))


def add_motors(spec: mujoco.MjSpec, plant: MultibodyPlant, names: Names) -> None:
    """Add a servo for each motor of a plant that has gains, under the motor's number, and without a limit."""
    for number in range(plant.num_actuators()):
        motor = plant.get_joint_actuator(JointActuatorIndex(number))
        if motor.has_controller():
            gains, joint = motor.get_controller_gains(), names.joint(motor.joint())
            servo = spec.add_actuator(
                name=str(number), trntype=mujoco.mjtTrn.mjTRN_JOINT, target=joint
            )
            servo.set_to_position(kp=gains.p, kv=gains.d)


def add_force(spec: mujoco.MjSpec, frame: Frame, point: Vector, *, name: str, names: Names) -> None:
    """Add a force in a frame's axes, at a point (3,) [m] in it: three actuators, whose controls are its parts [N]."""
    add_site(spec, frame, name=name, names=names, point=point)
    for axis, along in zip("xyz", np.eye(3).tolist(), strict=True):
        spec.add_actuator(
            name=f"{name}.{axis}",
            trntype=mujoco.mjtTrn.mjTRN_SITE,
            target=name,
            gear=[*along, 0, 0, 0],
        )


def add_site(
    spec: mujoco.MjSpec, frame: Frame, *, name: str, names: Names, point: Vector | None = None
) -> mujoco.MjsSite:
    """Add a frame of the plant, moved to a point (3,) [m] in it."""
    body, pose = frame.body(), frame.GetFixedPoseInBodyFrame()
    onto = spec.worldbody if body.index() == 0 else spec.body(names.body(body))
    at = pose.translation() if point is None else pose @ point
    return onto.add_site(name=name, pos=at, quat=pose.rotation().ToQuaternion().wxyz(), group=4)


_SENSES, _OBJECTS = mujoco.mjtSensor, mujoco.mjtObj
_FORCE_BIT, _NET = 1 << 1, 3  # of a contact sensor: the force alone, of all contacts together
_FAR = 1e3  # m, of distances


@dataclass(frozen=True)
class OutputSensors:
    """How the sensors of a model give an output."""

    names: tuple[str, ...]  # of the sensors, in order
    # how their values become the output's: ``row``, side by side; ``pose``, one whose quaternion has a sense; ``sum``
    # of vectors; ``least`` of numbers
    kind: Literal["row", "pose", "sum", "least"] = "row"
    damping: Vector | None = (
        None  # of dampers that brake beside servos: their speeds follow in a row, shape (n,)
    )

    def of(self, columns: Mapping[str, slice], data: Vector) -> Vector:
        """Return the output (m, size) of a model's sensor data (m, k)."""
        values = [data[:, columns[name]] for name in self.names]
        if self.kind == "sum":
            return np.asarray(sum(values))
        whole = np.hstack(values)
        if self.damping is not None:
            torque, speed = np.split(whole, 2, axis=1)
            return np.asarray(torque - self.damping * speed)
        if self.kind == "pose":
            return unit_poses(whole)
        return whole.min(axis=1, keepdims=True) if self.kind == "least" else whole


def add_sensors(
    spec: mujoco.MjSpec,
    station: StationContents,
    plant: StationPlant,
    names: Names,
    shapes: Mapping[GeometryId, str],
    *,
    moved_by_torque: bool = True,
) -> dict[str, OutputSensors]:
    """Add sensors for positions, velocities, torques, poses, and the station's sensors of force and distance.

    Returns the outputs that the model tells, by the names of the station's ports.
    """
    outputs: dict[str, OutputSensors] = {}
    for robot in plant.robots.values():
        if moved_by_torque:
            outputs |= _of_servos(spec, robot)
        frames = {
            "base_pose": robot.root,
            **{f"tcp_pose.{tool}": frame for tool, frame in robot.tools.items()},
        }
        for output, frame in frames.items():
            place = f"{robot.prefix}{output.removesuffix('_pose').removeprefix('tcp_pose.')}"
            add_site(spec, frame, name=place, names=names)
            outputs[f"{robot.prefix}{output}"] = _of_frame(spec, place, _OBJECTS.mjOBJ_SITE, place)
        if robot.tcp:
            outputs[f"{robot.prefix}tcp_pose"] = outputs[f"{robot.prefix}tcp_pose.{robot.tcp}"]
    for piece, body in plant.free_pieces.items():
        seen = spec, f"piece.{piece}", _OBJECTS.mjOBJ_XBODY, names.body(body)
        outputs |= {
            f"piece_pose.{piece}": _of_frame(*seen),
            f"piece_velocity.{piece}": _of_frame(*seen, "row"),
        }
    pairs = {(pair.geomname1, pair.geomname2) for pair in spec.pairs}
    for name, section in station.sensors.items():
        if isinstance(section, Force | Distance) and station.has_contact:
            own = [shapes.get(shape, "") for shape in shapes_of(plant, station, section.body)]
            others = list(shapes.values())
            if section.other is not None:
                others = [
                    shapes.get(shape, "") for shape in shapes_of(plant, station, section.other)
                ]
            found = [(a, b) for a in own for b in others if (a, b) in pairs or (b, a) in pairs]
            outputs |= _of_shapes(spec, section.kind, name, found)
    return outputs


def _of_servos(spec: mujoco.MjSpec, robot: StationRobot) -> dict[str, OutputSensors]:
    outputs = {}
    for output, column, sense in (
        ("position", "q", _SENSES.mjSENS_ACTUATORPOS),
        ("velocity", "v", _SENSES.mjSENS_ACTUATORVEL),
        ("torque", "tau", _SENSES.mjSENS_ACTUATORFRC),
    ):
        sensors = [f"{robot.prefix}{column}.{axis}" for axis in robot.axes]
        for name, axis in zip(sensors, robot.axes, strict=True):
            spec.add_sensor(
                name=name,
                type=sense,
                objtype=_OBJECTS.mjOBJ_ACTUATOR,
                objname=f"{robot.prefix}{axis}",
            )
        outputs[f"{robot.prefix}{output}"] = OutputSensors(tuple(sensors))
    if robot.gains.damping.any():
        torque, speed = (
            outputs[f"{robot.prefix}{output}"].names for output in ("torque", "velocity")
        )
        outputs[f"{robot.prefix}torque"] = OutputSensors(
            (*torque, *speed), damping=robot.gains.damping
        )
    return outputs


def _of_frame(
    spec: mujoco.MjSpec,
    name: str,
    objtype: mujoco.mjtObj,
    objname: str,
    kind: Literal["pose", "row"] = "pose",
) -> OutputSensors:
    """Add sensors of a frame's pose, or in a row of its linear and its angular velocity."""
    poses = {"position": _SENSES.mjSENS_FRAMEPOS, "quaternion": _SENSES.mjSENS_FRAMEQUAT}
    speeds = {
        "velocity": _SENSES.mjSENS_FRAMELINVEL,
        "angular_velocity": _SENSES.mjSENS_FRAMEANGVEL,
    }
    sensors = {
        f"{name}.{part}": sense for part, sense in (poses if kind == "pose" else speeds).items()
    }
    for sensor, sense in sensors.items():
        spec.add_sensor(name=sensor, type=sense, objtype=objtype, objname=objname)
    return OutputSensors(tuple(sensors), kind)


def _of_shapes(
    spec: mujoco.MjSpec, kind: str, name: str, pairs: list[tuple[str, str]]
) -> dict[str, OutputSensors]:
    """Add a sensor of force or distance as one for each pair of shapes that may touch."""
    sensors = tuple(f"{kind}.{name}.{number}" for number in range(len(pairs)))
    sense, geom = (
        _SENSES.mjSENS_CONTACT if kind == "force" else _SENSES.mjSENS_GEOMDIST,
        _OBJECTS.mjOBJ_GEOM,
    )
    for sensor, (own, other) in zip(
        sensors, pairs, strict=True
    ):  # MuJoCo tells the force on the second
        added = spec.add_sensor(
            name=sensor, type=sense, objtype=geom, objname=other, reftype=geom, refname=own
        )
        if kind == "force":
            added.intprm = np.resize([_FORCE_BIT, _NET, 1], len(added.intprm))
        else:
            added.cutoff = _FAR
    if not sensors:
        return {}
    return {f"{kind}.{name}": OutputSensors(sensors, "sum" if kind == "force" else "least")}
