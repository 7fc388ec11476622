"""The multibody plant of a station: its robots, pieces and floor."""

from __future__ import annotations

from dataclasses import dataclass, field
from xml.etree.ElementTree import Element

import numpy as np
from pydrake.geometry import (
    AddRigidHydroelasticProperties,
    Box,
    CollisionFilterDeclaration,
    HalfSpace,
    ProximityProperties,
    SceneGraph,
)
from pydrake.math import RigidTransform
from pydrake.multibody.plant import (
    AddMultibodyPlant,
    ContactModel,
    CoulombFriction,
    DiscreteContactApproximation,
    MultibodyPlant,
    MultibodyPlantConfig,
)
from pydrake.multibody.tree import Frame, Joint, ModelInstanceIndex
from pydrake.systems.framework import DiagramBuilder

from simrob_drake.blocks.actuator_servo import set_actuator_gains
from simrob_drake.blocks.servo import ServoGains
from simrob_drake.errors import InvalidModel
from simrob_drake.frames import Vector, transform_from_pose
from simrob_drake.robots.catalog import RobotModel
from simrob_drake.robots.parse import add_urdf
from simrob_drake.robots.piece_urdf import FRICTION, add_piece, piece_robot
from simrob_drake.robots.urdf import with_absolute_meshes
from simrob_drake.stations.config import ContactConfig, ServoConfig, StationConfig
from simrob_drake.stations.names import (
    WORLD,
    carrier,
    initial_position,
    piece_model,
    piece_parent,
    pieces_outward,
    robot_model,
)
from simrob_drake.stations.solver_config import DiscreteSolver

_FLOOR_COLOUR = np.array([0.82, 0.84, 0.86, 1.0])
_FLOOR_THICKNESS = 0.02
_FLOOR_FRICTION = CoulombFriction(FRICTION["mu_static"], FRICTION["mu_dynamic"])


@dataclass
class StationRobot:
    """A robot in the plant of a station."""

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

    @property
    def axes(self) -> list[str]:
        """The names of the axes, in order."""
        return list(self.model.axes)


@dataclass
class StationPlant:
    """The plant of a station before it is wired."""

    plant: MultibodyPlant
    scene_graph: SceneGraph
    robots: dict[str, StationRobot]

    def state_map(self, robot: StationRobot) -> Vector:
        """Return the matrix (2n, nq + nv) that picks a robot's axis positions and velocities from the plant's state."""
        count, rows = len(robot.joints), np.arange(len(robot.joints))
        matrix = np.zeros((2 * count, self.plant.num_multibody_states()))
        matrix[rows, [joint.position_start() for joint in robot.joints]] = robot.signs
        velocities = [self.plant.num_positions() + joint.velocity_start() for joint in robot.joints]
        matrix[count + rows, velocities] = robot.signs
        return matrix

    def actuation_map(self, robot: StationRobot) -> Vector:
        """Return the matrix (actuators of the robot, n) that hands axis torques to the robot's actuators."""
        actuators = self.plant.GetJointActuatorIndices(robot.instance)
        joints = [self.plant.get_joint_actuator(index).joint().index() for index in actuators]
        matrix = np.zeros((len(joints), len(robot.joints)))
        for axis, joint in enumerate(robot.joints):
            matrix[joints.index(joint.index()), axis] = robot.signs[axis]
        return matrix


def add_plant(builder: DiagramBuilder, config: StationConfig, *, with_collision: bool | None = None) -> StationPlant:
    """Add a station's scene graph and its finalized plant, which stands in the diagram unless it is kinematic.

    Args:
        builder: the diagram under construction.
        config: the station.
        with_collision: parse collision geometry; unless given, where the station has contact. A plant without it
            never asks the scene graph for contacts, which makes a step a third cheaper.

    Raises:
        InvalidModel: a robot that cannot be simulated in this mode.
    """
    collision = config.contact is not None if with_collision is None else with_collision
    if config.mode == "kinematic":
        plant = MultibodyPlant(0.0)
        scene_graph = builder.AddNamedSystem("scene_graph", SceneGraph())
        plant.RegisterAsSourceForSceneGraph(scene_graph)
    else:
        time_step = config.solver.time_step if isinstance(config.solver, DiscreteSolver) else 0.0
        plant, scene_graph = AddMultibodyPlant(MultibodyPlantConfig(time_step=time_step), builder)
    plant.set_name("plant")
    scene_graph.set_name("scene_graph")
    plant.mutable_gravity_field().set_gravity_vector(np.array([0.0, 0.0, -config.gravity]))
    if isinstance(config.solver, DiscreteSolver) and config.mode == "dynamic":
        approximation = getattr(DiscreteContactApproximation, f"k{config.solver.scheme.capitalize()}")
        plant.set_discrete_contact_approximation(approximation)
        plant.SetUseSampledOutputPorts(False)  # so that signals can be evaluated again from a recorded state
    _set_contact_model(plant, config.contact)
    robots = {name: _add_robot(plant, config, name, collision) for name in config.robots}
    _add_standing_pieces(plant, config, collision)
    _add_floor(plant, config, collision)
    plant.Finalize()
    for robot in robots.values():
        for joint, sign, angle in zip(robot.joints, robot.signs, robot.initial, strict=True):
            joint.set_default_positions(np.array([sign * angle]))
    station = StationPlant(plant, scene_graph, robots)
    _filter_collisions(station, config.contact)
    return station


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


