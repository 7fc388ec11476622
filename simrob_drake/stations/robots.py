"""The robots of a station: what each is in the plant, and the pieces that it carries."""

from __future__ import annotations

from dataclasses import dataclass, field
from xml.etree.ElementTree import Element

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import FixedOffsetFrame, Frame, Joint, ModelInstanceIndex

from simrob_drake.blocks.actuator_servo import set_actuators
from simrob_drake.blocks.servo import ServoGains
from simrob_drake.errors import InvalidModel
from simrob_drake.frames import Vector, transform_from_pose
from simrob_drake.robots.catalog import RobotModel
from simrob_drake.robots.feet import FootContact, put_on_feet
from simrob_drake.robots.parse import add_urdf
from simrob_drake.robots.piece_urdf import add_piece
from simrob_drake.robots.pieces import TCP
from simrob_drake.robots.urdf import with_absolute_meshes
from simrob_drake.stations.config import ServoConfig, StationConfig
from simrob_drake.stations.names import (
    carrier,
    initial_position,
    parent_frame,
    piece_model,
    piece_parent,
    pieces_outward,
    robot_model,
)


@dataclass(frozen=True)
class StationRobot:
    """A robot in the plant of a station.

    Attributes:
        name, prefix: its key in the station, and what stands before the names of its ports.
        model: what it is.
        instance: its model instance in the plant.
        joints, signs: of the axes, in order, and their senses (n,).
        root: the frame of its root link.
        gains: of its servos.
        initial: where its axes are at the start of a station, shape (n,) [rad or m].
        tools: frames of tools and carried pieces by name; ``tcp`` is the one in use, empty without any.
        feet: what it stands on; None without.
    """

    name: str
    prefix: str
    model: RobotModel
    instance: ModelInstanceIndex
    joints: list[Joint]
    signs: Vector
    root: Frame
    gains: ServoGains
    initial: Vector
    tools: dict[str, Frame] = field(default_factory=dict)
    tcp: str = ""
    feet: FootContact | None = None

    @property
    def axes(self) -> list[str]:
        """The names of the axes, in order."""
        return list(self.model.axes)

    @property
    def places(self) -> list[int]:
        """Where the axes' positions stand among those of the plant, in order."""
        return [joint.position_start() for joint in self.joints]

    @property
    def speeds(self) -> list[int]:
        """Where the axes' velocities stand among those of the plant, in order."""
        return [joint.velocity_start() for joint in self.joints]

    def of_axes(self, values: Vector) -> Vector:
        """Return the axes' entries, shape (n,), of a vector over the plant's velocities, in the axes' sense."""
        return np.asarray(self.signs * values[self.speeds])


def add_robot(plant: MultibodyPlant, config: StationConfig, name: str, *, collision: bool) -> StationRobot:
    """Add one of a station's robots to its plant, with the pieces that it carries.

    Args:
        plant: not finalized, registered with a scene graph.
        config: the station.
        name: of the robot.
        collision: keep collision geometry.

    Raises:
        InvalidModel: a robot that cannot be simulated in the station's mode.
    """
    entry, model, servo = config.robots[name], robot_model(config, name), config.servo_of(name)
    if config.mode == "dynamic" and model.links_without_inertia:
        listed = ", ".join(model.links_without_inertia)
        remedy = "take mode: kinematic, or estimate them with robot.import_options.estimate_inertia: true"
        raise InvalidModel(entry.urdf or model.urdf_path, "", f"the moving links {listed} have no inertia; {remedy}")
    carried = [piece for piece in pieces_outward(config) if carrier(config, piece) == name]
    urdf = _with_pieces(config, name, model, carried)
    instance = add_urdf(plant, urdf, name=name, where=model.urdf_path, collision=collision)
    root = plant.GetFrameByName(model.root, instance)
    if model.base == "fixed" or config.mode == "kinematic":
        plant.WeldFrames(plant.world_frame(), root, transform_from_pose(entry.base))
    else:
        plant.SetDefaultFloatingBaseBodyPose(root.body(), transform_from_pose(entry.base))
    frames = {**model.tools, **{piece: f"{piece}_tcp" for piece in carried}}
    tools = {tool: plant.GetFrameByName(frame, instance) for tool, frame in frames.items()}
    tcp = entry.tcp or list(tools)[-1 if carried else 0] if tools else ""
    if entry.tcp_offset is not None and tcp:
        offset = FixedOffsetFrame(f"{name}_tcp_offset", tools[tcp], transform_from_pose(entry.tcp_offset), instance)
        tcp, tools[TCP] = TCP, plant.AddFrame(offset)
    robot = StationRobot(
        name=name,
        prefix=config.prefix(name),
        model=model,
        instance=instance,
        joints=[plant.GetJointByName(axis.joint, instance) for axis in model.axes.values()],
        signs=np.array([float(axis.sign) for axis in model.axes.values()]),
        root=root,
        gains=servo_gains(model, servo),
        initial=initial_position(config, name, model),
        tools=tools,
        tcp=tcp,
        feet=model.feet.kind(entry.feet) if model.feet else None,
    )
    implicit = servo.realization == "implicit"
    if config.mode == "dynamic" and (implicit or config.solver.scheme == "cenic"):
        set_actuators(plant, [joint.index() for joint in robot.joints], robot.gains, with_servos=implicit)
    return robot


def servo_gains(robot: RobotModel, servo: ServoConfig) -> ServoGains:
    """Return the figures of a robot's servos: the station's, else the robot's own, else the URDF's efforts."""
    efforts = robot.efforts

    def figures(key: str) -> Vector:
        own = getattr(robot.servo, key, None)
        base = robot.axis_vector(own, key) if own is not None else np.zeros(len(robot.axes))
        given = getattr(servo, key)
        return base if given is None else robot.axis_vector(given, f"servo.{key}", base)

    limit = efforts if servo.torque_limit is None else robot.axis_vector(servo.torque_limit, "torque_limit", efforts)
    integral = (
        limit if servo.integral_limit is None else robot.axis_vector(servo.integral_limit, "integral_limit", limit)
    )
    return ServoGains(figures("kp"), figures("ki"), figures("kd"), limit, integral)


def _with_pieces(config: StationConfig, name: str, model: RobotModel, carried: list[str]) -> Element:
    """Return a robot's URDF with the pieces that it carries."""
    robot = with_absolute_meshes(model.element, model.folder)
    if model.feet is not None:
        put_on_feet(robot, model.feet.kind(config.robots[name].feet))
    for piece in carried:
        parent, tool = piece_parent(config, piece), config.pieces[piece].frame
        flange = model.tools[tool] if tool in model.tools else next(iter(model.tools.values()), model.root)
        mount = flange if parent == name else parent_frame(config, piece)
        pose = transform_from_pose(config.pieces[piece].pose)
        add_piece(robot, name=piece, piece=piece_model(config, piece), parent=mount, pose=pose)
    return robot
