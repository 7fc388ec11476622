"""The multibody plant of a station: its robots, pieces and floor.

A *resolved* station is its configuration with the robots and pieces that it names. In a *dynamic* station forces move
the robots, in a *kinematic* one a given motion does (``engine.moves_by_forces`` is False). The *engine* is what moves a
station: usually Drake's plant with one of Drake's solvers, or a block of an extension that *stands in* for the plant.
The *scope* is a prefix of the names of model instances, by which several stations in one plant differ. A piece is
*carried* if it is mounted on a robot, directly or through other pieces; it is *free* if nothing holds it.
"""

import logging
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple, TypeAlias
from xml.etree.ElementTree import Element

import numpy as np
from pydrake.geometry import (
    AddCompliantHydroelasticProperties,
    AddRigidHydroelasticProperties,
    Box,
    CollisionFilterDeclaration,
    GeometryId,
    HalfSpace,
    ProximityProperties,
    Role,
    SceneGraph,
)
from pydrake.math import RigidTransform
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import (
    AddMultibodyPlant,
    CoulombFriction,
    MultibodyPlant,
    MultibodyPlantConfig,
)
from pydrake.multibody.tree import (
    FixedOffsetFrame,
    JointActuatorIndex,
    ModelInstanceIndex,
    RigidBody,
)
from pydrake.systems.framework import DiagramBuilder

from simrob_drake.base.errors import InvalidModel, InvalidParameter, SimrobError
from simrob_drake.base.frames import transform_from_pose
from simrob_drake.base.messages import message
from simrob_drake.blocks.passive_joints import set_friction
from simrob_drake.blocks.servo import set_actuators
from simrob_drake.parts.resolved import WORLD, ResolvedRobot
from simrob_drake.parts.station_plant import StationPlant, StationRobot
from simrob_drake.parts.targets import FLOOR
from simrob_drake.robots.feet import put_on_feet
from simrob_drake.robots.motors import add_play
from simrob_drake.robots.parse import add_urdf
from simrob_drake.robots.pieces import FRICTION, TCP, add_piece, piece_robot
from simrob_drake.robots.urdf import scale_masses, with_absolute_meshes
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.contact import apply_materials, check_stiffnesses, needs_shapes
from simrob_drake.stations.contact_points import (
    ContactPoints,
    add_contact_points,
    filter_contact_points,
)
from simrob_drake.stations.other_engine import add_plant_block, other_engine
from simrob_drake.stations.prescribed import set_rotors
from simrob_drake.stations.resolve import ResolvedStation
from simrob_drake.stations.solver_config import ContactConfig

_NEEDLESS = re.compile("deformable contact|does not handle joint limits for continuous models")
"""Warnings of Drake: a station has no deformable bodies, and its joints have stops of its own."""

logging.getLogger("drake").addFilter(lambda record: not _NEEDLESS.search(record.getMessage()))

_FLOOR_COLOUR = np.array([0.82, 0.84, 0.86, 1.0])
_SOFT_COLOUR = np.array([0.62, 0.48, 0.36, 1.0])

_SHADE = 0.2
"""The highest boxes of a terrain are lighter by this fraction, the lowest ones have the floor's colour."""

_FLOOR_THICKNESS = 0.02
"""Thickness of the slab that is drawn [m]. Contact is with a half-space."""

_FLOOR_STIFFNESS = 1e9
"""Stiffness of the floor in point contact [N/m]. Two surfaces are springs in series: the softer one, that of the body
on the floor, determines the contact."""

_FLOOR_FRICTION = CoulombFriction(FRICTION["mu_static"], FRICTION["mu_dynamic"])


ParserHook: TypeAlias = Callable[[Parser], object]
"""Callback of the user that may add models to a plant, or packages to its parser."""
BuilderHook: TypeAlias = Callable[[DiagramBuilder], object]
"""Callback of the user that may add systems to a diagram."""