def _add_robot(plant: MultibodyPlant, config: StationConfig, name: str, collision: bool) -> StationRobot:
    entry, model, servo = config.robots[name], robot_model(config, name), config.servo_of(name)
    if config.mode == "dynamic" and model.links_without_inertia:
        listed = ", ".join(model.links_without_inertia)
        problem = f"the moving links {listed} have no inertia; only a kinematic station can take them"
        raise InvalidModel(model.urdf_path, "", problem)
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
        tcp=entry.tcp or list(tools)[-1 if carried else 0] if tools else "",
    )
    if servo.realization == "implicit" and config.mode == "dynamic":
        set_actuator_gains(plant, [joint.index() for joint in robot.joints], robot.gains)
    return robot


def _with_pieces(config: StationConfig, name: str, model: RobotModel, carried: list[str]) -> Element:
    """Return a robot's URDF with the pieces that it carries."""
    robot = with_absolute_meshes(model.element, model.folder)
    for piece in carried:
        parent = piece_parent(config, piece)
        mount = f"{parent}_tcp" if parent != name else next(iter(model.tools.values()), model.root)
        pose = transform_from_pose(config.pieces[piece].pose)
        add_piece(robot, name=piece, piece=piece_model(config, piece), parent=mount, pose=pose)
    return robot


def _add_standing_pieces(plant: MultibodyPlant, config: StationConfig, collision: bool) -> None:
    """Add the pieces that no robot carries."""
    tips = {WORLD: plant.world_frame()}
    for piece in pieces_outward(config):
        if carrier(config, piece) == WORLD:
            robot = piece_robot(piece, piece_model(config, piece))
            instance = add_urdf(plant, robot, name=piece, where=f"pieces.{piece}", collision=collision)
            pose = transform_from_pose(config.pieces[piece].pose)
            plant.WeldFrames(tips[piece_parent(config, piece)], plant.GetFrameByName(piece, instance), pose)
            tips[piece] = plant.GetFrameByName(f"{piece}_tcp", instance)


def _add_floor(plant: MultibodyPlant, config: StationConfig, collision: bool) -> None:
    if config.floor is None:
        return
    slab = Box(config.floor.size, config.floor.size, _FLOOR_THICKNESS)
    below = RigidTransform(np.array([0.0, 0.0, -_FLOOR_THICKNESS / 2]))
    plant.RegisterVisualGeometry(plant.world_body(), below, slab, "floor", _FLOOR_COLOUR)
    if collision:
        rigid = ProximityProperties()  # rigid: a compliant box on a compliant half space falls back to points
        AddRigidHydroelasticProperties(1.0, rigid)
        rigid.AddProperty("material", "coulomb_friction", _FLOOR_FRICTION)
        plant.RegisterCollisionGeometry(plant.world_body(), RigidTransform(), HalfSpace(), "floor", rigid)


def _set_contact_model(plant: MultibodyPlant, contact: ContactConfig | None) -> None:
    models = {
        "point": ContactModel.kPoint,
        "hydroelastic": ContactModel.kHydroelastic,
        "hydroelastic_with_fallback": ContactModel.kHydroelasticWithFallback,
    }
    plant.set_contact_model(models[contact.model if contact else "point"])


def _filter_collisions(station: StationPlant, contact: ContactConfig | None) -> None:
    """Let the links and pieces of one robot pass through each other, unless self-collision is asked."""
    if contact is None or contact.self_collision:
        return
    for robot in station.robots.values():
        bodies = [station.plant.get_body(index) for index in station.plant.GetBodyIndices(robot.instance)]
        geometry = station.plant.CollectRegisteredGeometries(bodies)
        station.scene_graph.collision_filter_manager().Apply(CollisionFilterDeclaration().ExcludeWithin(geometry))
