"""Contact materials of a station: write them into the shapes of its plant, and check that its solver can hold them.

A material is the stiffness, dissipation, friction and hydroelastic modulus of a surface. The section ``contact`` of a
station gives one material for all shapes; a piece may replace some of its values. The last functions add the friction
inside of the robots' joints, which Drake's plants do not simulate.

In *point* contact two shapes touch at single points, in *hydroelastic* contact over surfaces. The *modulus* is the
pressure by which a hydroelastic shape resists; a *rigid* shape has none, a *compliant* one has. A robot has n axes; its
*axis map* converts between values of the axes and of the whole plant. The *engine* of a station is what moves it.
"""

import math
from collections.abc import Sequence
from itertools import combinations

import numpy as np
from pydrake.geometry import (
    AddCompliantHydroelasticProperties,
    Capsule,
    Cylinder,
    Ellipsoid,
    GeometryId,
    ProximityProperties,
    Role,
    RoleAssign,
    SceneGraph,
    SceneGraphInspector,
    Shape,
    Sphere,
)
from pydrake.multibody.plant import CoulombFriction, MultibodyPlant
from pydrake.multibody.tree import RigidBody
from pydrake.systems.framework import DiagramBuilder, OutputPort
from pydrake.systems.primitives import ConstantVectorSource, Saturation

from simrob_drake.base.errors import InvalidParameter
from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import compound, join_texts, message
from simrob_drake.blocks.block import add_and_connect, add_matrix_gain, add_sum
from simrob_drake.parts.station_plant import StationRobot
from simrob_drake.parts.targets import FLOOR, piece_of_shape
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.ports import StationPorts
from simrob_drake.stations.resolve import ResolvedStation
from simrob_drake.stations.solver_config import (
    ContactConfig,
    ContactMaterial,
    SolverConfig,
)

_MOST_FACES = 20_000
"""Largest count of faces into which the round shapes of a station are divided. 33 000 faces of one ball take Drake 3 s,
131 000 take 12 s and 0.2 GB."""
# Shortest step of an error-controlled scheme that is worth waiting for [s].
_FINEST_STEP = 1e-5
_STABLE = 2.5
"""Largest stable product of step and angular frequency of a damped spring, for a third-order Runge-Kutta scheme. For a
spring without damping it is below 1.7."""
_STEPS_A_CONTACT = 10  # fixed steps that a scheme needs during one contact
# The limit of sap's contact stiffness, see `largest_stiffness`: a measured factor, and Drake's relaxation time [s].
_SAP_FACTOR = 3.3
_SAP_RELAXATION = 0.1

MODULUS = 1e7  # hydroelastic modulus [Pa] where none is given: stiff rubber


def needs_shapes(config: StationConfig) -> bool:
    """Whether a plant needs collision shapes: for contact, or in a kinematic station for sensors that measure them."""
    measures_shapes = any(sensor.measures_shapes for sensor in config.sensors.values())
    return config.contact is not None or (not config.engine.moves_by_forces and measures_shapes)


def apply_materials(
    plant: MultibodyPlant,
    scene_graph: SceneGraph,
    station: ResolvedStation,
    shapes: Sequence[GeometryId],
) -> None:
    """Write stiffness, dissipation, friction and modulus into the shapes of a station, before its plant is finalized.

    The plant also gets the speed up to which contacts stick. The modulus is written only for shapes that touch over
    surfaces. Values that neither the station nor a piece gives stay as they are in the shape. Without a section
    ``contact`` nothing is written.

    Finalizing makes the collision filters between neighbouring links, and a shape would lose them if its material were
    written later.

    Args:
        plant: the plant, not finalized.
        scene_graph: the scene graph of the plant.
        station: the station.
        shapes: collision shapes of the station.

    Raises:
        InvalidParameter: the resolution is too fine, or a piece has the contact model ``point``, which only the
            station's models ``point`` and ``hydroelastic_with_fallback`` allow.
    """
    config = station.config
    contact = config.contact
    if contact is None:
        return
    plant.set_stiction_tolerance(contact.stiction_speed)
    source = plant.get_source_id()
    assert source is not None  # add_plant registers the plant
    inspector = scene_graph.model_inspector()
    # Point contact uses the shapes as they are, without dividing them.
    if contact.model != "point":
        _check_resolution(contact.resolution, [inspector.GetShape(shape) for shape in shapes])
    # Shape by shape, since a piece may have a material of its own.
    for shape in shapes:
        piece = piece_of_shape(station, inspector, shape)
        contact_of_piece = config.pieces[piece].contact if piece else None
        touches_at_points = contact_of_piece is not None and contact_of_piece.model == "point"
        if touches_at_points and contact.model == "hydroelastic":
            expected = message(
                "stations.hydroelastic_with_fallback",
                "hydroelastic_with_fallback, since a piece has contact.model point",
            )
            raise InvalidParameter("contact.model", contact.model, expected)
        material = _material(config, contact, piece)
        if inspector.GetName(shape).startswith(f"{FLOOR}."):
            # Boxes of a soft terrain have a modulus already, which that of the station must not replace.
            material = material.model_copy(update={"hydroelastic_modulus": None})
        # A copy of what the robot's file gives: values that the station does not give stay.
        properties = ProximityProperties(inspector.GetProximityProperties(shape))
        _write_material(properties, material)
        if contact.model != "point" and not touches_at_points:
            _write_modulus(properties, material, contact)
        scene_graph.AssignRole(source, shape, properties, RoleAssign.kReplace)