class PlantHooks(NamedTuple):
    """Callbacks of the user while a plant is filled. Both get the same Parser of the plant."""

    parser_preload: ParserHook | None = None  # before the robots are added
    # After robots and pieces are added, before the plant is finalized.
    prefinalize: ParserHook | None = None

    @property
    def is_used(self) -> bool:
        """Whether there is any callback, so that the plant may have bodies of the user's own."""
        return self.parser_preload is not None or self.prefinalize is not None

    def preload(self, parser: Parser) -> None:
        """Call the callback that comes before the robots."""
        if self.parser_preload is not None:
            self.parser_preload(parser)

    def finish(self, parser: Parser) -> None:
        """Call the callback that comes before the plant is finalized."""
        if self.prefinalize is not None:
            self.prefinalize(parser)


def check_steps_plant(config: StationConfig) -> None:
    """Check that a station steps Drake's plant, so that bodies of the user's own in the plant move.

    Raises:
        SimrobError: the station is kinematic, or another engine stands in for the plant.
    """
    if not config.engine.moves_by_forces or other_engine(config) is not None:
        raise SimrobError(
            message(
                "stations.plant_not_stepped",
                "{station} cannot share a plant with bodies of your own: it is kinematic, or its solver ({solver}) "
                "does not step Drake's plant; call add_station(builder, station) alone",
                station=config.name,
                solver=config.solver.kind,
            )
        )


def add_plant(
    builder: DiagramBuilder,
    resolved: ResolvedStation,
    hooks: PlantHooks | None = None,
) -> StationPlant:
    """Add a station's scene graph and plant to a diagram.

    The plant stays outside of the diagram if the station is kinematic, or if another engine stands in for it.

    Args:
        builder: builder of the diagram.
        resolved: the station.
        hooks: callbacks that may add bodies to the plant; None if there are none.

    Returns:
        the station's finalized plant. Its attribute ``stand_in`` is the block of another engine, if there is one.

    Raises:
        SimrobError: a robot does not suit the mode of the station, the engine cannot simulate the station, a coupling
            does not hold at the start, or there are callbacks although nothing steps the plant.
    """
    hooks = PlantHooks() if hooks is None else hooks
    config = resolved.config
    # Bodies of the user's own would stand still in a plant that nothing steps.
    if hooks.is_used:
        check_steps_plant(config)
    # The engine that steps the station in place of Drake's plant, or None.
    engine_in_place = other_engine(config)
    if not config.engine.moves_by_forces or engine_in_place is not None:
        # A plant outside of the diagram only computes poses and masses: its time step 0 has no
        # effect.
        plant = MultibodyPlant(0.0)
        scene_graph = builder.AddNamedSystem("scene_graph", SceneGraph())
        plant.RegisterAsSourceForSceneGraph(scene_graph)
        plant.set_name("plant")
        plant.mutable_gravity_field().set_gravity_vector(np.array([0.0, 0.0, -config.gravity]))
    else:
        plant, scene_graph = add_empty_plant(builder, config)
    if hooks.is_used:
        # One parser for both callbacks, as it remembers the packages that the first one names.
        parser = Parser(plant)
        hooks.preload(parser)
        models = add_models(plant, scene_graph, resolved, floor=True, is_shared=True)
        hooks.finish(parser)
    else:
        models = add_models(plant, scene_graph, resolved, floor=True)
    # Bodies, joints and actuators can be added until here only; collision filters and defaults come after.
    plant.Finalize()
    station = complete_plant(models)
    # Flat shapes touch by contact points. Filters exclude the pairs of whole shapes that these points replace.
    replaced = filter_contact_points(scene_graph, models.points)
    station = replace(station, replaced_pairs=tuple(replaced))
    if engine_in_place is None:
        return station
    return replace(station, stand_in=add_plant_block(builder, engine_in_place, resolved, station))