def _check_resolution(resolution: float, shapes: Sequence[Shape]) -> None:
    """Check that a resolution does not divide round shapes into more faces than a computer can hold.

    Drake divides the surfaces of balls, ellipsoids and capsules, and the rims of cylinders; others it leaves whole.

    Args:
        resolution: length of the edges into which Drake divides shapes [m].
        shapes: all collision shapes of the station.

    Raises:
        InvalidParameter: the resolution is too fine; the message gives one that is not.
    """
    area = 0.0  # of surfaces that are divided [m²]
    rim_length = 0.0  # of rims that are divided [m]
    for shape in shapes:
        if isinstance(shape, Cylinder):
            rim_length += 2 * np.pi * shape.radius()
        elif isinstance(shape, (Sphere, Capsule)):
            length = shape.length() if isinstance(shape, Capsule) else 0.0
            # Sphere: 4 pi r² = 2 pi r (2 r); the mantle of a capsule adds 2 pi r l.
            area += 2 * np.pi * shape.radius() * (2 * shape.radius() + length)
        elif isinstance(shape, Ellipsoid):
            # The sphere around the ellipsoid has a larger area, so that the bound is on the safe side.
            area += 4 * np.pi * max(shape.a(), shape.b(), shape.c()) ** 2
    # Edges of the length h divide the surfaces into about area / h² faces, and the rims into length / h. With at most N
    # faces, surfaces alone allow h = sqrt(area / N), and rims alone h = length / N. The sum of the two is enough for
    # both together, and only a little more than needed.
    finest = float(np.sqrt(area / _MOST_FACES) + rim_length / _MOST_FACES)
    if resolution < finest:
        # Two digits, rounded up: the value that the message gives must not be refused.
        place = 10.0 ** (math.floor(math.log10(finest)) - 1)
        finest = math.ceil(finest / place) * place
        expected = message(
            "stations.coarser_resolution",
            "{finest:.2g} m or more, since a finer resolution divides the shapes of this station into "
            "too many faces",
            finest=finest,
        )
        raise InvalidParameter(
            "contact.resolution", compound("{resolution:g} m", resolution=resolution), expected
        )


def check_stiffnesses(
    plant: MultibodyPlant,
    scene_graph: SceneGraph,
    station: ResolvedStation,
    shapes: Sequence[GeometryId],
) -> None:
    """Check that the solver of a station can hold the contacts of its bodies.

    Only stiffnesses that the station or one of its pieces gives are checked, and only at bodies that can move. A
    station without contact forces passes.

    Args:
        plant: the finalized plant.
        scene_graph: the scene graph of the plant.
        station: the station.
        shapes: collision shapes of the station.

    Raises:
        InvalidParameter: a stiffness is too large; the message gives the largest one that the solver can hold.
    """
    config = station.config
    if config.contact is None or not config.engine.moves_by_forces:
        return
    inspector = scene_graph.model_inspector()
    for shape in shapes:
        body = plant.GetBodyFromFrameId(inspector.GetFrameId(shape))
        material = _material(config, config.contact, piece_of_shape(station, inspector, shape))
        stiffness = material.stiffness
        # A body that cannot move has no oscillation that a step could miss.
        if stiffness is not None and not plant.IsAnchored(body):
            _check_stiffness(config.solver, body, stiffness)


def pairs_without_surface(plant: MultibodyPlant, inspector: SceneGraphInspector) -> list[str]:
    """Find the pairs of bodies that cannot meet in a hydroelastic surface, since both are rigid.

    Returns a text for each pair, such as "table and cube", in alphabetical order.
    """
    rigid = [
        shape
        for shape in inspector.GetAllGeometryIds(Role.kProximity)
        if _is_rigid(inspector, shape)
    ]
    pairs = set()
    for first, second in combinations(rigid, 2):
        bodies = [
            plant.GetBodyFromFrameId(inspector.GetFrameId(shape)) for shape in (first, second)
        ]
        # Two bodies that cannot move do not fall into each other.
        is_fixed = all(plant.IsAnchored(body) for body in bodies)
        if not is_fixed and not inspector.CollisionFiltered(first, second):
            names = sorted(body.scoped_name().get_full() for body in bodies)
            pairs.add(join_texts(names, message("base.and", " and ")))
    return sorted(pairs)


def _is_rigid(inspector: SceneGraphInspector, shape: GeometryId) -> bool:
    """Whether a shape is rigid in hydroelastic contact: it takes part, but has no modulus."""
    properties = inspector.GetProximityProperties(shape)
    if not _is_hydroelastic(properties):
        return False
    return not properties.HasProperty("hydroelastic", "hydroelastic_modulus")


def _is_hydroelastic(properties: ProximityProperties) -> bool:
    """Whether a shape with these properties takes part in hydroelastic contact."""
    return bool(
        properties.HasGroup("hydroelastic")
        and properties.HasProperty("hydroelastic", "compliance_type")
    )


def _material(
    config: StationConfig,
    contact: ContactConfig,
    piece: str | None,
) -> ContactMaterial:
    """Combine the material of a station with the values that a piece replaces.

    Args:
        config: the station, with the sections of its pieces.
        contact: section ``contact`` of the station.
        piece: name of the piece, or None for a robot or the floor, which have the material of the station.
    """
    own = config.pieces[piece].contact if piece else None
    # None means that the piece does not give a value, so the station's stays.
    replaced = {} if own is None else own.model_dump(exclude_none=True, exclude={"model"})
    shared = contact.model_dump(include=set(ContactMaterial.model_fields), exclude_none=True)
    return ContactMaterial.model_validate({**shared, **replaced})


def _write_material(properties: ProximityProperties, material: ContactMaterial) -> None:
    """Write stiffness, dissipation and friction into the properties of a shape, except values that are None.

    Drake combines the stiffnesses of two shapes like springs in series. So two shapes with twice the stiffness make a
    contact with the stiffness that the user gives.
    """
    if material.stiffness is not None:
        # In series, 1/k = 1/(2 k1) + 1/(2 k2): for k1 = k2 this is k = k1.
        properties.UpdateProperty("material", "point_contact_stiffness", 2 * material.stiffness)
    if material.dissipation is not None:
        properties.UpdateProperty("material", "hunt_crossley_dissipation", material.dissipation)
    if material.friction is not None:
        friction = CoulombFriction(material.friction.static, material.friction.dynamic)
        properties.UpdateProperty("material", "coulomb_friction", friction)


def _write_modulus(
    properties: ProximityProperties,
    material: ContactMaterial,
    contact: ContactConfig,
) -> None:
    """Write the hydroelastic modulus into the properties of a shape.

    A shape that is already rigid in hydroelastic contact, by the robot's file or as the floor, stays rigid. A compliant
    one of the file gets the modulus of the material, or keeps its own if the material gives none. Any other shape
    becomes compliant, with the modulus of the material, or MODULUS if the material gives none.

    Args:
        properties: properties of the shape, which are changed.
        material: material of the shape.
        contact: section ``contact`` of the station, for the size of the surface's facets.
    """
    if not _is_hydroelastic(properties):
        AddCompliantHydroelasticProperties(
            contact.resolution, material.hydroelastic_modulus or MODULUS, properties
        )
        return
    is_compliant = properties.HasProperty("hydroelastic", "hydroelastic_modulus")
    if material.hydroelastic_modulus is not None and is_compliant:
        properties.UpdateProperty(
            "hydroelastic", "hydroelastic_modulus", material.hydroelastic_modulus
        )