def add_empty_plant(
    builder: DiagramBuilder, config: StationConfig
) -> tuple[MultibodyPlant, SceneGraph]:
    """Add a plant without bodies and its scene graph to a diagram, with the settings of a station.

    These are the time step, the contact model, the approximation of contact if the solver is discrete, and gravity. The
    systems are named ``plant`` and ``scene_graph``.
    """
    engine = config.engine
    settings = MultibodyPlantConfig(
        time_step=engine.time_step,
        contact_model=config.contact.model if config.contact else "point",
    )
    if engine.has_discrete_states:
        # Schemes of the discrete solver have Drake's names of the approximation.
        settings.discrete_contact_approximation = engine.name
        # Otherwise signals could not be evaluated again from a recorded state.
        settings.use_sampled_output_ports = False
    plant, scene_graph = AddMultibodyPlant(settings, builder)
    plant.set_name("plant")
    scene_graph.set_name("scene_graph")
    plant.mutable_gravity_field().set_gravity_vector(np.array([0.0, 0.0, -config.gravity]))
    return plant, scene_graph


@dataclass(frozen=True)
class StationModels:
    """The robots, pieces and floor of a station in a plant that may not be finalized yet.

    Attributes:
        resolved: the station.
        plant: the plant with the station's robots and pieces.
        shapes: collision shapes of the station, with its contact points.
        points: its contact points.
    """

    resolved: ResolvedStation
    plant: StationPlant
    shapes: Sequence[GeometryId]
    points: ContactPoints


def add_models(
    plant: MultibodyPlant,
    scene_graph: SceneGraph,
    resolved: ResolvedStation,
    *,
    floor: bool,
    is_shared: bool = False,
) -> StationModels:
    """Add the robots and pieces of a station to a plant that is not finalized, and the floor if `floor` is True.

    Couplings are added as well, but not in a kinematic station. The shapes of the station get their contact materials.
    In point contact, flat shapes of bodies that move freely, and of those on which they may lie, get *contact points*:
    small balls at their corners, at which they touch others.

    Args:
        plant: the plant. It may contain other bodies.
        scene_graph: the scene graph with which the plant is registered.
        resolved: the station.
        floor: whether to add the floor that the station may have.
        is_shared: whether the plant may contain bodies of the user's own.

    Returns:
        the models, for :func:`complete_plant` after the plant has been finalized.

    Raises:
        SimrobError: a robot does not suit the mode of the station, or a value does not suit its solver.
    """
    config = resolved.config
    engine = config.engine
    # Without collision shapes, the plant never asks the scene graph: a fifth less work.
    collision = needs_shapes(config)
    # The plant may have shapes of the user's own, whose materials are not changed.
    inspector = scene_graph.model_inspector()
    shapes_before = set(inspector.GetAllGeometryIds(Role.kProximity))

    def own_shapes() -> list[GeometryId]:
        """Collision shapes that this station has added so far."""
        return [
            shape
            for shape in inspector.GetAllGeometryIds(Role.kProximity)
            if shape not in shapes_before
        ]

    robots = {
        name: add_robot(plant, resolved, robot, collision=collision)
        for name, robot in resolved.robots.items()
    }
    free_pieces = _add_standing_pieces(plant, resolved, collision)
    if floor:
        _add_floor(plant, resolved, collision)
    # After all bodies: the weight of the heaviest free body is the load by which the radii of all balls are chosen.
    points = add_contact_points(plant, scene_graph, resolved, [*robots.values()], own_shapes())
    shapes_with_points = own_shapes()  # the contact points are shapes, too
    # Before the plant is finalized, which makes filters that a later change of roles would lose.
    apply_materials(plant, scene_graph, resolved, shapes_with_points)
    station = StationPlant(
        plant,
        scene_graph,
        robots,
        free_pieces,
        resolved.ground,
        contact_points=frozenset(points.balls),
        holds_constraints=engine.constrains_in_plant,
        scope=resolved.scope,
        is_shared=is_shared,
    )
    # Constraints and springs act only in a plant that is stepped.
    for coupling in config.couplings.values() if engine.moves_by_forces else ():
        coupling.add(station)
    return StationModels(resolved, station, shapes_with_points, points)