def largest_stiffness(solver: SolverConfig, mass: float) -> float:
    r"""Compute the largest contact stiffness [N/m] that a solver can hold; infinite if it holds any.

    * Error-controlled schemes follow any spring with steps that are short enough, :math:`h = 2.5 \sqrt{m/k}` for
      explicit ones at rest. Steps shorter than 10 µs are not worth waiting for, so :math:`k \le m\,(2.5/h)^2`.
    * Schemes of fixed steps need ten of them for a contact, which lasts :math:`\pi\sqrt{m/k}`.
    * ``sap`` never lets a contact be stiffer than :math:`k = 4\pi^2 m / (3.3\,h\,(h + 0.1\,\mathrm{s}))`, whatever it
      is told (measured within 5 % on a ball at rest, for steps of 1 and 5 ms): it would soften a stiffer one silently.
    * Engines that treat the spring implicitly, such as ``lagged`` and ``cenic``, hold any.

    Args:
        solver: the solver of the station.
        mass: mass m of the body in contact [kg].
    """
    engine = solver.engine
    if engine.softens_contacts:
        # The third case of the list above: k = 4 pi² m / (3.3 h (h + 0.1 s)).
        softened = (
            4 * np.pi**2 * mass / (_SAP_FACTOR * solver.step * (solver.step + _SAP_RELAXATION))
        )
        return float(softened)
    if engine.takes_any_contact_stiffness:
        return np.inf
    if engine.has_fixed_steps:
        # The second case: ten steps take at most pi sqrt(m/k), so k = m (pi / (10 h))².
        return float(mass * (np.pi / (_STEPS_A_CONTACT * solver.step)) ** 2)
    # The first case: k = m (2.5 / h)² for the shortest step that is worth waiting for.
    return mass * (_STABLE / _FINEST_STEP) ** 2


def _check_stiffness(solver: SolverConfig, body: RigidBody, stiffness: float) -> None:
    """Check that a solver can hold a body with a contact stiffness [N/m].

    Raises:
        InvalidParameter: the stiffness is too large.
    """
    largest = largest_stiffness(solver, body.default_mass())
    if stiffness > largest:
        # The message has the step of a discrete solver, and the kind of any other one.
        solver_text: str = solver.kind
        if solver.engine.has_discrete_states:
            solver_text = message("stations.steps_of", "steps of {step:g} s", step=solver.step)
        allowed = message(
            "stations.largest_stiffness",
            "at most {largest:.3g} N/m for {body} ({mass:.3g} kg) with the solver",
            largest=largest,
            body=body.name(),
            mass=body.default_mass(),
        )
        expected = compound(
            "{allowed} {engine}, {step}",
            allowed=allowed,
            engine=solver.engine.name,
            step=solver_text,
        )
        raise InvalidParameter("contact.stiffness", stiffness, expected)


def wire_friction(builder: DiagramBuilder, ports: StationPorts) -> None:
    """Add the Coulomb friction of the robots' joints to the diagram of a station.

    There are three cases:

    * An engine that computes friction itself, such as one of an extension, needs nothing, and nothing is added.
    * With the solver ``cenic`` friction is computed by blocks, since its actuators hold one torque for each joint, that
      of the motor.
    * Otherwise the plant has an actuator for the friction of each joint that has any: a servo without stiffness whose
      torque limit is the friction, and which pulls the joint to rest. Its desired state, zero, is connected here,
      unless the robot's servos have the realization ``implicit``. Then the servos are actuators, too, and the one port
      for the desired state of all actuators of the robot is connected already, with the speed zero for friction.

    ``cenic`` linearises the forces of blocks at the start of a step h. Friction c that reverses a joint's motion within
    a step would reverse it again in the next one, and so on. So the speed v_s above which friction is constant is at
    least c h / M, with the inertia M of the axis if all other axes are free.
    """
    config = ports.config
    engine = config.engine
    if engine.has_friction_of_joints:
        return
    for robot in ports.plant.robots.values():
        friction = robot.model.friction  # of the n axes [N·m or N]
        if not friction.any():
            continue
        if not engine.puts_friction_in_actuators:
            # v_s >= c h / M, so that friction does not reverse the motion within a step.
            slowest = friction * config.solver.step / robot.free_inertias()
            speed = np.maximum(robot.model.drives.friction_speed, slowest)
            sliding = _sliding(builder, ports, robot, speed)
            # Friction acts against the motion: from the n axes to the generalized forces of the plant, with a minus.
            to_plant = -robot.axis_map.velocity_matrix.T
            ports.generalized_forces.append(
                add_matrix_gain(builder, f"{robot.prefix}friction.force", to_plant, sliding)
            )
        elif config.servo_of(robot.name).realization != "implicit":
            desired_state = ports.plant.plant.get_desired_state_input_port(robot.instance)
            rest = ConstantVectorSource(np.zeros(desired_state.size()))
            builder.Connect(add_and_connect(builder, f"{robot.prefix}rest", rest), desired_state)
            ports.picture.draw_nothing(f"{robot.prefix}rest")