def complete_plant(models: StationModels) -> StationPlant:
    """Set what a station can set only after its plant is finalized, and check couplings and contact stiffnesses.

    It sets the initial posture, heavy rotors of joints whose motion is prescribed, and collision filters.

    Args:
        models: the station's robots and pieces.

    Returns:
        the station's plant, the one in ``models``.

    Raises:
        SimrobError: a coupling does not hold at the start, or the solver cannot hold a contact.
    """
    resolved = models.resolved
    config = resolved.config
    station = models.plant
    plant = station.plant
    for robot in station.robots.values():
        for joint, sign, angle in zip(
            robot.joints, robot.axis_map.signs, robot.initial, strict=True
        ):
            # The default positions are those of every context that is created from now on.
            joint.set_default_positions(np.array([sign * angle]))
    # After the positions of all robots: the inertias of the rotors follow from the mass matrix at the start.
    for robot in station.robots.values():
        set_rotors(plant, robot.joints, robot)
    if config.couplings:
        start = plant.CreateDefaultContext()
        for name, coupling in config.couplings.items():
            coupling.check_start(f"couplings.{name}", station, start)
    check_stiffnesses(plant, station.scene_graph, resolved, models.shapes)
    _filter_collisions(station, config.contact)
    return station


def _add_standing_pieces(
    plant: MultibodyPlant,
    station: ResolvedStation,
    collision: bool,
) -> dict[str, RigidBody]:
    """Add the pieces that no robot carries: free pieces at their initial poses, and others, which are welded in place.

    Args:
        plant: the plant, which is not finalized.
        station: the station.
        collision: whether the pieces get collision shapes.

    Returns:
        the bodies of the free pieces among them, by name.
    """
    instances: dict[str, ModelInstanceIndex] = {}  # of the pieces that were added, by name
    free: dict[str, RigidBody] = {}
    # Each piece comes after its parent, so that the parent's frame exists.
    for name, piece in station.pieces.items():
        if piece.carrier == WORLD:
            robot = piece_robot(name, piece.model)
            instance = add_urdf(
                plant,
                robot,
                name=f"{station.scope}{name}",
                where=f"pieces.{name}",
                collision=collision,
            )
            if piece.free:
                free[name] = plant.GetBodyByName(name, instance)
                plant.SetDefaultFloatingBaseBodyPose(free[name], piece.pose)
            else:
                # A piece on the world has no parent in the plant.
                parent = instances.get(piece.parent)
                mount = plant.GetFrameByName(piece.mount, parent) if parent else plant.world_frame()
                plant.WeldFrames(mount, plant.GetFrameByName(name, instance), piece.pose)
            instances[name] = instance
    return free


def _add_floor(plant: MultibodyPlant, station: ResolvedStation, collision: bool) -> None:
    """Add the floor of a station, if it has one: a half-space, or the boxes of its terrain.

    Args:
        plant: the plant, which is not finalized.
        station: the station.
        collision: whether the floor gets a collision shape. Otherwise it is only visible.
    """
    config = station.config
    floor_pose = station.ground.floor_pose
    if config.floor is None:
        return
    terrain = config.floor.terrain
    if terrain is None:
        # The picture shows a slab, contact is with a half-space: it has no edges over which a body
        # could fall.
        slab = Box(config.floor.size, config.floor.size, _FLOOR_THICKNESS)
        below = RigidTransform(np.array([0.0, 0.0, -_FLOOR_THICKNESS / 2]))
        plant.RegisterVisualGeometry(
            plant.world_body(), floor_pose @ below, slab, FLOOR, _FLOOR_COLOUR
        )
        if collision:
            surface = _floor_surface(config, None)
            plant.RegisterCollisionGeometry(
                plant.world_body(), floor_pose, HalfSpace(), FLOOR, surface
            )
        return
    # With a terrain there is no half-space, though there may be level ground: Drake crashes when it copies a
    # half-space among many boxes.
    for number, block in enumerate(terrain.blocks(config.floor.size)):
        name = f"{FLOOR}.{number}"
        box = Box(*(2 * block.half))
        pose = floor_pose @ block.pose
        # Height of the upper face: half of the box over its centre.
        top = block.pose.translation()[2] + block.half[2]
        relative_height = top / terrain.height
        brightness = 1 + _SHADE * relative_height
        # Red, green and blue are brighter, the opacity stays. A block with a modulus is soft.
        colour = _SOFT_COLOUR if block.modulus else _FLOOR_COLOUR * ([brightness] * 3 + [1.0])
        plant.RegisterVisualGeometry(plant.world_body(), pose, box, name, np.clip(colour, 0.0, 1.0))
        if collision:
            surface = _floor_surface(config, block.modulus)
            plant.RegisterCollisionGeometry(plant.world_body(), pose, box, name, surface)


def _floor_surface(config: StationConfig, modulus: float | None) -> ProximityProperties:
    """Create the contact properties of a floor: hydroelastic ones if the station's contact needs them, and friction.

    `apply_materials` replaces friction and stiffness later if the section ``contact`` gives them.

    Args:
        config: the station.
        modulus: hydroelastic modulus of a soft floor [Pa], or None for a rigid floor.
    """
    surface = ProximityProperties()
    if config.contact is not None and config.contact.model != "point":
        # 1.0 is the length of edges into which round shapes are divided [m], which has no effect on planes and boxes.
        if modulus is None:
            # The floor is rigid: a compliant box on a compliant floor would fall back to points.
            AddRigidHydroelasticProperties(1.0, surface)
        else:
            AddCompliantHydroelasticProperties(1.0, modulus, surface)
    surface.AddProperty("material", "coulomb_friction", _FLOOR_FRICTION)
    surface.AddProperty("material", "point_contact_stiffness", _FLOOR_STIFFNESS)
    return surface


def _filter_collisions(station: StationPlant, contact: ContactConfig | None) -> None:
    """Exclude contact among the links and carried pieces of each robot or, with self-collision, only among its feet.

    Feet are excluded because their contact spheres may reach beyond the foot, even into the other foot.

    Args:
        station: the finalized plant.
        contact: section ``contact`` of the station, or None: then no contact is simulated, and nothing is excluded.
    """
    if contact is None:
        return
    for robot in station.robots.values():
        # The bodies among which contact is excluded: all of the robot, or its feet.
        bodies = [
            station.plant.get_body(index) for index in station.plant.GetBodyIndices(robot.instance)
        ]
        if contact.self_collision:
            feet = [] if robot.feet is None else robot.feet.links
            bodies = [station.plant.GetFrameByName(foot, robot.instance).body() for foot in feet]
        geometry = station.plant.CollectRegisteredGeometries(bodies)
        without_own_contact = CollisionFilterDeclaration().ExcludeWithin(geometry)
        station.scene_graph.collision_filter_manager().Apply(without_own_contact)