def with_friction(
    builder: DiagramBuilder,
    ports: StationPorts,
    robot: StationRobot,
    torque: OutputPort,
    *,
    axes: Sequence[int] | None = None,
) -> OutputPort:
    """Add the torques that overcome Coulomb friction to computed torques that lack them.

    The sum is what the motors give: the signal ``torque`` of the robot in the results. Torques lack friction if they
    come from the inverse dynamics of a kinematic station, from the actuators of a discrete solver, or from the
    reaction forces of joints. With a discrete solver, friction is one more actuator of each joint that has friction
    (see :func:`wire_friction`), so the sum over a joint's actuators is the motor's torque minus friction.

    Args:
        builder: builder of the station's diagram, to which blocks are added.
        ports: ports of the station; its plant's state drives the friction.
        robot: the robot.
        torque: output port with torques (n,) [N·m or N], which lack friction.
        axes: indices of the axes whose torques lack friction, such as those with a prescribed motion among axes with
            servos; None stands for all axes.

    Returns:
        output port with the sum, shape (n,) [N·m or N]; the given port if none of these axes has friction.
    """
    count = len(robot.axes)
    weights = np.ones(count)  # 1 for axes whose friction is added, else 0
    if axes is not None:
        weights = np.zeros(count)
        weights[list(axes)] = 1.0
    if not (weights * robot.model.friction).any():
        return torque
    # The speed above which friction is constant: that of the robot's drives.
    speeds = np.full(count, robot.model.drives.friction_speed)
    friction = _sliding(builder, ports, robot, speeds)
    if not weights.all():
        # A diagonal matrix of ones and zeros drops the friction of the other axes.
        friction = add_matrix_gain(
            builder, f"{robot.prefix}friction.counted", np.diag(weights), friction
        )
    return add_sum(builder, f"{robot.prefix}friction.torque", torque, friction)


def _sliding(
    builder: DiagramBuilder,
    ports: StationPorts,
    robot: StationRobot,
    speed: Vector,
) -> OutputPort:
    """Add a block for the Coulomb friction of a robot's axes: c sat(v / v_s), of the plant's state.

    Here c are the friction torques of the robot's model, v the speeds of its axes, and sat limits to -1 and 1.

    Args:
        builder: builder of the station's diagram.
        ports: ports of the station.
        robot: the robot.
        speed: speeds v_s above which friction is constant, shape (n,) [rad/s or m/s].

    Returns:
        output port with torques in the direction of the motion, shape (n,) [N·m or N].
    """
    name = f"{robot.prefix}friction"
    friction = robot.model.friction
    label = message("stations.block_friction", "Friction\nof {robot}", robot=robot.model.name)
    ports.picture.draw(name, "force", label, robot)
    # The lower half of the state matrix gives the speeds of the axes.
    speeds_of_state = robot.axis_map.state_matrix[len(friction) :]
    # c v / v_s, which the saturation limits to -c and c.
    slope = (friction / speed)[:, np.newaxis] * speeds_of_state
    unlimited = add_matrix_gain(builder, f"{name}.slope", slope, ports.state)
    return add_and_connect(builder, name, Saturation(-friction, friction), unlimited)