def add_robot(
    plant: MultibodyPlant,
    station: ResolvedStation,
    robot: ResolvedRobot,
    *,
    collision: bool,
) -> StationRobot:
    """Add a robot and the pieces that it carries to a plant that is not finalized.

    The robot gets its base, the frame of an offset tool and, in a dynamic station, what its actuators need: limits,
    gains and friction, as far as the solver realizes these in actuators.

    Args:
        plant: the plant.
        station: the station.
        robot: the robot.
        collision: whether it gets collision shapes.

    Returns:
        the robot with its joints and frames in the plant.

    Raises:
        InvalidModel: links that move have no inertia, though the station is dynamic.
        InvalidParameter: an axis has backlash, but its motor has no rotor inertia.
    """
    model = robot.model
    if station.engine.moves_by_forces and model.links_without_inertia:
        listed = ", ".join(model.links_without_inertia)
        remedy = message(
            "stations.kinematic_or_estimate",
            "set mode to kinematic, or {key}.import_options.estimate_inertia to true",
            key=station.config.robot_key(robot.name),
        )
        where = station.config.robots[robot.name].urdf or model.urdf_path
        problem = message(
            "stations.links_without_inertia",
            "the moving links {links} have no inertia; {remedy}",
            links=listed,
            remedy=remedy,
        )
        raise InvalidModel(where, "", problem)
    urdf = urdf_with_pieces(station, robot)
    scale_masses(urdf, station.config.robots[robot.name].mass_factors)
    if station.engine.moves_by_forces:
        # Play is the backlash of an axis: its link may move by so much while its motor stands still.
        joint_names = [axis.joint for axis in model.axes.values()]
        add_play(urdf, dict(zip(joint_names, model.play.tolist(), strict=True)))
    name_in_plant = f"{station.scope}{robot.name}"
    instance = add_urdf(plant, urdf, name=name_in_plant, where=model.urdf_path, collision=collision)
    # A free base gets an initial pose, a fixed one a weld to the world.
    root = plant.GetFrameByName(model.root, instance)
    if robot.floats:
        plant.SetDefaultFloatingBaseBodyPose(root.body(), robot.base)
    else:
        plant.WeldFrames(plant.world_frame(), root, robot.base)
    tools = {
        tool: plant.GetFrameByName(frame, instance) for tool, frame in robot.tool_frames.items()
    }
    # The tool in use, or the frame at an offset from it, which then is a tool of its own.
    tcp = robot.tcp
    if robot.tcp_offset is not None and tcp:
        pose = transform_from_pose(robot.tcp_offset)
        offset = FixedOffsetFrame(f"{robot.name}_tcp_offset", tools[tcp], pose, instance)
        tools[TCP] = plant.AddFrame(offset)
        tcp = TCP
    joints = [plant.GetJointByName(axis.joint, instance) for axis in model.axes.values()]
    if station.engine.moves_by_forces:
        # All actuators that the plant has so far, also those of other robots.
        actuators = [
            plant.get_joint_actuator(JointActuatorIndex(index))
            for index in range(plant.num_actuators())
        ]
        # Joints whose motor has a rotor with inertia. Within the play the motor turns its rotor alone: without inertia
        # its acceleration would be infinite.
        with_rotor = {
            actuator.joint().index()
            for actuator in actuators
            if actuator.default_reflected_inertia() > 0
        }
        for axis, joint, play in zip(robot.axes, joints, robot.model.play, strict=True):
            if play > 0 and joint.index() not in with_rotor:
                expected = message(
                    "stations.zero_or_rotor_inertia",
                    "0, or {axis} must have a rotor_inertia, since its motor moves only its rotor within the backlash",
                    axis=axis,
                )
                key = f"robots.{robot.name}.drives.backlash_deg"
                found = message("stations.given_for", "given for {axis}", axis=axis)
                raise InvalidParameter(key, found, expected)
        implicit = station.config.servo_of(robot.name).realization == "implicit"
        # Limits and gains of actuators can be set before the plant is finalized only.
        if implicit or station.engine.limits_torques_in_actuators:
            set_actuators(
                plant, [joint.index() for joint in joints], robot.gains, with_servos=implicit
            )
        if station.engine.puts_friction_in_actuators:
            set_friction(plant, joints, model.friction, model.drives.friction_speed)
    # The robot in the plant has all properties of the resolved one, but for the tool of the offset.
    own = {**vars(robot), "tcp": tcp}
    return StationRobot(
        **own, plant=plant, instance=instance, joints=joints, root=root, tools=tools
    )


def urdf_with_pieces(station: ResolvedStation, robot: ResolvedRobot) -> Element:
    """URDF of a robot with its contact feet and the pieces that it carries. Its mesh names are absolute."""
    element = with_absolute_meshes(robot.model.element, robot.model.folder)
    if robot.feet is not None:
        put_on_feet(element, robot.feet)
    for name in robot.carried:
        piece = station.pieces[name]
        # Carried pieces become links of the robot, so that its model has their masses.
        add_piece(element, name=name, piece=piece.model, parent=piece.mount, pose=piece.pose)
    return element
